"""Explicit integration of friction, with the drift that section I of [dSF91] describes.

The scheme integrates the rate form (51). Status and direction of slip are taken from the
start of the step, and the cone is replaced by its tangent there. It serves for comparison:
`bipot_rs.ContactProblem.solve` uses the implicit scheme (Moreau's catching-up algorithm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import coulomb
from bipot_rs._lib.validation import loads as steps_of
from bipot_rs.contact.law.projection import project
from bipot_rs.contact.problem import ContactProblem


@dataclass(frozen=True, kw_only=True, eq=False)
class ExplicitPath:
    """Result of `explicit_path`.

    Attributes
    ----------
    reaction, relative_displacement
        At the end of each step, ``(steps, n_c, d)``, normal first.
    excess
        Distance of each reaction from Coulomb's cone, ``(steps, n_c)`` [force]. In the
        implicit scheme this is zero up to rounding.
    """

    reaction: Floats
    relative_displacement: Floats
    excess: Floats


def explicit_path(
    problem: ContactProblem,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
) -> ExplicitPath:
    """Follow a load path from the unloaded state by the explicit scheme.

    A contact that is open at the start of a step stays open in the step. All other contacts
    are closed at its end, ``v_n = 0``, with ``t_n < 0`` if necessary; a contact with
    ``t_n < 0`` opens in the next step. A closed contact sticks, ``Δv_t = 0``, if its
    traction was inside the cone. On the border or outside, it slides along the traction at
    the start, ``m = t_t/‖t_t‖``,

        Δv_t = -λ m,    m·Δt_t = μ Δt_n,

    unless this gives ``λ < 0``: then it sticks. If the traction turns, the tangent
    ``m·Δt_t = μ Δt_n`` leaves the cone, always outwards, because ``‖t_t‖`` is convex. The
    error of a step is ``½ ‖Δt_t‖² sin²/‖t_t‖``; the sum is of first order in the step size.

    Parameters
    ----------
    problem
        A problem whose supports stop all rigid motions. ``W`` is formed as a dense matrix.
    load, prescribed
        As in `ContactProblem.solve`.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; rigid motions without support; closed contacts with a singular
        compliance.
    """
    n, fixed = problem.loading.n, problem.loading.fixed
    contacts, d = problem.contacts.shape
    steps = steps_of(load, prescribed, n, fixed)
    first = problem.reduced(np.zeros(n), np.zeros(fixed))
    mu = coulomb(first.mu, contacts)
    if first.rigid is not None:
        raise ValueError(
            "problem has unsupported rigid motions "
            f"({', '.join(problem.rigid_motions)}): add supports, which the explicit scheme needs"
        )
    W = problem.compliance
    t, v, q = np.zeros((contacts, d)), first.q.copy(), first.q
    kept_t, kept_v = [], []
    for force, moved in steps:
        free = problem.reduced(force, moved).q
        dt = _step(W, free - q, t, v, mu)
        v = v + (W @ dt.ravel()).reshape(v.shape) + free - q
        t, q = t + dt, free
        kept_t.append(t)
        kept_v.append(v)
    shape = (len(steps), contacts, d)
    reaction = np.array(kept_t).reshape(shape)
    inside, _ = project(reaction.reshape(-1, d), np.tile(mu, len(steps)))
    excess = np.linalg.norm(reaction - inside.reshape(shape), axis=2)
    return ExplicitPath(
        reaction=reaction,
        relative_displacement=np.array(kept_v).reshape(shape),
        excess=excess,
    )


def _step(W: Floats, dq: Floats, t: Floats, v: Floats, mu: Floats) -> Floats:
    """``Δt`` of a step from ``t``, ``v`` with the increment ``dq`` of free displacement."""
    contacts, d = t.shape
    drag = np.linalg.norm(t[:, 1:], axis=1)
    closed = (t[:, 0] > 0) | (v[:, 0] <= 0)
    # A contact without friction force has no direction of slip.
    slides = closed & (drag > 0) & (drag >= mu * t[:, 0]) & (mu > 0)
    m = np.divide(
        t[:, 1:],
        drag[:, None],
        where=drag[:, None] > 0,
        out=np.zeros((contacts, d - 1)),
    )
    while True:
        dt, rate = _rates(W, dq, t, v, mu, closed, slides, m)
        # Slip in the direction of its own friction force is impossible: such a contact sticks.
        turned = slides & (rate < 0)
        if not turned.any():
            return dt
        slides &= ~turned


def _rates(
    W: Floats,
    dq: Floats,
    t: Floats,
    v: Floats,
    mu: Floats,
    closed: Bools,
    slides: Bools,
    m: Floats,
) -> tuple[Floats, Floats]:
    """Solve the linear problem of given statuses for ``Δt`` and ``λ``."""
    contacts, d = t.shape
    size = contacts * d
    sliding = np.flatnonzero(slides)
    A = np.zeros((size + len(sliding), size + len(sliding)))
    b = np.zeros(len(A))
    for i in range(contacts):
        rows = slice(i * d, (i + 1) * d)
        if not closed[i]:
            A[rows, rows], b[rows] = np.eye(d), -t[i]
            continue
        A[rows, :size], b[rows] = W[rows], -dq[i]
        b[i * d] -= v[i, 0]
        if mu[i] == 0:
            across = slice(i * d + 1, (i + 1) * d)
            A[across] = 0.0
            A[across, across], b[across] = np.eye(d - 1), 0.0
    for k, i in enumerate(sliding.tolist()):
        across = slice(i * d + 1, (i + 1) * d)
        A[across, size + k] = m[i]
        A[size + k, across], A[size + k, i * d] = m[i], -mu[i]
    try:
        x = np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        raise ValueError(
            "the compliance of the closed contacts of problem is singular: it does not "
            "determine their reactions; remove redundant contacts"
        ) from None
    rate = np.zeros(contacts)
    rate[sliding] = x[size:]
    return np.asarray(x[:size].reshape(contacts, d), np.float64), rate
