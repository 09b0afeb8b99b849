"""One elastic body by scikit-fem: mesh, material, stiffness, nodal forces of (1).

Shape functions, quadrature and mappings are scikit-fem's. Degrees of freedom go
node by node, ``dim * node + component``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bipot_rs.check import floats, number
from bipot_rs.extras import missing

try:
    import skfem
    from skfem.quadrature import get_quadrature
except ModuleNotFoundError as error:
    raise missing(error, "finite elements", "skfem", "fem") from None

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
# Scalar element on a facet.
_FACETS: dict[type, type] = {
    skfem.MeshTri1: skfem.ElementLineP1,
    skfem.MeshQuad1: skfem.ElementLineP1,
    skfem.MeshTet1: skfem.ElementTriP1,
    skfem.MeshHex1: skfem.ElementQuad1,
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
class Quadrature:
    """Points of Gauss on cells or facets, with the shape functions there.

    Attributes
    ----------
    corners : (parts, c)
        Nodes of each cell or facet.
    phi : (c, q)
        Shape functions at the points, the same on every part.
    places : (d, parts, q)
        The points [m].
    weights : (parts, q)
        Weights, which sum up to the volume [m³], or to the area [m²]; one power of
        length less in 2D, without the thickness.
    normals : (d, parts, q) or None
        Unit and outward, on facets.
    nodes : int
        Nodes of the body.
    """

    corners: Ints
    phi: Floats
    places: Floats
    weights: Floats
    normals: Floats | None
    nodes: int

    def moment(self, density: Floats) -> Floats:
        """∫ φ_i density, ``(nodes,)``, of a density ``(parts, q)`` at the points."""
        parts = np.einsum("pq,cq->pc", self.weights * density, self.phi)
        total = np.bincount(self.corners.ravel(), parts.ravel(), minlength=self.nodes)
        return np.asarray(total, dtype=np.float64)


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

    def volume(self) -> Quadrature:
        """Quadrature on the cells."""
        corners = np.asarray(self.mesh.t, dtype=np.int64).T
        x = self.points[corners]
        phi, slopes, weights = _reference(*_ELEMENTS[type(self.mesh)])
        _, determinant = _inverse(_jacobian(x, slopes))
        return Quadrature(
            corners=corners,
            phi=phi,
            places=np.einsum("pcd,cq->dpq", x, phi),
            weights=(weights[:, None] * np.abs(determinant)).T,
            normals=None,
            nodes=len(self.points),
        )

    def facets(self, surface: str) -> Ints:
        """Facets of a named surface; `ValueError` lists the names there are."""
        known = self.mesh.boundaries or {}
        if surface not in known:
            raise ValueError(
                f"body {self.name!r} has no surface {surface!r}, expected one of "
                + (", ".join(sorted(known)) or "none: its mesh names no surface")
            )
        return np.asarray(known[surface], dtype=np.int64)

    def surface(self, name: str) -> Quadrature:
        """Quadrature on the facets of a named surface."""
        facets = self.facets(name)
        corners = np.asarray(self.mesh.facets, dtype=np.int64)[:, facets].T
        x = self.points[corners]
        phi, slopes, weights = _reference(_FACETS[type(self.mesh)], 2)
        tangents = _jacobian(x, slopes).swapaxes(0, 1)
        if self.dim == 2:
            area = np.stack([tangents[0, :, 1], -tangents[0, :, 0]], axis=1)
        else:
            area = _cross(*tangents)
        size = np.linalg.norm(area, axis=1)
        cells = self.mesh.t[:, self.mesh.f2t[0, facets]]
        inwards = self.mesh.p[:, cells].mean(axis=1) - x.mean(axis=1).T
        inverted = np.einsum("qdp,dp->qp", area, inwards) > 0
        normals = area * (np.where(inverted, -1.0, 1.0) / size)[:, None]
        return Quadrature(
            corners=corners,
            phi=phi,
            places=np.einsum("pcd,cq->dpq", x, phi),
            weights=(weights[:, None] * size).T,
            normals=normals.transpose(1, 2, 0),
            nodes=len(self.points),
        )

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

    Triangles halve each rectangle by the diagonal from its lowest to its highest corner;
    tetrahedra are the six of each box whose edges climb from the lowest to the highest
    corner, one axis after the other in each of the six orders. Opposite faces are split
    alike, so that cells of neighbours conform, and bodies on one grid meet facet by
    facet; and halving all cells of the grid divides each simplex into 2^d.

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
    named = mesh.with_boundaries(
        {
            name: facets[(vertices[axis] == grids[axis][-end]).all(axis=0)]
            for name, (axis, end) in FACES[dim].items()
        }
    )
    # Names do not change facets and their cells: what is known of them is kept, as
    # finding it takes longer than assembling K.
    known = vars(named)
    known.update({key: value for key, value in vars(mesh).items() if key not in known})
    return named


def stiffness(body: Body) -> Any:
    """Stiffness of one body, CSR ``(dim * nodes, dim * nodes)``, symmetric to the bit.

    With ``E_kl = ∫ ∂_k φ_i ∂_l φ_j`` the block of nodes i, j is

        K_kl = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,

    so d(d+1)/2 scalar forms do the work of a vector form. Cells of one shape have one
    matrix, and all d² components share one sparsity pattern.
    """
    dim, nodes = body.dim, int(body.mesh.p.shape[1])
    cells = np.asarray(body.mesh.t, dtype=np.int64).T  # (cells, corners)
    shapes, which = _shapes(body.points[cells])
    start, column, gather = _node_pairs(cells, which, len(shapes), nodes)
    data = np.empty((dim, dim, len(column)))
    for k, m, values in _components(body, shapes):
        # The sum over cells: a row of `gather` for each pair of nodes that share one.
        data[k, m] = gather @ values.ravel()
        if m != k:
            data[m, k] = gather @ values.swapaxes(0, 1).ravel()
    blocks = sparse.bsr_array(
        (np.ascontiguousarray(data.transpose(2, 0, 1)), column, start),
        shape=(dim * nodes, dim * nodes),
    )
    return blocks.tocsr()


def _shapes(corners: Floats) -> tuple[Floats, Ints]:
    """Distinct cells up to translation, and which of them each cell is.

    Parameters
    ----------
    corners
        ``(cells, corners, d)``.

    Returns
    -------
    shapes, which
        Corners from the first one, ``(shapes, corners, d)``, and ``(cells,)``. Cells
        share a shape only if these differences agree in every bit: none is replaced
        by another that is only close to it.
    """
    count = len(corners)
    # Differences first: far from the origin the Jacobian of places loses digits.
    offset = corners - corners[:, :1]
    # Adding zero makes -0.0 the 0.0 that it equals.
    bits = (offset[:, 1:] + 0.0).reshape(count, -1).view(np.uint64)
    # Powers of an odd number; lengths with few digits end in zero bits, which products
    # keep, so the upper half is folded onto them.
    mix = np.cumprod(np.full(bits.shape[1], 0x9E3779B97F4A7C15, dtype=np.uint64))
    hashes = (bits ^ (bits >> np.uint64(32))) @ mix
    _, first, which = np.unique(hashes, return_index=True, return_inverse=True)
    if 2 * len(first) > count or not np.array_equal(bits[first][which], bits):
        # Hardly two alike, or two different ones of one hash.
        return offset, np.arange(count)
    return offset[first], which.astype(np.int64)


def _components(body: Body, shapes: Floats) -> Iterator[tuple[int, int, Floats]]:
    """Components ``K_km``, k ≤ m, of the stiffness of each shape, one at a time.

    Yields
    ------
    k, m, values
        ``(corners, corners, shapes)``, for k = m symmetric to the bit.
    """
    _, slopes, weights = _reference(*_ELEMENTS[type(body.mesh)])
    inverse, determinant = _inverse(_jacobian(shapes, slopes))
    root = np.sqrt(weights[:, None] * np.abs(determinant) * body.depth)
    inverse *= root[:, None, None]
    # ∂_a φ_i as (q, i, a, shapes); shapes last makes every loop below a long one.
    grad = np.einsum("qbi,qbac->qiac", slopes, inverse)
    dim = body.dim
    lame_lambda, lame_mu = body.material.lame(dim)

    def integral(k: int, m: int) -> Floats:
        found = np.einsum("qic,qjc->ijc", grad[:, :, k], grad[:, :, m])
        return np.asarray(found, dtype=np.float64)

    diagonal = [integral(k, k) for k in range(dim)]
    trace = sum(diagonal[1:], start=diagonal[0])
    for k in range(dim):
        own = (lame_lambda + lame_mu) * diagonal[k] + lame_mu * trace
        # Whoever computes products need not sum the mirrored one in the same order.
        yield k, k, 0.5 * (own + own.swapaxes(0, 1))
        for m in range(k + 1, dim):
            mixed = integral(k, m)
            yield k, m, lame_lambda * mixed + lame_mu * mixed.swapaxes(0, 1)


def _reference(element: type, order: int) -> tuple[Floats, Floats, Floats]:
    """Shape functions of scikit-fem on the reference cell, at its points of Gauss.

    Returns
    -------
    phi, slopes, weights
        ``(c, q)``, ``∂φ_i/∂ξ_b`` as ``(q, b, c)``, and ``(q,)``.
    """
    own = element()
    points, weights = get_quadrature(own.refdom, order)
    both = [own.lbasis(points, i) for i in range(own.doflocs.shape[0])]
    # Constant ones come without a column for each point.
    phi = np.stack([np.broadcast_to(f, weights.shape) for f, _ in both])
    slopes = np.stack([np.broadcast_to(df, points.shape) for _, df in both], axis=-1)
    return phi, np.ascontiguousarray(slopes.transpose(1, 0, 2)), weights


def _jacobian(corners: Floats, slopes: Floats) -> Floats:
    """``∂x_a/∂ξ_b``, ``(q, b, a, parts)``, of corners ``(parts, c, a)``."""
    # From the first corner: far from the origin the digits of x would be lost.
    offset = np.ascontiguousarray((corners - corners[:, :1]).transpose(1, 2, 0))
    return np.asarray(np.einsum("qbi,iac->qbac", slopes, offset), dtype=np.float64)


def _inverse(jacobian: Floats) -> tuple[Floats, Floats]:
    """``∂ξ_b/∂x_a``, ``(q, b, a, parts)``, and determinants ``(q, parts)``."""
    tangents = jacobian.swapaxes(0, 1)
    if len(tangents) == 2:
        (x, y), (z, w) = tangents.swapaxes(1, 2)
        determinant = x * w - y * z
        cofactors = np.stack([w, -z, -y, x], axis=1).reshape(jacobian.shape)
    else:
        s, t, r = tangents
        cofactors = np.stack([_cross(t, r), _cross(r, s), _cross(s, t)], axis=1)
        determinant = np.sum(s * cofactors[:, 0], axis=1)
    return cofactors / determinant[:, None, None], determinant


def _cross(u: Floats, v: Floats) -> Floats:
    """Vector products of ``(q, 3, parts)``."""
    (u0, u1, u2), (v0, v1, v2) = u.swapaxes(0, 1), v.swapaxes(0, 1)
    return np.stack([u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0], axis=1)


def _node_pairs(
    cells: Ints, which: Ints, shapes: int, nodes: int
) -> tuple[NDArray[Any], NDArray[Any], Any]:
    """Pattern of the nodes that share a cell, and where its entries come from.

    Returns
    -------
    start, column
        CSR of the pattern, columns ascending, int32 where that holds them.
    gather
        Sparse ``(pairs, corners² * shapes)`` of ones: the entries of cell matrices
        that a pair of nodes sums, in the order of the cells.
    """
    count, corners = cells.shape
    entries = count * corners**2
    integer = np.dtype(np.int32 if entries < 2**31 else np.int64)
    nodes_of = cells.astype(integer)
    # Transposing sorts by counting: in linear time, and stable, so that the entries of
    # a pair, and those of the mirrored pair, stay in the order of the cells. Rows are
    # corners of cells first, then the nodes of the columns.
    column = np.repeat(nodes_of, corners, axis=0).ravel()
    row_start = np.arange(0, entries + 1, corners, dtype=integer)
    entry = np.arange(entries, dtype=integer)
    by_column = sparse.csr_array(
        (entry, column, row_start), shape=(count * corners, nodes)
    ).tocsc()
    row = nodes_of.ravel()[by_column.indices]
    pairs = sparse.csr_array(
        (by_column.data, row, by_column.indptr), shape=(nodes, nodes)
    ).tocsc()
    new = np.empty(entries, dtype=np.bool_)
    new[1:] = pairs.indices[1:] != pairs.indices[:-1]
    new[pairs.indptr[:-1][np.diff(pairs.indptr) > 0]] = True
    first = np.flatnonzero(new)
    start = np.searchsorted(first, pairs.indptr)
    cell, place = np.divmod(pairs.data, corners**2)
    gather = sparse.csr_array(
        (
            np.ones(entries),
            place * integer.type(shapes) + which[cell].astype(integer),
            np.append(first, entries).astype(integer),
        ),
        shape=(len(first), corners**2 * shapes),
    )
    return start.astype(integer), pairs.indices[first].astype(integer), gather


def nodal_forces(body: Body, points: Quadrature, value: Field) -> Floats:
    """∫ φ_i value, ``(dim * nodes,)``, over cells or facets.

    Parameters
    ----------
    body
        The body, which gives the thickness in 2D.
    points
        `Body.volume` or `Body.surface`.
    value
        Density ``(d,)``, one at each quadrature point ``(d, cells, points)``, or
        a function of the places ``(d, cells, points)`` that returns either.
    """
    places = points.places
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
    forces = [body.depth * points.moment(component) for component in density]
    return np.stack(forces, axis=1).ravel()


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
