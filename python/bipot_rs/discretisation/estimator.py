"""Discretisation error: the constitutive relation error of equilibrated stresses.

Let the displacement u_h be admissible (prescribed values met, no penetration on whole
facets), and also the stress σ̂ (in equilibrium with the loads at every point, contact
tractions t̂ in the cone on whole facets). Then

    B(u_h, σ̂) = ½ ∫ (σ̂ - σ(u_h)) : C⁻¹ (σ̂ - σ(u_h)) dV + ∫ t̂·ṽ(u_h) dA  ≥  0,

It is the bifunctional [dSF91, 23], [dSF91, 25] of the continuous problem, and zero only at
the exact solution. Proofs: docs/paper/10-discretisation-error.md.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, sparse

from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.law.contact_law import BESIDE_MU
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.discretisation import johnson_mercier
from bipot_rs.discretisation.contact_facets import contact_facets, prescribed_facets
from bipot_rs.discretisation.equilibrium import SelfStress, moments
from bipot_rs.discretisation.simplices import (
    Simplices,
    complementary,
    elastic,
    error_energy,
    simplices,
    strain,
)
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.fem.checks.free_bodies import find_free, list_motions
from bipot_rs.obstacle.shapes import Plane
from bipot_rs.scene.case import Case

BOUND = "guaranteed bound"
INDICATOR = "indicator"
# Energy of penetration that counts as rounding: relative to B, and to the elastic energy.
_SOLVED, _ROUNDING = 1e-6, 1e-12


@dataclass(frozen=True)
class DiscretisationError:
    """Constitutive relation error of one load step, in total and by element.

    Attributes
    ----------
    cells : (cells,)
        Energy of ``σ̂ - σ(u_h)`` of each element of all bodies, as `Assembly.cells` [J].
    contacts : (n_c,)
        Work ``∫ φ_i t̂·ṽ`` of each contact node, ``>= 0`` [J].
    volumes : (cells,)
        Volumes of the elements [m³].
    elastic_energy
        ``½ uᵀK u`` of u_h [J].
    kind
        ``"guaranteed bound"``: ``½‖u - û‖² + ½‖σ - σ̂‖² <= total`` in the energy norm. u, σ
        is the exact solution of this load step, which starts from the computed state; û
        is u_h, for curved gaps corrected so that facets do not penetrate between nodes.
        Penetration at the nodes up to a millionth of B counts as rounding. Otherwise
        ``"indicator"``: an estimate without guarantee.
    reasons
        Why it is only an indicator.
    traction : (n_c, d)
        t̂ at the contact nodes, in their frames; linear on facets [Pa].
    stress : tuple of (cells, d + 1, d + 1, d, d)
        σ̂ of each body, as `johnson_mercier.stress` returns it [Pa].
    """

    cells: Floats
    contacts: Floats
    volumes: Floats = field(repr=False)
    elastic_energy: float
    kind: str
    reasons: tuple[str, ...]
    traction: Floats = field(repr=False)
    stress: tuple[Floats, ...] = field(repr=False)

    __repr__ = short_repr

    @property
    def total(self) -> float:
        """B(u_h, σ̂) [J]."""
        return float(self.cells.sum() + self.contacts.sum())

    @property
    def energy_share(self) -> float:
        """B over the elastic energy of u_h; 0 if both are zero."""
        if self.total == 0:
            return 0.0
        return self.total / self.elastic_energy if self.elastic_energy else np.inf

    @property
    def relative(self) -> float:
        """Bound of the error relative to u_h in the energy norm: √energy_share.

        ``‖u - û‖ <= relative ‖u_h‖`` for a guaranteed bound.
        """
        return float(np.sqrt(self.energy_share))

    @property
    def density(self) -> Floats:
        """Error energy per volume of each element, without contacts, ``(cells,)`` [J/m³]."""
        return self.cells / self.volumes


def discretisation_error(
    case: Case,
    result: Result | Step,
    step: int = -1,
    *,
    threshold: ArrayLike | None = None,
) -> DiscretisationError:
    """Discretisation error of one load step of a scene on triangles or tetrahedra.

    Parameters
    ----------
    case
        The assembled scene, with ``mesh.element = "P1"``.
    result, step
        Its result and the index of a load step; or a single step and its index.
    threshold
        Friction limits of Tresca's law at the contacts, ``(n_c,)`` [Pa], if the problem
        was solved with these limits; by default Coulomb's law.

    Raises
    ------
    ValueError
        Cells that are not P1, a contact surface that is not flat, a step that does not
        exist, or loads that no tractions balance: a body that only contact keeps from
        rotating, or a node with a support but no supported facet.
    """
    return Estimator(case).error(result, step, threshold=threshold)


class Estimator:
    """Discretisation errors of many steps of one scene; common parts are computed once.

    Parameters
    ----------
    case
        As in `discretisation_error`.

    Raises
    ------
    ValueError
        As in `discretisation_error`, if it does not depend on the step.
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        model = case.model
        _refuse_model(case)
        named = [
            {name for name, at in (mesh.boundaries or {}).items() if border[at].all()}
            for mesh in (body.mesh for body in model.bodies)
            for border in [np.asarray(mesh.f2t)[1] < 0]
        ]
        owners = [body.name for body in model.bodies]
        for support in model.supports:
            surfaces = named[owners.index(support.body)]
            if support.surface not in surfaces or support.at is not None:
                raise ValueError(
                    f"a support holds nodes of body {support.body!r} that are not a "
                    "surface: the discretisation error needs supports on surfaces"
                )
        self.bodies = [simplices(body) for body in model.bodies]
        self.materials = [body.isotropic for body in model.bodies]
        self.facets = contact_facets(model, self.bodies)
        held = prescribed_facets(model, self.bodies)
        self.elastic = _Elastic(model)
        self.known = [
            acting.outside[:, None] & ~prescribed
            for acting, prescribed in zip(self.bodies, held, strict=True)
        ]
        self.own = [
            SelfStress(acting, material, ~cells)
            for acting, material, cells in zip(
                self.bodies, self.materials, self.known, strict=True
            )
        ]

    def error(
        self,
        result: Result | Step,
        step: int = -1,
        *,
        threshold: ArrayLike | None = None,
    ) -> DiscretisationError:
        """Discretisation error of a load step, as `discretisation_error`."""
        case, model = self.case, self.case.model
        if isinstance(result, Result) and result.s is not None:
            result = result[_number(step, len(result))]
        if isinstance(result, Step) and result.s is not None:
            # An automatic step may end between load steps: use the loads there.
            there = copy.copy(self)
            there.case = case.sampled(result.s)
            return there.error(replace(result, s=None), 0, threshold=threshold)
        k = _number(step, len(case.parameter))
        if isinstance(result, Result):
            if k >= len(result):
                raise ValueError(
                    f"step is {step}, expected 0 to {len(result) - 1}, the steps of result"
                )
            at: Step = result[k]
        else:
            at = result
        limit = None
        if threshold is not None:
            limit = floats("threshold", threshold, shape=model.mu.shape)
            if (limit < 0).any():
                raise ValueError(
                    f"threshold is {limit.min():g} at a contact, expected zero or positive"
                )
        traction = at.reaction / self.facets.node_area[:, None]
        moments_given = self.facets.traction_moments(
            self.bodies, np.einsum("ck,ckd->cd", traction, model.frame)
        )
        u = at.displacement.reshape(-1, model.dim)
        forces, pulls = self._loads(k)
        w = self._consistent(moments_given, forces, pulls, k).reshape(-1, model.dim)
        lift = self._lift(at.relative_displacement[:, 0])
        ends = np.append(model.offset, model.n) // model.dim
        cells, volumes, stresses, energy = [], [], [], 0.0
        for owner, (body, part) in enumerate(
            zip(model.bodies, self.bodies, strict=True)
        ):
            nodes = slice(ends[owner], ends[owner + 1])
            material = self.materials[owner]
            tractions = moments(
                part,
                elastic(material, strain(part, w[nodes])),
                forces[owner],
                moments_given[owner] + pulls[owner],
                self.known[owner],
            )
            stresses_given = elastic(material, strain(part, u[nodes]))
            tractions = self.own[owner].relax(tractions, u[nodes], stresses_given)
            hat = johnson_mercier.stress(
                part.edges, part.gradients, part.by_cell(tractions)
            )
            missing = hat - stresses_given[:, None, None]
            for bubbles in lift.bubbles:
                if bubbles.body == owner:
                    bubbles.subtract(part, material, missing)
            cells.append(body.depth * error_energy(part, material, missing))
            volumes.append(body.depth * part.volume)
            stresses.append(hat)
            energy += 0.5 * float(volumes[-1] @ complementary(material, stresses_given))
        reasons = list(lift.reasons)
        mu = np.array([np.max(c.mu) for c in model.contacts])[model.group]
        if limit is None and mu.any():
            reasons.append(
                "Coulomb friction, whose limit depends on the unknown exact pressure"
            )
        if any(not _quadratic(contact.clearance) for contact in model.contacts):
            reasons.append(
                "a gap that is known only at the nodes and the midpoints of edges"
            )
        # The gap of any other obstacle is not linear between nodes.
        flat = Plane | None
        if any(not isinstance(contact.obstacle, flat) for contact in model.contacts):
            reasons.append("an obstacle whose shape is known only at the nodes")
        if limit is not None:
            shear = np.linalg.norm(traction[:, 1:], axis=1)
            if (shear > limit + 1e-9 * shear.max(initial=0.0)).any():
                reasons.append("tractions above the threshold of friction")
        contacts = self._work(traction, at, mu, limit, lift.kept)
        total = float(sum(c.sum() for c in cells) + contacts.sum())
        # Work of the exact pressures on the penetration; they are about as large as these.
        depth = np.maximum(-at.relative_displacement[:, 0], 0.0).sum()
        through = depth * at.reaction[:, 0].max(initial=0.0)
        if through > _SOLVED * total + _ROUNDING * energy:
            reasons.append("contacts that penetrate: solve with a smaller tol")
        return DiscretisationError(
            cells=np.concatenate(cells),
            contacts=contacts,
            volumes=np.concatenate(volumes),
            elastic_energy=energy,
            kind=INDICATOR if reasons else BOUND,
            reasons=tuple(reasons),
            traction=traction,
            stress=tuple(stresses),
        )

    def _consistent(
        self, given: list[Floats], forces: list[Floats], pulls: list[Floats], k: int
    ) -> Floats:
        """Displacement under the loads of step k and contact tractions with these moments.

        u_h is in equilibrium with nodal contact forces, which in general are not those of
        tractions in the cone.
        """
        case, model = self.case, self.case.model
        load, contact = np.zeros(model.n), np.zeros(model.n)
        for owner, (body, cells) in enumerate(
            zip(model.bodies, self.bodies, strict=True)
        ):
            first = model.offset[owner]
            dofs = slice(first, first + cells.points.size)
            nodal = np.zeros_like(cells.points)
            np.add.at(nodal, cells.facets, pulls[owner])
            # ∫ φ_i dV is the same for all corners of a cell.
            share = (
                cells.volume[:, None, None] / (cells.dim + 1) * forces[owner][:, None]
            )
            np.add.at(nodal, cells.corners, share)
            load[dofs] = body.depth * nodal.ravel()
            nodal = np.zeros_like(cells.points)
            np.add.at(nodal, cells.facets, given[owner])
            contact[dofs] = body.depth * nodal.ravel()
        nodal_load = np.zeros(model.n) if case.load is None else case.load[k]
        # Sums of the same forces in another order: they differ by rounding.
        if np.abs(load - nodal_load).max() > 1e-9 * np.abs(load).max(initial=0.0):
            raise ValueError(
                "case.load is not the sum of case.loads: the discretisation error needs "
                "tractions and forces per volume, and supports no other nodal forces"
            )
        return self.elastic.solve(load + contact, case.prescribed[k])

    def _loads(self, k: int) -> tuple[list[Floats], list[Floats]]:
        """Force per volume of each cell, and moments of loads on facets, for each body."""
        forces = [np.zeros((len(cells.corners), cells.dim)) for cells in self.bodies]
        pulls = [
            np.zeros((len(cells.facets), cells.dim, cells.dim)) for cells in self.bodies
        ]
        for acting in self.case.loads:
            load, factor = acting.load, acting.history[k]
            if load is None:
                continue
            numbered = self.case.model.numbered[load.body]
            body, owner = numbered.body, numbered.index
            cells = self.bodies[owner]
            if load.force is not None:
                forces[owner] += factor * np.asarray(load.force)
                continue
            facets = body.facets(str(load.surface))
            if load.pressure is None:
                density = factor * np.asarray(load.traction)
            else:
                # Facets are flat: one normal for each.
                normals = np.asarray(body.surface(str(load.surface)).normals)
                density = factor * (-load.pressure * normals[:, :, 0].T)
            by_facet = np.broadcast_to(density, (len(facets), cells.dim))
            nodal = np.repeat(by_facet[:, None], cells.dim, axis=1)
            np.add.at(pulls[owner], facets, cells.linear_moments(facets, nodal))
        return forces, pulls

    def _lift(self, opening: Floats) -> _Lift:
        """Remove the penetration of a curved gap between nodes.

        On a facet ``v_n = Σ φ_i v_i - Σ k_ij φ_i φ_j``, with k the curvature of the gap
        along the edges. If ``k_ij <= v_i + v_j`` on all edges, v_n is not negative, since
        Σ φ_i = 1. An edge function of the normal displacement compensates the excess of k.
        """
        facets, model = self.facets, self.case.model
        room = np.maximum(opening[facets.edges], 0.0).sum(axis=1)
        amount = facets.curvature - np.minimum(facets.curvature, room)
        moved = np.flatnonzero(amount > 0)
        if not moved.size:
            return _Lift(facets.curvature, [], ())
        kept = facets.curvature - amount
        ends = facets.edges[moved]
        normal = model.frame[ends[:, 0], 0]
        dofs = model.contact_dofs[ends]  # (edges, ends, sides)
        # Half on each of two bodies; all on one body against a rigid obstacle.
        share = amount[moved] * np.where(dofs[:, 0, 1] >= 0, 0.5, 1.0)
        owner = np.searchsorted(model.offset, dofs[:, 0], side="right") - 1
        fixed = np.zeros(model.n, dtype=np.bool_)
        fixed[model.fixed] = True
        bubbles, stopped = [], False
        for side, sign in ((0, 1.0), (1, -1.0)):
            for b in range(len(model.bodies)):
                here = (owner[:, side] == b) & (dofs[:, 0, side] >= 0)
                if not here.any():
                    continue
                vector = sign * share[here, None] * normal[here]
                first = dofs[here, :, side]
                both = fixed[first[..., None] + np.arange(model.dim)].all(axis=1)
                stopped |= bool((both & (vector != 0)).any())
                nodes = (first - model.offset[b]) // model.dim
                bubbles.append(_Bubbles(b, nodes, vector))
        reasons = (
            "a curved gap along an edge whose normal displacement is prescribed",
        )
        return _Lift(kept, bubbles, reasons if stopped else ())

    def _work(
        self,
        traction: Floats,
        step: Step,
        mu: Floats,
        limit: Floats | None,
        kept: Floats,
    ) -> Floats:
        """``∫ φ_i t̂·ṽ`` of each contact, with the limit ``μ t̂_n`` or that of Tresca.

        ‖v_t‖ is replaced by the interpolant of its nodal values. By convexity this is an
        upper bound, exact where the slip has one direction: every part is ``>= 0``, and
        the sum is an upper bound. Penetration counts as closed contact.
        """
        facets, dim = self.facets, self.case.model.dim
        length = np.linalg.norm(step.slip, axis=1)
        normal = np.maximum(step.relative_displacement[:, 0], 0.0)
        # The friction limit is treated as another component of force, dual to ‖v_t‖.
        resistance = mu * traction[:, 0] if limit is None else limit
        force = np.column_stack([traction, resistance])[facets.first.contact]
        v = np.column_stack([normal, step.slip, length])[facets.first.contact]
        mass = (1 + np.eye(dim)) / (dim * (dim + 1))
        work = np.einsum("ab,fak,fbk->fa", mass, force, v)
        # ∫ φ_a φ_b φ_c dA over a facet is its area times (d - 1)! α!/(d + 2)!.
        for e, edge in enumerate(combinations(range(dim), 2)):
            bend = kept[facets.edge_of[:, e]] / (dim * (dim + 1) * (dim + 2))
            for a in range(dim):
                work[:, a] -= (2 if a in edge else 1) * bend * force[:, a, 0]
        work *= facets.area[:, None]
        at = facets.first.contact
        work_of_facets = np.bincount(at.ravel(), work.ravel(), minlength=len(traction))
        return np.asarray(work_of_facets, dtype=np.float64)


@dataclass(frozen=True)
class _Bubbles:
    """Displacements ``φ_i φ_j vector`` along edges of a body.

    ``edges (m, 2)`` are nodes of the body, ``vector (m, d)``.
    """

    body: int
    edges: Ints
    vector: Floats

    def subtract(self, cells: Simplices, material: Material, stress: Floats) -> None:
        """Subtract their stress from ``(cells, d + 1, d + 1, d, d)``, linear in each part."""
        nodes = len(cells.points)
        low, high = np.sort(self.edges, axis=1).T
        keys = low * nodes + high
        order = np.argsort(keys)
        corners = range(cells.dim + 1)
        for a, b in combinations(corners, 2):
            ends = np.sort(cells.corners[:, [a, b]], axis=1)
            key = ends[:, 0] * nodes + ends[:, 1]
            at = np.minimum(np.searchsorted(keys, key, sorter=order), len(keys) - 1)
            cell = np.flatnonzero(keys[order[at]] == key)
            vector = self.vector[order[at[cell]]]

            def bent(slope: Floats, vector: Floats = vector) -> Floats:
                gradient = np.einsum("ci,cj->cij", vector, slope)
                return elastic(material, 0.5 * (gradient + gradient.swapaxes(1, 2)))

            # ∇(φ_a φ_b) at the corners is ∇φ_b at a, ∇φ_a at b, and 0.
            at_a = bent(cells.gradients[cell, b])
            at_b = bent(cells.gradients[cell, a])
            for part in corners:
                for corner, value in ((a, at_a), (b, at_b)):
                    if corner != part:
                        stress[cell, part, corner] -= value
                stress[cell, part, part] -= (at_a + at_b) / (cells.dim + 1)


@dataclass(frozen=True)
class _Lift:
    """Curvature kept in the gap, displacements for the rest, reasons against a bound."""

    kept: Floats
    bubbles: list[_Bubbles]
    reasons: tuple[str, ...]


def _quadratic(clearance: object) -> bool:
    """Whether a clearance is quadratic on an edge: a number, or a table of a scene."""
    if not callable(clearance):
        return True
    return getattr(getattr(clearance, "__self__", None), "QUADRATIC", False)


class _Elastic:
    """The bodies without their contacts, with a factored stiffness."""

    def __init__(self, model: Assembly) -> None:
        self.model = model
        # Motions of single bodies that supports leave free, ``(n, k)``.
        modes, _ = list_motions(model)
        self.motions = modes @ find_free(modes[model.fixed])
        pins: Ints = np.zeros(0, np.int64)
        if self.motions.shape[1]:
            # Balanced forces cause no reaction at pins. Choose the pins that determine the
            # rigid motions best.
            free = np.setdiff1d(np.arange(model.n), model.fixed)
            _, _, order = linalg.qr(
                self.motions[free].T, pivoting=True, mode="economic"
            )
            pins = free[order[: self.motions.shape[1]]]
        self.held = np.concatenate([model.fixed, pins])
        self.problem = ContactProblem(
            model.K,
            sparse.csr_array((0, model.n)),
            gap=np.zeros(0),
            mu=np.zeros(0),
            fixed=self.held,
            dim=model.dim,
            coordinates=np.repeat(model.nodes, model.dim, axis=0),
        )

    def solve(self, load: Floats, prescribed: Floats) -> Floats:
        """Displacements ``(n,)``, for free bodies up to a rigid motion."""
        model = self.model
        force = load.copy()
        force[model.fixed] = 0.0
        left = np.abs(self.motions.T @ force)
        # Contact forces balance only up to the tolerance of the solver.
        if (left > 1e-6 * (np.abs(self.motions.T) @ np.abs(force))).any():
            raise ValueError(
                "contact alone keeps a body from moving, and its contact tractions do not "
                "balance the loads: support the body, or solve with a smaller tol"
            )
        values = np.concatenate(
            [prescribed, np.zeros(len(self.held) - len(prescribed))]
        )
        displacement: Floats = self.problem.solve(load, values).displacement[-1]
        return displacement


def _refuse_model(case: Case) -> None:
    """Refuse what the discretisation error does not support."""
    model, loads = case.model, [acting.load for acting in case.loads if acting.load]
    for k, contact in enumerate(model.contacts):
        mu, where = np.ravel(contact.mu).tolist(), f"of contacts[{k}] is"
        for refused, what in (
            (len(set(mu)) > 1, f"mu {where} {mu}, expected one number"),
            *(
                (value, f"{name} {where} {value:g}, expected 0")
                for name in BESIDE_MU
                for value in [getattr(contact, name)]
            ),
            (
                contact.pairing != "match",
                f"pairing {where} {contact.pairing!r}, expected 'match'",
            ),
        ):
            if refused:
                raise ValueError(f"{what}: the discretisation error supports no other")
    for present, what in (
        (
            model.numbered.axisymmetric,
            "axisymmetric bodies: they are in the plane or in space",
        ),
        (any(load.strain is not None for load in loads), "initial strains"),
        (
            any(load.within is not None for load in loads),
            "a load within ranges: name its part as a surface",
        ),
        (model.springs, "springs: replace them by supports"),
        (
            model.inclined,
            "a plane of symmetry that is not normal to an axis: rotate the meshes",
        ),
        (
            model.references or model.ties,
            "a floating obstacle, a rigid set, a cyclic symmetry, a bolt or a periodicity",
        ),
        (
            isinstance(model.moving, MovingGaps),
            "an obstacle that turns, or is curved and moves: frames must stay",
        ),
    ):
        if present:
            raise ValueError(f"the discretisation error does not support {what}")


def _number(step: int, steps: int) -> int:
    if not -steps <= step < steps:
        raise ValueError(f"step is {step}, but the path has {steps} steps")
    return step % steps
