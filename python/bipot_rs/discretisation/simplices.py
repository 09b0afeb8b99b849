"""Triangles and tetrahedra with their facets, and the elasticity of a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.materials import Material


def pairs(dim: int) -> list[tuple[int, int]]:
    """Pairs (k, a) of a cell: facet opposite to corner k, and corner a of this facet."""
    return [(k, a) for k in range(dim + 1) for a in range(dim + 1) if a != k]


@dataclass(frozen=True)
class Simplices:
    """Cells, their facets, and how they are connected; areas without thickness."""

    points: Floats  # (nodes, d)
    corners: Ints  # (cells, d + 1)
    facets: Ints  # (facets, d): nodes of each facet
    facet_of: Ints  # (cells, d + 1): the facet opposite to each corner
    # (cells, d + 1): 1 if the normal of that facet points out of the cell, else -1.
    sign: Floats
    # (cells, d + 1, d + 1): entry [k, a]: position of corner a among the nodes of the facet
    # opposite to corner k; 0 for a = k.
    place: Ints
    gradients: Floats  # (cells, d + 1, d): gradients of the barycentric coordinates
    edges: Floats  # (cells, d, d): column k goes from corner 0 to corner k + 1
    volume: Floats  # (cells,)
    area: Floats  # (facets, d): normal of the facet times its area
    outside: Bools  # (facets,): whether the facet is on the boundary

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.points.shape[1])

    @property
    def size(self) -> Floats:
        """Areas of the facets, ``(facets,)``."""
        return np.asarray(np.linalg.norm(self.area, axis=1), dtype=np.float64)

    def local_moments(self) -> tuple[Ints, Floats]:
        """Indices of the facet moments of each cell, and their signs.

        Returns ``place, sign (cells, d (d + 1))``: ``d * facet + node`` in the order of
        `pairs`; 1 or -1.
        """
        of, at, signs = self.facet_of, self.place, self.sign
        chosen = pairs(self.dim)
        place = [self.dim * of[:, k] + at[:, k, a] for k, a in chosen]
        return np.stack(place, axis=1), np.stack([signs[:, k] for k, _ in chosen], 1)

    def by_cell(self, moments: Floats) -> Floats:
        """Outward moments ``(cells, d + 1, d + 1, d)``: facet opposite to k, corner a."""
        dim = self.dim
        place, sign = self.local_moments()
        outward = np.zeros((len(self.corners), dim + 1, dim + 1, dim))
        k, a = np.array(pairs(dim)).T
        outward[:, k, a] = sign[..., None] * moments.reshape(-1, dim)[place]
        return outward

    def linear_moments(self, facets: Ints, traction: Floats) -> Floats:
        """Moments ``(m, d nodes, d)`` of tractions linear on facets.

        ``facets, traction``: indices of facets ``(m,)``; tractions at their nodes ``(m, d
        nodes, d)``.
        """
        total = traction.sum(axis=1, keepdims=True)
        share = self.size[facets, None, None] / (self.dim * (self.dim + 1))
        return np.asarray(share * (traction + total), dtype=np.float64)


def simplices(body: Body) -> Simplices:
    """Cells and facets of a body.

    Raises `ValueError`: its cells are not triangles or tetrahedra.
    """
    mesh, points, dim = body.mesh, body.points, body.dim
    corners = body.cells
    if corners.shape[1] != dim + 1:
        raise ValueError(
            f"body {body.name!r} has cells of {corners.shape[1]} nodes, expected "
            'triangles or tetrahedra of first order: mesh.element = "P1"'
        )
    facets = np.asarray(mesh.facets, dtype=np.int64).T
    listed = np.asarray(mesh.t2f, dtype=np.int64).T
    # The corner opposite to a facet is the sum of all corners minus those of the facet.
    missing = corners.sum(axis=1)[:, None] - facets[listed].sum(axis=2)
    order = np.argmax(missing[:, None] == corners[:, :, None], axis=2)
    facet_of = np.take_along_axis(listed, order, axis=1)
    place = np.argmax(facets[facet_of][:, :, None] == corners[:, None, :, None], axis=3)
    edges = (points[corners[:, 1:]] - points[corners[:, :1]]).swapaxes(1, 2)
    inner = np.linalg.inv(edges)
    gradients = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    factorial = 2 if dim == 2 else 6
    volume = np.abs(np.linalg.det(edges)) / factorial
    first = np.asarray(mesh.f2t, dtype=np.int64)[0]
    sign = np.where(first[facet_of] == np.arange(len(corners))[:, None], 1.0, -1.0)
    area = np.empty((len(facets), dim))
    outward = -dim * volume[:, None, None] * gradients
    area[facet_of[sign > 0]] = outward[sign > 0]
    return Simplices(
        points=points,
        corners=corners,
        facets=facets,
        facet_of=facet_of,
        sign=sign,
        place=place,
        gradients=gradients,
        edges=edges,
        volume=volume,
        area=area,
        outside=np.asarray(mesh.f2t)[1] < 0,
    )


def strain(cells: Simplices, displacement: Floats) -> Floats:
    """Strain ``(cells, d, d)`` of nodal displacements ``(nodes, d)``."""
    gradient = np.einsum("cai,caj->cij", displacement[cells.corners], cells.gradients)
    return np.asarray(0.5 * (gradient + gradient.swapaxes(1, 2)), dtype=np.float64)


def elastic(material: Material, deformation: Floats) -> Floats:
    """Stress ``(..., d, d)`` of a strain ``(..., d, d)``."""
    dim = deformation.shape[-1]
    lame_lambda, lame_mu = material.lame(dim)
    trace = np.trace(deformation, axis1=-2, axis2=-1)[..., None, None]
    stress: Floats = 2 * lame_mu * deformation + lame_lambda * trace * np.eye(dim)
    return stress


def complementary(material: Material, stress: Floats) -> Floats:
    """``σ : C⁻¹ σ`` of stresses ``(..., d, d)``."""
    dim = stress.shape[-1]
    lame_lambda, lame_mu = material.lame(dim)
    trace = np.trace(stress, axis1=-2, axis2=-1)
    square = np.einsum("...ij,...ij->...", stress, stress)
    # With the deviator: near ν = 1/2 the usual form subtracts large numbers.
    deviator = square - trace**2 / dim
    bulk = dim * lame_lambda + 2 * lame_mu
    strains: Floats = deviator / (2 * lame_mu) + trace**2 / (dim * bulk)
    return strains


def error_energy(cells: Simplices, material: Material, stress: Floats) -> Floats:
    """``½ ∫ σ : C⁻¹ σ dV`` of each cell, exact for stresses of `johnson_mercier.stress`."""
    dim = cells.dim
    energy_density = complementary(material, stress).sum(axis=(1, 2))
    mean = complementary(material, stress.sum(axis=2)).sum(axis=1)
    # ∫ φ_a φ_b dV is the volume times (1 + δ_ab)/((d + 1)(d + 2)), of d + 1 equal parts.
    energy: Floats = (
        cells.volume / (2 * (dim + 1) ** 2 * (dim + 2)) * (energy_density + mean)
    )
    return energy
