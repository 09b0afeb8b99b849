"""The tolerance that a mesh is worth: iterating further than it changes nothing real.

Where the mesh leaves an error of a tenth, digits of the iteration beyond a hundredth tell
of the mesh, not of the bodies. `tolerance` compares the two errors, both relative, on a
loose solution, and tightens until the iteration's is a tenth of the mesh's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs.contact.errors import BipotError
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.solution import Step
from bipot_rs.discretisation.estimator import Estimator

SHARE = 0.1
# Looser than this, statuses are guesses; tighter, nothing is left to save.
LOOSEST, TIGHTEST = 1e-2, 1e-10
_ATTEMPTS = 4


@dataclass(frozen=True)
class Enough:
    """A tolerance, and what it was found from.

    Attributes
    ----------
    tol
        For the residual η, (13).
    discretisation
        `DiscretisationError.relative` of the load step that was looked at.
    algebraic
        The larger of `Solution.error_estimate` there; 0 where there is none.
    work
        What looking took, in products with W.
    """

    tol: float
    discretisation: float
    algebraic: float
    work: float


def tolerance(
    estimator: Estimator,
    problem: ContactProblem,
    *,
    method: str = "auto",
    max_iterations: int | None = None,
    share: float = SHARE,
) -> Enough:
    """Tolerance at which the error of the iteration is ``share`` of that of the mesh.

    Found on the first load step with a contact force, by the method that will be used,
    for all steps of the path. What it rests on is estimated on either side: the result is
    a rule, no guarantee. Without an estimate it is `TIGHTEST`.

    Parameters
    ----------
    estimator, problem
        Of one scene.
    method, max_iterations
        As of `ContactProblem.solve`.
    share
        In (0, 1].
    """
    if not 0 < share <= 1:
        raise ValueError(f"share is {share:g}, expected it in (0, 1]")
    tol, work = LOOSEST, 0.0
    mesh, iteration = 0.0, 0.0
    for _ in range(_ATTEMPTS):
        try:
            done, spent = _first(estimator, problem, method, tol, max_iterations)
        except BipotError:
            # The solve of the whole path will say so, with its result.
            break
        work += spent
        if done is None:
            break
        k, step = done
        try:
            mesh = estimator.error(step, k).relative
        except ValueError:
            # Where nodal forces do not balance well enough for tractions.
            tol *= 1e-3
            continue
        errors = step.error_estimate
        if errors is None or not np.isfinite(mesh):
            break
        iteration = max(errors)
        if iteration <= share * mesh:
            return Enough(tol, mesh, iteration, work)
        # Errors fall with η; half of it, as they do so only roughly.
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
    """The first load step that presses anything, and what it took to get there."""
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
