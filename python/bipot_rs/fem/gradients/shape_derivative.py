"""Derivatives of integrals over cells and facets with respect to node coordinates.

Cells are isoparametric: moving the nodes by δx moves the quadrature points by
``Σ φ_i δx_i``, and changes at each of them

    ∂_a u_k  by  -∂_b u_k ∂_a δx_b,      dV  by  ∂_a δx_a dV,

so that the derivative of an integral over cells is ``∫ S_ba ∂_a φ_i``, nodal forces of a
"stress" S. An integral over facets depends on the nodes by the area vectors only.
These are the exact derivatives of the sums over quadrature points.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.fem.bodies.body import Body
from bipot_rs.mesh.elements import facet_nodes, jacobian


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
