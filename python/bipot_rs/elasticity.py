"""One elastic body by scikit-fem: mesh, materials, stiffness, nodal forces of (1).

Shape functions, quadrature and mappings are scikit-fem's. Degrees of freedom go
node by node, ``dim * node + component``; nodes on edges, faces and in cells of second
order are nodes as those at corners are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bipot_rs.boxes import FACES, box
from bipot_rs.check import floats
from bipot_rs.elements import (
    KINDS,
    Floats,
    Ints,
    Kind,
    cell_nodes,
    cross,
    facet_nodes,
    inverse,
    jacobian,
    reference,
)
from bipot_rs.materials import Elastic, Material, Orthotropic

__all__ = [
    "FACES",
    "Body",
    "Box",
    "Elastic",
    "Field",
    "Floats",
    "Ints",
    "Material",
    "Orthotropic",
    "Quadrature",
    "box",
    "nodal_forces",
    "stiffness",
    "surface_stiffness",
    "vtk_cells",
]

Field: TypeAlias = ArrayLike | Callable[[Floats], ArrayLike]
Box: TypeAlias = Mapping[int, tuple[float, float]]


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
    """A mesh with named surfaces (``mesh.boundaries``) and its material.

    Parameters
    ----------
    name
        Names differ among the bodies of a model.
    mesh
        Of scikit-fem: triangles, quadrilaterals, tetrahedra, hexahedra, of first or
        second order, as of `box` or `mesh_file.read_mesh`.
    material
        Of the whole body, or one by the name of each of its volumes
        (``mesh.subdomains``), which cover it without overlap.
    """

    name: str
    mesh: Any
    material: Elastic | Mapping[str, Elastic]

    def __post_init__(self) -> None:
        if type(self.mesh) not in KINDS:
            raise TypeError(
                f"mesh of body {self.name!r} is a {type(self.mesh).__name__}, expected "
                + ", ".join(t.__name__ for t in KINDS)
            )
        if isinstance(self.material, Mapping):
            self.material_of_cells  # noqa: B018 - says what does not fit
            if len({(m.plane_stress, m.thickness) for m in self.materials}) > 1:
                raise ValueError(
                    f"materials of body {self.name!r} differ in plane_stress or in "
                    "thickness, expected the same in all its volumes"
                )
        for material in self.materials:
            material.tensor(self.dim)  # one of three dimensions may not fit a plane

    @property
    def kind(self) -> Kind:
        """What is to know of its cells."""
        return KINDS[type(self.mesh)]

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.mesh.p.shape[0])

    @property
    def points(self) -> Floats:
        """Nodes, ``(nodes, d)``."""
        return np.ascontiguousarray(self.mesh.p.T, dtype=np.float64)

    @property
    def cells(self) -> Ints:
        """Nodes of each cell in the order of its element, ``(cells, c)``."""
        return cell_nodes(self.mesh)

    @property
    def materials(self) -> list[Elastic]:
        """Those of its volumes, or its only one."""
        if isinstance(self.material, Mapping):
            return list(self.material.values())
        return [self.material]

    @property
    def material_of_cells(self) -> Ints:
        """Which of `materials` each cell has, ``(cells,)``.

        Raises
        ------
        ValueError
            A volume that the mesh does not name, cells of none or of two.
        """
        found = np.full(int(self.mesh.t.shape[1]), -1, dtype=np.int64)
        if not isinstance(self.material, Mapping):
            return np.zeros_like(found)
        for k, volume in enumerate(self.material):
            cells = self.volume_cells(volume)
            twice = cells[found[cells] >= 0]
            if twice.size:
                raise ValueError(
                    f"volume {volume!r} of body {self.name!r} shares "
                    f"{len(twice)} cells with another one that has a material"
                )
            found[cells] = k
        if (found < 0).any():
            bare = self.mesh.p[:, self.mesh.t[:, np.argmin(found)]].mean(axis=1)
            place = ", ".join(f"{x:g}" for x in bare)
            raise ValueError(
                f"material of body {self.name!r} leaves {(found < 0).sum()} cells "
                f"without one, the first at ({place}), expected volumes that cover it"
            )
        return found

    @property
    def isotropic(self) -> Material:
        """Its material, for what knows only one that is isotropic; else `ValueError`."""
        if not isinstance(self.material, Material):
            many = isinstance(self.material, Mapping)
            raise ValueError(
                f"body {self.name!r} has {'several materials' if many else 'an '}"
                f"{'' if many else 'orthotropic material'}, expected one that is "
                "isotropic"
            )
        return self.material

    @property
    def depth(self) -> float:
        """What turns areas of the mesh into volumes: thickness in 2D, 1 in 3D."""
        return self.materials[0].thickness if self.dim == 2 else 1.0

    def volume(self) -> Quadrature:
        """Quadrature on the cells."""
        corners = self.cells
        x = self.points[corners]
        phi, slopes, weights = reference(self.kind.scalar, self.kind.order)
        _, determinant = inverse(jacobian(x, slopes))
        return Quadrature(
            corners=corners,
            phi=phi,
            places=np.einsum("pcd,cq->dpq", x, phi),
            weights=(weights[:, None] * np.abs(determinant)).T,
            normals=None,
            nodes=len(self.points),
        )

    def volume_cells(self, volume: str) -> Ints:
        """Cells of a named volume; `ValueError` lists the names there are."""
        known = self.mesh.subdomains or {}
        if volume not in known:
            raise ValueError(
                f"body {self.name!r} has no volume {volume!r}, expected one of "
                + (", ".join(sorted(known)) or "none: its mesh names no volume")
            )
        return np.asarray(known[volume], dtype=np.int64)

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
        corners = facet_nodes(self.mesh, facets)
        x = self.points[corners]
        phi, slopes, weights = reference(self.kind.facet, self.kind.facet_order)
        tangents = jacobian(x, slopes).swapaxes(0, 1)
        if self.dim == 2:
            area = np.stack([tangents[0, :, 1], -tangents[0, :, 0]], axis=1)
        else:
            area = cross(*tangents)
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
        corners = facet_nodes(self.mesh, self.facets(surface))
        nodes = np.unique(corners).astype(np.int64)
        for axis, (low, high) in (within or {}).items():
            x = self.mesh.p[axis, nodes]
            # A bound that falls on a grid line must not lose it to rounding.
            slack = 1e-9 * np.ptp(self.mesh.p[axis])
            nodes = nodes[(x >= low - slack) & (x <= high + slack)]
        return nodes


def stiffness(body: Body) -> Any:
    """Stiffness of one body, CSR ``(dim * nodes, dim * nodes)``, symmetric to the bit.

    With ``E_kl = ∫ ∂_k φ_i ∂_l φ_j`` the block of nodes i, j is

        K_kl = Σ_ab C_kalb E_ab = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,

    the latter where the material is isotropic, so d(d+1)/2 scalar forms do the work of
    a vector form. Cells of one shape and material have one matrix, and all d²
    components share one sparsity pattern.

    Raises
    ------
    ValueError
        A cell that is folded or flat: its number, and where it is.
    """
    dim, nodes = body.dim, int(body.mesh.p.shape[1])
    cells = body.cells
    shapes, which = _shapes(body.points[cells])
    material = np.zeros(len(shapes), dtype=np.int64)
    if len(body.materials) > 1:
        both = which * len(body.materials) + body.material_of_cells
        kept, which = np.unique(both, return_inverse=True)
        shape, material = np.divmod(kept, len(body.materials))
        shapes = shapes[shape]
    gradients = _gradients(body, shapes, which)
    start, column, gather = _node_pairs(cells, which, len(shapes), nodes)
    data = np.empty((dim, dim, len(column)))
    for k, m, values in _components(body, gradients, material):
        # The sum over cells: a row of `gather` for each pair of nodes that share one.
        data[k, m] = gather @ values.ravel()
        if m != k:
            data[m, k] = gather @ values.swapaxes(0, 1).ravel()
    return _matrix(data, column, start)


def surface_stiffness(body: Body, surface: str, density: Floats) -> Any:
    """``∫ φ_i k φ_j`` over a surface, CSR as `stiffness`, symmetric to the bit.

    Parameters
    ----------
    density
        Stiffness per area k, symmetric, at the points of ``body.surface(surface)``:
        ``(d, d, facets, points)`` [N/m³].
    """
    points = body.surface(surface)
    phi, weights = points.phi, body.depth * points.weights
    parts = len(points.corners)
    start, column, gather = _node_pairs(
        points.corners, np.arange(parts), parts, points.nodes
    )
    data = np.empty((body.dim, body.dim, len(column)))
    for k in range(body.dim):
        for m in range(k, body.dim):
            values = np.einsum("pq,iq,jq->ijp", weights * density[k, m], phi, phi)
            values = 0.5 * (values + values.swapaxes(0, 1))
            data[k, m] = data[m, k] = gather @ values.ravel()
    return _matrix(data, column, start)


def _matrix(data: Floats, column: NDArray[Any], start: NDArray[Any]) -> Any:
    """CSR of components ``(d, d, pairs)`` on a pattern of nodes."""
    n = len(data) * (len(start) - 1)
    blocks = (np.ascontiguousarray(data.transpose(2, 0, 1)), column, start)
    return sparse.bsr_array(blocks, shape=(n, n)).tocsr()


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


def _gradients(body: Body, shapes: Floats, which: Ints) -> Floats:
    """``∂_a φ_i √(weight)``, ``(q, i, a, shapes)``: products of two sum to integrals."""
    _, slopes, weights = reference(body.kind.scalar, body.kind.order)
    with np.errstate(divide="ignore", invalid="ignore"):
        inner, determinant = inverse(jacobian(shapes, slopes))
    # A mirrored numbering has one sign all over; a cell that is folded has both.
    good = (determinant * np.sign(determinant[0]) > 0).all(axis=0)
    if not good.all():
        cell = int(np.argmin(good[which]))
        place = body.points[body.cells[cell]].mean(axis=0)
        raise ValueError(
            f"cell {cell} of body {body.name!r} is folded or flat, at "
            f"({', '.join(f'{x:g}' for x in place)}): its mapping has the determinants "
            f"{determinant[:, which[cell]].min():g} to "
            f"{determinant[:, which[cell]].max():g} within it"
        )
    root = np.sqrt(weights[:, None] * np.abs(determinant) * body.depth)
    inner *= root[:, None, None]
    # Shapes last makes every loop below a long one.
    return np.asarray(np.einsum("qbi,qbac->qiac", slopes, inner), dtype=np.float64)


def _components(
    body: Body, gradients: Floats, material: Ints
) -> Iterator[tuple[int, int, Floats]]:
    """Components ``K_km``, k ≤ m, of the stiffness of each shape, one at a time.

    Parameters
    ----------
    gradients
        As of `_gradients`.
    material
        Which material of the body each shape has.

    Yields
    ------
    k, m, values
        ``(corners, corners, shapes)``, for k = m symmetric to the bit.
    """
    dim = body.dim

    def integral(k: int, m: int) -> Floats:
        found = np.einsum("qic,qjc->ijc", gradients[:, :, k], gradients[:, :, m])
        return np.asarray(found, dtype=np.float64)

    plain = [one for one in body.materials if isinstance(one, Material)]
    if len(plain) < len(body.materials):
        yield from _anisotropic(body, integral, material)
        return
    lame: list[Any] = [*plain[0].lame(dim)]
    if len(plain) > 1:
        lame = list(np.array([one.lame(dim) for one in plain])[material].T)
    lame_lambda, lame_mu = lame
    diagonal = [integral(k, k) for k in range(dim)]
    trace = sum(diagonal[1:], start=diagonal[0])
    for k in range(dim):
        own = (lame_lambda + lame_mu) * diagonal[k] + lame_mu * trace
        # Whoever computes products need not sum the mirrored one in the same order.
        yield k, k, 0.5 * (own + own.swapaxes(0, 1))
        for m in range(k + 1, dim):
            mixed = integral(k, m)
            yield k, m, lame_lambda * mixed + lame_mu * mixed.swapaxes(0, 1)


def _anisotropic(
    body: Body, integral: Callable[[int, int], Floats], material: Ints
) -> Iterator[tuple[int, int, Floats]]:
    """`_components` of any elasticity."""
    dim = body.dim
    tensors = np.stack([one.tensor(dim) for one in body.materials], axis=-1)
    forms = {(a, b): integral(a, b) for a in range(dim) for b in range(a, dim)}
    # E_ba of nodes i, j is E_ab of j, i.
    forms |= {(b, a): form.swapaxes(0, 1) for (a, b), form in forms.items()}
    for k in range(dim):
        for m in range(k, dim):
            total = np.zeros_like(forms[0, 0])
            for (a, b), form in forms.items():
                C = tensors[k, a, m, b]
                if C.any():
                    total += C[material] * form
            yield k, m, total if m > k else 0.5 * (total + total.swapaxes(0, 1))


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
    """Kind and nodes of the cells, which scikit-fem may number mirrored."""
    kind = body.kind
    cells = body.cells[:, kind.order_of_vtk]
    edges = kind.places[: kind.corners] - kind.places[0]
    # Neighbours of corner 0 along the axes.
    axes = [int(np.argmax((edges == axis).all(axis=1))) for axis in np.eye(kind.dim)]
    sides = body.points[cells[:, axes]] - body.points[cells[:, :1]]
    inverted = np.linalg.det(sides) < 0
    cells[inverted] = cells[inverted][:, kind.mirror]
    return kind.vtk, cells
