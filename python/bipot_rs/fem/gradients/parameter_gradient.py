"""Gradients with respect to materials, springs, loads, node coordinates and obstacles.

Of a gradient of (1) and (2), the adjoint displacement λ_k of step k, the cotangent G_k of
its gaps, the displacement u_k and the reaction r_k determine the derivative of any
parameter θ of the model:

    Σ_k  λ_kᵀ (∂f_k/∂θ - ∂K/∂θ u_k + ∂Bᵀ/∂θ r_k) + G_k · (∂B/∂θ u_k + ∂g_k/∂θ).

The products are integrals over the cells; no derivative of K is formed. Each quantity is
computed when it is first asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.fem.bodies.boundary import Load, Spring
from bipot_rs.fem.bodies.materials import Material, elasticity, of_poisson, of_young
from bipot_rs.fem.bodies.stress_recovery import (
    gradient_at_points,
    initial_strain,
    internal_forces,
    slopes_at_points,
)
from bipot_rs.fem.gradients.contact_derivative import (
    AreaVectors,
    Meets,
    of_matching,
    refuse_moving_nodes,
    stress_of_motion,
)

if TYPE_CHECKING:
    from bipot_rs.contact.results.derivatives import Gradient
    from bipot_rs.fem.assembly.assembly import Assembly


@dataclass(frozen=True)
class _Integrals:
    """Sums over the steps within the cells of a body."""

    moments: list[Floats]  # `Σ_k ∫ ∂_b λ_a ε_cd`, `(3, 3, 3, 3)`, of each material
    # (3, 3, cells, points): what `stress_of_motion` gives for `λᵀ (K u - f)`.
    motion: Floats


class ParameterGradient:
    """Derivatives of one number with respect to the parameters of a model.

    Parameters
    ----------
    model
        The `Assembly` of the problem.
    adjoint, displacement
        λ and u of each step, ``(steps, n)``: λ is the derivative with respect to the load.
    gap
        Derivative with respect to the gaps of each step by component, ``(steps, n_c, d)``.
    reaction
        ``(steps, n_c, d)`` [N].
    loads
        The loads of the path. Their nodal forces change with the parameters; without
        loads the nodal forces are held constant.

    Raises
    ------
    ValueError
        A shape does not fit the model, or a load names an unknown body or surface.
    """

    def __init__(
        self,
        model: Assembly,
        *,
        adjoint: ArrayLike,
        displacement: ArrayLike,
        gap: ArrayLike,
        reaction: ArrayLike,
        loads: Sequence[Load] = (),
    ) -> None:
        self._model = model
        if model.references or model.images:
            raise ValueError(
                "the model has a floating obstacle, a rigid set, a cyclic symmetry, a bolt or a "
                "periodicity: gradients with respect to parameters are not available"
            )
        u = floats("displacement", displacement, ndim=2)
        steps, n, contacts = len(u), model.nodes.size, (len(model.group), model.dim)
        self._u = floats("displacement", u, shape=(steps, n))
        self._lambda = floats("adjoint", adjoint, shape=(steps, n))
        self._gap = floats("gap", gap, shape=(steps, *contacts))
        self._reaction = floats("reaction", reaction, shape=(steps, *contacts))
        if model.ties is not None:
            # The planes take the part of every force that is normal to them.
            self._lambda = self._lambda @ model.ties.within.T
        self._loads = [(load, load.of_steps(steps)) for load in loads]
        self._owners = [model.numbered[load.body].index for load in loads]

    @cached_property
    def _integrals(self) -> list[_Integrals]:
        """Sums over the steps within the cells of each body, in one pass."""
        return [self._integrate_body(b) for b in range(len(self._model.bodies))]

    def _integrate_body(self, b: int) -> _Integrals:
        body, d = self._model.bodies[b], self._model.dim
        weights = body.depth * body.volume().weights
        which = [body.material_of_cells == m for m in range(len(body.materials))]
        laws = [elasticity(material, d) for material in body.materials]
        moments = [np.zeros((3, 3, 3, 3)) for _ in body.materials]
        motion = np.zeros((3, 3, *weights.shape))
        for adjoint, gradient, initial in self._gradients(b):
            strain = gradient - initial
            stress, other = np.empty_like(gradient), np.empty_like(adjoint)
            for here, law, moment in zip(which, laws, moments, strict=True):
                pushed, moved = adjoint[:, :, here], strain[:, :, here]
                moment += np.einsum(
                    "abpq,cdpq,pq->abcd", pushed, moved, weights[here], optimize=True
                )
                for made, given in ((stress, moved), (other, pushed)):
                    made[:, :, here] = np.einsum("abcd,cdpq->abpq", law, given)
            motion[:d, :d] += stress_of_motion(
                adjoint[:d, :d], gradient[:d, :d], stress[:d, :d], other[:d, :d]
            )
        return _Integrals(moments, motion)

    def _gradients(self, b: int) -> Iterator[tuple[Floats, Floats, Floats]]:
        """``∇λ``, ``∇u`` and ``ε0`` of each step, ``(3, 3, cells, points)``."""
        body = self._model.bodies[b]
        slopes = slopes_at_points(body)
        initial = [
            (initial_strain(body, load.strain), factors)
            for load, factors, owner in self._loads_of()
            if owner == b and load.strain is not None
        ]
        shape = (3, 3, *body.volume().weights.shape)
        for k in range(len(self._u)):
            adjoint, displacement = (
                gradient_at_points(body, self._of_body(b, field[k]), slopes)
                for field in (self._lambda, self._u)
            )
            whole = np.zeros(shape)
            for strain, factors in initial:
                whole += factors[k] * strain
            yield adjoint, displacement, whole

    def _loads_of(self) -> list[tuple[Load, Floats, int]]:
        return [(*parts, b) for parts, b in zip(self._loads, self._owners, strict=True)]

    def _of_body(self, b: int, field: Floats) -> Floats:
        """Part ``(nodes, d)`` of a field ``(n,)``."""
        span = self._model.numbered[self._model.bodies[b].name].span
        return field[span].reshape(-1, self._model.dim)

    def _isotropic(self, name: str) -> None:
        for body in self._model.bodies:
            for material in body.materials:
                if not isinstance(material, Material):
                    raise ValueError(
                        f"a material of body {body.name!r} is orthotropic: the derivative "
                        f"with respect to {name} is available only for isotropic ones"
                    )

    @cached_property
    def young(self) -> dict[str, Floats]:
        """By body, of Young's modulus of each of ``body.materials``, ``(materials,)``."""
        return self._moduli("young", of_young)

    @cached_property
    def poisson(self) -> dict[str, Floats]:
        """By body, of Poisson's ratio of each of ``body.materials``, ``(materials,)``."""
        return self._moduli("poisson", of_poisson)

    def _moduli(self, name: str, law: Callable[..., Floats]) -> dict[str, Floats]:
        self._isotropic(name)
        return {
            body.name: -np.array(
                [
                    np.sum(moment * law(material, body.dim))
                    for material, moment in zip(
                        body.materials, integrals.moments, strict=True
                    )
                ]
            )
            for body, integrals in zip(self._model.bodies, self._integrals, strict=True)
        }

    @cached_property
    def thickness(self) -> dict[str, float]:
        """By body, of the thickness of a body in the plane, which scales K and its loads.

        Raises
        ------
        ValueError
            The bodies are in space.
        """
        if self._model.dim == 3 or self._model.numbered.axisymmetric:
            raise ValueError("bodies in space and of revolution have no thickness")
        thickness = {}
        for b, body in enumerate(self._model.bodies):
            derivative = 0.0
            moments = self._integrals[b].moments
            for material, moment in zip(body.materials, moments, strict=True):
                # Initial strains are within the moment.
                derivative -= float(np.sum(moment * elasticity(material, 2)))
            for value, (load, _, owner) in zip(
                self.load_factor, self._loads_of(), strict=True
            ):
                derivative += value if owner == b and load.strain is None else 0.0
            for spring, parts in zip(self._model.springs, self.springs, strict=True):
                if spring.body == body.name:
                    derivative += sum(
                        float(np.sum(np.multiply(getattr(spring, name), part)))
                        for name, part in parts.items()
                        if getattr(spring, name) is not None
                    )
            thickness[body.name] = derivative / body.depth
        return thickness

    @cached_property
    def load_factor(self) -> Floats:
        """Of a factor common to all steps of each of ``loads``, ``(loads,)``."""
        factors_of_loads = np.zeros(len(self._loads))
        for i, (load, factors, b) in enumerate(self._loads_of()):
            forces = load.forces(self._model.bodies[b]).reshape(-1, self._model.dim)
            weighted = self._of_body(b, factors @ self._lambda)
            factors_of_loads[i] = np.sum(forces * weighted)
        return factors_of_loads

    @cached_property
    def initial_strain(self) -> list[Floats | None]:
        """Of a constant strain added to each of ``loads``, ``(3, 3)`` and symmetric.

        None for loads of another kind. If the load names volumes, the strain is added in
        these.
        """
        strains: list[Floats | None] = []
        for load, factors, b in self._loads_of():
            if load.strain is None:
                strains.append(None)
                continue
            body, d = self._model.bodies[b], self._model.dim
            where = np.ones(len(body.cells), np.bool_)
            if isinstance(load.strain, Mapping):
                where[:] = False
                for volume in load.strain:
                    where[body.volume_cells(volume)] = True
            nodal = self._of_body(b, factors @ self._lambda)
            slope = gradient_at_points(body, nodal)
            weights = body.depth * body.volume().weights
            derivative = np.zeros((3, 3))
            for m, material in enumerate(body.materials):
                here = where & (body.material_of_cells == m)
                total = np.einsum("kapq,pq->ka", slope[:, :, here], weights[here])
                derivative += np.einsum("abcd,ab->cd", elasticity(material, d), total)
            strains.append(derivative)
        return strains

    @cached_property
    def springs(self) -> list[dict[str, float | Floats]]:
        """Of ``stiffness``, or of ``normal`` and ``tangential``, of each spring.

        ``stiffness`` is a number or ``(d,)``, as given.
        """
        return [self._spring(spring) for spring in self._model.springs]

    def _spring(self, spring: Spring) -> dict[str, float | Floats]:
        numbered = self._model.numbered[spring.body]
        body, b = numbered.body, numbered.index
        points = body.surface(spring.surface)
        weights, normals = body.depth * points.weights, np.asarray(points.normals)
        each, normal = np.zeros(body.dim), 0.0
        for adjoint, u in zip(self._lambda, self._u, strict=True):
            sides = [
                np.einsum(
                    "pcd,cq->dpq", self._of_body(b, field)[points.corners], points.phi
                )
                for field in (adjoint, u)
            ]
            each += np.einsum("dpq,dpq,pq->d", *sides, weights)
            across = [np.einsum("dpq,dpq->pq", side, normals) for side in sides]
            normal += float(np.sum(across[0] * across[1] * weights))
        if spring.stiffness is None:
            return {"normal": -normal, "tangential": -(float(each.sum()) - normal)}
        if np.ndim(spring.stiffness) == 0:
            return {"stiffness": -float(each.sum())}
        return {"stiffness": -each}

    @cached_property
    def obstacles(self) -> list[Floats | None]:
        """Of the position ``(d,)`` of the rigid obstacle of each contact, moved as a whole.

        None for contacts between bodies.

        Raises
        ------
        ValueError
            The obstacle turns, moves such that its normals change, is triangulated, or has
            no formula for its curvature.
        """
        return [
            None
            if meets.contact.against is not None
            else -self._rigid(meets).sum(axis=0)
            for meets in self._meets
        ]

    def _rigid(self, meets: Meets) -> Floats:
        derivative = meets.at_rigid()
        if self._model.inclined is not None and np.any(
            np.abs(meets.frame[:, 0] - meets.frame[:1, 0]) > 0
        ):
            raise ValueError(
                "the model has inclined planes of symmetry and a curved obstacle: the "
                "derivative of B is not available"
            )
        return derivative

    @cached_property
    def clearance(self) -> list[Floats]:
        """Of the clearance at each node of each contact, ``(m,)``."""
        total = self._gap[:, :, 0].sum(axis=0)
        return [total[self._model.group == i] for i in range(len(self._model.contacts))]

    @cached_property
    def _meets(self) -> list[Meets]:
        model, d = self._model, self._model.dim
        if isinstance(model.moving, MovingGaps):
            raise ValueError(
                "an obstacle turns, or is curved and moves: contacts have frames of each "
                "step, and derivatives with respect to nodes and obstacles need the same "
                "frames in all steps"
            )
        relative = np.zeros((2, *self._gap.shape))
        for side, sign in ((0, 1.0), (1, -1.0)):
            has = model.contact_dofs[:, side] >= 0
            dofs = model.contact_dofs[has, side][:, None] + np.arange(d)
            for k, field in enumerate((self._lambda, self._u)):
                relative[k][:, has] += sign * field[:, dofs]
        rows = np.einsum("kci,kcj->cij", self._reaction, relative[0])
        rows += np.einsum("kci,kcj->cij", self._gap, relative[1])
        members = [np.flatnonzero(model.group == i) for i in range(len(model.contacts))]
        return [
            Meets(c, model.points[at], model.frame[at], self._gap[:, at], rows[at])
            for c, at in zip(model.contacts, members, strict=True)
        ]

    @cached_property
    def nodes(self) -> Floats:
        """Of the node coordinates, ``(n / d, d)``, in the order of ``model.nodes``.

        Raises
        ------
        ValueError
            A contact has no derivative with respect to node coordinates (pairing by
            mortar or on facets, triangulated or turning obstacles, a clearance that is a
            function), the model has inclined planes of symmetry, or a load is a function
            of the positions.
        """
        model = self._model
        if model.inclined is not None:
            raise ValueError(
                "the model has inclined planes of symmetry, which move with the nodes: the "
                "derivative with respect to node coordinates is not available"
            )
        if model.numbered.axisymmetric:
            raise ValueError(
                "the derivative with respect to node coordinates is not available for bodies "
                "of revolution"
            )
        refuse_moving_nodes(model.contacts)
        for load, _ in self._loads:
            _refuse_function(load)
        moved = np.zeros_like(model.nodes)
        for b, body in enumerate(model.bodies):
            of_body = self._of_body(b, moved.reshape(-1))
            of_body -= self._cells(b)
            for load, factors, owner in self._loads_of():
                if owner == b and load.surface is not None:
                    of_body += self._surface(b, load, factors)
            for spring in model.springs:
                if spring.body == body.name:
                    of_body -= self._foundation(b, spring)
        for i, meets in enumerate(self._meets):
            self._add_contact(moved, meets, np.flatnonzero(model.group == i))
        return moved

    def _cells(self, b: int) -> Floats:
        """Derivative of ``λᵀ (K u - f)``, as far as it is over cells, ``(nodes, d)``."""
        body, d = self._model.bodies[b], self._model.dim
        total = self._integrals[b].motion.copy()
        phi = body.volume().phi
        for load, factors, owner in self._loads_of():
            if owner == b and load.force is not None:
                # ∫ λ·b dV changes with the volume alone.
                nodal = self._of_body(b, factors @ self._lambda) @ np.asarray(
                    load.force
                )
                work = np.einsum("pc,cq->pq", nodal[body.cells], phi)
                total[np.arange(d), np.arange(d)] -= work
        return internal_forces(body, total).reshape(-1, d)

    def _surface(self, b: int, load: Load, factors: Floats) -> Floats:
        """Derivative of ``λᵀ f`` of a traction or a pressure, ``(nodes, d)``."""
        body = self._model.bodies[b]
        facets = AreaVectors(body, str(load.surface))
        at = facets.at_points(self._of_body(b, factors @ self._lambda))
        if load.pressure is not None:
            cotangent = -load.pressure * at
        else:
            size = np.linalg.norm(facets.vectors, axis=0)
            along = np.einsum("dpq,d->pq", at, np.asarray(load.traction))
            cotangent = along * facets.vectors / size
        return facets.adjoint(body.depth * facets.weights * cotangent)

    def _foundation(self, b: int, spring: Spring) -> Floats:
        """Derivative of ``λᵀ K u`` of an elastic foundation, ``(nodes, d)``."""
        body = self._model.bodies[b]
        facets = AreaVectors(body, spring.surface)
        size = np.linalg.norm(facets.vectors, axis=0)
        n = facets.vectors / size
        total = np.zeros_like(n)
        for fields in zip(self._lambda, self._u, strict=True):
            adjoint, u = (facets.at_points(self._of_body(b, field)) for field in fields)
            if spring.stiffness is not None:
                each = np.broadcast_to(spring.stiffness, (body.dim,))
                total += np.einsum("d,dpq,dpq->pq", each, adjoint, u) * n
                continue
            tangential, normal = spring.tangential or 0.0, spring.normal or 0.0
            total += tangential * np.sum(adjoint * u, axis=0) * n
            # (λ·a) (u·a) / |a| of the area vector a.
            along, other = np.sum(adjoint * n, axis=0), np.sum(u * n, axis=0)
            total += (normal - tangential) * (
                along * u + other * adjoint - along * other * n
            )
        return facets.adjoint(body.depth * facets.weights * total)

    def _add_contact(self, derivative: Floats, meets: Meets, at: Ints) -> None:
        """Add the derivative of the contacts ``at`` of one surface to that of the nodes."""
        model, contact = self._model, meets.contact
        numbered, first_dofs = model.numbered[contact.body], model.contact_dofs[at]
        node, opposite = first_dofs.T // model.dim
        if contact.against is None:
            np.add.at(derivative, node, meets.at_rigid())
            return
        nodes, first = numbered.nodes_at(first_dofs[:, 0]), numbered.first // model.dim
        partners = model.nodes[opposite]
        ours, theirs = of_matching(meets, numbered.body, nodes, partners)
        derivative[first : first + len(ours)] += ours
        np.add.at(derivative, opposite, theirs)


def of_gradient(
    model: Assembly, gradient: Gradient, loads: Sequence[Load] = ()
) -> ParameterGradient:
    """The gradient of `Result.vjp` with respect to the parameters of a model.

    ``model``: the `Assembly` whose ``problem()`` was solved.
    ``gradient``: what ``result.vjp(...)`` returned for a result of this problem.
    ``loads``: the loads of the path, as in `ParameterGradient`.
    """
    result = gradient.result
    return ParameterGradient(
        model,
        adjoint=gradient.load,
        displacement=np.stack([step.displacement for step in result]),
        gap=gradient.gap_by_component,
        reaction=result.reaction,
        loads=loads,
    )


def _refuse_function(load: Load) -> None:
    if load.within is not None:
        raise ValueError(
            f"the {load.kind} on body {load.body!r} acts within ranges, which do not move with "
            "the nodes: its derivative with respect to node coordinates is not known; name "
            "its part as a surface instead"
        )
    value = getattr(load, load.kind)
    each = value.values() if isinstance(value, Mapping) else [value]
    if any(callable(values) or np.ndim(values) > 2 for values in each):
        raise ValueError(
            f"the {load.kind} on body {load.body!r} varies with the position, and its "
            "derivative with respect to node coordinates is not known: give a constant"
        )
