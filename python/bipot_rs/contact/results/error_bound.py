"""Guaranteed bounds of the distance to the solution; the minimising sequence of [dSF91]."""

from __future__ import annotations

from dataclasses import dataclass

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats

_REASONS = {
    "held by contact": "contact alone holds a body: friction depends on its rigid motion, "
    "which has no bound in advance",
    "no answer": "contact {0} penetrates and no reaction can move it: no solution exists",
    "touching": "no reaction can move contact {0}, which just touches: its reaction is not "
    "determined",
    "led": "contact {0} has friction along a tangent in which it cannot move: its reaction "
    "there depends on the slip of other contacts; set mu = 0 if a tangent is prescribed",
    "too large": "{0} unknowns are coupled, expected at most 3000: the proof needs dense "
    "matrices of that order",
    "not definite": "W of the contacts coupled with contact {0} is not positive definite to "
    "rounding, or nearly singular: reactions are not determined",
    "friction": "friction of the contacts coupled with contact {0} is too large for a proof: "
    "there may be several solutions, or no solution close enough was isolated",
    "impossible": "contact {0} has a reaction that the law excludes: a tangential reaction "
    "without friction, or a reaction at a contact that must stay open",
    "dilatancy": "contact {0} has dilatancy, for which no bound is proved",
    "range": "the numbers leave the range of doubles",
    "working set": "the problem was solved on a working set of its contacts, and the "
    "compliance of the other contacts was not formed",
    "engine": "the iterative engine does not form the compliance W, which the bound needs: "
    "use engine='direct'",
    "lost": "the problem is not available: the solution was read from a file or came from "
    "another process, and the bound was not computed before",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBound:
    """Proved bounds of the error of reactions ``r`` of a contact problem.

    ``r*`` is the solution of the reduced problem ``v = W r + q`` with the numbers W, q
    and mu in memory, and the law (9). The distance to ``r*`` is bounded, including
    rounding errors of the proof. The discretisation error and the rounding error of W in
    the condensation are not included. The proofs are in ``docs/paper/9-error-bound.md``.

    Attributes
    ----------
    constitutive
        Gap of the bipotential ``r·ṽ`` of each contact in units of work, ``(n_c,)``,
        (10): zero if the contact law holds, else positive if ``v_n >= 0`` and r lies in
        its cone, and of any sign otherwise.
    total
        The sum of ``constitutive``. If no contact penetrates and all reactions lie in
        their cones, it is the bifunctional B of section 4 of ``docs/theory.md`` for ``u``
        in equilibrium with ``r``, and not negative. Otherwise B is infinite.
    share
        ``total`` over the energy ``½ rᵀ W r`` of the reactions; 0 if both are zero,
        infinite if only the energy is zero.
    kind
        ``"global"``: there is exactly one solution, and its distance is bounded.
        ``"local"``: one solution lies within ``energy`` of ``r``, and no other within
        ``alone_within``; there may be others further away.
        ``"not available"``: there is no bound, and the following are ``None``.
    reason
        Why there is no bound; empty if there is one.
    unique
        Whether uniqueness of the solution is proved for any q.
    energy
        Bound of ``‖r - r*‖`` in the norm of W, ``√(dᵀ W d)``, in the root of units of work.
        For bodies with supports it also bounds ``‖u - u*‖`` in the norm of K.
    relative
        Bound of ``‖r - r*‖ / ‖r*‖`` in that norm; infinite if ``r* = 0`` is possible.
    alone_within
        Distance from ``r`` in that norm within which there is no other solution: at least
        ``energy``, and infinite for a global bound.
    reaction, relative_displacement
        Bounds of each component of ``r - r*`` and of ``v - v*``, ``(n_c, d)``, for
        the ``v`` that is reported with ``r``.
    traction
        ``reaction / area``, ``(n_c, d)``; ``None`` without areas.
    contraction
        Upper bound of ``L`` of section 10 of ``docs/theory.md``, if it is below 1: the
        smaller one of scaled and unscaled variables. Not with two coefficients.
    energy_by_gap
        Another bound of ``‖r - r*‖`` if ``L < 1``, from the gap in energy:
        ``½ (1 - L) (‖u - u*‖² + ‖r - r*‖²) ≤ B``. It is proportional to the root of the
        gap, and coarser.
    """

    constitutive: Floats
    total: float
    share: float | None
    kind: str
    reason: str = ""
    unique: bool = False
    energy: float | None = None
    relative: float | None = None
    alone_within: float | None = None
    reaction: Floats | None = None
    relative_displacement: Floats | None = None
    traction: Floats | None = None
    contraction: float | None = None
    energy_by_gap: float | None = None

    __repr__ = short_repr


def read_error_bound(core: _core.ProvedBound, area: Floats | None = None) -> ErrorBound:
    """Build an `ErrorBound` from what the core returns."""
    reaction = core.reaction
    traction = None if area is None or reaction is None else reaction / area[:, None]
    reason = core.reason
    return ErrorBound(
        constitutive=core.gap,
        total=float(core.gap.sum()),
        share=core.share,
        kind=core.kind,
        reason="" if reason is None else _REASONS[reason].format(core.which),
        unique=core.unique,
        energy=core.energy,
        relative=core.relative,
        alone_within=core.alone_within,
        reaction=reaction,
        relative_displacement=core.relative_displacement,
        traction=traction,
        contraction=core.contraction,
        energy_by_gap=core.energy_by_gap,
    )


def make_unavailable(reason: str, gap: Floats) -> ErrorBound:
    """Build an `ErrorBound` that has only the gap."""
    return ErrorBound(
        constitutive=gap,
        total=float(gap.sum()),
        share=None,
        kind="not available",
        reason=_REASONS[reason],
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MinimisingSequence:
    """The pairs ``(u_i, σ_i)`` of a minimising sequence and the bifunctional ``B`` along it.

    ``u_i`` is in equilibrium with reactions ``τ_i``, ``K u_i = f + Bᵀ τ_i``, and ``σ_i`` is
    the stress in equilibrium with reactions ``r_i`` in their cones, that of the displacement
    ``w_i`` with ``K w_i = f + Bᵀ r_i``. With ``v_i = W τ_i + q`` the bifunctional
    [dSF91, 23], less its lower bound, is::

        B(u_i, σ_j) = ½ (τ_i - r_j)ᵀ W (τ_i - r_j) + Σ (r_j·v_i + mu r_jn |v_it|)  >= 0.

    With two coefficients ``|D v_it|`` replaces ``mu |v_it|``, (10e). ``σ_0`` is the start
    value, ``u_i`` minimises ``B(·, σ_i)`` [dSF91, 33], and ``σ_(i+1)`` minimises ``B(u_i, ·)``
    [dSF91, 31]. So ``B`` does not increase [dSF91, 32, 34]. It falls to zero at a solution,
    or to a positive limit without one. Each minimum is computed to a hundredth of η times
    the error of the fields before, because ``B`` is of second order in the error, and more
    accurately where ``B`` would increase. ``v_i`` may penetrate by as much, which counts as
    zero in ``B``. Both properties hold to the rounding of ``B``: 16 ε of the product of
    ``|W||r| + |q|`` and ``r``, in norms, with the larger of both reactions, times 1 + mu.

    Attributes
    ----------
    bifunctional
        ``B(u_0, σ_0), B(u_0, σ_1), B(u_1, σ_1), ...`` in units of work: ``B(u_i, σ_i)`` has
        the index ``2 i``, and ``B(u_i, σ_(i+1))`` the index ``2 i + 1``. Empty if the start
        value is the solution.
    reaction
        ``r_i``, ``(m, n_c, d)``.
    balanced_reaction
        ``τ_i``, ``(k, n_c, d)``. ``m`` is ``k`` or ``k + 1``: the solver stops as soon as a
        point satisfies (13), which may be in the middle of a step. That point is the
        `Solution`, and the step is not part of the sequence.
    relative_displacement
        ``v_i``, ``(k, n_c, d)``; its tangential part is the slip since the start of the
        load step.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> problem = bp.ReducedProblem([[1.0, 0.4], [0.4, 1.0]], [[-1.0, 0.9]], 0.3)
    >>> sequence = problem.solve("minimising_sequence").minimising_sequence
    >>> [float(f"{b:.3g}") for b in sequence.bifunctional[:4]]
    [0.5, 0.0445, 0.00396, 0.000352]
    >>> len(sequence.reaction), len(sequence)
    (10, 9)
    """

    bifunctional: Floats
    reaction: Floats
    balanced_reaction: Floats
    relative_displacement: Floats

    def __len__(self) -> int:
        """Number of complete pairs ``(u_i, σ_i)``."""
        return len(self.balanced_reaction)

    def __repr__(self) -> str:
        lengths = f"{len(self)} pairs"
        if len(self):
            ends = self.bifunctional[[0, -1]]
            lengths += f", B from {ends[0]:.1e} to {ends[1]:.1e}"
        return f"{type(self).__name__}({lengths})"


def read_sequence(
    core: _core.SequenceFields, shape: tuple[int, ...]
) -> MinimisingSequence:
    """The sequence of contacts of a shape ``(n_c, d)`` from what the core returns."""
    return MinimisingSequence(
        bifunctional=core.bifunctional,
        reaction=core.reaction.reshape(-1, *shape),
        balanced_reaction=core.balanced_reaction.reshape(-1, *shape),
        relative_displacement=core.relative_displacement.reshape(-1, *shape),
    )
