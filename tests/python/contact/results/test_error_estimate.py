"""`error_estimate` agrees with the true error, or is None."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import fem
from support.bodies import block
from support.oracle import Problem, follow
from support.pressed import MU, cube, free, square

Array = NDArray[np.float64]
CELL = {2: "quadrilateral", 3: "hexahedron"}
# Each method stops at its tolerance, so it leaves an error of the size of tol. In "auto",
# Newton's last step leaves the square of that.
SLOW = ("gauss_seidel", "nesterov", "uzawa", "uzawa_two_projection")


def away(solution: Any, r: Array, v: Array) -> tuple[float, float]:
    """Relative errors, by the definition of the estimate."""
    pairs = (solution.reaction, r), (solution.relative_displacement, v)
    of_r, of_v = (np.linalg.norm(x - y) / np.linalg.norm(y) for x, y in pairs)
    return float(of_r), float(of_v)


def within_three(solution: Any, r: Array, v: Array) -> None:
    assert solution.converged
    for estimate, true in zip(
        solution.error_estimate, away(solution, r, v), strict=True
    ):
        assert true > 1e-12  # # well above the rounding of the reference
        assert true / 3 <= estimate <= 3 * true


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("held", [True, False])
def test_loads_that_the_contacts_carry_at_once(dim: int, held: bool) -> None:
    """Nothing moves: v is rounding, and its error is one relative to what it is made of.

    Loads act at the contact nodes, without friction above the limit. W has a condition of some
    hundred, and each of its products some ten roundings.
    """
    model = fem.assemble(
        [
            fem.Body(
                "b",
                fem.box([np.linspace(0, 1, 4)] * dim, CELL[dim]),
                fem.Material(210e3, 0.3),
            )
        ],
        [fem.Contact("b", "bottom", 0.3, plane=(np.zeros(dim), np.eye(dim)[-1]))],
        [fem.Support("b", "top", tuple(range(dim)))] if held else [],
    )
    force = np.zeros_like(model.nodes)
    below = np.flatnonzero(model.nodes[:, -1] == 0)
    force[below, -1], force[below, 0] = -1.0 - below / 3, 0.1
    step = model.problem(engine="direct").solve(force.ravel())[0]
    assert np.abs(step.displacement).max() < 1e-17  # F / E is 5e-6
    assert max(step.error_estimate) < 1e-13


@pytest.mark.parametrize("tol", [1e-4, 1e-8])
@pytest.mark.parametrize("method", SLOW)
@pytest.mark.parametrize("problem", [cube, square, free])
@pytest.mark.slow_variants("*cube*")
def test_the_estimate_is_right_to_a_factor_of_three(
    problem: Callable[[], bp.ReducedProblem], method: str, tol: float
) -> None:
    reduced = problem()
    solution = reduced.solve(method, tol)
    refined = reduced.solve(tol=1e-14)
    assert refined.residual <= 1e-14
    within_three(solution, refined.reaction, refined.relative_displacement)
    # Computed without the package.
    exact = follow(Problem(reduced.W, reduced.q, MU, reduced.rigid))
    within_three(solution, exact.r, exact.v)
    # The correction of a point that is exact to rounding is itself rounding. W has a
    # condition of about a hundred.
    assert max(refined.error_estimate or [1.0]) <= 1e-13


@pytest.mark.parametrize("tol", [1e-2, 1e-4])
@pytest.mark.parametrize("method", ["auto", "newton"])
def test_of_methods_that_end_with_newton(method: str, tol: float) -> None:
    solution, refined = cube().solve(method, tol), cube().solve(tol=1e-14)
    within_three(solution, refined.reaction, refined.relative_displacement)


@pytest.mark.parametrize("tol", [1e-4, 1e-8])
@pytest.mark.parametrize("held", [True, False])
def test_of_the_steps_of_a_path(held: bool, tol: float) -> None:
    body = block((2.0, 1.0), (5, 3), 100.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in (0, 1)]) if held else None
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=MU, fixed=fixed)
    down, side = body.weight([0.0, -1.0]), body.traction(0, 2.0, [0.12, 0.0])
    path = np.stack([down + side, 1.2 * down - side / 2, 1.1 * down + side])
    result = problem.solve(path, method="uzawa", tol=tol)
    before = None
    for load, step in zip(path, result, strict=True):
        # The solution of this step, started from the true end of the step before.
        exact = problem.solve(load, tol=1e-14, start=before)[0]
        within_three(step, exact.reaction, exact.relative_displacement)
        before = step


def test_none_where_reactions_are_not_determined() -> None:
    # H7: the same contact twice.
    W, q = np.array([[0.5, 0.1], [0.1, 1.0]]), np.array([[-1.0, 0.7]])
    assert bp.ReducedProblem(W, q, MU).solve().error_estimate is not None
    twice = bp.ReducedProblem(np.tile(W, (2, 2)), np.tile(q, (2, 1)), MU).solve()
    assert twice.converged
    assert twice.error_estimate is None
    # H8: three supports of a bar (v, θ, w along them); two would be enough.
    rows = [[[1.0, x, 0.0], [0.0, 0.0, 1.0]] for x in (-1.0, 0.0, 1.0)]
    K, B, load = 1e-3 * np.eye(3), np.vstack(rows), [-1.0, 0.0, 0.1]
    bar = bp.solve(K, B, load, gap=np.zeros(3), mu=MU)[0]
    assert bar.converged
    assert bar.error_estimate is None


def test_none_without_convergence() -> None:
    cut = cube().solve("uzawa", 1e-10, max_iterations=2)
    assert not cut.converged
    assert cut.error_estimate is None


def test_a_computed_estimate_is_pickled(tmp_path: Path) -> None:
    body = block((2.0, 1.0), (4, 2), 100.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in (0, 1)])
    path = np.outer([1.0, 1.2], body.weight([0.3, -1.0]))
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=MU, fixed=fixed)
    result = problem.solve(path, method="uzawa")
    asked = result[1].error_estimate
    sent = pickle.loads(pickle.dumps(result))
    result.save(tmp_path / "result.h5")
    read = bp.load(tmp_path / "result.h5")
    for copy in (sent, read):
        assert copy[0].error_estimate is None
        assert copy[1].error_estimate == asked
    # If the problem is available, the estimate can still be computed.
    assert result[0].error_estimate is not None
    assert pickle.loads(pickle.dumps(result))[0].error_estimate is not None

    solution = cube().solve("uzawa")
    assert pickle.loads(pickle.dumps(solution)).error_estimate is None
    assert solution.error_estimate is not None
    assert (
        pickle.loads(pickle.dumps(solution)).error_estimate == solution.error_estimate
    )
