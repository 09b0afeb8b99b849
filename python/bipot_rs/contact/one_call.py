"""`solve`: a problem and its load path in one call."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.result import Result


def solve(
    K: Any,
    B: Any,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
    *,
    gap: ArrayLike,
    mu: ArrayLike,
    fixed: ArrayLike | None = None,
    area: ArrayLike | None = None,
    dim: int | None = None,
    num_threads: int | None = None,
    points: ArrayLike | None = None,
    frame: ArrayLike | None = None,
    coordinates: ArrayLike | None = None,
    memory_limit: int | None = None,
    working_set: bool | None = None,
    gaps: ArrayLike | None = None,
    stiffness_rtol: float | None = None,
    **settings: Any,
) -> Result:
    """Solve one contact problem with Coulomb friction, over one load step or a path.

    ``K u = load + Bᵀ r``, ``v = B u + gap``, and at every contact no penetration, no
    tension, and Coulomb's friction between ``v`` and ``r``: equations (1), (2) and (9) of
    ``docs/theory.md``. It is ``ContactProblem(K, B, ...).solve(load, prescribed, ...)`` in
    one call; keep the `ContactProblem` to solve again without another factorisation.

    Any consistent units; components normal first, ``(n, t1[, t2])``; n degrees of
    freedom, n_c contacts, d = 2 or 3.

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``, symmetric positive semidefinite, dense or sparse, supports
        not eliminated.
    B
        ``(d n_c, n)``: row ``d i + k`` gives component ``k`` of the relative displacement
        of contact ``i``, that of the body minus that of the obstacle.
    load
        Nodal forces, ``(n,)``, or ``(steps, n)`` for a path: totals at the end of each
        step; missing is zero.
    prescribed
        Displacements of ``fixed``, ``(len(fixed),)`` or ``(steps, len(fixed))``: totals;
        missing is zero.
    gap
        Normal gap, ``(n_c,)``, open when positive, or ``(n_c, d)``.
    mu
        Friction coefficient, a number or ``(n_c,)``; in space also ``(n_c, 2)``.
    fixed
        Numbers of the prescribed degrees of freedom.
    area
        Tributary areas, ``(n_c,)``, for tractions.
    dim, num_threads, points, frame, coordinates, memory_limit, working_set, gaps, \
    stiffness_rtol
        As in `ContactProblem`.
    **settings
        ``method``, ``tol``, ``max_iterations``, ``max_seconds``, ``start`` and ``on_step`` of
        `ContactProblem.solve`.

    Returns
    -------
    Result
        Of each step the ``reaction`` ``(steps, n_c, d)``, a force on the body, its normal
        part never negative; ``relative_displacement``, ``slip``, ``status``,
        ``displacement`` ``(steps, n)``, and the ``residual`` that says how exact it is.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; the message names it, what was found and what was expected.
    NoEquilibriumError, NotConvergedError, FloatingBodyError, MemoryError
        As `ContactProblem` and `ContactProblem.solve` say.

    Examples
    --------
    A point on two springs is pressed onto a wall by 10 N and pulled along it, first by
    2 N, which friction holds, then by 5 N, of which it takes 0.3 · 10 N:

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
    problem = ContactProblem(
        K,
        B,
        gap=gap,
        mu=mu,
        fixed=fixed,
        area=area,
        dim=dim,
        num_threads=num_threads,
        points=points,
        frame=frame,
        coordinates=coordinates,
        memory_limit=memory_limit,
        working_set=working_set,
        gaps=gaps,
        stiffness_rtol=stiffness_rtol,
    )
    return problem.solve(load, prescribed, **settings)
