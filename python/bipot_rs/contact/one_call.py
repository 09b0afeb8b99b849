"""`solve`: a problem and its load path in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypedDict, Unpack

from numpy.typing import ArrayLike

from bipot_rs._lib.types import MatrixLike, OpenRecord
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result

if TYPE_CHECKING:
    from bipot_rs.contact.path.prepared import OnForecast
    from bipot_rs.contact.results.solution import Step
    from bipot_rs.contact.results.state import Start


class _OfSolve(TypedDict, total=False):
    """Keywords of `ContactProblem.solve`."""

    method: str
    tol: float
    max_iterations: int | None
    max_seconds: float | None
    start: Start | None
    on_step: Callable[[int, Step], object] | None
    progress: bool


class _Keywords(_OfSolve, total=False):
    """Keywords of `ContactProblem.solve`, and the optional ones of `ContactProblem`."""

    fixed: ArrayLike | None
    area: ArrayLike | None
    cohesion: ArrayLike | None
    dilatancy: ArrayLike | None
    dim: int | None
    num_threads: int | None
    points: ArrayLike | None
    frame: ArrayLike | None
    coordinates: ArrayLike | None
    loads: ArrayLike | tuple[ArrayLike | None, ArrayLike | None] | None
    memory_limit: int | None
    working_set: bool | None
    gaps: ArrayLike | MovingGaps | None
    on_forecast: OnForecast | None
    bodies: Mapping[str, int] | None
    stiffness_rtol: float | None
    engine: str


def solve(
    K: MatrixLike,
    B: MatrixLike,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
    *,
    gap: ArrayLike,
    mu: ArrayLike,
    **keywords: Unpack[_Keywords],
) -> Result:
    """Solve one contact problem with Coulomb friction, over one load step or a path.

    The problem is ``K u = load + Bᵀ r``, ``v = B u + gap``, and at every contact no
    penetration, no tension, and Coulomb's friction between ``v`` and ``r``: equations (1),
    (2) and (9) of ``docs/theory.md``. The call is short for
    ``ContactProblem(K, B, ...).solve(load, prescribed, ...)``. Keep a `ContactProblem` to
    solve again without another factorisation.

    Units are any consistent set. Components are normal first, ``(n, t1[, t2])``. There are
    n degrees of freedom and n_c contacts, and d is 2 or 3.

    Parameters
    ----------
    K, B, gap, mu
        As in `ContactProblem`: the stiffness ``(n, n)``, from which supports are not
        eliminated; the contact operator ``(d n_c, n)``; the normal gaps ``(n_c,)``, positive
        when open, or all components; and the friction coefficients.
    load, prescribed
        As in `ContactProblem.solve`: nodal forces ``(n,)``, or ``(steps, n)`` for a path, and
        displacements of the degrees of freedom ``fixed``, totals at the end of each step.
    **keywords
        All other keywords of `ContactProblem`, such as ``fixed`` and ``area``, and all of
        `ContactProblem.solve`, such as ``method`` and ``tol``.

    Returns
    -------
    Result
        For each step the ``reaction`` ``(steps, n_c, d)``, which is the force on the body,
        with a normal part that is never negative; ``relative_displacement``, ``slip``,
        ``status``, ``displacement`` ``(steps, n)``, and the ``residual``, which measures
        the error in the equations.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong. The message names it, what was found and what is expected.
    NoEquilibriumError, NotConvergedError, FloatingBodyError, MemoryError
        As `ContactProblem` and `ContactProblem.solve` raise them.

    Examples
    --------
    A point on two springs is pressed onto a wall by 10 N and pulled along it: first by
    2 N, which friction holds, then by 5 N, of which friction takes 0.3 · 10 N:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> K, B = 1000.0 * np.eye(2), np.eye(2)
    >>> result = bp.solve(K, B, [[-10.0, 2.0], [-10.0, 5.0]], gap=[0.0], mu=0.3)
    >>> result.reaction[:, 0]
    array([[10., -2.],
           [10., -3.]])
    >>> [bp.Status(s).name for s in result.status[:, 0]]
    ['STICK', 'SLIP']
    >>> result.displacement[-1].round(12)
    array([0.   , 0.002])
    """
    arguments: OpenRecord = dict(keywords)
    settings = {
        name: arguments.pop(name)
        for name in _OfSolve.__annotations__
        if name in arguments
    }
    return ContactProblem(K, B, gap=gap, mu=mu, **arguments).solve(
        load, prescribed, **settings
    )
