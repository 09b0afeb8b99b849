"""Discrete energies, functionals and bifunctional of one load step: [dSF91, 23-30, 67-72].

A displacement is the vector of all degrees of freedom; it is admissible if it has the
prescribed values. A stress field of the elastic bodies is given by the contact reactions, and
by the stresses of the plastic points, with which it is in equilibrium. The load contains body
forces and tractions; there may be several bodies. All quantities are increments from a start
state ``(t0, u0, h0)``. By default this is the unloaded state; increments are then totals.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Bools, Floats, Ints, MatrixLike, OpenRecord
from bipot_rs._lib.validation import floats, integer
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result
from bipot_rs.theory.structure import Structure
from bipot_rs.theory.structure_state import StructureState

# Of each of the soils: flow, stress at the end and stress at the start, as of `points`.
SoilFields: TypeAlias = Sequence[tuple[Floats, Floats, Floats]]

# Tolerance of constraints: of penetration relative to the largest displacement, of contact
# forces to the largest reaction, of balance on rigid motions to the loads. Without it the
# indicator at a computed solution would be infinite.
_SLACK = 1e-9


class Functionals:
    """The functionals of one load step of a structure.

    ``du (n,)`` and ``dr (n_c, d)`` are increments of displacement and contact reaction
    from the start state, ``soils`` are `SoilFields`; energies are in units of work. The
    relative displacement is ``v = B du + offset``, the reaction ``r = t0 + dr``.

    Parameters
    ----------
    structure
        Bodies, soils and contacts.
    load, prescribed
        Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``; default zero. The
        weight of soils is part of the load.
    reaction, displacement
        ``t0 (n_c, d)`` of any sign and ``u0 (n,)`` at the start of the step; default the
        unloaded bodies.
    carried
        Loads of this state, ``(n,)``. By default those that balance it, ``K u0 - Bᵀ t0``; at
        prescribed degrees of freedom, the loads of the step.
    offset
        Relative displacement to which increments are added, ``(n_c, d)``. By default, as in
        [dSF91], its normal part is the gap ``u_n0 + h0`` and its tangential part zero.
    broken
        Contacts without cohesion in the step, ``(n_c,)``; default none.

    Attributes
    ----------
    load, prescribed
        Increments of the step.
    offset
        ``(u_n0 + h0, 0)`` of each contact, ``(n_c, d)``.
    start_work
        ``Σ t0·offset``, the constant ``Σ t_n0 (u_n0 + h0)`` that (54) omits.
    """

    def __init__(
        self,
        structure: Structure,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        reaction: ArrayLike | None = None,
        displacement: ArrayLike | None = None,
        carried: ArrayLike | None = None,
        offset: ArrayLike | None = None,
        broken: Bools | None = None,
    ) -> None:
        if not isinstance(structure, Structure):
            raise make_type_error("structure", structure, "a Structure")
        n, fixed, shape = structure.n, structure.fixed, structure.shape
        self._structure, self._shape = structure, shape
        self._stiffness, self._fixed = structure.K, fixed
        self._contact = structure.matrix
        self._by = structure.by
        self._law = structure.weaken(broken)
        force = np.zeros(n) if load is None else floats("load", load, shape=(n,))
        moved = np.zeros(len(fixed))
        if prescribed is not None:
            moved = floats("prescribed", prescribed, shape=moved.shape)
        t0, u0, gap = np.zeros(shape), np.zeros(n), structure.gap
        if reaction is not None:
            t0 = floats("reaction", reaction, shape=shape)
        if displacement is not None:
            u0 = floats("displacement", displacement, shape=(n,))
        # Relative displacements are differences of displacements, those of the start
        # included: these set the size of rounding.
        self._reach = np.abs(gap).max(initial=0.0)
        self._reach += (abs(self._contact) @ np.abs(u0)).max(initial=0.0)
        if carried is None:
            borne = self._stiffness @ u0 - self._contact.T @ t0.ravel()
            borne[fixed] = 0.0 if displacement is None else force[fixed]
        else:
            borne = floats("carried", carried, shape=(n,))
        self._before, self.load = t0, force - borne
        self.prescribed = moved - u0[fixed]
        if offset is not None:
            self.offset = floats("offset", offset, shape=shape)
        else:
            self.offset = gap.copy()
            if displacement is not None:
                self.offset[:, 0] += self._relative(u0)[:, 0]
                self.offset[:, 1:] = 0.0
        self.start_work = float(np.sum(self._before * self.offset))

    @classmethod
    def between(
        cls,
        structure: Structure,
        start: StructureState,
        end: StructureState,
        load: ArrayLike,
    ) -> Functionals:
        """The functionals of a step between two states, with the load at its end."""
        force = floats("load", load, shape=(structure.n,)) + structure.weight
        u0, offset = start.displacement, end.gap.copy()
        offset[:, 1:] -= start.gap[:, 1:]
        moved = np.asarray(structure.matrix @ u0).reshape(structure.shape)
        offset[:, 0] += moved[:, 0]
        if start.dilation is not None:
            offset[:, 0] -= start.dilation
        carried = structure.K @ u0
        carried -= structure.matrix.T @ start.reaction.ravel()
        for group, stress in zip(structure.points, start.stress, strict=True):
            carried += group.forces(group.from_tensors(stress))
        return cls(
            structure,
            force,
            end.displacement[structure.fixed],
            reaction=start.reaction,
            displacement=u0,
            carried=carried,
            offset=offset,
            broken=end.broken,
        )

    @classmethod
    def of_step(
        cls,
        structure: Structure,
        result: Result,
        k: int = -1,
        *,
        increments: bool = True,
    ) -> Functionals:
        """The functionals of step ``k`` of a solved load path.

        Parameters
        ----------
        structure
            The elastic structure of the problem that was solved, see `of_problem`.
        result
            Result of ``problem.solve``. A result from a file has no loads and is refused.
        k
            Index of the step.
        increments
            If true, quantities are increments from the step before; otherwise totals, with
            the slip history in the offset as in (22). If the step before is in equilibrium,
            the two bifunctionals differ by ``start_work`` only.

        Raises
        ------
        ValueError
            ``k`` is out of range, the result was read from a file, or frames change along
            the path.
        """
        count = len(result)
        if count == 0:
            raise ValueError("result has no steps, expected one or more")
        at = integer("k", k, least=-count, most=count - 1) % count
        step, before = result[at], result[at - 1] if at else result.start
        if step.load is None or (before is not None and before.load is None):
            raise ValueError(
                f"step {at} of result, or the step before it, has no loads: give the result of "
                "problem.solve, not one from a file or the first step from a bp.State"
            )
        if step.frame is not None or (before is not None and before.frame is not None):
            raise ValueError(
                f"step {at} of result, or the step before it, has frames of its own: the "
                "functionals need those of B"
            )
        start: OpenRecord = {}
        if before is not None:
            u0, offset = before.displacement, structure.gap.copy()
            moved = (structure.matrix @ u0).reshape(offset.shape)
            offset[:, 1:] = -moved[:, 1:]
            if before.dilation is not None:
                offset[:, 0] -= before.dilation
            start["offset"] = offset
            if increments:
                start = {"reaction": before.reaction, "displacement": u0}
                start |= {"carried": before.load, "offset": offset + moved}
        return cls(structure, step.load, step.prescribed, broken=step.broken, **start)

    def relative_displacement(self, du: ArrayLike) -> Floats:
        """``v = B du + offset``, ``(n_c, d)``: gap at the end and slip of the step."""
        return self._relative(self._admissible(du)) + self.offset

    def strain_energy(self, du: ArrayLike) -> float:
        """``V = ½ duᵀ K du``, the strain energy of (64)."""
        return self._energy(self._admissible(du))

    def elastic_answer(
        self,
        dr: ArrayLike,
        at_supports: ArrayLike | None = None,
        soils: SoilFields = (),
    ) -> Floats | None:
        """Elastic displacement ``w (n,)``: ``K w = load + Bᵀ dr`` at free degrees of freedom.

        The stresses of ``w`` are statically admissible (20) with the reactions ``dr`` and
        the stresses of soils. With redundant supports there are several such fields; ``w`` at
        the prescribed degrees of freedom selects one. By default these values are the
        prescribed ones, which minimise [dSF91, 27]. Other values ``at_supports
        (len(fixed),)`` give other support forces. Where no elastic body is, ``w`` is zero.

        ``None`` if loads and ``dr`` do not balance on a free rigid motion, ``Rᵀ r + e ≠ 0``.
        """
        reaction = floats("dr", dr, shape=self._shape)
        ends = self.prescribed
        if at_supports is not None:
            ends = floats("at_supports", at_supports, shape=ends.shape)
        rest, bodies = self.load - self._find_forces(soils), self._bodies
        w = np.zeros(len(rest))
        if not len(bodies):
            return w
        core = self._elastic.stiffness.core
        here = np.isin(self._fixed, bodies)
        _, modes, force = core.free_part(rest[bodies], ends[here])
        if len(force):
            lack = np.abs(modes @ reaction.ravel() + force).max()
            # e has the rounding of the loads, even where the loads balance each other.
            carried = np.linalg.norm(self._contact.T @ reaction.ravel())
            size = np.linalg.norm(rest) + carried + np.linalg.norm(force)
            if lack > _SLACK * size:
                return None
        motion = np.zeros(len(force))
        (w[bodies],) = core.displacements(
            [(rest[bodies], ends[here], reaction, motion)]
        )
        return w

    @cached_property
    def _bodies(self) -> Ints:
        """Degrees of freedom of the elastic bodies: all that not points alone hold."""
        alone = np.zeros(len(self.load), np.bool_)
        for group in self._structure.points:
            alone[group.strain.indices] = True
        alone[np.diff(self._stiffness.indptr) > 0] = False
        return np.flatnonzero(~alone)

    @cached_property
    def _elastic(self) -> ContactProblem:
        """The problem of the elastic bodies alone, whose factor is used."""
        bodies = self._bodies
        return ContactProblem(
            self._stiffness[bodies][:, bodies],
            self._contact[:, bodies],
            gap=np.zeros(self._shape),
            mu=0.0,
            fixed=np.searchsorted(bodies, np.intersect1d(self._fixed, bodies)),
            dim=self._shape[1],
        )

    def _find_forces(self, soils: SoilFields) -> Floats:
        """Nodal forces that balance the change of the stresses of soils."""
        force = np.zeros(len(self.load))
        for group, (_, stress, start) in zip(
            self._structure.points, soils, strict=bool(soils)
        ):
            force += group.forces(stress) - group.forces(start)
        return force

    def complementary_energy(
        self, dr: ArrayLike, at_supports: ArrayLike | None = None
    ) -> float:
        """``W = ½ wᵀ K w`` with ``w`` of `elastic_answer`; infinite where that is ``None``."""
        w = self.elastic_answer(dr, at_supports)
        return np.inf if w is None else self._energy(w)

    def potential(self, du: ArrayLike) -> float:
        """``Φ = V - load·du``: (26), or (67) for increments."""
        u = self._admissible(du)
        return self._energy(u) - float(self.load @ u)

    def complementary(
        self,
        dr: ArrayLike,
        at_supports: ArrayLike | None = None,
        soils: SoilFields = (),
    ) -> float:
        """``Π = W - s·prescribed``, ``s`` the support forces: (27), or (71) for increments.

        Infinite if reactions and loads do not balance on a free rigid motion.
        """
        w = self.elastic_answer(dr, at_supports, soils)
        if w is None:
            return np.inf
        reaction = np.asarray(dr, np.float64)
        support = self._stiffness @ w - self.load - self._contact.T @ reaction.ravel()
        support += self._find_forces(soils)
        return self._energy(w) - float(support[self._fixed] @ self.prescribed)

    def bipotential(self, du: ArrayLike, dr: ArrayLike) -> Floats:
        """(54) of each contact, ``b(-B du, dr)``, ``(n_c,)``; infinite outside its domain.

        As printed, without the constant of `start_work`. If the offset has a tangential
        part ``c`` (from ``gap`` or from a slip history), the slip is ``B_t du + c``, and
        ``dr_t·c`` is added.
        """
        u, reaction = self._admissible(du), floats("dr", dr, shape=self._shape)
        moved = self._relative(u)
        v, r = moved + self.offset, self._before + reaction
        at_start = self._before * moved + reaction * self.offset
        finite = at_start.sum(axis=1) + self._law.limit(r) * self._slip(v)
        size = self._reach + (abs(self._contact) @ np.abs(u)).max(initial=0.0)
        size += np.abs(self.offset).max(initial=0.0)
        outside = v[:, 0] < self._law.dilatancy * self._slip(v) - _SLACK * size
        outside |= self._beyond(r)
        return np.where(outside, np.inf, finite)

    def bifunctional(
        self,
        du: ArrayLike,
        dr: ArrayLike,
        soils: SoilFields = (),
        at_supports: ArrayLike | None = None,
    ) -> float:
        """``B = Φ + Π + Σ b + ∫ β dΩ``: (23), with the sign of ``u`` from (21).

        β is that of the plastic points, with their flow as an argument of its own: not less
        than its minimum over flows, and the same at solutions. B is never less than
        ``-start_work``, which is zero if the start state is complementary; equal at
        solutions only. Infinite outside the domain of a bipotential or without balance.
        Where only soils bear a load, its balance is not checked.
        """
        total = float(self.bipotential(du, dr).sum())
        u = np.asarray(du, np.float64)
        for group, (flow, stress, start) in zip(
            self._structure.points, soils, strict=True
        ):
            beta = group.bipotential(group.strains(u), flow, stress, start)
            total += float(group.weights @ beta)
        if not np.isfinite(total):
            return np.inf
        return total + self.potential(du) + self.complementary(dr, at_supports, soils)

    def excess(
        self,
        du: ArrayLike,
        dr: ArrayLike,
        soils: SoilFields = (),
        at_supports: ArrayLike | None = None,
    ) -> float:
        """``½ ‖du - w‖²_K + Σ r·ṽ + ∫ [β - σ·ε] dΩ``: B above its bound ``-start_work``, (28).

        The first term is the energy of the error in equilibrium, the others are the gaps of
        the laws of contacts and points. It equals ``bifunctional + start_work`` where that is
        finite, without cancellation: its rounding is that of ``r·ṽ``, instead of ``Φ`` and
        ``Π``. Constraints are not checked; if they hold, no term is negative.
        """
        u = self._admissible(du)
        w = self.elastic_answer(dr, at_supports, soils)
        if w is None:
            return np.inf
        v = self._relative(u) + self.offset
        r = self._before + np.asarray(dr, np.float64)
        friction = self._law.limit(r) * self._slip(v)
        total = self._energy(u - w) + float(np.sum(r * v) + friction.sum())
        for group, (flow, stress, start) in zip(
            self._structure.points, soils, strict=True
        ):
            gap = group.gap(group.strains(u), flow, stress, start)
            total += float(group.weights @ gap)
        return total

    def displacement_functional(self, du: ArrayLike, dr: ArrayLike) -> float:
        """``ΔΦ_b`` (68), which ``du`` minimises for given normal reactions of ``dr``.

        Infinite where ``du`` penetrates. ``ΔΦ_b + ΔΠ_b`` is not `bifunctional`, because both
        terms contain friction, ``Σ (c + (μ - β) r_n) ‖v_t‖``.
        """
        reaction = floats("dr", dr, shape=self._shape)
        held = np.zeros_like(reaction)
        held[:, 0] = reaction[:, 0] + self._before[:, 0]
        # (68) contains only r_n of dr, so that only the constraint on du is checked.
        if not np.isfinite(self.bipotential(du, held - self._before)).all():
            return np.inf
        u = self._admissible(du)
        work = float(np.sum(self._before * self._relative(u)))
        return self.potential(u) + work + self._friction(u, reaction)

    def stress_functional(self, dr: ArrayLike, du: ArrayLike) -> float:
        """``ΔΠ_b`` (72), which ``dr`` minimises for given slip of ``du``.

        Infinite if a reaction is outside the cone, or a free rigid motion is not balanced.
        """
        reaction = floats("dr", dr, shape=self._shape)
        r = self._before + reaction
        if self._beyond(r).any():
            return np.inf
        work = float(np.sum(reaction * self.offset))
        friction = self._friction(self._admissible(du), reaction)
        return self.complementary(reaction) + work + friction

    def _admissible(self, du: ArrayLike) -> Floats:
        u = floats("du", du, shape=(self._stiffness.shape[0],), copy=False)
        lack = np.abs(u[self._fixed] - self.prescribed)
        size = np.abs(u).max(initial=0.0) + np.abs(self.prescribed).max(initial=0.0)
        if (lack > _SLACK * size).any():
            at = int(np.argmax(lack))
            dof = int(self._fixed[at])
            raise ValueError(
                f"du is {u[dof]} at degree of freedom {dof}, expected the prescribed value "
                f"{self.prescribed[at]}"
            )
        return u

    def _relative(self, u: Floats) -> Floats:
        return np.asarray(self._contact @ u, np.float64).reshape(self._shape)

    def _energy(self, u: Floats) -> float:
        return 0.5 * float(u @ (self._stiffness @ u))

    def _friction(self, u: Floats, reaction: Floats) -> float:
        slip = self._slip(self._relative(u) + self.offset)
        return float(np.sum(self._law.limit(self._before + reaction) * slip))

    def _slip(self, v: Floats) -> Floats:
        # Scaled components: friction is isotropic in them.
        return np.asarray(np.linalg.norm((self._by * v)[:, 1:], axis=1))

    def _beyond(self, r: Floats) -> Bools:
        """Contacts whose reaction is outside the cone by more than the slack."""
        force = np.abs(r).max(initial=0.0) + np.abs(self._before).max(initial=0.0)
        shear = np.linalg.norm((r / self._by)[:, 1:], axis=1)
        slack = _SLACK * force
        limit = self._law.cohesion + self._law.mu * np.maximum(r[:, 0], 0.0)
        limit += slack / self._by.min(axis=1)
        return np.asarray((r[:, 0] < -slack) | (shear > limit))


def measure_bifunctional(
    structure: Structure, start: StructureState, end: StructureState, load: ArrayLike
) -> float:
    """B of (23), from the energies, at the increments from ``start`` to ``end`` [J].

    Infinite where the fields do not satisfy the constraints of the bipotentials.

    Parameters
    ----------
    structure
        The structure.
    start, end
        States at the start and at the end of a step; that at the end may be any.
    load
        Total loads at the end without the weight, ``(n,)`` [N].
    """
    before = structure.check_state("start", start)
    after = structure.check_state("end", end)
    soils = [
        (
            group.from_strain_tensors(p1 - p0),
            group.from_tensors(s1),
            group.from_tensors(s0),
        )
        for group, p0, p1, s0, s1 in zip(
            structure.points,
            before.plastic_strain,
            after.plastic_strain,
            before.stress,
            after.stress,
            strict=True,
        )
    ]
    return Functionals.between(structure, before, after, load).bifunctional(
        after.displacement - before.displacement,
        after.reaction - before.reaction,
        soils,
    )


def of_problem(problem: ContactProblem, K: MatrixLike) -> Structure:
    """The elastic structure of a contact problem and its stiffness, which it does not keep."""
    if not isinstance(problem, ContactProblem):
        raise make_type_error("problem", problem, "a ContactProblem")
    return Structure([K], (), problem.contacts, problem.stiffness.options.fixed)
