"""One elastic body by scikit-fem: mesh, material, stiffness, nodal forces of (1).

Shape functions, quadrature and mappings are scikit-fem's. Degrees of freedom go
node by node, ``dim * node + component``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import skfem
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bipot_rs.check import floats, number

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Field: TypeAlias = ArrayLike | Callable[[Floats], ArrayLike]
Box: TypeAlias = Mapping[int, tuple[float, float]]

# Scalar element and quadrature order by mesh type. Simplices have constant
# gradients; order 2 is full Gauss quadrature, 2 points a direction.
_ELEMENTS: dict[type, tuple[type, int]] = {
    skfem.MeshTri1: (skfem.ElementTriP1, 1),
    skfem.MeshQuad1: (skfem.ElementQuad1, 2),
    skfem.MeshTet1: (skfem.ElementTetP1, 1),
    skfem.MeshHex1: (skfem.ElementHex1, 2),
}
_CELLS: dict[str, type] = {
    "triangle": skfem.MeshTri1,
    "quadrilateral": skfem.MeshQuad1,
    "tetrahedron": skfem.MeshTet1,
    "hexahedron": skfem.MeshHex1,
}
# Faces of a box, (axis, end); the last axis points up.
FACES: dict[int, dict[str, tuple[int, int]]] = {
    2: {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)},
    3: {
        "left": (0, 0),
        "right": (0, 1),
        "front": (1, 0),
        "back": (1, 1),
        "bottom": (2, 0),
        "top": (2, 1),
    },
}
# VTK's name, corners on the reference cell, neighbours of corner 0 along the
# axes, and an order of the corners that mirrors the cell.
_RING = ((0, 0), (1, 0), (1, 1), (0, 1))
_VTK: dict[type, tuple[str, list[tuple[int, ...]], list[int], list[int]]] = {
    skfem.MeshTri1: ("triangle", [(0, 0), (1, 0), (0, 1)], [1, 2], [0, 2, 1]),
    skfem.MeshQuad1: ("quad", [*_RING], [1, 3], [0, 3, 2, 1]),
    skfem.MeshTet1: (
        "tetra",
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
        [1, 2, 3],
        [0, 2, 1, 3],
    ),
    skfem.MeshHex1: (
        "hexahedron",
        [(x, y, z) for z in (0, 1) for x, y in _RING],
        [1, 3, 4],
        [4, 5, 6, 7, 0, 1, 2, 3],
    ),
}


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity.

    Parameters
    ----------
    young
        Young's modulus, > 0 [Pa].
    poisson
        Poisson's ratio, in (-1, 1/2).
    plane_stress
        In 2D, plane stress instead of plane strain; of no effect in 3D.
    thickness
        Out of plane, in 2D, > 0 [m]; of no effect in 3D.
    """

    young: float
    poisson: float
    plane_stress: bool = False
    thickness: float = 1.0

    def __post_init__(self) -> None:
        for name in ("young", "poisson", "thickness"):
            number(name, getattr(self, name))
        if not (np.isfinite(self.young) and self.young > 0):
            raise ValueError(f"young is {self.young}, expected a finite number > 0")
        if not -1 < self.poisson < 0.5:
            raise ValueError(f"poisson is {self.poisson}, expected it in (-1, 1/2)")
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise ValueError(
                f"thickness is {self.thickness}, expected a finite number > 0"
            )

    def lame(self, dim: int) -> tuple[float, float]:
        """Lamé's constants λ and μ [Pa], λ made that of plane stress if asked."""
        lame_mu = self.young / (2 * (1 + self.poisson))
        lame_lambda = 2 * lame_mu * self.poisson / (1 - 2 * self.poisson)
        if dim == 2 and self.plane_stress:
            # 2λμ/(λ + 2μ), written so that it does not divide by λ = 0.
            lame_lambda = 2 * lame_mu * self.poisson / (1 - self.poisson)
        return lame_lambda, lame_mu


@dataclass(frozen=True)
class Body:
    """A mesh with named surfaces (``mesh.boundaries``) and its material."""

    name: str
    mesh: Any
    material: Material

    def __post_init__(self) -> None:
        if type(self.mesh) not in _ELEMENTS:
            raise TypeError(
                f"mesh of body {self.name!r} is a {type(self.mesh).__name__}, expected "
                + ", ".join(t.__name__ for t in _ELEMENTS)
            )

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.mesh.p.shape[0])

    @property
    def points(self) -> Floats:
        """Nodes, ``(nodes, d)``."""
        return np.ascontiguousarray(self.mesh.p.T, dtype=np.float64)

    @property
    def depth(self) -> float:
        """What turns areas of the mesh into volumes: thickness in 2D, 1 in 3D."""
        return self.material.thickness if self.dim == 2 else 1.0

    def basis(self) -> Any:
        """Scalar basis of scikit-fem on the cells."""
        element, order = _ELEMENTS[type(self.mesh)]
        return skfem.Basis(self.mesh, element(), intorder=order)

    def facets(self, surface: str) -> Ints:
        """Facets of a named surface; `ValueError` lists the names there are."""
        known = self.mesh.boundaries or {}
        if surface not in known:
            raise ValueError(
                f"body {self.name!r} has no surface {surface!r}, expected one of "
                + (", ".join(sorted(known)) or "none: its mesh names no surface")
            )
        return np.asarray(known[surface], dtype=np.int64)

    def surface_basis(self, surface: str) -> Any:
        """Scalar basis of scikit-fem on the facets of a named surface."""
        element, _ = _ELEMENTS[type(self.mesh)]
        facets = self.facets(surface)
        return skfem.FacetBasis(self.mesh, element(), facets=facets, intorder=2)

    def nodes(self, surface: str, within: Box | None = None) -> Ints:
        """Nodes of a named surface, ascending; ``within`` keeps ``low ≤ x[axis] ≤ high``."""
        corners = self.mesh.facets[:, self.facets(surface)]
        nodes = np.unique(corners).astype(np.int64)
        for axis, (low, high) in (within or {}).items():
            x = self.mesh.p[axis, nodes]
            # A bound that falls on a grid line must not lose it to rounding.
            slack = 1e-9 * np.ptp(self.mesh.p[axis])
            nodes = nodes[(x >= low - slack) & (x <= high + slack)]
        return nodes


def box(axes: Sequence[ArrayLike], cell: str) -> Any:
    """Tensor-product mesh of a rectangle or a box with its faces named.

    Parameters
    ----------
    axes
        Grid points of each axis, in any order, at least two distinct ones [m].
    cell
        ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"``, ``"hexahedron"``.

    Returns
    -------
    skfem.Mesh
        With boundaries ``left``/``right`` (x), ``bottom``/``top`` (last axis),
        and in 3D ``front``/``back`` (y).
    """
    grids = [
        np.sort(floats(f"axis {k} of axes", axis, ndim=1))
        for k, axis in enumerate(axes)
    ]
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    if cell not in _CELLS or len(grids) != dim:
        raise ValueError(
            f"cell is {cell!r} with {len(grids)} axes, expected triangle or "
            "quadrilateral with 2, tetrahedron or hexahedron with 3"
        )
    for k, grid in enumerate(grids):
        if grid.size < 2 or not np.all(np.diff(grid) > 0):
            raise ValueError(f"axis {k} needs two or more distinct grid points")
    mesh: Any = _CELLS[cell].init_tensor(*grids)  # type: ignore[attr-defined]
    facets = mesh.boundary_facets()
    vertices = mesh.p[:, mesh.facets[:, facets]]
    return mesh.with_boundaries(
        {
            name: facets[(vertices[axis] == grids[axis][-end]).all(axis=0)]
            for name, (axis, end) in FACES[dim].items()
        }
    )


def stiffness(body: Body) -> Any:
    """Stiffness of one body, CSR ``(dim * nodes, dim * nodes)``, symmetric to the bit.

    With ``E_kl = ∫ ∂_k φ_i ∂_l φ_j`` the block of nodes i, j is

        K_kl = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,

    so d(d+1)/2 scalar forms do the work of one vector form with (2^d d)²
    entries a cell, and all d² blocks share one sparsity pattern.
    """
    basis, dim = body.basis(), body.dim
    lame_lambda, lame_mu = body.material.lame(dim)
    cells = np.asarray(basis.element_dofs, dtype=np.int64)  # (shape functions, cells)
    corners, count = cells.shape
    nodes = int(basis.N)

    # √w ∂_k φ_i as (d, cells, corners, points): products of these are symmetric.
    root = np.sqrt(np.asarray(basis.dx) * body.depth)
    grad = np.stack([phi[0].grad * root for phi in basis.basis], axis=2)

    # One entry of the scalar pattern for each pair of nodes that share a cell.
    row = np.broadcast_to(cells.T[:, :, None], (count, corners, corners))
    column = np.broadcast_to(cells.T[:, None, :], (count, corners, corners))
    keys, slot = np.unique(row.ravel() * nodes + column.ravel(), return_inverse=True)
    slots = slot.reshape(count, corners, corners)
    transposed = np.ascontiguousarray(slots.swapaxes(1, 2))

    def gather(where: Ints, values: Floats) -> Floats:
        total = np.bincount(where.ravel(), values.ravel(), minlength=len(keys))
        return np.asarray(total, dtype=np.float64)

    diagonal = [grad[k] @ grad[k].swapaxes(1, 2) for k in range(dim)]
    trace = sum(diagonal[1:], start=diagonal[0])
    data = np.empty((len(keys), dim, dim))
    for k in range(dim):
        own = (lame_lambda + lame_mu) * diagonal[k] + lame_mu * trace
        data[:, k, k] = gather(slots, 0.5 * (own + own.swapaxes(1, 2)))
        for m in range(k + 1, dim):
            mixed = grad[k] @ grad[m].swapaxes(1, 2)
            mixed = lame_lambda * mixed + lame_mu * mixed.swapaxes(1, 2)
            data[:, k, m] = gather(slots, mixed)
            # Summed in the same order at the mirrored place: the same bits.
            data[:, m, k] = gather(transposed, mixed)

    start = np.searchsorted(keys, np.arange(nodes + 1) * nodes)
    index = (keys % nodes).astype(np.int32)
    blocks = sparse.bsr_array(
        (data, index, start.astype(np.int32)), shape=(dim * nodes, dim * nodes)
    )
    return blocks.tocsr()


def nodal_forces(body: Body, basis: Any, value: Field) -> Floats:
    """∫ φ_i value, ``(dim * nodes,)``, over the cells or facets of a basis.

    Parameters
    ----------
    body
        The body, which gives the thickness in 2D.
    basis
        `Body.basis` or `Body.surface_basis`.
    value
        Density ``(d,)``, one at each quadrature point ``(d, cells, points)``, or
        a function of the places ``(d, cells, points)`` that returns either.
    """
    places = np.asarray(basis.global_coordinates())
    what = f"force on body {body.name!r}"
    density = floats(what, value(places) if callable(value) else value)
    if density.shape[:1] != (body.dim,):
        raise ValueError(
            f"{what} has shape {density.shape}, expected {body.dim} components"
        )
    if density.ndim == 1:
        density = density[:, None, None]
    if density.ndim > places.ndim or any(
        found not in (1, wanted)
        for found, wanted in zip(density.shape[::-1], places.shape[::-1], strict=False)
    ):
        raise ValueError(
            f"{what} has shape {density.shape}, expected ({body.dim},) or "
            f"{places.shape}"
        )
    density = np.broadcast_to(density, places.shape)
    forces = [body.depth * moment(basis, component) for component in density]
    return np.stack(forces, axis=1).ravel()


def moment(basis: Any, density: Floats) -> Floats:
    """∫ φ_i density, ``(nodes,)``, of a density at the quadrature points."""

    @skfem.LinearForm  # type: ignore[untyped-decorator]
    def form(v: Any, w: Any) -> Any:
        return w.density * v

    values: Floats = np.asarray(form.assemble(basis, density=density), dtype=float)
    return values


def vtk_cells(body: Body) -> tuple[str, Ints]:
    """Kind and corners of the cells, which scikit-fem may number mirrored."""
    kind, corners, axes, mirror = _VTK[type(body.mesh)]
    element, _ = _ELEMENTS[type(body.mesh)]
    theirs = [tuple(int(c) for c in place) for place in element().doflocs]
    cells = body.mesh.t[[theirs.index(corner) for corner in corners]].T.astype(np.int64)
    edges = body.points[cells[:, axes]] - body.points[cells[:, :1]]
    inverted = np.linalg.det(edges) < 0
    cells[inverted] = cells[inverted][:, mirror]
    return kind, cells
