"""How far a point is from the answer: what is guaranteed, and where nothing is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bipot_rs._lib.types import Floats

_REASONS = {
    "held by contact": "bodies are held by contact alone: friction feels their rigid "
    "motion, of which nothing is known beforehand",
    "no answer": "contact {0} penetrates and nothing can move it: there is no answer",
    "touching": "nothing moves contact {0}, which just touches: its reaction is not "
    "determined",
    "led": "contact {0} has friction along a tangent that nothing moves: its reaction "
    "there follows from the slip of the others; set mu = 0 where a tangent is prescribed",
    "too large": "{0} unknowns are coupled, expected 3000 at the most: the proof takes "
    "dense matrices of that order",
    "not definite": "W is not positive definite to rounding, or too nearly singular, "
    "among the contacts that are coupled with contact {0}: reactions are not determined",
    "friction": "friction is too large for a proof among the contacts that are coupled "
    "with contact {0}: there may be several answers, or none near enough was isolated",
    "impossible": "contact {0} has a reaction where the law leaves none, a tangential one "
    "without friction, or one of a contact that must stay open",
    "directional": "friction depends on direction: the rounding of the change of variables "
    "that makes it Coulomb's is not counted",
    "range": "the numbers leave the range of doubles",
    "working set": "the problem was solved on a working set of its contacts, of the rest "
    "no compliance is at hand",
    "lost": "the solution has lost its problem (it was read from a file, or sent by "
    "another process, before this was asked for)",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBound:
    """The error of a point ``r`` of a contact problem, as far as it can be proved.

    ``r*`` is the answer of the reduced problem ``v = W r + q`` with the numbers W, q
    and mu that are in memory, and the law (9). What is bounded is the distance to it:
    of a scene neither the error of the mesh is in it, nor what W has lost in
    condensation. Rounding is counted. Proofs are in ``docs/paper/9-error-bound.md``.

    Attributes
    ----------
    constitutive
        Gap of the bipotential ``r·ṽ`` of each contact in units of work, ``(n_c,)``,
        (10): zero on the law, positive off it where ``v_n >= 0`` and r lies in its
        cone, of either sign, or zero, where not.
    total
        Its sum. Where no contact penetrates and all reactions lie in their cones it is
        the bifunctional B of section 4 of ``docs/theory.md``, for ``u`` in equilibrium
        with ``r``, and then not negative; elsewhere B is infinite and this is not.
    share
        ``total`` over the energy ``½ rᵀ W r`` that the reactions store; 0 where both are,
        infinite where only that is.
    kind
        ``"global"``: there is one answer, and this bounds the distance to it.
        ``"local"``: one answer is within ``energy`` of ``r``, the only one within
        ``alone_within``, which is never less; nothing is said of answers further away.
        ``"not available"``: no bound; the rest is ``None``.
    reason
        Why there is none, in words; empty where there is one.
    unique
        Whether it is proved that there is one answer, whatever q is.
    energy
        Bound of ``‖r - r*‖`` in the norm of W, ``√(dᵀ W d)``, in the root of units of work.
        For bodies with supports it is that of ``‖u - u*‖`` in the norm of K too.
    relative
        Bound of ``‖r - r*‖ / ‖r*‖`` in that norm; infinite where ``r* = 0`` is not
        excluded.
    alone_within
        How far from ``r``, in that norm, there is no other answer than the one that is
        bounded: ``energy`` or more, infinite where the bound is global.
    reaction, relative_displacement
        Bounds of each component of ``r - r*`` and of ``v - v*``, ``(n_c, d)``, for
        the ``v`` that is reported with ``r``.
    traction
        ``reaction / area``, ``(n_c, d)``; ``None`` without areas.
    contraction
        ``L`` of section 10 of ``docs/theory.md``, from above, where it is below 1; of scaled
        variables or the caller's, whichever is smaller.
    energy_by_gap
        Another bound of ``‖r - r*‖``, by what is missing in energy, where ``L < 1``:
        ``½ (1 - L) (‖u - u*‖² + ‖r - r*‖²) ≤ B``. It goes with the root of the gap, and is
        the coarser one.
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


def from_core(raw: Mapping[str, Any], area: Floats | None = None) -> ErrorBound:
    """Of what the core says of a point."""
    gap = raw["gap"]
    known = {
        name: raw.get(name)
        for name in (
            "energy",
            "relative",
            "alone_within",
            "reaction",
            "relative_displacement",
            "contraction",
            "energy_by_gap",
        )
    }
    reaction = known["reaction"]
    traction = None if area is None or reaction is None else reaction / area[:, None]
    reason = raw.get("reason")
    return ErrorBound(
        constitutive=gap,
        total=float(gap.sum()),
        share=raw["share"],
        kind=raw["kind"],
        reason="" if reason is None else _REASONS[reason].format(raw["which"]),
        unique=raw["unique"],
        traction=traction,
        **known,
    )


def without(reason: str, gap: Floats) -> ErrorBound:
    """Nothing but the gap."""
    return ErrorBound(
        constitutive=gap,
        total=float(gap.sum()),
        share=None,
        kind="not available",
        reason=_REASONS[reason],
    )
