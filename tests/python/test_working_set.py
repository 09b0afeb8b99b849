"""Far more candidates than contacts: a set that grows, and the answer of all of them."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bodies import Body, block

# Both answers fulfil the law to rounding; what they may differ by is the error of two
# W's of cond(S) below 1e3, and of η = 1e-13 over the smallest reaction that counts.
SAME = 1e-10


def indented(dim: int, cells: int, radius: float) -> tuple[Body, np.ndarray]:
    """A unit block over a rigid ball that touches it in the middle of its face."""
    body = block([1.0] * dim, [cells] * dim, 1.0, 0.3)
    away = ((body.points[:, :-1] - 0.5) ** 2).sum(axis=1)
    return body, away / (2 * radius)


def path(body: Body, fixed: np.ndarray, depth: float) -> np.ndarray:
    """Press, drag, lift a little."""
    dim = body.dim
    steps = np.zeros((3, len(fixed)))
    component = np.asarray(fixed) % dim
    steps[:, component == dim - 1] = -depth * np.array([[1.0], [1.0], [0.4]])
    steps[1:, component == 0] = depth / 3
    return steps


def both(
    body: Body, gap: np.ndarray, fixed: Any, load: Any, prescribed: Any, **more: Any
) -> list[bp.Result]:
    results = []
    for grow in (True, False):
        problem = bp.ContactProblem(
            body.K, body.B, gap=gap, mu=0.4, fixed=fixed, working_set=grow, **more
        )
        assert (problem.stats["working_set"] is not None) == grow
        results.append(problem.solve(load, prescribed, tol=1e-13))
    return results


def agree(grown: bp.Result, whole: bp.Result, inertia: float = 0.0) -> None:
    size = np.abs(whole.reaction).max()
    np.testing.assert_allclose(grown.reaction, whole.reaction, rtol=0, atol=SAME * size)
    for name in ("relative_displacement", "slip", "displacement"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(
            getattr(grown, name),
            expected,
            rtol=0,
            atol=SAME * max(np.abs(expected).max(), inertia),
        )
    assert np.array_equal(grown.status, whole.status)
    assert all(step.residual <= step.tolerance for step in grown)


@pytest.mark.parametrize(("dim", "cells"), [(2, 320), (3, 15)])
def test_the_answer_of_all_candidates(dim: int, cells: int) -> None:
    body, gap = indented(dim, cells, radius=1.0)
    fixed = np.concatenate([body.dofs(dim - 1, 1.0, k) for k in range(dim)])
    grown, whole = both(body, gap, fixed, None, path(body, fixed, 0.02))
    agree(grown, whole)
    closed = (whole.status != 0).any(axis=0)
    assert 5 < closed.sum() < len(gap) / 4
    # No contact that was left out penetrates.
    assert grown.relative_displacement[:, :, 0].min() >= -1e-15


def test_the_gaps_decide() -> None:
    body, gap = indented(2, 320, radius=1.0)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    few = bp.ContactProblem(body.K, body.B, gap=gap, mu=0.4, fixed=fixed)
    assert few.stats["working_set"] is not None
    touching = bp.ContactProblem(body.K, body.B, gap=0 * gap, mu=0.4, fixed=fixed)
    assert touching.stats["working_set"] is None
    small, gap = indented(2, 40, radius=1.0)
    held = np.concatenate([small.dofs(1, 1.0, k) for k in range(2)])
    few = bp.ContactProblem(small.K, small.B, gap=gap, mu=0.4, fixed=held)
    assert few.stats["working_set"] is None


@pytest.mark.parametrize(("dim", "cells"), [(2, 320), (3, 14)])
def test_a_body_held_by_contact_alone(dim: int, cells: int) -> None:
    # In space the contacts are numbered row by row: those that pin the body must not
    # follow a diagonal, about which it would be held by rounding.
    body, gap = indented(dim, cells, radius=1.0)
    down = [0.0] * (dim - 1) + [-0.01]
    load = body.traction(dim - 1, 1.0, down) + body.weight([0.001, *down[1:]])
    loads = np.array([load, 1.5 * load])
    grown, whole = both(body, gap, None, loads, None)
    agree(grown, whole, inertia=gap.max())


def test_a_body_that_nothing_holds_is_still_said_to_slide_away() -> None:
    body, gap = indented(2, 320, radius=1.0)
    pulled = body.weight([0.0, 1.0])
    for grow in (True, False):
        problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=0.4, working_set=grow)
        with pytest.raises(bp.NoEquilibriumError, match="nothing stops"):
            problem.solve(pulled)


def test_when_nearly_all_close_all_are_taken() -> None:
    body, gap = indented(2, 320, radius=50.0)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    grown, whole = both(body, gap, fixed, None, path(body, fixed, 0.05))
    assert (whole.status != 0).all(axis=1).any()
    agree(grown, whole)


def test_two_bodies_and_a_state_to_start_from() -> None:
    upper, gap = indented(2, 320, radius=1.0)
    n = upper.K.shape[0]
    K = sparse.block_diag([upper.K, 0.5 * upper.K], format="csr")
    B = sparse.hstack([upper.B, -upper.B], format="csr")
    top = np.concatenate([upper.dofs(1, 1.0, k) for k in range(2)])
    # The lower body is the mirror image: its face in contact is the same line.
    fixed = np.concatenate([top, n + top])
    steps = np.zeros((3, len(fixed)))
    steps[:, : len(top)] = path(upper, top, 0.02)
    results = []
    for grow in (True, False):
        problem = bp.ContactProblem(
            K, B, gap=gap, mu=0.4, fixed=fixed, working_set=grow
        )
        first = problem.solve(prescribed=steps[:2], tol=1e-13)
        then = problem.solve(prescribed=steps[2:], start=first, tol=1e-13)
        through = problem.solve(prescribed=steps, tol=1e-13)
        size = np.abs(through.reaction).max()
        np.testing.assert_allclose(
            then.reaction[-1], through.reaction[-1], rtol=0, atol=SAME * size
        )
        results.append(through)
    agree(*results)


def test_bits_do_not_depend_on_threads() -> None:
    body, gap = indented(3, 15, radius=1.0)
    fixed = np.concatenate([body.dofs(2, 1.0, k) for k in range(3)])
    one, two = (
        both(body, gap, fixed, None, path(body, fixed, 0.02), num_threads=k)[0]
        for k in (1, 2)
    )
    assert one.reaction.tobytes() == two.reaction.tobytes()
    assert one.displacement.tobytes() == two.displacement.tobytes()


def test_what_else_is_asked_of_it() -> None:
    """The dense W, the reduced problem and the error estimate, as without it."""
    body, gap = indented(2, 320, radius=1.0)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    made = [
        bp.ContactProblem(
            body.K, body.B, gap=gap, mu=0.4, fixed=fixed, working_set=grow
        )
        for grow in (True, False)
    ]
    moved = path(body, fixed, 0.02)[1]
    grown, whole = (problem.reduced(prescribed=moved) for problem in made)
    # One and the same elimination, once it is asked for.
    assert np.array_equal(np.asarray(grown.W), np.asarray(whole.W))
    assert np.array_equal(grown.q, whole.q)
    step = made[0].solve(prescribed=moved)[0]
    assert step.unique == "unknown"
    estimate = step.error_estimate
    assert estimate is not None
    assert max(estimate) < 1e-9  # η = 1e-10 and a well-conditioned W
    assert grown.residual(step.reaction) <= 1e-10
