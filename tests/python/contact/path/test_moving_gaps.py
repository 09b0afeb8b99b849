"""Gaps that change along the load path: obstacles that move."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.bodies import Body, block

TOL = 1e-13
# Two solutions with η = 1e-13 whose data differ by the rounding of sums.
SAME = 1e-10


@cache
def setup(dim: int) -> tuple[Body, Any, np.ndarray]:
    """A block held at its top over a plane that slopes away."""
    body = block([1.0] * dim, [5] * dim, 1.0, 0.3)
    fixed = np.concatenate([body.dofs(dim - 1, 1.0, k) for k in range(dim)])
    gap = 0.03 * np.abs(body.points[:, 0] - 0.4)
    return body, fixed, gap


def make(dim: int, mu: Any = 0.3, **more: Any) -> bp.ContactProblem:
    body, fixed, gap = setup(dim)
    return bp.ContactProblem(
        body.K, body.B, gap=gap, mu=mu, fixed=fixed, area=body.area, **more
    )


def wall(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Displacements of the obstacle, normal first ``(4, d)``, and the gaps that they give.

    The obstacle rises, moves aside, returns past its start, and sinks a little.
    """
    ways = np.zeros((4, dim))
    ways[:, 0] = [0.01, 0.01, 0.012, 0.006]
    ways[:, 1] = [0.0, 0.004, -0.003, -0.002]
    if dim == 3:
        ways[:, 2] = [0.0, 0.001, 0.003, 0.0]
    gap = setup(dim)[2]
    gaps = np.repeat(-ways[:, None], len(gap), axis=1)
    gaps[:, :, 0] += gap
    return ways, gaps


def as_supports(dim: int, ways: np.ndarray) -> np.ndarray:
    """Prescribed displacements of the top with the same effect on the body as the wall."""
    fixed = len(setup(dim)[1]) // dim
    in_axes = np.column_stack([ways[:, 1:], ways[:, 0]])
    return np.repeat(-in_axes, fixed, axis=1)


def close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=SAME * np.abs(expected).max()
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_moving_wall_equals_a_moving_body(dim: int) -> None:
    problem = make(dim)
    ways, gaps = wall(dim)
    moving = problem.solve(gap=gaps, tol=TOL)
    body = problem.solve(prescribed=as_supports(dim, ways), tol=TOL)
    assert {0, 1, 2} <= set(body.status.ravel().tolist())
    assert np.array_equal(moving.status, body.status)
    close(moving.reaction, body.reaction)
    close(moving.relative_displacement, body.relative_displacement)
    close(moving.slip, body.slip)
    # The two differ by the motion of the wall.
    shift = np.zeros((dim, len(ways)))
    shift[:-1], shift[-1] = ways[:, 1:].T, ways[:, 0]
    n = moving.displacement.shape[1] // dim
    close(moving.displacement - np.tile(shift.T, n), body.displacement)


def test_a_working_set_grows_by_contacts_that_a_step_closes() -> None:
    body = block([1.0, 1.0], [320, 4], 1.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    x = body.points[:, 0]
    start = 0.1 + (x - 0.2) ** 2 / 2
    # A roller passes by: each step closes other contacts.
    gaps = np.array([(x - c) ** 2 / 2 - 0.002 for c in (0.2, 0.5, 0.8)])
    results = []
    for grow in (True, False):
        problem = bp.ContactProblem(
            body.K, body.B, gap=start, mu=0.4, fixed=fixed, working_set=grow
        )
        assert (problem.stats["working_set"] is not None) == grow
        results.append(problem.solve(gap=gaps, tol=TOL))
    grown, whole = results
    assert np.array_equal(grown.status, whole.status)
    assert [x[s != 0].mean().round(1) for s in whole.status] == [0.2, 0.5, 0.8]
    # Cells with aspect ratio 80 cost both W's three digits more than SAME.
    for name in ("reaction", "relative_displacement"):
        expected = getattr(whole, name)
        within = 1e3 * SAME * np.abs(expected).max()
        assert np.abs(getattr(grown, name) - expected).max() <= within


@pytest.mark.parametrize("mu", [0.3, (0.3, 0.1)])
def test_the_gaps_of_the_problem_given_again_change_no_bit(mu: Any) -> None:
    dim = 2 if np.ndim(mu) == 0 else 3
    gap = setup(dim)[2]
    friction = mu if dim == 2 else np.tile(mu, (len(gap), 1))
    problem = make(dim, friction)
    prescribed = as_supports(dim, wall(dim)[0])
    without = problem.solve(prescribed=prescribed)
    with_gap = problem.solve(prescribed=prescribed, gap=gap)
    for name in ("reaction", "relative_displacement", "slip", "status", "displacement"):
        assert np.array_equal(getattr(without, name), getattr(with_gap, name))
    assert without[0].gap is None
    np.testing.assert_array_equal(with_gap[0].gap[:, 0], gap)


@pytest.mark.parametrize("mu", [0.3, (0.3, 0.1)])
def test_a_step_is_the_problem_with_its_gaps(mu: Any) -> None:
    """Each step solved again by a new problem with the gaps of that step."""
    dim = 2 if np.ndim(mu) == 0 else 3
    body, fixed, gap = setup(dim)
    friction = mu if dim == 2 else np.tile(mu, (len(gap), 1))
    problem = make(dim, friction)
    gaps = wall(dim)[1]
    path = problem.solve(gap=gaps, tol=TOL)
    before = None
    for k, step in enumerate(path):
        held_problem = bp.ContactProblem(
            body.K, body.B, gap=gaps[k], mu=friction, fixed=fixed, area=body.area
        )
        same = held_problem.solve(start=before, tol=TOL)[0]
        for name in ("reaction", "relative_displacement", "slip", "displacement"):
            value, expected = getattr(step, name), getattr(same, name)
            assert np.array_equal(value, expected), name
        assert step.unique == same.unique
        assert step.error.kind == same.error.kind
        if dim == 2:
            assert step.error_estimate == same.error_estimate
            assert step.error.energy == same.error.energy
        reduced = problem.reduced(start=before, gap=gaps[k])
        again = reduced.solve(tol=TOL)
        close(again.reaction, step.reaction)
        np.testing.assert_array_equal(reduced.q, held_problem.reduced(start=before).q)
        before = step


def test_friction_reverses_with_the_wall() -> None:
    """A wall rubs to and fro: friction reverses with it, and slip adds up."""
    problem = make(2)
    gap = setup(2)[2]
    there = np.zeros((4, len(gap), 2))
    there[:, :, 0] = gap - 0.03
    there[:, :, 1] = -np.array([0.0, 0.05, 0.1, 0.0])[:, None]
    result = problem.solve(gap=there, tol=TOL)
    pressed = result.reaction[:, :, 0] > 0
    drag = 0.3 * result.reaction[:, :, 0]
    # Far enough for all contacts to slide; the wall drags the body, then back.
    for k, sense in ((2, 1.0), (3, -1.0)):
        assert pressed[k].sum() >= 5
        np.testing.assert_allclose(result.reaction[k, :, 1], sense * drag[k], rtol=1e-9)
    total = result.slip.sum(axis=0)[:, 0]
    np.testing.assert_allclose(
        total, result.relative_displacement[-1, :, 1], rtol=1e-12
    )
    # Relative displacement is that of the body minus that of the wall.
    body = setup(2)[0]
    moved = (body.B @ result.displacement.T).T.reshape(4, -1, 2)
    close(result.relative_displacement, moved + there)


def test_continuing_from_a_step_gives_the_same_bits(tmp_path: Path) -> None:
    problem = make(3)
    gaps = wall(3)[1]
    whole = problem.solve(gap=gaps)
    first = problem.solve(gap=gaps[:2])
    first.save(tmp_path / "first.h5")
    read = bp.load(tmp_path / "first.h5")
    np.testing.assert_array_equal(read[1].gap, gaps[1])
    for start in (first, read):
        rest = problem.solve(gap=gaps[2:], start=start)
        assert np.array_equal(rest.reaction, whole.reaction[2:])
        assert np.array_equal(rest.slip, whole.slip[2:])


def test_paths_side_by_side_have_the_bits_of_one() -> None:
    problem = make(3)
    gaps = wall(3)[1]
    cases = [{"gap": gaps}, {"gap": gaps[:, :, 0], "mu": 0.6}, {"gap": gaps[::-1]}]
    alone = [
        problem.solve(gap=gaps),
        make(3, 0.6).solve(gap=gaps[:, :, 0]),
        problem.solve(gap=gaps[::-1]),
    ]
    for many, alone_result in zip(problem.solve_many(cases), alone, strict=True):
        assert many.success
        assert np.array_equal(many.reaction, alone_result.reaction)
        assert np.array_equal(many.slip, alone_result.slip)
        assert [step.unique for step in many] == [step.unique for step in alone_result]


def test_files_of_steps_hold_the_problem_of_the_step(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    problem = make(2)
    gaps = wall(2)[1]
    result = problem.solve(gap=gaps)
    paths = bp.fclib.write_path(tmp_path / "wall", problem, result)
    for path, step in zip(paths, result, strict=True):
        alone = bp.fclib.read(path)
        assert alone.residual(step.reaction) <= step.tolerance
        close(alone.solve().reaction, step.reaction)


def test_gaps_of_the_problem() -> None:
    body, fixed, gap = setup(2)
    moving = wall(2)[1]
    told = make(2).solve(gap=moving)
    arguments: Any = {"gap": gap, "mu": 0.3, "fixed": fixed, "area": body.area}
    solved = bp.solve(body.K, body.B, gaps=moving, **arguments)
    assert np.array_equal(solved.reaction, told.reaction)
    with pytest.raises(ValueError, match=r"gap has shape \(4, 5\), expected \(6,\)"):
        bp.solve(body.K, body.B, gaps=np.zeros((4, 5)), **arguments)


def test_loads_and_gaps_of_the_problem_continue_after_the_start(tmp_path: Path) -> None:
    ways, gaps = wall(2)
    prescribed = as_supports(2, 0.1 * ways[::-1])
    owned: list[dict[str, Any]] = [
        {"gaps": gaps},
        {"gaps": gaps, "loads": (None, prescribed)},
        {"gaps": gaps, "loads": (None, prescribed[:1])},
    ]
    for options in owned:
        moved = options.get("loads", (None, None))[1]
        told = [] if moved is None else list(np.broadcast_to(moved, prescribed.shape))
        problem = make(2, **options)
        whole = problem.solve()
        assert len(whole) == 4
        with_gaps = make(2)
        first = with_gaps.solve(prescribed=told[:2] or None, gap=gaps[:2])
        first.save(tmp_path / "first.h5")
        for start in (first, bp.load(tmp_path / "first.h5")):
            rest = problem.solve(start=start)
            assert np.array_equal(rest.reaction, whole.reaction[2:])
            assert np.array_equal(rest.slip, whole.slip[2:])
            (many,) = problem.solve_many([{"start": start}])
            assert np.array_equal(many.reaction, whole.reaction[2:])
        # A path in three parts numbers its steps from the first part on.
        third = with_gaps.solve(
            prescribed=told[2:3] or None, gap=gaps[2:3], start=first
        )
        third.save(tmp_path / "third.h5")
        for start in (third, bp.load(tmp_path / "third.h5")):
            last = problem.solve(start=start)
            assert np.array_equal(last.reaction, whole.reaction[3:])
        assert len(problem.solve(start=whole)) == 0
    # Arguments apply to the following steps only.
    loaded = make(2, gaps=gaps).solve(prescribed=prescribed)
    begun = make(2).solve(prescribed=prescribed[:2], gap=gaps[:2])
    rest = make(2, gaps=gaps).solve(prescribed=prescribed[2:], start=begun)
    assert np.array_equal(rest.reaction, loaded.reaction[2:])


def test_a_start_that_does_not_determine_the_next_step() -> None:
    ways, gaps = wall(2)
    prescribed = as_supports(2, ways)
    problem = make(2, gaps=gaps)
    whole = problem.solve()
    with pytest.raises(
        TypeError, match="start is a Step, expected a Result: its number"
    ):
        problem.solve(start=whole[1])
    with pytest.raises(TypeError, match="case 0: start is a Step"):
        problem.solve_many([{"start": whole[1]}])
    again = problem.solve(gap=gaps[2:], start=whole[1])
    assert np.array_equal(again.reaction, whole.reaction[2:])
    other = make(2).solve(gap=gaps[[1, 0]])
    with pytest.raises(
        ValueError, match="start ends with another gap than load step 2"
    ):
        problem.solve(start=other)
    with pytest.raises(
        ValueError, match=r"4 steps, and the loads or gaps .* have 4: give"
    ):
        problem.solve(prescribed=prescribed, start=whole)
    with pytest.raises(ValueError, match="load has 4 steps, expected 2"):
        problem.solve(prescribed=prescribed, start=make(2).solve(gap=gaps[:2]))
    loads = make(2, loads=(None, prescribed))
    with pytest.raises(ValueError, match="gaps has 4 steps but loads has 3"):
        make(2, gaps=gaps, loads=(None, prescribed[:3]))
    with pytest.raises(
        ValueError, match="start ends with another prescribed than load step 1"
    ):
        loads.solve(start=make(2).solve(prescribed=2 * prescribed[0]))


def test_a_single_row_of_loads_or_gaps_is_repeated() -> None:
    problem = make(2)
    prescribed = as_supports(2, wall(2)[0])
    gaps = wall(2)[1]
    moved = problem.solve(prescribed=prescribed[0], gap=gaps)
    spelled = problem.solve(prescribed=np.tile(prescribed[0], (4, 1)), gap=gaps)
    assert np.array_equal(moved.reaction, spelled.reaction)
    kept = problem.solve(prescribed=prescribed, gap=gaps[1:2])
    assert len(kept) == 4
    with_loads = make(2, loads=(None, prescribed))
    np.testing.assert_array_equal(
        with_loads.solve(gap=gaps).reaction,
        problem.solve(prescribed=prescribed, gap=gaps).reaction,
    )


@pytest.mark.parametrize(
    ("gap", "message"),
    [
        (np.zeros(5), r"gap has shape \(5,\), expected \(6,\), \(steps, 6\) or"),
        (np.zeros((3, 6, 3)), r"gap has shape \(3, 6, 3\)"),
        (
            np.zeros((3, 6)),
            "gap has 3 steps but the load path has 4: expected the same number",
        ),
        (np.full((4, 6), np.nan), r"gap is nan at \(0, 0\), expected finite numbers"),
    ],
)
def test_wrong_gaps(gap: np.ndarray, message: str) -> None:
    problem = make(2)
    prescribed = as_supports(2, wall(2)[0])
    with pytest.raises(ValueError, match=message):
        problem.solve(prescribed=prescribed, gap=gap)
    with pytest.raises(ValueError, match="case 0: gap"):
        problem.solve_many([{"prescribed": prescribed, "gap": gap}])


def test_a_gap_of_one_step() -> None:
    with pytest.raises(ValueError, match=r"gap has shape \(2, 6\), expected \(6,\) or"):
        make(2).reduced(gap=np.zeros((2, 6)))


def test_existence_uses_the_gaps_of_the_step() -> None:
    """A contact that cannot move has a solution if it is closed, none if it penetrates."""
    K, B = np.eye(2), np.eye(2)
    problem = bp.ContactProblem(K, B, gap=[0.1], mu=0.3, fixed=[0])
    assert problem.existence().verdict == "guaranteed"
    assert problem.existence(gap=[-0.1]).verdict == "none"
    with pytest.raises(
        bp.NoEquilibriumError, match="load step 2: contact 0 penetrates by 1"
    ):
        problem.solve(gap=[[0.1], [-0.1]])


def test_adaptive_steps() -> None:
    """Gaps as a function of s; steps that are not halved equal given load steps."""
    for dim in (2, 3):
        _, gaps = wall(dim)
        problem = make(dim)
        fixed = problem.solve(gap=gaps, tol=TOL)
        start = np.zeros_like(gaps[0])
        start[:, 0] = setup(dim)[2]

        def at(s: float, gaps: Any = gaps, start: Any = start) -> Any:
            gaps_with_start = np.concatenate([start[None], gaps])
            before = min(int(s), len(gaps) - 1)
            share = s - before
            if share == 1.0:
                return gaps_with_start[before + 1]
            return (1 - share) * gaps_with_start[before] + share * gaps_with_start[
                before + 1
            ]

        ends = np.arange(1.0, 5.0)
        followed = problem.follow(stops=ends, largest=1.0, gap=at, tol=TOL)
        assert followed.reaction.tobytes() == fixed.reaction.tobytes()
        assert followed.slip.tobytes() == fixed.slip.tobytes()
        # Halved steps use the gaps of their own s, and the path continues from there.
        most = 0.3 * float(np.abs(fixed.slip).max())
        divided = problem.follow(stops=ends, gap=at, slip=most, tol=TOL)
        assert len(divided) > 4
        again = problem.solve(gap=np.stack([at(s) for s in divided.s]), tol=TOL)
        assert divided.reaction.tobytes() == again.reaction.tobytes()
        rest = problem.follow(stops=ends, gap=at, slip=most, tol=TOL, start=divided[2])
        assert rest.reaction.tobytes() == divided.reaction[3:].tobytes()


def test_wrong_gaps_of_follow() -> None:
    _, gaps = wall(2)
    problem = make(2)
    with pytest.raises(ValueError, match=r"gap at s = 1 has shape \(2,\), expected"):
        problem.follow(gap=lambda _: [0.0, 1.0])
    with pytest.raises(TypeError, match="gap is"):
        problem.follow(gap=gaps[0])
    # Otherwise the obstacles would stop moving without a message.
    with pytest.raises(
        ValueError, match="gap is missing: the gaps of this problem have 4"
    ):
        make(2, gaps=gaps).follow()


def test_loads_of_the_problem_need_an_explicit_load_for_one_step() -> None:
    """`reduced` and `follow` raise if the problem has loads and none is given."""
    K = 1e3 * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
    arguments = {"gap": [0.0], "mu": 0.3}
    load = np.array([10.0, 1.0, 0.0, 0.0])
    with_row = bp.ContactProblem(K, np.eye(2, 4), loads=load[None], **arguments)
    assert with_row.existence().verdict == "none"
    plain = bp.ContactProblem(K, np.eye(2, 4), **arguments)
    np.testing.assert_array_equal(with_row.reduced().q, plain.reduced(load).q)
    several = bp.ContactProblem(K, np.eye(2, 4), loads=[0 * load, load], **arguments)
    for ask in (several.existence, several.reduced):
        with pytest.raises(ValueError, match=r"load is missing: .* have 2 steps"):
            ask()
    for problem in (with_row, several):
        with pytest.raises(ValueError, match=r"load is missing: .* as a function of s"):
            problem.follow()
