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

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.errors import NoEquilibriumError
from bipot_rs.contact.proof.equilibrium import statics_of_rows
from bipot_rs.theory.structure_state import (
    LACK_ACROSS,
    Assembled,
    StepNotConvergedError,
    StructureStep,
)

# A motion of a body is rigid if it strains it by less, relative to the stiffest motion.
_RIGID = 1e-12
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
    statics, borne = _make_statics(structure, motions, associated=True)
    decision = statics.decide(live - borne)
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
    statics, borne = _make_statics(structure, motions, associated=True)
    limit = statics.find_limit(held - borne, live)
    if limit.dead.verdict == "none":
        return LimitInterval(-np.inf, -np.inf, motions @ limit.dead.motion)
    statics, borne = _make_statics(structure, motions, associated=False)
    lower = statics.find_limit(held - borne, live).reached
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


def _make_statics(
    structure: Assembled, motions: CsrMatrix, *, associated: bool
) -> tuple[_core.Statics, Floats]:
    """Cones of points and contacts, with the slopes μ or β, and the load borne at the apex.

    A stress that balances the load is ``a`` in the mean, less a reaction in the cone.
    """
    rows, sizes, friction, cohesion = [], [], [], []
    borne = np.zeros(motions.shape[1])
    for group in structure.points:
        slope = group.law.mu if associated else group.law.dilatancy
        rows.append(group.strain @ motions)
        sizes.append(np.full(len(slope), group.d))
        friction.append(np.repeat(slope, group.d))
        cohesion.append(group.weights * group.law.cohesion)
        apex = group.weights[:, None] * group.rest
        borne += rows[-1].T @ apex.ravel()
    (contacts, d), law = structure.shape, structure.law
    slope = law.mu if associated else law.dilatancy
    rows.append(structure.B @ motions)
    sizes.append(np.full(contacts, d))
    friction.append(np.repeat(slope, d))
    # Contacts may break: the lower limit does without their cohesion.
    cohesion.append(law.cohesion if associated else np.zeros(contacts))
    # Rows of unit length for each cone: neither units nor the sizes of cells matter.
    whole, counts = sparse.csr_array(sparse.vstack(rows)), np.concatenate(sizes)
    squares = whole.multiply(whole).sum(axis=1)
    ends = np.concatenate([[0], np.cumsum(counts)[:-1]])
    size = np.sqrt(np.add.reduceat(squares, ends))
    size[size == 0] = 1.0
    statics = statics_of_rows(
        sparse.diags_array(np.repeat(1 / size, counts)) @ whole,
        counts,
        np.concatenate(friction),
        np.concatenate(cohesion) * size,
    )
    return statics, borne


def _find_motions(structure: Assembled) -> CsrMatrix:
    """Displacements zero at supports that move elastic bodies rigidly, ``(n, k)``."""
    free = structure.free
    stiff = structure.K[free][:, free]
    bodies = np.flatnonzero(np.diff(stiff.indptr))
    loose = np.setdiff1d(np.arange(len(free)), bodies)
    columns = [_embed(np.eye(len(loose)), free[loose], structure.n)]
    if len(bodies):
        values, vectors = np.linalg.eigh(stiff[bodies][:, bodies].toarray())
        rigid = vectors[:, values <= _RIGID * values.max()]
        columns.append(_embed(rigid, free[bodies], structure.n))
    made: CsrMatrix = sparse.csr_array(sparse.hstack(columns))
    return made


def _embed(block: Floats, rows: Ints, n: int) -> CsrMatrix:
    """Values of some degrees of freedom as columns of all."""
    part = sparse.coo_array(block)
    made: CsrMatrix = sparse.csr_array(
        sparse.coo_array((part.data, (rows[part.row], part.col)), (n, block.shape[1]))
    )
    return made
