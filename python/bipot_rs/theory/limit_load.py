"""Limit loads of a body of soil: a mechanism as the proof that no stress balances a load.

Let ``d`` be a displacement that is zero at the supports and whose strain satisfies
``d_v >= α ‖d_e‖`` everywhere, in the notation of `soils`. For a stress that satisfies the
criterion ``‖s‖ <= α (a - σ_m)``,

    ``σ:ε(d) = σ_m d_v + s:d_e <= σ_m d_v + (a - σ_m) α ‖d_e‖ <= a d_v``.

If it also balances the load, ``f·d = ∫ σ:ε(d) dΩ``. So ``f·d > ∫ a d_v dΩ`` proves that no
such stress exists, whatever the flow. The flow of a soil with ``β < α`` may end before: this
limit is that of associated flow, and an upper bound of all others (Radenkovic).
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.contact.proof.equilibrium import statics_of_rows
from bipot_rs.theory.body_assembly import BodyAssembly
from bipot_rs.theory.body_step import BodyStep
from bipot_rs.theory.soils import DruckerPrager


class LimitLoadError(NoEquilibriumError):
    """The load is above the limit load; this is proved.

    Attributes
    ----------
    steps
        The steps before.
    mechanism
        ``(n,)``, the proof, see `mechanism`; its largest component is 1.
    """

    steps: tuple[BodyStep, ...] = ()
    mechanism: Floats


class StepNotConvergedError(NotConvergedError):
    """A step did not reach the tolerance. A solution may exist.

    Attributes
    ----------
    steps
        The steps before.
    last
        The last iterate of the step that failed.
    """

    steps: tuple[BodyStep, ...] = ()
    last: BodyStep


def mechanism(
    assembly: BodyAssembly, soil: DruckerPrager, load: Floats
) -> Floats | None:
    """Displacement that proves that no admissible stress balances the load.

    Parameters
    ----------
    assembly, soil
        The body, and its criterion.
    load
        ``(n,)`` [N].

    Returns
    -------
    mechanism
        ``(n,)``, zero at the supports, with ``d_v >= α ‖d_e‖`` at the quadrature points
        and ``f·d > ∫ a d_v dΩ``; scaled so that its largest component is 1. None if no such
        displacement was found: the load can be carried, or is within 1e-6 of the limit.
    """
    force = load[assembly.free]
    if not force.any():
        return None
    cones = _list_cones(assembly, soil)
    points, rows, free = cones.shape
    # A stress that balances the load is σ = a 1 + τ, with τ in the cone of a soil without
    # cohesion: the apex takes part of the load.
    borne = soil.apex * (assembly.weights @ cones[:, 0])
    statics = statics_of_rows(
        cones.reshape(-1, free),
        np.full(points, rows),
        np.ones(points * rows),
        np.zeros(points),
    )
    decision = statics.decide(force - borne)
    if decision.verdict != "none":
        return None
    d = decision.motion
    whole = np.zeros(len(load))
    whole[assembly.free] = d / np.abs(d).max()
    return whole


def _list_cones(assembly: BodyAssembly, soil: DruckerPrager) -> Floats:
    """``(d_v, α d_e)`` of unit displacements: ``(m, 1 + components, free)``."""
    strain = assembly.unit_strains()
    volume = strain[:, :3].sum(axis=1)
    strain[:, :3] -= volume[:, None] / 3
    if assembly.body.dim == 2:
        strain = strain[:, [0, 1, 2, 5]]
    return np.concatenate([volume[:, None], soil.friction * strain], axis=1)
