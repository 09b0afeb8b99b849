"""A tolerance from the discretisation error: the solver's error stays small against it."""

import discretisation_error as bench
import numpy as np
import pytest

from bipot_rs.discretisation import Estimator
from bipot_rs.discretisation.stopping import LOOSEST, TIGHTEST, tolerance
from support.comparisons import refused


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "nesterov", "uzawa"])
@pytest.mark.parametrize(
    ("name", "n"), [("sheared_cube", 3), ("two_blocks", 4), ("cattaneo_mindlin", 5)]
)
@pytest.mark.quick_variants("*-3-auto", "*-3-gauss_seidel", "*-3-nesterov")
def test_solver_error_is_below_the_mesh_error(name: str, n: int, method: str) -> None:
    case, exact = bench.solved(name, [f"mesh.n={n}"])
    problem, estimator = case.model.problem(), Estimator(case)
    enough = tolerance(estimator, problem, method=method)
    assert TIGHTEST <= enough.tol <= LOOSEST
    assert enough.algebraic <= 0.1 * enough.discretisation
    assert enough.work > 0
    done = problem.solve(case.load, case.prescribed, method=method, tol=enough.tol)
    K = case.model.K
    for k in range(len(done)):
        left = done.displacement[k] - exact.displacement[k]
        u = exact.displacement[k]
        error = np.sqrt((left @ (K @ left)) / (u @ (K @ u)))
        # The rule allows a tenth for the step that it used; errors of a path add up over its
        # two steps.
        assert error <= 0.2 * estimator.error(exact, k).relative
    long = problem.solve(case.load, case.prescribed, method=method, tol=TIGHTEST)
    assert done.work.sum() <= long.work.sum()
    if method != "auto":
        # One or two of ten digits are needed.
        assert done.work.sum() <= 0.5 * long.work.sum()


def test_a_smaller_share_is_tighter() -> None:
    case, _ = bench.solved("two_blocks", ["mesh.n=4"])
    problem, estimator = case.model.problem(), Estimator(case)
    tols = [
        tolerance(estimator, problem, method="gauss_seidel", share=share).tol
        for share in (1.0, 0.1, 0.001)
    ]
    assert tols[0] > tols[1] > tols[2]


def test_tolerance_without_contact_force() -> None:
    case, _ = bench.solved("sheared_cube", ["mesh.n=2", "support.0.z=0.05"])
    assert tolerance(Estimator(case), case.model.problem()).tol == TIGHTEST


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, np.nan])
def test_share_out_of_range_is_refused(share: float) -> None:
    case, _ = bench.solved("sheared_cube", ["mesh.n=2"])
    with refused("share is"):
        tolerance(Estimator(case), case.model.problem(), share=share)
