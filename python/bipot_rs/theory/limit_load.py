"""Limit loads of a structure: mechanisms as proofs, with contacts in them.

Let ``d`` be a displacement that is zero at the supports, moves elastic bodies rigidly, and
satisfies at every plastic point and contact, in the notation of `points`,

    ``x_n >= μ‖x_t‖``,    ``v_n >= μ‖v_t‖``    with ``v = B d``.

Stresses and reactions that satisfy the laws and balance the load have ``r·x >= -c‖x_t‖`` and
``r·v >= -c‖v_t‖``: ``f·d = ∫ (a x_n - r·x) dΩ - Σ r·v <= ∫ (a x_n + c‖x_t‖) dΩ + Σ c‖v_t‖``.
A larger ``f·d`` proves that no such stresses exist, whatever the flow. This is the limit of
associated laws, an upper bound of all others. The limit of the associated laws with the cones
of β, ``‖r_t‖ <= c + β r_n``, is a lower bound (Radenkovic), in which contacts, which may break,
have no cohesion: without dilatancy and without cohesion that cone is an axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import CsrMatrix, Floats
from bipot_rs._lib.validation import floats
from bipot_rs.contact.errors import NoEquilibriumError
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.proof.equilibrium import statics_of_rows
from bipot_rs.theory.structure_state import (
    LACK_ACROSS,
    Assembled,
    StepNotConvergedError,
    StructureStep,
)

# Gaps and imbalance of this size are rounding: some hundred terms of a sum.
_ROUNDING = 1e-13


class LimitLoadError(NoEquilibriumError):
    """The load is above the limit load; this is proved.

    Attributes
    ----------
    steps
        The steps before.
    mechanism
        ``(n,)``, the proof, see `find_mechanism`; its largest component is 1.
    """

    steps: tuple[StructureStep, ...] = ()
    mechanism: Floats


@dataclass(frozen=True)
class LimitInterval:
    """Proved limits of the multiple of a load that the structure carries.

    Attributes
    ----------
    lower, upper
        The limit load is not below and not above these. The lower one is zero where the cone
        of β carries nothing of the load, and ``-inf`` where it does not carry the dead load;
        the upper one is infinite without a mechanism.
    mechanism
        ``(n,)``, the proof of the upper limit; None if that is infinite.
    """

    lower: float
    upper: float
    mechanism: Floats | None

    __repr__ = short_repr


def find_mechanism(structure: Assembled, load: ArrayLike) -> Floats | None:
    """Displacement that proves that nothing admissible balances the load.

    Parameters
    ----------
    structure
        The structure.
    load
        ``(n,)``, with the weight [N].

    Returns
    -------
    mechanism
        ``(n,)``, zero at the supports, with ``f·d`` above what points can dissipate, to
        rounding; scaled so that its largest component is 1. None if no such displacement was
        found: the load can be carried, or is within 1e-6 of the limit.
    """
    force = floats("load", load, shape=(structure.n,))
    motions = _find_motions(structure)
    live = motions.T @ force
    if not live.any():
        return None
    make_statics, borne = _gather_rows(structure, motions)
    decision = make_statics(True).decide(live - borne)
    if decision.verdict != "none":
        return None
    motion = motions @ decision.motion
    return np.asarray(motion / np.abs(motion).max())


def bound_load(
    structure: Assembled, load: ArrayLike, dead: ArrayLike | None = None
) -> LimitInterval:
    """Proved limits of λ in ``dead + λ load``, besides the weight.

    Parameters
    ----------
    structure
        The structure.
    load, dead
        ``(n,)`` [N].

    """
    force = floats("load", load, shape=(structure.n,))
    rest = structure.weight.copy()
    if dead is not None:
        rest += floats("dead", dead, shape=rest.shape)
    motions = _find_motions(structure)
    live, held = motions.T @ force, motions.T @ rest
    if not live.any():
        return LimitInterval(np.inf, np.inf, None)
    make_statics, borne = _gather_rows(structure, motions)
    limit = make_statics(True).find_limit(held - borne, live)
    if limit.dead.verdict == "none":
        return LimitInterval(-np.inf, -np.inf, motions @ limit.dead.motion)
    lower = make_statics(False).find_limit(held - borne, live).reached
    bounded = np.isfinite(limit.upper)
    return LimitInterval(
        lower=-np.inf if lower is None else lower,
        upper=limit.upper,
        mechanism=motions @ limit.mechanism if bounded else None,
    )


def refuse_step(
    structure: Assembled,
    steps: tuple[StructureStep, ...],
    step: StructureStep,
    tol: float,
) -> None:
    """Raise the error of a step that did not converge."""
    flow = find_mechanism(structure, step.load)
    which = f"step {len(steps)}"
    if flow is not None:
        above = LimitLoadError(
            f"the load of {which} is above the limit load: no stress satisfies the "
            "criterion and balances it, because on the mechanism of this error the "
            "load does more work than the soil can dissipate; reduce the load, or "
            "prescribe displacements"
        )
        above.steps, above.mechanism = steps, flow
        raise above
    reason = (
        "Its load may be above the limit load of the flow, or the step too large: use smaller "
        "steps, or prescribe displacements"
    )
    if max(step.gap_soil, step.gap_contact, step.imbalance) <= _ROUNDING:
        reason = f"This is rounding: tol is {tol:g}, use a larger one"
    if step.lack_across > max(tol, LACK_ACROSS) and step.imbalance < 1e-6:
        reason = (
            "The stress across the plane is not the intermediate one, or the mean tension is "
            "too large, so that the plane law of Mohr and Coulomb does not hold: use "
            "law='drucker-prager', another nu, or an initial stress"
        )
    failed = StepNotConvergedError(
        f"{which} did not converge: gap of the soils {step.gap_soil:.1e}, of the contacts "
        f"{step.gap_contact:.1e}, imbalance {step.imbalance:.1e}. {reason}"
    )
    failed.steps, failed.last = steps, step
    raise failed


def _gather_rows(
    structure: Assembled, motions: CsrMatrix
) -> tuple[Callable[[bool], _core.Statics], Floats]:
    """What makes the cones of points and contacts, and the load borne at the apex.

    The slopes of the cones are μ, or β if they are not the associated ones. A stress that
    balances the load is ``a`` in the mean, less a reaction in the cone.
    """
    laws = [*(group.law for group in structure.points), structure.law]
    blocks = [group.strain @ motions for group in structure.points]
    # Energies are per volume at points, and those of the contacts whole.
    weights = [group.weights for group in structure.points]
    borne = np.zeros(motions.shape[1])
    for group, block in zip(structure.points, blocks, strict=True):
        borne += block.T @ (group.weights[:, None] * group.rest).ravel()
    contacts, d = structure.shape
    weights.append(np.ones(contacts))
    counts = np.repeat(
        [*(group.d for group in structure.points), d], [len(row) for row in weights]
    )
    # Rows of unit length for each cone: neither units nor the sizes of cells matter.
    whole = sparse.csr_array(sparse.vstack([*blocks, structure.B @ motions]))
    squares = whole.multiply(whole).sum(axis=1)
    ends = np.concatenate([[0], np.cumsum(counts)[:-1]])
    size = np.sqrt(np.add.reduceat(squares, ends))
    size[size == 0] = 1.0
    rows = sparse.diags_array(np.repeat(1 / size, counts)) @ whole

    def make_statics(associated: bool) -> _core.Statics:
        slopes = [law.mu if associated else law.dilatancy for law in laws]
        cohesion = [law.cohesion * w for law, w in zip(laws, weights, strict=True)]
        if not associated:
            # Contacts may break: the lower limit does without their cohesion.
            cohesion[-1] = np.zeros(contacts)
        friction = np.repeat(np.concatenate(slopes), counts)
        return statics_of_rows(rows, counts, friction, np.concatenate(cohesion) * size)

    return make_statics, borne


def _find_motions(structure: Assembled) -> CsrMatrix:
    """Displacements zero at supports that move elastic bodies rigidly, ``(n, k)``."""
    n, K = structure.n, structure.K
    stiff = np.diff(K.indptr) > 0
    bodies, loose = np.flatnonzero(stiff), structure.free[~stiff[structure.free]]
    moved = np.zeros((0, len(bodies)))
    if len(bodies):
        # All that touches a body counts as a contact, of two components.
        touching = [*(group.strain for group in structure.points), structure.B]
        rows = sparse.csr_array(sparse.vstack(touching))[:, bodies]
        rows = rows[np.diff(rows.indptr) > 0]
        count = -(-rows.shape[0] // 2)
        rows.resize((2 * count, len(bodies)))
        fixed = np.searchsorted(bodies, structure.fixed[stiff[structure.fixed]])
        core = ContactProblem(
            K[bodies][:, bodies],
            rows,
            gap=np.zeros(count),
            mu=0.0,
            fixed=fixed,
            dim=2,
            engine="direct",
        ).stiffness.core
        still = np.zeros(len(bodies)), np.zeros(len(fixed)), np.zeros((count, 2))
        moved = core.displacements([(*still, a) for a in np.eye(len(core.modes()))])
    rigid = sparse.coo_array(np.reshape(moved, (len(moved), len(bodies))))
    amounts = np.concatenate([np.ones(len(loose)), rigid.data])
    rows_of = np.concatenate([loose, bodies[rigid.coords[1]]])
    column_of = np.concatenate([np.arange(len(loose)), len(loose) + rigid.coords[0]])
    shape = n, len(loose) + rigid.shape[0]
    made: CsrMatrix = sparse.csr_array((amounts, (rows_of, column_of)), shape)
    return made
