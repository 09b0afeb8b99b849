"""What a step of a structure needs of it, and what it returns: states, steps, an error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.theory.points import PlasticPoints, PointLaw

# A stress across the plane is the intermediate one within this part of the stress: changes
# of stress add up in each step, and only their rounding counts.
LACK_ACROSS = 1e-9


class Assembled(Protocol):
    """The matrices and points of a `structure.Structure`, whose attributes these are.

    ``B``, ``by`` and ``law`` are in the components in which friction is isotropic.
    """

    n: int
    fixed: Ints
    free: Ints
    K: CsrMatrix
    elastic: CsrMatrix
    points: tuple[PlasticPoints, ...]
    B: CsrMatrix
    by: Floats
    law: PointLaw
    springs: Floats
    guided: Bools
    weight: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_c, d)`` of the contacts."""

    def weaken(self, broken: Bools | None) -> PointLaw:
        """Law of the contacts with the cohesion of those that are not broken."""

    def solve_elastic(self, rest: Floats) -> Floats:
        """Displacement of the free degrees of freedom under forces on them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StructureState:
    """State between two steps.

    Attributes
    ----------
    displacement
        ``(n,)`` [m].
    reaction
        Contact forces, ``(n_c, d)`` [N].
    stress, plastic_strain
        One for each of the soils: stresses [Pa], tension positive, and totals of the plastic
        strain, ``(cells, points, 6)`` as of `soils.mandel`; ``(m, d)`` for `PlasticPoints`.
    gap
        Gaps of the step, ``(n_c, d)`` [m].
    broken, dilation
        Contacts that have lost their cohesion, and the opening at which their surfaces meet
        [m], as of a `bp.ContactProblem`, ``(n_c,)``; None without cohesion, or dilatancy.
    """

    displacement: Floats
    reaction: Floats
    stress: tuple[Floats, ...]
    plastic_strain: tuple[Floats, ...]
    gap: Floats
    broken: Bools | None = None
    dilation: Floats | None = None

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True, eq=False)
class StructureStep(StructureState):
    """A solved step, with its certificate.

    Attributes
    ----------
    load
        Total loads ``(n,)`` with the weights [N].
    support
        Forces of the supports, ``(len(fixed),)`` [N].
    relative_displacement, slip
        ``B u + gap`` of the contacts, ``(n_c, d)``, and their slip in the step [m].
    opened
        Contacts that are open by more than the tolerance, ``(n_c,)``.
    work
        Elastic energies, plastic work and work of the contacts in the step, each without its
        sign [J]: the size that gaps and imbalance are relative to. Not less than half of
        the work of the loads on the elastic structure with the springs of contacts.
    gap_soil
        ``∫ [β - σ:ε] dΩ`` relative to ``work``: the part of B of the plastic points, whose
        stresses satisfy the criterion.
    gap_contact
        ``Σ [b(-v, r) + r·v]`` relative to ``work``, of reactions in the cone. A penetration
        counts with the energy of the springs of `Structure.springs`.
    imbalance
        ``√(½ g·K̂⁻¹ g / work)``, ``g`` the forces that stay unbalanced, K̂ the elastic
        stiffness with the springs of contacts.
    bifunctional
        B of (23) [J]: ``work (gap_soil + gap_contact + imbalance²)``.
    converged
        Whether gaps and imbalance are at most the tolerance, and the stress across the plane
        of a soil of Mohr and Coulomb is the intermediate one.
    lack_across
        How far the latter stress is outside the criterion, relative to it.
    ellipticity
        Of each soil, ``det Q(n)`` of the tangent relative to the elastic one, the least over
        all directions n, ``(cells, points)``; 1 where a point is elastic.
    second_order_work
        ``∫ Δσ:Δε dΩ`` of the step relative to the elastic one; 1 without flow. A negative
        one is apparent softening.
    associated
        Whether no flow and no contact has a dilatancy below its friction.
    iterations
        Iterations of all passes.
    history
        Both gaps and the imbalance after each pass, ``(passes, 3)``; one row for ``"newton"``.
    """

    load: Floats
    support: Floats
    relative_displacement: Floats
    slip: Floats
    opened: Bools
    work: float
    gap_soil: float
    gap_contact: float
    imbalance: float
    converged: bool
    lack_across: float
    ellipticity: tuple[Floats, ...]
    second_order_work: float
    associated: bool
    iterations: int
    history: Floats

    __repr__ = short_repr

    @property
    def bifunctional(self) -> float:
        """B of (23) [J]."""
        return self.work * (self.gap_soil + self.gap_contact + self.imbalance**2)

    @property
    def elliptic(self) -> bool:
        """Whether no direction of any point has ``det Q < 0``: no band of strain may form.

        For associated flow the least value is zero, to rounding.
        """
        return all(bool((smallest >= -1e-9).all()) for smallest in self.ellipticity)

    @property
    def unique(self) -> bool:
        """Whether the stress is proved to be the only one: associated flow, no friction.

        It is never claimed where `elliptic` is lost.
        """
        return self.converged and self.associated and self.elliptic

    @property
    def stability(self) -> str:
        """What the material may do after this step, in words."""
        lost = sum(int((smallest < -1e-9).sum()) for smallest in self.ellipticity)
        if not lost:
            return "elliptic: strains do not gather in bands"
        softens = self.second_order_work < 0
        softening = (
            "; the second-order work of the step is negative, so that the structure softens, "
            "although the material does not"
            if softens
            else ""
        )
        return (
            f"ellipticity is lost at {lost} points: strains may gather in bands as wide as the "
            f"cells, and other answers may exist{softening}"
        )


class StepNotConvergedError(NotConvergedError):
    """A step did not reach the tolerance. A solution may exist.

    Attributes
    ----------
    steps
        The steps before.
    last
        The last iterate of the step that failed.
    """

    steps: tuple[StructureStep, ...] = ()
    last: StructureStep
