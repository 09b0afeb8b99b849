"""Tolerance of the solver that matches the error of the mesh.

A solver error far below the discretisation error does not improve the result. `tolerance`
compares the two relative errors on a rough solution, and reduces the tolerance until the
solver error is a tenth of the discretisation error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs.contact.errors import BipotError
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.solution import Step
from bipot_rs.discretisation.estimator import Estimator
from bipot_rs.discretisation.tuning import ATTEMPTS, LOOSEST, SHARE, TIGHTEST


@dataclass(frozen=True)
class Enough:
    """A tolerance, and the errors from which it was computed."""

    tol: float  # for the residual η, (13)
    # `DiscretisationError.relative` of the load step that was examined.
    discretisation: float
    # The larger value of `Solution.error_estimate` there; 0 if there is none.
    algebraic: float
    work: float  # work spent to find it, in products with W


def tolerance(
    estimator: Estimator,
    problem: ContactProblem,
    *,
    method: str = "auto",
    max_iterations: int | None = None,
    share: float = SHARE,
) -> Enough:
    """Tolerance at which the solver error is ``share`` of the discretisation error.

    It is determined on the first load step with a contact force, with the given method,
    and used for all steps. Both errors are estimates: there is no guarantee. If one cannot
    be estimated, the result is `TIGHTEST`.

    ``estimator, problem``: estimator and problem of the same scene.
    ``method, max_iterations``: as in `ContactProblem.solve`.
    ``share``: in (0, 1].
    """
    if not 0 < share <= 1:
        raise ValueError(f"share is {share:g}, expected above 0 and at most 1")
    tol, work = LOOSEST, 0.0
    mesh, iteration = 0.0, 0.0
    for _ in range(ATTEMPTS):
        try:
            done, spent = _first(estimator, problem, method, tol, max_iterations)
        except BipotError:
            # Solving the whole path will raise the same error, with a result.
            break
        work += spent
        if done is None:
            break
        k, step = done
        try:
            mesh = estimator.error(step, k).relative
        except ValueError:
            # The nodal forces do not balance well enough to compute tractions.
            tol *= 1e-3
            continue
        errors = step.error_estimate
        if errors is None or not np.isfinite(mesh):
            break
        iteration = max(errors)
        if iteration <= share * mesh:
            return Enough(tol, mesh, iteration, work)
        # The error is roughly proportional to η; the factor 0.5 is a margin.
        tol *= 0.5 * max(share * mesh / iteration, 1e-4)
        if tol <= TIGHTEST:
            break
    return Enough(TIGHTEST, mesh, iteration, work)


def _first(
    estimator: Estimator,
    problem: ContactProblem,
    method: str,
    tol: float,
    max_iterations: int | None,
) -> tuple[tuple[int, Step] | None, float]:
    """Number and solution of the first load step with a contact force, and the work."""
    case, start, work = estimator.case, None, 0.0
    moving = case.model.gaps(len(case.parameter))
    for k in range(len(case.parameter)):
        result = problem.solve(
            None if case.load is None else case.load[k : k + 1],
            case.prescribed[k : k + 1],
            method=method,
            tol=tol,
            max_iterations=max_iterations,
            start=start,
            gap=None if moving is None else moving[k : k + 1],
        )
        work += float(result.work.sum())
        if result.reaction.any():
            return (k, result[0]), work
        start = result
    return None, work
