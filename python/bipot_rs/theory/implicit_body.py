"""A body of an implicit standard material: the boundary-value problem (19)–(23) of [dSF91].

The material has the bipotential β of `elastoplastic`, there is no contact (``S_2`` is
empty), and ``u`` is prescribed at some degrees of freedom. For increments ``Δu`` of a step,
total loads ``f`` and total stresses ``σ``, (23) is

    ``B(Δu, σ) = ∫ β(ε(Δu), σ) dΩ - f·Δu - s·Δū``,    s the forces of the supports.

If ``Δu`` and ``σ`` are admissible, ``B = ∫ [β(ε(Δu), σ) - σ:ε(Δu)] dΩ >= 0``, and zero at
solutions only. A stress is admissible if it satisfies the criterion and balances the loads
in the weak sense, tested with the shape functions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import splu

from bipot_rs._lib.messages import mistyped
from bipot_rs._lib.short_repr import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, indices, integer, loads, number, one_of
from bipot_rs.fem.body import Body, Field
from bipot_rs.fem.materials import Material
from bipot_rs.fem.stress_recovery import slopes_at_points
from bipot_rs.theory.elastoplastic import ElastoplasticStep, Response
from bipot_rs.theory.limit_load import LimitLoadError, StepNotConvergedError, mechanism
from bipot_rs.theory.soils import DruckerPrager, mandel

METHODS = ("newton", "displacements")
# Halvings of a Newton step: a shorter one only adds rounding.
_HALVINGS = 30
_NEWTON = 60
# A pass of the displacement method is solved this much more exactly than the step.
_INNER = 0.01
# Share of the elastic stiffness in Newton's matrix, which is singular where all points
# around a node yield at the apex. It changes Newton's rate of convergence by as much.
_SHARE = 1e-9

Law: TypeAlias = Callable[[Floats], Response]


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
        Gap and imbalance after each pass, ``(passes, 2)``; ``"newton"`` has one pass.
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


class ImplicitBody:
    """An elastic body with Drucker–Prager flow.

    Parameters
    ----------
    body
        Mesh and elasticity, isotropic, in 2D in plane strain. Its volumes may have
        different moduli.
    soil
        Criterion and flow, the same in the whole body.
    fixed
        Degrees of freedom ``dim * node + component`` with prescribed displacement. They
        must stop all rigid motions.

    Attributes
    ----------
    shape
        ``(cells, points)`` of the quadrature.
    weights
        Volumes that the quadrature points stand for, ``(cells, points)`` [m³].

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    def __init__(self, body: Body, soil: DruckerPrager, fixed: ArrayLike) -> None:
        if not isinstance(body, Body):
            raise mistyped("body", body, "a bipot_rs.fem.Body")
        if not isinstance(soil, DruckerPrager):
            raise mistyped("soil", soil, "a DruckerPrager")
        self.body, self.soil = body, soil
        moduli = _moduli(body)
        self.weights = body.depth * body.volume().weights
        self.shape = self.weights.shape
        n = body.points.size
        self.fixed = indices("fixed", fixed, n)
        _check_supports(body, self.fixed)
        self._free = np.setdiff1d(np.arange(n), self.fixed)
        self._strain = _strain_matrix(body)
        points = self.weights.size
        self._bulk, self._shear = np.repeat(moduli, self.shape[1], axis=1)
        law = self._law(self.at_rest())
        elastic = law.elastic(np.broadcast_to(np.eye(6)[:, None], (6, points, 6)))
        self._elastic = self._stiffness(elastic.swapaxes(0, 1))
        self._factor = splu(self._elastic[self._free][:, self._free].tocsc())

    def at_rest(self, stress: Field | None = None) -> BodyState:
        """State without displacement, with an initial stress.

        Parameters
        ----------
        stress
            A constant tensor ``(3, 3)``, tensors ``(3, 3, cells, points)``, or a function
            of the positions ``(d, cells, points)`` that returns one of these [Pa]; by
            default zero. It need not balance a load: the first step brings it into
            equilibrium.

        Raises
        ------
        ValueError
            The stress has a wrong shape or violates the criterion.
        """
        zero = np.zeros((*self.shape, 6))
        start = BodyState(
            displacement=np.zeros(self.body.points.size),
            stress=zero,
            plastic_strain=zero,
        )
        if stress is None:
            return start
        places = self.body.volume().places
        given = floats("stress", stress(places) if callable(stress) else stress)
        if given.shape not in ((3, 3), (3, 3, *self.shape)):
            raise ValueError(
                f"stress has shape {given.shape}, expected (3, 3) or "
                f"{(3, 3, *self.shape)}"
            )
        if given.ndim == 2:
            given = given[..., None, None]
        found = mandel(np.moveaxis(given, (0, 1), (-2, -1)))
        return self._checked(replace(start, stress=np.broadcast_to(found, zero.shape)))

    def strain(self, displacement: ArrayLike) -> Floats:
        """Strain at the quadrature points, ``(cells, points, 6)``."""
        n = self.body.points.size
        u = floats("displacement", displacement, shape=(n,))
        return self._strains(u).reshape(*self.shape, 6)

    def internal_forces(self, stress: ArrayLike) -> Floats:
        """Nodal forces ``∫ σ:ε(φ_i) dΩ`` that balance a stress field, ``(n,)`` [N]."""
        given = floats("stress", stress, shape=(*self.shape, 6))
        return self._forces(given.reshape(-1, 6))

    def solve(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        start: BodyState | None = None,
        method: str = "newton",
        tol: float = 1e-10,
        max_iterations: int = 200,
    ) -> tuple[BodyStep, ...]:
        """Solve load steps, each from the end of the one before.

        ``"newton"`` solves equilibrium with the law (22) by Newton's method, whose matrix is
        not symmetric. ``"displacements"`` is (37), (38): each pass minimises
        ``B(·, σ_i)``, which is the problem of a body with associated flow and the limits of
        ``σ_i``. Both are judged alike: by the gap of the bipotential and by equilibrium.

        Parameters
        ----------
        load, prescribed
            Totals at the end of each step, ``(steps, n)`` [N] and ``(steps, len(fixed))``
            [m]; one without steps serves for all; default zero.
        start
            State at the start, from `at_rest` or a `BodyStep`; default no stress.
        method
            ``"newton"`` or ``"displacements"``.
        tol
            Largest gap and imbalance, see `BodyStep`.
        max_iterations
            Largest number of passes of a step.

        Raises
        ------
        LimitLoadError
            No stress that satisfies the criterion balances the load.
        StepNotConvergedError
            A step did not reach the tolerance. Both carry the steps before.
        TypeError, ValueError
            A wrong argument.
        """
        one_of("method", method, METHODS)
        tol = number("tol", tol)
        if not 0 < tol < 1:
            raise ValueError(f"tol is {tol}, expected a number between 0 and 1")
        passes = integer("max_iterations", max_iterations, least=1)
        n = self.body.points.size
        state = self.at_rest() if start is None else self._checked(start)
        found: list[BodyStep] = []
        for force, moved in loads(load, prescribed, n, len(self.fixed)):
            step = _Step(self, state, force, moved, tol)
            state = step.solve(passes if method == "displacements" else 0)
            if not state.converged:
                self._refuse(tuple(found), state)
            found.append(state)
        return tuple(found)

    def bifunctional(self, start: BodyState, end: BodyState, load: ArrayLike) -> float:
        """B of (23), from the energies, at the increments from ``start`` to ``end`` [J].

        The minimum over ``p`` in β is replaced by the increment of plastic strain, which
        is an upper bound and the same at solutions. The value is infinite if ``end``
        violates the criterion or the plastic strain dilates too little. It is not negative
        if the stress of ``end`` balances the load.
        """
        force = floats("load", load, shape=(self.body.points.size,))
        law = self._law(start)
        du = end.displacement - start.displacement
        p = (end.plastic_strain - start.plastic_strain).reshape(-1, 6)
        stress = end.stress.reshape(-1, 6)
        energy = law.energy(self._strains(du) - p) + law.split_bipotential(p, stress)
        supports = (self._forces(stress) - force)[self.fixed]
        total = self.weights.ravel() @ energy - force @ du
        return float(total - supports @ du[self.fixed])

    def _refuse(self, found: tuple[BodyStep, ...], step: BodyStep) -> None:
        """Raise the error of a step that did not converge."""
        flow = mechanism(self, step.load)
        which = f"step {len(found)}"
        if flow is not None:
            raise LimitLoadError(
                f"the load of {which} is above the limit load: no stress satisfies the "
                "criterion and balances it, because on the mechanism of this error the "
                "load does more work than the soil can dissipate; reduce the load, or "
                "prescribe displacements",
                found,
                flow,
            )
        raise StepNotConvergedError(
            f"{which} did not converge: gap {step.gap:.1e}, imbalance "
            f"{step.imbalance:.1e}. Its load may be above the limit load of the flow, "
            "or the step too large: use smaller steps, or prescribe displacements",
            found,
            step,
        )

    def _checked(self, state: BodyState) -> BodyState:
        """Refuse a state of another shape, or with a stress outside the criterion."""
        if not isinstance(state, BodyState):
            raise mistyped("start", state, "a BodyState")
        points = (*self.shape, 6)
        u = floats("displacement of start", state.displacement)
        stress = floats("stress of start", state.stress, shape=points)
        plastic = floats("plastic_strain of start", state.plastic_strain, shape=points)
        if u.shape != (self.body.points.size,):
            raise ValueError(
                f"displacement of start has shape {u.shape}, expected "
                f"({self.body.points.size},)"
            )
        outside = np.isinf(self.soil.bipotential(np.zeros(points), stress))
        if outside.any():
            cell, point = np.argwhere(outside)[0]
            over = self.soil.criterion(stress)[cell, point]
            raise ValueError(
                f"stress of start violates the criterion at point {point} of cell {cell} "
                f"by {over:g}: start from an admissible stress"
            )
        return BodyState(displacement=u, stress=stress, plastic_strain=plastic)

    def _law(self, start: BodyState) -> ElastoplasticStep:
        stress = np.reshape(start.stress, (-1, 6))
        return ElastoplasticStep(self.soil, self._bulk, self._shear, stress)

    def _strains(self, u: Floats) -> Floats:
        return np.asarray((self._strain @ u).reshape(-1, 6))

    def _forces(self, stress: Floats) -> Floats:
        weighted = self.weights.reshape(-1, 1) * stress
        return np.asarray(self._strain.T @ weighted.ravel())

    def _stiffness(self, tangent: Floats) -> Any:
        """``∫ ε(φ_i):C:ε(φ_j) dΩ``, CSR."""
        points = len(tangent)
        blocks = self.weights.reshape(-1, 1, 1) * tangent
        law = sparse.bsr_array(
            (blocks, np.arange(points), np.arange(points + 1)),
            shape=(6 * points, 6 * points),
        )
        return (self._strain.T @ (law.tocsr() @ self._strain)).tocsr()


class _Step:
    """One step of an `ImplicitBody`."""

    def __init__(
        self,
        owner: ImplicitBody,
        start: BodyState,
        load: Floats,
        prescribed: Floats,
        tol: float,
    ) -> None:
        self.owner, self.start, self.load, self.tol = owner, start, load, tol
        self.law = owner._law(start)
        self.moved = prescribed - start.displacement[owner.fixed]
        self.iterations = 0

    def solve(self, passes: int) -> BodyStep:
        """Iterate at most so many passes of (37), (38); Newton's method for none."""
        du = self._predictor()
        response = self.law.response
        if not passes:
            du, end, _ = self._newton(response, du, self.tol)
            return self._step(du, end, [])
        stress = response(self.owner._strains(du)).stress
        history: list[tuple[float, float]] = []
        while True:
            limit = self.law.limit(stress)
            frozen = partial(self.law.frozen, limit=limit)
            du, end, balanced = self._newton(frozen, du, _INNER * self.tol)
            stress = end.stress
            step = self._step(du, end, history)
            history.append((step.gap, step.imbalance))
            # A pass without equilibrium has no minimum: its load is above the limit load
            # of the frozen limits.
            if step.converged or not balanced or len(history) == passes:
                return step

    def _predictor(self) -> Floats:
        """Elastic increment: the stresses of most points do not reach the criterion."""
        owner = self.owner
        du = np.zeros(len(self.load))
        du[owner.fixed] = self.moved
        rest = self.load - owner._forces(self.law.start) - owner._elastic @ du
        du[owner._free] = owner._factor.solve(rest[owner._free])
        return du

    def _newton(
        self, law: Law, du: Floats, tol: float
    ) -> tuple[Floats, Response, bool]:
        """Balance the load with the stresses of ``law``, and tell whether this was reached.

        The unbalanced forces are measured by ``r·K⁻¹r``, which decreases along a Newton
        step: a measure of single forces would depend on the numbering and the mesh.
        """
        owner = self.owner
        free = owner._free
        end = law(owner._strains(du))
        rest, size = self._unbalanced(end.stress)
        for _ in range(_NEWTON):
            if np.sqrt(0.5 * size) <= tol * np.sqrt(self._work(end)):
                return du, end, True
            matrix = owner._stiffness(end.tangent) + _SHARE * owner._elastic
            move = np.zeros_like(du)
            try:
                move[free] = splu(matrix[free][:, free].tocsc()).solve(rest)
            except RuntimeError:  # singular to rounding: a mechanism
                break
            share = 1.0
            for _ in range(_HALVINGS):
                new = law(owner._strains(du + share * move))
                new_rest, new_size = self._unbalanced(new.stress)
                if new_size <= (1 - 1e-4 * share) * size:
                    break
                share /= 2
            else:
                break
            du, end, rest, size = du + share * move, new, new_rest, new_size
            self.iterations += 1
        return du, end, False

    def _unbalanced(self, stress: Floats) -> tuple[Floats, float]:
        """Forces at free degrees of freedom, and ``r·K⁻¹r`` [J]."""
        rest = (self.load - self.owner._forces(stress))[self.owner._free]
        return rest, float(rest @ self.owner._factor.solve(rest))

    def _work(self, end: Response) -> float:
        elastic = 0.5 * np.sum(end.stress * self.law.compliance(end.stress), axis=1)
        # Dissipation σ·p, which for `frozen` is that of its own potential.
        spent = np.abs(np.sum(end.stress * end.plastic, axis=1))
        return float(self.owner.weights.ravel() @ (elastic + spent))

    def _step(
        self, du: Floats, end: Response, history: list[tuple[float, float]]
    ) -> BodyStep:
        """Judge an iterate, with its stress brought into the criterion."""
        owner, start = self.owner, self.start
        weights = owner.weights.ravel()
        stress = owner.soil.prox_at(end.stress, np.zeros_like(end.stress), 1.0)
        work = self._work(Response(stress, end.plastic, end.tangent))
        gap = self.law.gap(owner._strains(du), end.plastic, stress)
        _, size = self._unbalanced(stress)
        # Without any stress and flow, both are zero.
        scale = work if work > 0 else 1.0
        relative = max(float(weights @ gap), 0.0) / scale
        imbalance = float(np.sqrt(max(0.5 * size, 0.0) / scale))
        points = (*owner.shape, 6)
        return BodyStep(
            displacement=start.displacement + du,
            stress=stress.reshape(points),
            plastic_strain=start.plastic_strain + end.plastic.reshape(points),
            load=self.load,
            reaction=(owner._forces(stress) - self.load)[owner.fixed],
            work=work,
            gap=relative,
            imbalance=imbalance,
            converged=relative <= self.tol and imbalance <= self.tol,
            iterations=self.iterations,
            history=np.array([*history, (relative, imbalance)]),
        )


def _moduli(body: Body) -> Floats:
    """Bulk and shear modulus of each cell, ``(2, cells)``."""
    pairs = []
    for material in body.materials:
        if not isinstance(material, Material):
            raise ValueError(
                f"body {body.name!r} has an orthotropic material, expected isotropic ones"
            )
        if body.dim == 2 and material.plane_stress:
            raise ValueError(
                f"body {body.name!r} is in plane stress, expected plane strain or 3D"
            )
        lame_lambda, lame_mu = material.lame(3)
        pairs.append((lame_lambda + 2 * lame_mu / 3, lame_mu))
    return np.array(pairs)[body.material_of_cells].T


def _strain_matrix(body: Body) -> Any:
    """Strains at the quadrature points of the displacements of nodes, CSR ``(6 m, n)``."""
    d, slopes = body.dim, slopes_at_points(body)
    q, corners, _, cells = slopes.shape
    # Gradient ∂_a u_k of unit displacements: (cells, q, corner, component, a, k).
    gradient = np.zeros((cells, q, corners, d, 3, 3))
    for k in range(d):
        gradient[:, :, :, k, :d, k] = slopes.transpose(3, 0, 1, 2)
    strain = mandel(0.5 * (gradient + gradient.swapaxes(-1, -2)))
    dofs = d * body.cells[:, None, :, None] + np.arange(d)
    columns = np.broadcast_to(dofs[..., None], strain.shape)
    rows = 6 * np.arange(cells * q).reshape(cells, q, 1, 1, 1) + np.arange(6)
    made = sparse.coo_array(
        (
            strain.ravel(),
            (np.broadcast_to(rows, strain.shape).ravel(), columns.ravel()),
        ),
        shape=(6 * cells * q, body.points.size),
    ).tocsr()
    made.eliminate_zeros()
    return made


def _check_supports(body: Body, fixed: Any) -> None:
    """Refuse supports that leave a rigid motion free."""
    d = body.dim
    x = body.points - body.points.mean(axis=0)
    x /= np.abs(x).max()
    motions = [np.tile(axis, (len(x), 1)) for axis in np.eye(d)]
    for i in range(d):
        for j in range(i):
            turn = np.zeros_like(x)
            turn[:, i], turn[:, j] = x[:, j], -x[:, i]
            motions.append(turn)
    held = np.stack([m.ravel()[fixed] for m in motions], axis=1)
    if np.linalg.matrix_rank(held, tol=1e-9) < len(motions):
        raise ValueError(
            f"fixed leaves a rigid motion of body {body.name!r} free: fix more degrees of "
            "freedom"
        )
