"""Derivatives of gaps and of B with respect to node coordinates and obstacle positions.

With the gap cotangent G of each step by component, the adjoint displacement λ, the
displacement u and the reaction r, what depends on the geometry of the contacts is

    Σ_k  λ_kᵀ Bᵀ r_k  +  G_k · (B u_k + g_k).

The rows of B are the frame of the contact, and the frame depends on its normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.matrices import length
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.contact.contact import Contact, both, rigid_obstacle
from bipot_rs.mesh.elements import facet_nodes, jacobian
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.protocol import Obstacle, check_direction
from bipot_rs.obstacle.shapes import Cylinder, Plane, Sphere, Torus, Union


def curvature(obstacle: Obstacle, points: Floats) -> Floats:
    """``∂n_i/∂x_j`` of `Obstacle.closest`, ``(n, d, d)`` [1/m]; symmetric.

    It is the second derivative of the distance: its first derivative is n.

    Raises `ValueError`: the obstacle has no formula for it: `Distance`, `Surface`, or a class
    defined elsewhere.
    """
    if isinstance(obstacle, Union):
        each = [part.closest(points).distance for part in obstacle.obstacles]
        nearest = np.argmin(each, axis=0)
        curvatures = np.stack([curvature(part, points) for part in obstacle.obstacles])
        return np.asarray(curvatures[nearest, np.arange(len(points))])
    count, dim = points.shape
    unit = np.broadcast_to(np.eye(dim), (count, dim, dim))
    if isinstance(obstacle, Plane):
        return np.zeros((count, dim, dim))
    if isinstance(obstacle, Sphere):
        arm = points - np.asarray(obstacle.centre, np.float64)
        return _round(arm, unit, obstacle.inside)
    if isinstance(obstacle, Cylinder):
        arm, slope = points - np.asarray(obstacle.point, np.float64), unit
        if obstacle.axis is not None:
            axis = check_direction("axis of the cylinder", obstacle.axis, 3)
            slope = unit - np.outer(axis, axis)
            arm = np.einsum("nij,nj->ni", slope, arm)
        return _round(arm, slope, obstacle.inside)
    if isinstance(obstacle, Torus):
        axis = check_direction("axis of the torus", obstacle.axis, 3)
        across = unit - np.outer(axis, axis)
        arm = points - np.asarray(obstacle.centre, np.float64)
        radial = np.einsum("nij,nj->ni", across, arm)
        far = length(radial)[:, None]
        slope = unit - obstacle.major_radius * _differentiate_direction(radial, across)
        return _round(
            arm - obstacle.major_radius * radial / far, slope, obstacle.inside
        )
    raise ValueError(
        f"the obstacle is a {type(obstacle).__name__}, for which the derivative of the "
        "normal has no formula: use a Plane, Sphere, Cylinder, Torus or a Union of these"
    )


def _differentiate_direction(arm: Floats, slope: Floats) -> Floats:
    """Derivative of ``arm / |arm|``, from that of ``arm``, ``(n, d, d)``."""
    far = length(arm)
    unit = arm / far[:, None]
    along = np.einsum("nk,nkj->nj", unit, slope)
    turned = (slope - unit[:, :, None] * along[:, None]) / far[:, None, None]
    return np.asarray(turned, np.float64)


def _round(arm: Floats, slope: Floats, inside: bool) -> Floats:
    return (-1.0 if inside else 1.0) * _differentiate_direction(arm, slope)


def stress_of_motion(
    adjoint: Floats, displacement: Floats, stress: Floats, adjoint_stress: Floats
) -> Floats:
    """S of ``∫ ∇λ : C : (∇u - ε0)``, ``(d, d, cells, points)``.

    ``adjoint, displacement``: ``∂_a λ_k`` and ``∂_a u_k``, ``(k, a, cells, points)``.
    ``stress, adjoint_stress``: ``C : (∇u - ε0)`` and ``C : ∇λ``, in the plane in 2D, in the
    same shape.
    """
    stress_change = -np.einsum("kbpq,kapq->bapq", adjoint, stress)
    stress_change -= np.einsum("kbpq,kapq->bapq", displacement, adjoint_stress)
    energy = np.einsum("kapq,kapq->pq", adjoint, stress)
    for k in range(len(stress_change)):
        stress_change[k, k] += energy
    return np.asarray(stress_change, np.float64)


class AreaVectors:
    """Outward area vectors at the quadrature points of a surface, and their adjoint.

    ``corners (facets, c)``: nodes of each facet.
    ``phi (c, q)``: shape functions at the points.
    ``vectors (d, facets, q)``: outward normal times the area of the facet over that of the
    reference facet [m²], in 2D the length.
    ``weights (q,)``: weights of the points on the reference facet.
    """

    def __init__(self, body: Body, surface: str) -> None:
        kind = body.kind.facet
        self._count = len(body.points)
        self.corners = facet_nodes(body.mesh, body.facets(surface))
        self.phi, self._slopes, self.weights = kind.reference
        # (b, a, facets, q).
        self._tangents = jacobian(body.points[self.corners], self._slopes).transpose(
            1, 2, 3, 0
        )
        vectors = _normal(self._tangents)
        outward = np.asarray(body.surface(surface).normals)
        self._sign = np.sign(np.einsum("dpq,dpq->pq", vectors, outward))
        self.vectors = self._sign * vectors

    def at_points(self, nodal: Floats) -> Floats:
        """Values ``(d, facets, q)`` at the points, from those of the nodes ``(nodes, d)``."""
        return np.asarray(np.einsum("pcd,cq->dpq", nodal[self.corners], self.phi))

    def adjoint(self, cotangent: Floats) -> Floats:
        """Derivative with respect to the nodes, ``(nodes, d)``.

        ``cotangent``: derivative with respect to `vectors`, ``(d, facets, q)``.
        """
        signed = self._sign * cotangent
        if len(signed) == 2:
            along = np.stack([-signed[1], signed[0]])[None]
        else:
            s, t = self._tangents
            along = np.stack(
                [np.cross(t, signed, axis=0), np.cross(signed, s, axis=0)], axis=0
            )
        parts = np.einsum("qbi,bapq->pia", self._slopes, along)
        by_corner = np.zeros((self._count, len(signed)))
        np.add.at(by_corner, self.corners.ravel(), parts.reshape(-1, len(signed)))
        return by_corner


def _normal(tangents: Floats) -> Floats:
    """Area vectors ``(d, facets, q)`` of tangents ``(b, a, facets, q)``."""
    if len(tangents) == 1:
        return np.stack([tangents[0, 1], -tangents[0, 0]])
    return np.asarray(np.cross(tangents[0], tangents[1], axis=0))


@dataclass(frozen=True)
class Meets:
    """The contacts of one `Contact`, with what multiplies their derivatives."""

    contact: Contact  # the surface and its obstacle
    points: Floats  # (m, d): positions of the nodes [m]
    frame: Floats  # (m, d, d): rows n, t1[, t2]
    gap: Floats  # (steps, m, d): cotangent G of the gaps, by component
    # (m, d, d): cotangent of the frame as rows of B: `Σ_k r_k ⊗ λ_k + G_k ⊗ u_k`, with λ and u
    # relative to the partner.
    rows: Floats

    def at_rigid(self) -> Floats:
        """Derivative with respect to the points, for a rigid obstacle, ``(m, d)``.

        Its negative sum is the derivative with respect to the position of the obstacle.

        Raises `ValueError`: the obstacle turns, or its normals have no formula for the
        derivative.
        """
        contact = self.contact
        what = f"contact on {contact.surface!r} of body {contact.body!r}"
        obstacle = rigid_obstacle(contact, self.points.shape[1])
        motion = contact.motion
        if motion is not None and motion.turns:
            raise ValueError(
                f"{what}: its obstacle turns, and derivatives are available only for "
                "obstacles that rest or are translated"
            )
        if contact.pairing != "match" and not isinstance(obstacle, Plane):
            raise ValueError(
                f"{what}: with pairing {contact.pairing!r} the derivative of the gap is "
                "available only for a plane"
            )
        try:
            at_points, cotangent = np.zeros_like(self.points), self.rows.copy()
            seen = [
                obstacle.closest(self.points - shift)
                for shift in _shifts(motion, self.points.shape[1])
            ]
            shift = _shifts(motion, self.points.shape[1])
            # The normals are those of the start in all steps.
            slope = curvature(obstacle, self.points)
        except ValueError as error:
            raise ValueError(f"{what}: {error}") from None
        for k, G in enumerate(self.gap):
            # Without a motion all steps have the gap of the start.
            state = 0 if motion is None else k + 1
            at_points += G[:, :1] * seen[state].normal
            cotangent[:, 1:] -= G[:, 1:, None] * shift[state]
        normal = of_normal(self.frame, cotangent, contact)
        return np.asarray(at_points + np.einsum("cij,ci->cj", slope, normal))


def _shifts(motion: Motion | None, dim: int) -> Floats:
    """Translation of the obstacle at the start and after each step, ``(states, d)``."""
    return np.zeros((1, dim)) if motion is None else motion.shifts


def of_normal(frame: Floats, cotangent: Floats, contact: Contact) -> Floats:
    """Derivative with respect to the unit normals, from that of the frames of `frames`.

    ``frame, cotangent``: ``(m, d, d)``.
    ``contact``: its ``axis`` sets the tangents in space.
    Returns ``(m, d)``: orthogonal to the normal, as its changes are.
    """
    n, t = frame[:, 0], frame[:, 1]
    along, by_normal = cotangent[:, 1].copy(), cotangent[:, 0].copy()
    if frame.shape[1] == 3:
        # t2 = s n × t1 with the sign s of the frame.
        turning = np.linalg.det(frame)[:, None] * cotangent[:, 2]
        by_normal += np.cross(t, turning)
        along += np.cross(turning, n)
    reference = _find_first_axis(n, contact)
    # t1 = (e - (e·n) n) / size, of which the part along t1 is normalised away.
    size = np.sum(reference * t, axis=1, keepdims=True)
    along -= np.sum(along * t, axis=1, keepdims=True) * t
    e_n = np.sum(reference * n, axis=1, keepdims=True)
    by_normal -= (
        np.sum(along * n, axis=1, keepdims=True) * reference + e_n * along
    ) / size
    return np.asarray(by_normal - np.sum(by_normal * n, axis=1, keepdims=True) * n)


def _find_first_axis(normal: Floats, contact: Contact) -> Floats:
    """The direction from which `frames` makes t1, ``(m, d)``."""
    if contact.axis is not None:
        return np.broadcast_to(np.asarray(contact.axis, np.float64), normal.shape)
    nearest = np.argmax(np.abs(normal), axis=1)
    return np.asarray(np.eye(normal.shape[1])[np.where(nearest > 0, 0, 1)])


def of_matching(
    meets: Meets, body: Body, nodes: Ints, partners: Floats
) -> tuple[Floats, Floats]:
    """Derivatives for two bodies whose nodes match.

    ``body, nodes``: the body of the contact, and the node of each contact ``(m,)``.
    ``partners``: positions of the nodes opposite, ``(m, d)``.
    Returns ``own, opposite``: with respect to the nodes of the body, ``(nodes, d)``, and to the
    partners, ``(m, d)``.
    """
    contact, n, G = meets.contact, meets.frame[:, 0], meets.gap[:, :, 0].sum(axis=0)
    at_nodes = np.zeros_like(body.points)
    cotangent = meets.rows.copy()
    cotangent[:, 0] += G[:, None] * (meets.points - partners)
    normal = of_normal(meets.frame, cotangent, contact)
    # n is minus the sum of area vectors, weighted by φ, over its length.
    facets = AreaVectors(body, contact.surface)
    weighted = np.einsum("dpq,cq,q->pcd", facets.vectors, facets.phi, facets.weights)
    total = np.zeros_like(at_nodes)
    np.add.at(total, facets.corners.ravel(), weighted.reshape(-1, body.dim))
    nodal = np.zeros_like(at_nodes)
    nodal[nodes] = -normal / np.linalg.norm(total[nodes], axis=1, keepdims=True)
    at_nodes += facets.adjoint(facets.at_points(nodal) * facets.weights)
    np.add.at(at_nodes, nodes, G[:, None] * n)
    return at_nodes, -G[:, None] * n


def refuse_moving_nodes(contacts: Sequence[Contact]) -> None:
    """Refuse contacts whose derivative with respect to node coordinates is not known."""
    for contact in contacts:
        what = f"contact on {contact.surface!r} of body {contact.body!r}"
        if contact.pairing != "match":
            other = both(contact) if contact.against else "an obstacle"
            raise ValueError(
                f"{what}: with pairing {contact.pairing!r} ({other}) the derivative of B "
                "and of the gap with respect to node coordinates is not available: use "
                "pairing='match'"
            )
        if callable(contact.clearance):
            raise ValueError(
                f"{what}: clearance is a function of the positions, whose derivative is "
                "not known: give numbers"
            )
