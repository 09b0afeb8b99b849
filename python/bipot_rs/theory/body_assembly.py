"""Strains, forces and stiffness of a body at its quadrature points, as sparse matrices.

Strains and stresses are vectors of six components, as `soils.mandel` makes them; all
quadrature points are in one row, cell after cell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from bipot_rs._lib.messages import make_type_error, place
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import indices
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.elasticity import stiffness
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.fem.bodies.stress_recovery import slopes_at_points
from bipot_rs.theory.soils import mandel

# Supports stop a motion of order one if it moves them by more: no rounding, no mechanism.
_HELD = 1e-9


class BodyAssembly:
    """A body of isotropic elasticity, in 2D in plane strain, with its supports.

    Parameters
    ----------
    body
        Mesh and elasticity.
    fixed
        Degrees of freedom with prescribed displacement.

    Attributes
    ----------
    body, fixed, free
        The body, and its degrees of freedom with prescribed and with free displacement.
    shape
        ``(cells, points)`` of the quadrature.
    weights
        Volumes that the points stand for, ``(m,)`` [m³].
    bulk, shear
        Moduli K and G at the points, ``(m,)`` [Pa].
    elastic
        Elastic stiffness, CSR ``(n, n)`` [N/m].

    Raises
    ------
    TypeError, ValueError
        A wrong argument; the supports leave a rigid motion free.
    """

    def __init__(self, body: Body, fixed: ArrayLike) -> None:
        if not isinstance(body, Body):
            raise make_type_error("body", body, "a bipot_rs.fem.Body")
        n = body.points.size
        moduli = _moduli(body)
        self.body = body
        self.fixed = indices("fixed", fixed, n)
        _check_supports(body, self.fixed)
        self.free = np.setdiff1d(np.arange(n), self.fixed)
        weights = body.depth * body.volume().weights
        self.shape: tuple[int, int] = weights.shape
        self.weights = weights.ravel()
        self.bulk, self.shear = np.repeat(moduli, self.shape[1], axis=1)
        self._strain = _strain_matrix(body)
        self.elastic = stiffness(body)
        self._factor = splu(self.elastic[self.free][:, self.free].tocsc())

    def strains(self, u: Floats) -> Floats:
        """Strains of a displacement ``(n,)``, ``(m, 6)``."""
        return np.asarray((self._strain @ u).reshape(-1, 6))

    def forces(self, stress: Floats) -> Floats:
        """Nodal forces ``∫ σ:ε(φ_i) dΩ`` that balance stresses ``(m, 6)``, ``(n,)`` [N]."""
        return np.asarray(self._strain.T @ (self.weights[:, None] * stress).ravel())

    def stiffness(self, tangent: Floats) -> CsrMatrix:
        """``∫ ε(φ_i):C:ε(φ_j) dΩ`` of tangents ``(m, 6, 6)``, CSR ``(n, n)`` [N/m]."""
        points = len(tangent)
        blocks = self.weights[:, None, None] * tangent
        law = sparse.bsr_array(
            (blocks, np.arange(points), np.arange(points + 1)),
            shape=(6 * points, 6 * points),
        )
        blocks_of_points: CsrMatrix = law.tocsr()
        return (self._strain.T @ (blocks_of_points @ self._strain)).tocsr()

    def solve(self, rest: Floats) -> Floats:
        """Elastic displacement of the free degrees of freedom under forces on them."""
        return np.asarray(self._factor.solve(rest))

    def unit_strains(self) -> Floats:
        """Strains of unit displacements at free degrees of freedom, ``(m, 6, free)``."""
        dense = self._strain[:, self.free].toarray()
        return np.asarray(dense.reshape(len(self.weights), 6, -1))


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


def _strain_matrix(body: Body) -> CsrMatrix:
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
    matrix: CsrMatrix = sparse.coo_array(
        (
            strain.ravel(),
            (np.broadcast_to(rows, strain.shape).ravel(), columns.ravel()),
        ),
        shape=(6 * cells * q, body.points.size),
    ).tocsr()
    matrix.eliminate_zeros()
    return matrix


def _check_supports(body: Body, fixed: Ints) -> None:
    """Refuse supports that leave a rigid motion of the body, or of a part of it, free."""
    cells, nodes = body.cells, len(body.points)
    ends = np.repeat(cells[:, :1], cells.shape[1], axis=1)
    shape = (nodes, nodes)
    links = sparse.coo_array(
        (np.ones(cells.size), (ends.ravel(), cells.ravel())), shape
    )
    parts, part_of = connected_components(links, directed=False)
    for part in range(parts):
        motions = _rigid_motions(body.points, part_of == part)
        held = motions.reshape(len(motions), -1)[:, fixed]
        if np.linalg.matrix_rank(held, tol=_HELD) < len(motions):
            where = place(body.points[part_of == part].mean(axis=0))
            raise ValueError(
                f"fixed leaves a rigid motion of body {body.name!r} free, of the part "
                f"with its centre at {where}: fix more of its degrees of freedom"
            )


def _rigid_motions(points: Floats, inside: Bools) -> Floats:
    """Rigid motions of some nodes, zero at others, of order one: ``(motions, nodes, d)``."""
    d = points.shape[1]
    x = np.where(inside[:, None], points - points[inside].mean(axis=0), 0.0)
    x /= np.abs(x).max()
    motions = [np.outer(inside, axis) for axis in np.eye(d)]
    for i in range(d):
        for j in range(i):
            turn = np.zeros_like(x)
            turn[:, i], turn[:, j] = x[:, j], -x[:, i]
            motions.append(turn)
    return np.stack(motions)
