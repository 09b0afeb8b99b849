"""One load step of a body of soil, solved by Newton's method or by displacements alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from scipy.sparse.linalg import splu

from bipot_rs._lib.short_repr import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs.theory.body_assembly import BodyAssembly
from bipot_rs.theory.elastoplastic import ElastoplasticStep, PointEnd
from bipot_rs.theory.soils import DruckerPrager

# Halvings of a Newton step: a shorter one only adds rounding.
_HALVINGS = 30
_NEWTON = 60
# Tolerance of equilibrium in a pass, relative to that of the step: what remains must come
# from the frozen limits.
_INNER = 0.01
# Rounds of passes after which Newton's method is tried again, and their length.
_ROUNDS, _PASSES = 4, 8
# Share of the elastic stiffness in Newton's matrix, which is singular where all points
# around a node yield at the apex. It changes Newton's rate of convergence by as much.
_SHARE = 1e-9

Law: TypeAlias = Callable[[Floats], PointEnd]


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyState:
    """State between two steps.

    Attributes
    ----------
    displacement
        ``(n,)`` [m].
    stress, plastic_strain
        At the quadrature points, ``(cells, points, 6)``, components as in `soils.mandel`;
        stresses [Pa], tension positive, and totals of the plastic strain.
    """

    displacement: Floats
    stress: Floats
    plastic_strain: Floats

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyStep(BodyState):
    """A solved step.

    Attributes
    ----------
    load
        Total loads ``(n,)`` [N].
    reaction
        Forces of the supports, ``(len(fixed),)`` [N].
    work
        Elastic energy of the stresses and plastic dissipation of the step,
        ``∫ ½ σ:D⁻¹σ + b(p, σ) dΩ`` [J]: the size that gap and imbalance are relative to.
    gap
        ``∫ [β - σ:ε] dΩ`` relative to ``work``: the part of B that measures the material
        law. The stresses satisfy the criterion, so that it is finite.
    imbalance
        ``√(½ r·K⁻¹r / work)``, ``r`` the forces that the stresses leave unbalanced, K the
        elastic stiffness.
    converged
        Whether gap and imbalance are at most the tolerance.
    iterations
        Newton iterations of all passes.
    history
        Gap and imbalance after each pass, ``(passes, 2)``; one row for ``"newton"``.
    """

    load: Floats
    reaction: Floats
    work: float
    gap: float
    imbalance: float
    converged: bool
    iterations: int
    history: Floats

    __repr__ = short_repr


def law_of(
    assembly: BodyAssembly, soil: DruckerPrager, start: BodyState
) -> ElastoplasticStep:
    """The law of a step at all quadrature points."""
    stress = np.reshape(start.stress, (-1, 6))
    return ElastoplasticStep(soil, assembly.bulk, assembly.shear, stress)


class StepSolver:
    """One step of a body.

    Parameters
    ----------
    assembly
        The body.
    soil
        Criterion and flow.
    start
        State at the start of the step.
    load, prescribed
        Totals at its end, ``(n,)`` [N] and ``(len(fixed),)`` [m].
    tol
        Largest gap and imbalance, see `BodyStep`.
    """

    def __init__(
        self,
        assembly: BodyAssembly,
        soil: DruckerPrager,
        start: BodyState,
        load: Floats,
        prescribed: Floats,
        tol: float,
    ) -> None:
        self.assembly, self.soil, self.start = assembly, soil, start
        self.load, self.tol = load, tol
        self.law = law_of(assembly, soil, start)
        self.moved = prescribed - start.displacement[assembly.fixed]
        self.iterations = 0

    def newton(self) -> BodyStep:
        """Newton's method; where it stalls, some passes of `displacements` lead on."""
        du, end, balanced = self._newton(self.law.response, self._predictor(), self.tol)
        for _ in range(_ROUNDS):
            if balanced:
                break
            nearer, _, held = self._passes(du, end.stress, _PASSES, [])
            if not held:
                break
            du, end, balanced = self._newton(self.law.response, nearer, self.tol)
        return self._step(du, end, [])

    def displacements(self, passes: int) -> BodyStep:
        """At most so many passes of (37), (38)."""
        du = self._predictor()
        stress = self.law.response(self.assembly.strains(du)).stress
        history: list[tuple[float, float]] = []
        du, end, _ = self._passes(du, stress, passes, history)
        return self._step(du, end, history[:-1])

    def _passes(
        self,
        du: Floats,
        stress: Floats,
        passes: int,
        history: list[tuple[float, float]],
    ) -> tuple[Floats, PointEnd, bool]:
        """Passes of (37), (38) with their gaps and imbalances; whether all were balanced.

        A pass without equilibrium has no minimum: its load is above the limit load of the
        frozen limits. It is the last.
        """
        while True:
            frozen = partial(self.law.frozen, limit=self.law.limit(stress))
            du, end, balanced = self._newton(frozen, du, _INNER * self.tol)
            stress = end.stress
            step = self._step(du, end, [])
            history.append((step.gap, step.imbalance))
            if step.converged or not balanced or len(history) == passes:
                return du, end, balanced

    def _predictor(self) -> Floats:
        """Elastic increment: the stresses of most points do not reach the criterion."""
        body = self.assembly
        du = np.zeros(len(self.load))
        du[body.fixed] = self.moved
        rest = self.load - body.forces(self.law.start) - body.elastic @ du
        du[body.free] = body.solve(rest[body.free])
        return du

    def _newton(
        self, law: Law, du: Floats, tol: float
    ) -> tuple[Floats, PointEnd, bool]:
        """Balance the load with the stresses of ``law``, and tell whether this was reached.

        The unbalanced forces are measured by ``r·K⁻¹r``, which decreases along a Newton
        step: a measure of single forces would depend on the numbering and the mesh.
        """
        body = self.assembly
        free = body.free
        end = law(body.strains(du))
        rest, size = self._find_unbalanced(end.stress)
        for _ in range(_NEWTON):
            if np.sqrt(0.5 * size) <= tol * np.sqrt(self._work(end)):
                return du, end, True
            matrix = (body.stiffness(end.tangent) + _SHARE * body.elastic).tocsr()
            move = np.zeros_like(du)
            try:
                move[free] = splu(matrix[free][:, free].tocsc()).solve(rest)
            except RuntimeError:  # singular to rounding: a mechanism
                break
            share = 1.0
            for _ in range(_HALVINGS):
                new = law(body.strains(du + share * move))
                new_rest, new_size = self._find_unbalanced(new.stress)
                if new_size <= (1 - 1e-4 * share) * size:
                    break
                share /= 2
            else:
                break
            du, end, rest, size = du + share * move, new, new_rest, new_size
            self.iterations += 1
        return du, end, False

    def _find_unbalanced(self, stress: Floats) -> tuple[Floats, float]:
        """Forces at free degrees of freedom, and ``r·K⁻¹r`` [J]."""
        rest = (self.load - self.assembly.forces(stress))[self.assembly.free]
        return rest, float(rest @ self.assembly.solve(rest))

    def _work(self, end: PointEnd) -> float:
        elastic = 0.5 * np.sum(end.stress * self.law.compliance(end.stress), axis=1)
        # Dissipation σ·p, which for `frozen` is that of its own potential.
        spent = np.abs(np.sum(end.stress * end.plastic, axis=1))
        return float(self.assembly.weights @ (elastic + spent))

    def _step(
        self, du: Floats, end: PointEnd, history: list[tuple[float, float]]
    ) -> BodyStep:
        """Judge an iterate, with its stress brought into the criterion."""
        body, start = self.assembly, self.start
        stress = self.soil.prox_at(end.stress, np.zeros_like(end.stress), 1.0)
        work = self._work(PointEnd(stress, end.plastic, end.tangent))
        gap = self.law.gap(body.strains(du), end.plastic, stress)
        _, size = self._find_unbalanced(stress)
        relative = _ratio(float(body.weights @ gap), work)
        imbalance = float(np.sqrt(_ratio(0.5 * size, work)))
        points = (*body.shape, 6)
        return BodyStep(
            displacement=start.displacement + du,
            stress=stress.reshape(points),
            plastic_strain=start.plastic_strain + end.plastic.reshape(points),
            load=self.load,
            reaction=(body.forces(stress) - self.load)[body.fixed],
            work=work,
            gap=relative,
            imbalance=imbalance,
            converged=relative <= self.tol and imbalance <= self.tol,
            iterations=self.iterations,
            history=np.array([*history, (relative, imbalance)]),
        )


def _ratio(energy: float, work: float) -> float:
    """``energy / work``. Without work only zero energy is small; rounding may be negative."""
    if not energy > 0:
        return 0.0
    return energy / work if work > 0 else float("inf")
