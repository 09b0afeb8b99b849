"""One load step of a structure: Newton's method, passes of (37), (38), and Uzawa (80), (81).

A contact is a plastic point too: with ``τ = r - ρ v``, the response of a point with springs ρ
is one step of the augmented law, and its fixed points are the reactions. Displacements and
reactions ``(u, r)`` therefore satisfy

    ``K u + ∫ σ:ε(φ_i) dΩ = f + Bᵀ r``,    ``r = respond(r - ρ v)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from bipot_rs._lib.matrices import block_diagonal, length
from bipot_rs._lib.types import CsrMatrix, Floats
from bipot_rs.contact.path.bond import Bond
from bipot_rs.theory.convex import dot
from bipot_rs.theory.points import (
    PlasticPoints,
    PointEnd,
    Rate,
    critical_hardening,
    find_ellipticity,
)
from bipot_rs.theory.structure_state import (
    LACK_ACROSS,
    Assembled,
    StructureState,
    StructureStep,
)

# Halvings of a Newton step: shorter ones creep along a kink.
_HALVINGS = 12
_NEWTON = 60
# Tolerance of a pass, relative to that of the step: what remains must come from the frozen
# limits, or from rounding.
_INNER, _ROUNDING = 0.01, 1e-14
# Rounds of passes, or of sweeps, after which Newton's method is tried again, and their lengths.
_ROUNDS, _PASSES, _SWEEPS = 4, 8, 40
# Most multipliers of the rate term, and the imbalance of the law itself from which Newton's
# method is tried again.
_MULTIPLIERS, _NEAR = 40, 1e-3
# Factor of the hardening from one multiplier to the next. Without it (1) the footing of chapter
# 12 without dilatancy stalls at its tenth of thirty steps; one half solves all. Above a limit load
# the slips grow with the inverse of the hardening, and so does the work that the imbalance is
# relative to: with the least share, 40 multipliers reduce it by less than 1e3.
_LESS, _LEAST = 0.5, 1 / 64
# Share of the elastic stiffness in Newton's matrix, which is singular where all points
# around a node yield at the apex, and of 1 in the rows of contacts, for redundant ones. They
# change Newton's rate of convergence by as much.
_SHARE, _REDUNDANT = 1e-9, 1e-14
# Factor of the springs along surfaces where supports prescribe the slip.
_GUIDED = 1e6
# Pivots off the diagonal only where that is smaller by this factor: the pattern is symmetric.
_PIVOT = 0.01
# The least reduction of the residual for which a converged Newton iteration goes on.
_WORTH = 1e-4


class Limits(NamedTuple):
    """Frozen limits of the points of each soil, and of the contacts."""

    points: tuple[Floats, ...]
    contacts: Floats


class Iterate(NamedTuple):
    """A point of an iteration, with what it lacks.

    Attributes
    ----------
    du, r
        Increment of displacement, reaction of the contacts.
    ends
        Response of the points of each soil.
    rest
        Unbalanced forces at free degrees of freedom.
    lack, by_tau
        ``r - respond(r - ρ v)``, and the derivative of the response.
    energy
        ``½ g·K̂⁻¹ g + ½ Σ lack²/ρ`` [J]: it decreases along a Newton step. A measure of
        single forces would depend on the numbering and the mesh.
    """

    du: Floats
    r: Floats
    ends: tuple[PointEnd, ...]
    rest: Floats
    lack: Floats
    by_tau: Floats
    energy: float


# The iterate of displacements and reactions.
Evaluate: TypeAlias = Callable[[Floats, Floats], Iterate]


class Certificate(NamedTuple):
    """Stresses and reactions in the laws, the work, and gaps and imbalance of `StructureStep`."""

    stresses: list[Floats]
    r: Floats
    work: float
    gaps: tuple[float, float, float]


class StepSolver:
    """One step of a structure.

    Parameters
    ----------
    structure, start
        The structure, and its state at the start of the step.
    load, prescribed, gap
        Totals at its end: ``(n,)`` with the weight [N], ``(len(fixed),)`` and ``(n_c, d)`` [m].
    tol
        Largest gaps and imbalance.
    bond
        What is left of the cohesion of the contacts, and their dilation.
    """

    def __init__(
        self,
        structure: Assembled,
        start: StructureState,
        load: Floats,
        prescribed: Floats,
        gap: Floats,
        tol: float,
        bond: Bond,
    ) -> None:
        self.structure, self.start, self.tol = structure, start, tol
        self.bond, self.law = bond, structure.weaken(bond.broken)
        self.load, self.gap = load, gap
        self.moved = prescribed - start.displacement[structure.fixed]
        self.stress0 = tuple(
            group.from_tensors(field)
            for group, field in zip(structure.points, start.stress, strict=True)
        )
        offset = gap.copy()
        offset[:, 1:] -= start.gap[:, 1:]
        self.offset = structure.by * offset
        self.offset[:, 0] += self._relative(start.displacement)[:, 0]
        if bond.dilation is not None:
            self.offset[:, 0] -= bond.dilation
        self.rho = np.repeat(structure.springs[:, None], structure.shape[1], axis=1)
        # A slip that supports prescribe is at the limit, however short it is.
        self.rho[structure.guided, 1:] *= _GUIDED
        # Where contacts hold all at rest, the others are rounding. Not from reactions: those of
        # contacts that hold each other may grow without bound, and hide what is wrong.
        rest = load[structure.free]
        self.least_work = 0.5 * float(rest @ structure.solve_elastic(rest))
        self.iterations = 0

    def solve(self, method: str, most: int) -> StructureStep:
        """The step by one of the methods, converged or the last iterate."""
        if method == "newton":
            return self._by_newton()
        if method == "displacements":
            history: list[tuple[float, float, float]] = []
            at, _ = self._passes(self._predict(), most, history)
            return self.judge(at, history[:-1])
        return self._by_uzawa(most)

    def _by_newton(self) -> StructureStep:
        """Newton's method; where it stalls, passes or the rate term lead on."""
        at, balanced = self._newton(self._predict())
        for _ in range(_ROUNDS):
            if balanced:
                break
            nearer, held = self._passes(at, _PASSES, [])
            if not held:
                break
            at, balanced = self._newton(self.evaluate(nearer.du, nearer.r))
        if not balanced:
            at = self._multiply(at)
        return self.judge(at, [])

    def _by_uzawa(self, most: int) -> StructureStep:
        """(80), (81): an elastic solution, then one projection of each stress and reaction."""
        at = self._predict()
        for _ in range(most):
            # The energy is of second order in what the certificate is of first order in.
            near = np.sqrt(at.energy) <= self.tol * np.sqrt(self.work(at))
            if near and max(self.certify(at).gaps) <= self.tol:
                break
            at = self._sweep(at, self.evaluate)
            self.iterations += 1
        return self.judge(at, [])

    def _sweep(self, at: Iterate, evaluate: Evaluate) -> Iterate:
        """The projections (81) of an iterate, and the elastic solution of what is unbalanced."""
        structure, du, r = self.structure, at.du.copy(), at.r - at.lack
        force = structure.B.T @ (r - at.r).ravel()
        du[structure.free] += structure.solve_elastic(at.rest + force[structure.free])
        return evaluate(du, r)

    def _multiply(self, at: Iterate) -> Iterate:
        """The rate term with multipliers: friction that grows with slip beyond the last one.

        With the critical hardening no band of strain forms. Where the slips settle, the term
        has gone, and the law holds. They settle faster with less hardening, which is reduced
        until the step with the term stalls too. Newton's method is tried from near there.
        """
        points = self.structure.points
        before = [np.zeros(len(group.weights)) for group in points]
        critical = [critical_hardening(group) for group in points]
        share = 1.0
        for _ in range(_MULTIPLIERS):
            rates = [
                Rate(share * hardening, slip)
                for hardening, slip in zip(critical, before, strict=True)
            ]
            nearer, balanced = self._newton(
                self.evaluate(at.du, at.r, rates=rates), rates=rates
            )
            if not balanced:
                if share >= 1.0:
                    return at
                share *= _LESS**-1.5
                continue
            before = [length(end.flow[:, 1:]) for end in nearer.ends]
            at = self.evaluate(nearer.du, nearer.r)
            share = max(_LESS * share, _LEAST)
            if at.energy <= _NEAR**2 * self.work(at):
                solved, balanced = self._newton(at)
                if balanced:
                    return solved
        return at

    def _passes(
        self, at: Iterate, passes: int, history: list[tuple[float, float, float]]
    ) -> tuple[Iterate, bool]:
        """Passes of (37), (38) with their certificates; whether all were balanced.

        A pass without equilibrium has no minimum: its load is above the limit load of the
        frozen limits. It is the last.
        """
        points = self.structure.points
        while True:
            limits = Limits(
                tuple(
                    group.law.limit(end.stress)
                    for group, end in zip(points, at.ends, strict=True)
                ),
                self.law.limit(at.r),
            )
            frozen = self.evaluate(at.du, at.r, limits=limits)
            at, balanced = self._newton(
                frozen, limits=limits, tol=max(_INNER * self.tol, _ROUNDING)
            )
            gaps = self.certify(at).gaps
            history.append(gaps)
            if max(gaps) <= self.tol or not balanced or len(history) == passes:
                return at, balanced

    def _predict(self) -> Iterate:
        """Elastic increment with the reactions of the start: most points do not yield."""
        structure = self.structure
        du = np.zeros(structure.n)
        du[structure.fixed] = self.moved
        r = self.start.reaction / structure.by
        rest = self.load + structure.B.T @ r.ravel() - structure.elastic @ du
        rest -= structure.K @ self.start.displacement
        for group, stress in zip(structure.points, self.stress0, strict=True):
            rest -= group.forces(stress)
        du[structure.free] = structure.solve_elastic(rest[structure.free])
        return self.evaluate(du, r)

    def evaluate(
        self,
        du: Floats,
        r: Floats,
        *,
        limits: Limits | None = None,
        rates: list[Rate] | None = None,
    ) -> Iterate:
        """The iterate of displacements and reactions, with the law, frozen or with rates."""
        structure = self.structure
        ends = tuple(
            group.respond(
                group.strains(du),
                self.stress0[k],
                frozen=None if limits is None else limits.points[k],
                rate=None if rates is None else rates[k],
            )
            for k, group in enumerate(structure.points)
        )
        tau = r - self.rho * self.find_displacement(du)
        contact = self.law.respond(
            tau,
            self.rho[:, :2],
            frozen=None if limits is None else limits.contacts,
        )
        lack = r - contact.stress
        rest, size = self._find_unbalanced(du, [end.stress for end in ends], r)
        energy = size + 0.5 * float(np.sum(lack**2 / structure.springs[:, None]))
        return Iterate(du, r, ends, rest, lack, contact.jacobian, energy)

    def find_displacement(self, du: Floats) -> Floats:
        """``v`` of the contacts: their gap at the end and the slip of the step."""
        return self._relative(du) + self.offset

    def _relative(self, u: Floats) -> Floats:
        return np.asarray((self.structure.B @ u).reshape(self.structure.shape))

    def _find_unbalanced(
        self, du: Floats, stresses: list[Floats], r: Floats
    ) -> tuple[Floats, float]:
        """Forces at free degrees of freedom, and ``½ g·K̂⁻¹ g`` [J]."""
        whole = self.load - self.forces(du, stresses, r)
        rest = whole[self.structure.free]
        return rest, 0.5 * float(rest @ self.structure.solve_elastic(rest))

    def forces(self, du: Floats, stresses: list[Floats], r: Floats) -> Floats:
        """Nodal forces that balance the stresses and reactions, ``(n,)`` [N]."""
        structure = self.structure
        force = structure.K @ (self.start.displacement + du)
        for group, stress in zip(structure.points, stresses, strict=True):
            force = force + group.forces(stress)
        return np.asarray(force - structure.B.T @ r.ravel())

    def work(self, at: Iterate) -> float:
        """The size that energies are relative to [J]."""
        return self._work(
            at.du, [e.stress for e in at.ends], [e.flow for e in at.ends], at.r
        )

    def _work(
        self, du: Floats, stresses: list[Floats], flows: list[Floats], r: Floats
    ) -> float:
        u = self.start.displacement + du
        total = 0.5 * float(u @ (self.structure.K @ u))
        total += float(np.abs(dot(r, self.find_displacement(du))).sum())
        for group, stress, flow in zip(
            self.structure.points, stresses, flows, strict=True
        ):
            total += float(group.weights @ group.work(flow, stress))
        return max(total, self.least_work)

    def _newton(
        self,
        at: Iterate,
        *,
        limits: Limits | None = None,
        rates: list[Rate] | None = None,
        tol: float | None = None,
    ) -> tuple[Iterate, bool]:
        """Solve for displacements and reactions, and tell whether this was reached."""
        enough = self.tol if tol is None else tol

        def evaluate(du: Floats, r: Floats) -> Iterate:
            return self.evaluate(du, r, limits=limits, rates=rates)

        rounds, near = 0, at
        for _ in range(_NEWTON * (1 + _ROUNDS)):
            reached = np.sqrt(at.energy) <= enough * np.sqrt(self.work(at))
            after = self._newton_step(at, evaluate) if at.energy > 0 else None
            if after is None and (reached or rounds == _ROUNDS):
                return at, bool(reached)
            if after is None:
                # Nearer by Uzawa's way, which needs no derivative, from where it began.
                before = near.energy
                for _ in range(_SWEEPS << rounds):
                    near = self._sweep(near, evaluate)
                at, rounds = near, rounds + 1
                if near.energy > 0.5 * before:
                    rounds = _ROUNDS
                continue
            # The certificate is of first order where the energy is of second.
            if reached and after.energy > _WORTH * at.energy:
                return after, True
            at = after
            self.iterations += 1
        return at, bool(np.sqrt(at.energy) <= enough * np.sqrt(self.work(at)))

    def _newton_step(self, at: Iterate, evaluate: Evaluate) -> Iterate | None:
        """A Newton step along which the energy falls; None if there is none."""
        structure = self.structure
        (contacts, d), free = structure.shape, structure.free
        matrix = structure.K + _SHARE * structure.elastic
        for group, end in zip(structure.points, at.ends, strict=True):
            matrix = matrix + group.stiffness_matrix(end.jacobian)
        inner: CsrMatrix = matrix.tocsr()[free][:, free]
        B = structure.B[:, free]
        # The unknowns are du and dr/ρ, so that all entries are stiffnesses.
        springs = structure.springs[:, None, None]
        rho = sparse.diags_array(np.repeat(structure.springs, d))
        by_v = block_diagonal(at.by_tau * self.rho[:, None]) @ B
        kept = np.full((contacts, d), _REDUNDANT)
        # Where a guided contact sticks, nothing determines its friction: it stays.
        sticks = (at.by_tau[:, 1:, 1:] == np.eye(d - 1)).all(axis=(1, 2))
        kept[structure.guided & sticks, 1:] = 1.0
        by_r = block_diagonal(springs * (np.eye(d) * (1 + kept)[:, None] - at.by_tau))
        system = sparse.block_array([[inner, -B.T @ rho], [by_v, by_r]])
        try:
            factor = splu(
                system.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=_PIVOT,
                options={"SymmetricMode": True},
            )
            move = factor.solve(np.concatenate([at.rest, -at.lack.ravel()]))
        except RuntimeError:  # singular to rounding: a mechanism
            return None
        step = np.zeros(structure.n)
        step[free] = move[: len(free)]
        dr = structure.springs[:, None] * move[len(free) :].reshape(contacts, d)
        share = 1.0
        for _ in range(_HALVINGS):
            after = evaluate(at.du + share * step, at.r + share * dr)
            if after.energy <= (1 - 1e-4 * share) * at.energy:
                return after
            share /= 2
        return None

    def certify(self, at: Iterate) -> Certificate:
        """The certificate of an iterate, with stresses and reactions brought into the laws."""
        points = self.structure.points
        stresses = [
            group.law.clip(end.stress)
            for group, end in zip(points, at.ends, strict=True)
        ]
        flows = [end.flow for end in at.ends]
        r = self.law.clip(at.r)
        work = self._work(at.du, stresses, flows, r)
        soil = sum(
            float(group.weights @ group.gap(group.strains(at.du), flow, stress, before))
            for group, flow, stress, before in zip(
                points, flows, stresses, self.stress0, strict=True
            )
        )
        _, size = self._find_unbalanced(at.du, stresses, r)
        gaps = (
            _ratio(soil, work),
            _ratio(self._find_contact_gap(at.du, r), work),
            float(np.sqrt(_ratio(size, work))),
        )
        return Certificate(stresses, r, work, gaps)

    def judge(
        self, at: Iterate, history: list[tuple[float, float, float]]
    ) -> StructureStep:
        """The step of an iterate."""
        structure, start, points = self.structure, self.start, self.structure.points
        stresses, r, work, gaps = self.certify(at)
        tensors = tuple(
            group.to_tensors(stress, before)
            for group, stress, before in zip(
                points, stresses, start.stress, strict=True
            )
        )
        across = max(map(_find_lack_across, points, tensors, stresses), default=0.0)
        v = self.find_displacement(at.du)
        opening = structure.springs * (v[:, 0] - self.law.lift(v))
        least = self.tol * np.hypot(np.linalg.norm(r), np.linalg.norm(self.rho * v))
        total = self._relative(start.displacement + at.du) / structure.by
        return StructureStep(
            displacement=start.displacement + at.du,
            reaction=structure.by * r,
            gap=self.gap,
            stress=tensors,
            plastic_strain=tuple(
                total + group.to_strain_tensors(end.flow)
                for group, total, end in zip(
                    points, start.plastic_strain, at.ends, strict=True
                )
            ),
            load=self.load,
            support=(self.forces(at.du, stresses, r) - self.load)[structure.fixed],
            relative_displacement=total + self.gap,
            slip=(v / structure.by)[:, 1:],
            opened=(at.r[:, 0] == at.lack[:, 0]) & (opening > least),
            broken=self.bond.broken,
            dilation=self.bond.dilation,
            work=work,
            gap_soil=gaps[0],
            gap_contact=gaps[1],
            imbalance=gaps[2],
            converged=max(gaps) <= self.tol and across <= max(self.tol, LACK_ACROSS),
            lack_across=across,
            # Of the law itself, also where the limits of the iterate were frozen.
            ellipticity=tuple(
                find_ellipticity(group, group.respond(group.strains(at.du), before))
                for group, before in zip(points, self.stress0, strict=True)
            ),
            second_order_work=self._find_second_order_work(at.du, stresses),
            associated=self.law.associated
            and all(group.law.associated for group in points),
            iterations=self.iterations,
            history=np.array([*history, gaps]),
        )

    def _find_contact_gap(self, du: Floats, r: Floats) -> float:
        """``Σ [b(-v, r) + r·v]``, and the work and energy of penetrations [J]."""
        v = self.find_displacement(du)
        least = self.law.lift(v)
        into = np.maximum(least - v[:, 0], 0.0)
        v[:, 0] = np.maximum(v[:, 0], least)
        gap = self.law.gap(v, r) + r[:, 0] * into
        return float(np.sum(gap + 0.5 * self.structure.springs * into**2))

    def _find_second_order_work(self, du: Floats, stresses: list[Floats]) -> float:
        """``∫ Δσ:Δε`` relative to ``∫ Δε:D:Δε``."""
        work = elastic = 0.0
        for group, stress, before in zip(
            self.structure.points, stresses, self.stress0, strict=True
        ):
            x = group.strains(du)
            work += float(group.weights @ dot(before - stress, x))
            elastic += float(group.weights @ dot(group.springs * x, x))
        return work / elastic if elastic > 0 else 1.0


def _find_lack_across(group: PlasticPoints, tensors: Floats, stress: Floats) -> float:
    """`PlasticPoints.lack_across` relative to the stress, and a lost apex without friction."""
    lack = group.lack_across(tensors)
    size = group.apex * group.law.mu + group.law.cohesion + length(group.rest - stress)
    worst = np.max(np.divide(lack, size, out=np.zeros_like(lack), where=size > 0))
    flat = (group.law.cohesion > 0) & (stress[:, 0] <= 0)
    return 1.0 if flat.any() and group.components.shape[1] == 6 else float(worst)


def _ratio(energy: float, work: float) -> float:
    """``energy / work``. Without work only zero energy is small; rounding may be negative."""
    if not energy > 0:
        return 0.0
    return energy / work if work > 0 else float("inf")
