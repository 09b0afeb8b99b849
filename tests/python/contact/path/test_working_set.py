"""A working set of contacts grows, and gives the solution of all candidates."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support import comparisons
from support.bodies import Body, block
from support.comparisons import bits, solve_in_parts

# Both solutions satisfy the law to rounding. They may differ by the error of two W's with
# cond(S) below 1e3, and by η = 1e-13 over the smallest reaction that counts.
SAME = 1e-10


# In the plane the block is flat: what counts here is the number of its contacts.
HEIGHT = {2: 0.025, 3: 1.0}
# Closes some contacts, and less than a quarter of them.
DEPTH = {2: 0.005, 3: 0.02}


def indented(dim: int, cells: int, radius: float) -> tuple[Body, np.ndarray]:
    """A block over a rigid ball that touches it in the middle of its face."""
    sides = [1.0] * (dim - 1) + [HEIGHT[dim]]
    body = block(sides, [round(cells * side) for side in sides], 1.0, 0.3)
    away = ((body.points[:, :-1] - 0.5) ** 2).sum(axis=1)
    return body, away / (2 * radius)


def top(body: Body) -> np.ndarray:
    """Degrees of freedom of the face opposite to the contacts."""
    at = body.dim - 1, HEIGHT[body.dim]
    return np.concatenate([body.dofs(*at, k) for k in range(body.dim)])


def path(body: Body, fixed: np.ndarray, depth: float) -> np.ndarray:
    """Press, drag, lift a little."""
    dim = body.dim
    steps = np.zeros((3, len(fixed)))
    component = np.asarray(fixed) % dim
    steps[:, component == dim - 1] = -depth * np.array([[1.0], [1.0], [0.4]])
    steps[1:, component == 0] = depth / 3
    return steps


def held(dim: int, cells: int, radius: float = 1.0, depth: float = 0.0) -> Any:
    """Arguments of a block held at its top, and its prescribed displacements."""
    body, gap = indented(dim, cells, radius)
    fixed = top(body)
    given = {"K": body.K, "B": body.B, "gap": gap, "fixed": fixed}
    return given, {"prescribed": path(body, fixed, depth or DEPTH[dim])}


def loose(dim: int, cells: int) -> Any:
    """A body held by contact alone.

    In space, contacts are numbered row by row. The contacts that hold the body must not lie on
    a diagonal, about which only rounding would hold it.
    """
    body, gap = indented(dim, cells, radius=1.0)
    down = [0.0] * (dim - 1) + [-0.01]
    load = body.traction(dim - 1, HEIGHT[dim], down) + body.weight([0.001, *down[1:]])
    given = {"K": body.K, "B": body.B, "gap": gap}
    return given, {"load": np.array([load, 1.5 * load])}


def two_bodies() -> Any:
    """The lower body is the mirror image: its face in contact is the same line."""
    given, moved = held(2, 320)
    n, fixed = given["K"].shape[0], given["fixed"]
    given["K"] = sparse.block_diag([given["K"], 0.5 * given["K"]], format="csr")
    given["B"] = sparse.hstack([given["B"], -given["B"]], format="csr")
    given["fixed"] = np.concatenate([fixed, n + fixed])
    return given, {"prescribed": np.pad(moved["prescribed"], ((0, 0), (0, len(fixed))))}


def two_coefficients() -> Any:
    """In space, with friction that depends on the direction."""
    given, moved = held(3, 15)
    mu = np.random.default_rng(1).uniform(0.1, 0.5, (len(given["gap"]), 2))
    return given | {"mu": mu}, moved


# Nearly all contacts close under the large ball.
CASES = {
    "held": lambda: held(2, 320),
    "loose": lambda: loose(2, 320),
    "loose in space": lambda: loose(3, 14),
    "a large ball": lambda: held(2, 320, 50.0, 0.05),
    "two bodies": two_bodies,
    "in space, two coefficients": two_coefficients,
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.quick_variants("held", "two bodies")
def test_the_answer_of_all_candidates(name: str) -> None:
    given, loads = CASES[name]()
    grown, whole, threaded = (
        bp.ContactProblem(**{"mu": 0.4} | given, **more)
        for more in (
            {"working_set": True, "num_threads": 1},
            {"working_set": False},
            {"working_set": True, "num_threads": 2},
        )
    )
    assert grown.stats["working_set"] is not None
    assert whole.stats["working_set"] is None
    ours, theirs = (p.solve(**loads, tol=1e-13) for p in (grown, whole))
    assert np.array_equal(ours.status, theirs.status)
    assert all(step.residual <= step.tolerance for step in ours)
    for field in ("reaction", "relative_displacement", "slip", "displacement"):
        found, expected = getattr(ours, field), getattr(theirs, field)
        size = np.abs(expected).max()
        if name.startswith("loose") and field != "reaction":
            # The body moves by the gaps.
            size = max(size, given["gap"].max())
        np.testing.assert_allclose(found, expected, rtol=0, atol=SAME * size)
    closed = (theirs.status != 0).any(axis=0)
    if name == "a large ball":
        assert closed.all()
    elif not name.startswith("loose"):
        assert 5 < closed.sum() < len(closed) / 4
    # No contact outside the set penetrates, to rounding of the gaps.
    assert ours.relative_displacement[:, :, 0].min() >= -1e-15
    assert bits(threaded.solve(**loads, tol=1e-13), ours, FIELDS)


def test_the_gaps_choose_the_first_set() -> None:
    """A set is made for many contacts of which few are near."""
    for cells, scale, has_set in (
        (320, 1.0, True),
        (320, 0.0, False),
        (40, 1.0, False),
    ):
        given, _ = held(2, cells)
        problem = bp.ContactProblem(**given | {"gap": scale * given["gap"]}, mu=0.4)
        assert (problem.stats["working_set"] is not None) == has_set


def test_a_sliding_body_is_reported() -> None:
    body, gap = indented(2, 320, radius=1.0)
    pulled = body.weight([0.0, 1.0])
    for grow in (True, False):
        problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=0.4, working_set=grow)
        with pytest.raises(bp.NoEquilibriumError, match="nothing stops"):
            problem.solve(pulled)


FIELDS = (*comparisons.FIELDS, "working_set")


def rolling(dim: int) -> tuple[bp.ContactProblem, np.ndarray]:
    """A ball that rolls along the face of a block and drags it, and the gaps of its steps.

    Contacts that open again stay in the set, so the set cannot be found from a state alone.
    """
    cells, depth = ([320, 3], 2e-3) if dim == 2 else ([14, 14, 3], 2e-2)
    body = block([1.0] * dim, cells, 1.0, 0.3)
    fixed = np.concatenate([body.dofs(dim - 1, 1.0, k) for k in range(dim)])
    across = ((body.points[:, 1:-1] - 0.5) ** 2).sum(axis=1)
    away = [((body.points[:, 0] - x) ** 2 + across) / 2 for x in (0.3, 0.45, 0.6, 0.5)]
    problem = bp.ContactProblem(
        body.K, body.B, gap=away[0], mu=0.4, fixed=fixed, working_set=True
    )
    assert problem.stats["working_set"] is not None
    gaps = np.zeros((len(away), len(away[0]), dim))
    gaps[:, :, 0] = np.array(away) - depth
    gaps[:, :, 1] = -depth * np.array([[0.0], [1.0], [2.0], [1.5]])
    return problem, gaps


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow_variants("3")
def test_a_continued_path_has_the_same_bits(dim: int, tmp_path: Path) -> None:
    problem, gaps = rolling(dim)
    through = solve_in_parts(problem, tmp_path, FIELDS, gap=gaps)
    sets = [step.working_set for step in through]
    assert all(0 < len(s) < len(gaps[0]) for s in sets)
    # The set has more than the closed contacts and the first ones, so a state cannot give it.
    seeds = problem.stats["working_set"]
    assert len(sets[-1]) > seeds + (through.status[-1] > 0).sum()


def test_a_set_of_all_contacts_of_a_body_that_nothing_else_holds(
    tmp_path: Path,
) -> None:
    """The rigid motions involve unknowns outside the set, and are kept with it."""
    body = block([1.0, 1.0], [320, 3], 1.0, 0.3)
    gap = (body.points[:, 0] - 0.5) ** 2 / 100
    load = body.traction(1, 1.0, [0.0, -0.2]) + body.weight([0.01, 0.0])
    loads = np.outer([0.7, 1.0, 0.9], load)
    problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=0.4, working_set=True)
    through = solve_in_parts(problem, tmp_path, FIELDS, load=loads)
    assert through[0].working_set is not None
    assert len(through[0].working_set) == len(gap)
    assert through[0].working_motion is not None


def test_a_wrong_set_in_a_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    problem, gaps = rolling(2)
    step = problem.solve(gap=gaps[:1])
    count = len(gaps[0])
    for k, wrong in enumerate(([3, 3], [-1, 4], [0, count], [0.5])):
        name = tmp_path / f"{k}.h5"
        step.save(name)
        with h5py.File(name, "r+") as file:
            del file.attrs["sealed"]
            del file["steps/0000/working_set"]
            file["steps/0000/working_set"] = np.array(wrong)
        with pytest.raises(
            ValueError, match="working_set is wrong, expected ascending"
        ):
            bp.load(name)


def test_other_properties_with_a_working_set() -> None:
    """The dense W, the reduced problem and the error estimate, as without it."""
    given, loads = held(2, 320)
    made = [bp.ContactProblem(**given, mu=0.4, working_set=g) for g in (True, False)]
    moved = loads["prescribed"][1]
    grown, whole = (problem.reduced(prescribed=moved) for problem in made)
    # Both use one elimination, made when it is first needed.
    assert np.array_equal(np.asarray(grown.W), np.asarray(whole.W))
    assert np.array_equal(grown.q, whole.q)
    step = made[0].solve(prescribed=moved)[0]
    assert step.unique == "unknown"
    estimate = step.error_estimate
    assert estimate is not None
    assert max(estimate) < 1e-9  # η = 1e-10 and a well-conditioned W
    assert grown.residual(step.reaction) <= 1e-10
