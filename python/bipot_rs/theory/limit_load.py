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
from bipot_rs.contact.proof.cone_programme import Programme
from bipot_rs.theory.body_assembly import BodyAssembly
from bipot_rs.theory.body_step import BodyStep
from bipot_rs.theory.soils import DruckerPrager

# The search for a mechanism factors a dense matrix some thirty times; with more
# operations each time it is left out.
_OPERATIONS = 5e9
# Part of the work by which a mechanism must be unbalanced: it is known to this accuracy.
_SURE = 1e-6


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
        and ``f·d > ∫ a d_v dΩ``, to rounding; scaled so that its largest component is 1.
        None if no such displacement was found: the load can be carried, or is within 1e-6
        of the limit, or the mesh is too large for the search.
    """
    force = load[assembly.free]
    components = 5 if assembly.body.dim == 2 else 7
    operations = len(assembly.weights) * components * len(force) ** 2
    if not force.any() or operations > _OPERATIONS:
        return None
    cones = _list_cones(assembly, soil)
    dilation = assembly.weights @ cones[:, 0]
    cost = soil.apex * dilation - force
    # Columns and cost of unit length: the result does not depend on units.
    size = np.linalg.norm(cones, axis=(0, 1))
    scaled = cost / size
    optimum = Programme(cones / size, np.zeros(cones.shape[:2])).minimise(
        scaled / np.linalg.norm(scaled)
    )
    if optimum.bounded:
        return None
    d = optimum.y / size
    won = float(force @ d)
    if not won - soil.apex * float(dilation @ d) > _SURE * abs(won):
        return None
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
