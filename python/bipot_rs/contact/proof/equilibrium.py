"""Whether reactions balance the loads, and the largest load that they balance.

A cone programme in the core gives reactions, or a motion that proves that there are none. See
section 10 of ``docs/theory.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import CsrMatrix, Floats, Ints, MatrixLike
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.contact.law.contact_law import ContactLaw

if TYPE_CHECKING:
    from bipot_rs.contact.results.solution import Solution

# The solution at a multiplier, from that at a smaller one; None if it was not found.
Solve = Callable[[float, "Solution | None"], "Solution | None"]
Verdict = Literal["balanced", "none", "undecided"]
# Solves of a search for the largest multiplier.
_STEPS = 16
# The search for the friction that could hold: most contacts, the largest factor on the
# coefficients or, if it is larger, one that makes the largest of them so large, and the ratio of
# the limits at its end, which takes some ten programmes.
_MOST_CONTACTS, _LARGEST_FACTOR, _LARGEST_FRICTION, _CLOSE = 500, 100.0, 10.0, 1.005


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium:
    """Whether reactions in their cones balance the loads.

    Attributes
    ----------
    verdict
        ``"balanced"``: ``reaction`` balances the loads. ``"none"``: no reaction does, and
        ``motion`` proves it. ``"undecided"``: neither was found.
    reaction
        If balanced, reactions ``(n_c, d)`` in their cones with ``Rᵀ r + e = 0`` to
        rounding: those of the largest margin, or the smallest ones if the margin is
        rounding, as where the loads determine the reactions.
    motion
        With ``"none"``: amounts ``a (k,)`` of the rigid motions. ``v = R a`` lies in every
        dual cone, ``v_n >= mu |v_t|``, and the loads work more on it than cohesion,
        ``e·a > Σ c |v_t|``. Both hold for these numbers without rounding if ``excluded``
        is infinite.
    margin
        The largest distance from the borders of their cones that all reactions can have, in
        units of force; it is not followed above the mean load. Negative if some reactions
        would have to lie outside by as much. Infinite without rigid motions.
    excluded
        With ``"none"``: the motion excludes reactions up to this many times the loads.
        Usually infinite. Where reactions can balance each other without loads, rounding of
        ``R`` may hide a motion that lies in every dual cone.
    reason
        The verdict in words.
    """

    verdict: Verdict
    reason: str
    margin: float
    reaction: Floats | None = None
    motion: Floats | None = None
    excluded: float = 0.0

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitMultiplier:
    """The largest multiplier ``λ`` of a live load ``e1`` beside a dead load ``e0``.

    Attributes
    ----------
    upper
        No reactions in the cones balance ``e0 + λ e1`` for a larger ``λ``, whatever the
        compliance. Infinite if there is no bound.
    mechanism
        The proof of ``upper``: amounts ``a (k,)`` of the rigid motions, with ``v = R a`` in
        every dual cone, ``e1·a > 0``, and ``upper = (Σ c |v_t| - e0·a)/(e1·a)``. ``None``
        if ``upper`` is infinite. Where contacts hold each other without loads, a proof may
        exclude only reactions up to ``excluded`` times the loads; ``upper`` is then up to
        some 1e-3 of the loads above the largest multiplier.
    reached
        The largest multiplier with an answer of the contact law that was found; ``None``
        without one. Without compliance and free displacement (``W = 0``, ``q = 0``) it is
        the largest, to rounding. Otherwise larger ones may exist.
    reaction
        Reactions ``(n_c, d)`` of the answer at ``reached``. If ``reached`` is infinite,
        reactions that balance the live load alone; any multiple may be added to an answer
        at ``λ = 0``.
    """

    upper: float
    mechanism: Floats | None
    reached: float | None
    reaction: Floats | None
    excluded: float = np.inf

    __repr__ = short_repr


def make_statics(
    R: MatrixLike, law: ContactLaw, contacts: int, d: int
) -> _core.Statics:
    """The contacts of a reduced problem; ``R (d n_c, k)`` is dense or sparse."""
    friction = np.zeros((contacts, d))
    friction[:, 1:] = law.mu if law.mu.ndim == 2 else law.mu[:, None]
    cohesion = np.zeros(contacts) if law.cohesion is None else law.cohesion
    return statics_of_rows(R, np.full(contacts, d), friction.ravel(), cohesion)


def statics_of_rows(
    R: MatrixLike, sizes: ArrayLike, friction: Floats, cohesion: Floats
) -> _core.Statics:
    """Contacts with ``sizes`` rows of ``R`` each, and a coefficient of each row."""
    from scipy.sparse import csr_array

    rows = csr_array(R)
    sizes = np.asarray(sizes, np.int64)
    return _core.Statics(csr_parts(rows), rows.shape[1], sizes, friction, cohesion)


def make_cone_set(
    G: MatrixLike,
    h: Floats,
    equations: MatrixLike | None = None,
    right: Floats | None = None,
) -> _core.ConeSet:
    """The ``y`` with ``h + G y`` in the cones and, if given, ``equations y = right``.

    ``G, h``: matrix ``(m d, k)``, dense or sparse, and ``(m, d)``: each row of ``h + G y (m,
    d)`` lies in the cone ``s_0 >= |(s_1, ..)|``. A row whose other components are zero is a
    half-line.
    """
    from scipy.sparse import csr_array

    sparse = csr_array(G)
    other = csr_array((0, sparse.shape[1])) if equations is None else equations
    right = np.empty(0) if right is None else right
    sizes = np.full(len(h), h.shape[1], np.int64)
    return _core.ConeSet(
        csr_parts(sparse),
        np.ascontiguousarray(h, np.float64).ravel(),
        sizes,
        csr_parts(csr_array(other)),
        np.asarray(right, np.float64),
        sparse.shape[1],
    )


def csr_parts(matrix: CsrMatrix) -> tuple[Ints, Ints, Floats]:
    """Row pointers, columns and values of a matrix in CSR form, for the core."""
    return (
        np.asarray(matrix.indptr, np.int64),
        np.asarray(matrix.indices, np.int64),
        np.asarray(matrix.data, np.float64),
    )


def read_decision(
    decision: _core.Decision,
    shape: tuple[int, ...],
    describe: Callable[[Floats], str],
) -> Equilibrium:
    """The verdict of the core in words; ``describe`` gives those of amounts of motions."""
    (verdict,) = (v for v in get_args(Verdict) if v == decision.verdict)
    reaction, motion = None, None
    if verdict == "balanced":
        reaction = decision.reaction.reshape(shape)
        reason = "reactions inside their cones balance the loads"
        if not decision.inside:
            reason = (
                "reactions on the borders of their cones balance the loads, to "
                f"{decision.imbalance:.0e} of them"
            )
    elif verdict == "none":
        motion = decision.motion
        reason = (
            "contact cannot carry the loads, and nothing stops this motion: "
            f"{describe(motion)}"
        )
        if np.isfinite(decision.excluded):
            reason += (
                f"; reactions up to {decision.excluded:.0e} times the loads cannot"
            )
    else:
        reason = (
            f"the largest margin found is {decision.relative_margin:.0e} of the mean load; the "
            f"reactions found leave {decision.imbalance:.0e} of the loads out of balance, "
            "and no motion proves that there are none"
        )
    return Equilibrium(
        verdict=verdict,
        reason=reason,
        margin=decision.margin,
        reaction=reaction,
        motion=motion,
        excluded=decision.excluded,
    )


def name_friction(mu: Floats) -> str:
    """The friction coefficients: ``with mu = 0.1 to 0.3``."""
    low, high = f"{mu.min():g}", f"{mu.max():g}"
    return f"with mu = {low}" if low == high else f"with mu = {low} to {high}"


def describe_friction(
    R: Floats | CsrMatrix, load: Floats, law: ContactLaw, d: int
) -> str:
    """The friction of a reduced problem whose verdict is "none", and which one could hold.

    ``R (d n_c, k)``, ``load (k,)``: its motions, and the loads on them.
    """
    words, low = name_friction(law.mu), 1.0

    def judge(factor: float) -> str:
        stronger = replace(law, mu=factor * law.mu)
        return make_statics(R, stronger, len(law.mu), d).decide(load).verdict

    if not law.mu.any() or len(law.mu) > _MOST_CONTACTS:
        return words
    high = max(_LARGEST_FACTOR, _LARGEST_FRICTION / float(law.mu.max()))
    if (verdict := judge(high)) != "balanced":
        which = (
            "no friction"
            if law.mu.all()
            else "no more friction at contacts that have some"
        )
        return words + (
            f"; {which} could balance the loads" if verdict == "none" else ""
        )
    while high > _CLOSE * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if judge(middle) == "balanced" else (middle, high)
    alike = law.mu.min() == law.mu.max()
    least = (
        f"mu = {high * law.mu.max():.3g}"
        if alike
        else f"{high:.3g} times as much friction"
    )
    return f"{words}; contact could balance the loads from {least} on"


def read_limit(
    limit: _core.LimitLoad,
    shape: tuple[int, ...],
    describe: Callable[[Floats], str],
    solve: Solve | None,
) -> LimitMultiplier:
    """The largest multiplier; ``solve`` finds answers of bodies that are not rigid.

    Raises `NoEquilibriumError` or `NotConvergedError`: as `ReducedProblem.limit_multiplier`.
    """
    without = read_decision(limit.dead, shape, describe)
    if without.verdict == "none":
        raise NoEquilibriumError(f"e0 alone: {without.reason}")
    if without.verdict == "undecided" and limit.reached is None:
        raise NotConvergedError(f"e0 alone: {without.reason}")
    if np.isinf(limit.upper) and limit.reached != np.inf:
        raise NotConvergedError(
            "the largest multiplier was not decided: no motion proves a bound, and the live "
            "load alone was not balanced"
        )
    reached, reaction = limit.reached, limit.reaction
    if solve is not None:
        reached, reaction = _climb(solve, limit.upper)
    return LimitMultiplier(
        upper=limit.upper,
        mechanism=limit.mechanism if np.isfinite(limit.upper) else None,
        reached=reached,
        reaction=None if reaction is None else reaction.reshape(shape),
        excluded=limit.excluded,
    )


def _climb(solve: Solve, upper: float) -> tuple[float | None, Floats | None]:
    """The largest multiplier with a solution that a bounded search finds, and its reactions.

    Each solution is the start of the next.
    """
    best, low, high = solve(0.0, None), 0.0, upper
    if best is None:
        return None, None
    # Far steps lose the answer, of which each is the start of the next.
    step = upper / 4 if np.isfinite(upper) else 1.0
    for _ in range(_STEPS):
        multiplier = min(low + step, high)
        solution = solve(multiplier, best)
        if solution is None:
            high = multiplier
            step = (high - low) / 2
        elif multiplier >= upper:
            return multiplier, solution.reaction
        else:
            best, low = solution, multiplier
            step *= 1 if np.isfinite(high) else 2
    return low, best.reaction
