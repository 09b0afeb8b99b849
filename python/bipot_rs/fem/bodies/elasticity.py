"""Stiffness and nodal forces of (1) for one elastic body.

Degrees of freedom are numbered ``dim * node + component``. In cells of second order,
nodes on edges, faces and inside the cell are treated like nodes at corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

import bipot_rs._core as _core
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import CsrMatrix, Floats, Integers, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.fem.bodies.body import Body, Field, Quadrature
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.mesh.elements import inverse, jacobian

# Cells of a body of revolution that are integrated at once: some 30 MB for 9 nodes.
_CELLS = 1 << 11


def stiffness(body: Body, nodes: Ints | None = None) -> CsrMatrix:
    """Stiffness of one body, CSR ``(dim * nodes, dim * nodes)``, bitwise symmetric.

    With ``E_kl = ∫ ∂_k φ_i ∂_l φ_j`` the block of nodes i, j is

        K_kl = Σ_ab C_kalb E_ab = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,

    the last for isotropic materials; a body of revolution has the hoop strain ``φ_i / r``
    besides. Nodes that share a cell have a block, also where its
    entries are zero. The bits do not depend on the number of threads.

    Parameters
    ----------
    body
        The body.
    nodes
        Ascending numbers of the nodes whose rows are wanted, ``(m,)``; only the cells that
        touch them are integrated. The result is ``(dim * m, dim * nodes)``, with the bits
        of these rows of the whole matrix: a sum over the cells around two nodes has the
        same terms in the same order. The default is all nodes.

    Raises
    ------
    ValueError
        A cell is folded or flat; the message gives its index and position.
    """
    _, slopes, weights = body.kind.reference
    points, corners, touching, part = body.mesh.p, body.cells, None, None
    material = body.material_of_cells if len(body.materials) > 1 else None
    if nodes is not None:
        touching, near, corners = _around(body, nodes)
        points, part = points[:, near], (np.searchsorted(near, nodes), near)
        material = None if material is None else material[touching]
    try:
        values = (
            _of_revolution(body, corners, len(points.T), touching, part)
            if (body.axisymmetric)
            else _core.stiffness(
                np.ascontiguousarray(points, dtype=np.float64),
                np.ascontiguousarray(corners.T),
                slopes,
                weights,
                body.depth,
                _laws(body),
                material,
                part,
            )
        )
    except ValueError as error:
        cell = getattr(error, "cell", None)
        if cell is None:
            raise
        raise _describe_folded_cell(
            body, cell if touching is None else int(touching[cell])
        ) from None
    return _matrix(values, body.points.size)


def _of_revolution(
    body: Body,
    corners: Ints,
    nodes: int,
    touching: Ints | None,
    part: tuple[Ints, Ints] | None,
) -> tuple[Integers, Integers, Floats]:
    """Stiffness of a body of revolution, ``∫ ε_i : C : ε_j 2 π r dA``.

    With ``∂_a φ_i`` and the hoop strain ``φ_i / r`` in the order rr, zz, θθ, rz.
    """
    phi, slopes, weights = body.kind.reference
    cells = body.cells if touching is None else body.cells[touching]
    material = body.material_of_cells
    material = material if touching is None else material[touching]
    axes, other = [0, 1, 2, 0], [0, 1, 2, 1]
    laws = np.stack([m.tensor(3)[axes, other][:, axes, other] for m in body.materials])
    count = phi.shape[0]
    values = np.empty((len(cells), count, count, 2, 2))
    for first in range(0, len(cells), _CELLS):
        some = slice(first, first + _CELLS)
        x = body.points[cells[some]]
        inner, determinant = inverse(jacobian(x, slopes))
        folded = ~((determinant > 0).all(axis=0) | (determinant < 0).all(axis=0))
        if folded.any():
            cell = first + int(np.argmax(folded))
            raise _describe_folded_cell(
                body, cell if touching is None else int(touching[cell])
            )
        gradient = np.einsum("qbi,qbap->piaq", slopes, inner)
        r = np.einsum("pi,iq->pq", x[..., 0], phi)
        strain = np.zeros((len(x), count, 2, 4, len(weights)))
        strain[:, :, 0, 0] = strain[:, :, 1, 3] = gradient[:, :, 0]
        strain[:, :, 1, 1] = strain[:, :, 0, 3] = gradient[:, :, 1]
        strain[:, :, 0, 2] = phi / r[:, None]
        weighted = (
            strain
            * (2 * np.pi * r * np.abs(determinant).T * weights)[:, None, None, None]
        )
        stress = np.einsum("pst,piktq->piksq", laws[material[some]], strain)
        block = np.einsum("piksq,pjlsq->pijkl", weighted, stress)
        # A product of three may have another rounding in the mirrored entry.
        values[some] = 0.5 * (block + block.transpose(0, 2, 1, 4, 3))
    return _core.sum_of_cells(
        np.ascontiguousarray(corners.T),
        nodes,
        2,
        values.reshape(len(cells), (2 * count) ** 2),
        part,
    )


def _around(body: Body, nodes: Ints) -> tuple[Ints, Ints, Ints]:
    """Cells that touch some nodes, all nodes of these, and their corners among the latter."""
    cells = body.cells
    near = np.zeros(len(body.points), np.bool_)
    near[nodes] = True
    touching = np.flatnonzero(near[cells].any(axis=1))
    near[cells[touching]] = True
    number = np.cumsum(near) - 1
    return touching, np.flatnonzero(near), number[cells[touching]]


def dofs_of(nodes: Ints, dim: int) -> Ints:
    """Degrees of freedom of nodes, node after node."""
    return (dim * nodes[:, None] + np.arange(dim)).ravel()


def surface_stiffness(body: Body, points: Quadrature, density: Floats) -> CsrMatrix:
    """``∫ φ_i k φ_j`` over a surface, in the form of `stiffness`, bitwise symmetric.

    ``body, points``: the body, and the points of one of its surfaces.
    ``density``: stiffness per area k, symmetric, at these points: ``(d, d, facets, points)``
    [N/m³].
    """
    phi, weights = points.phi, body.depth * points.weights
    parts, dim = len(points.corners), body.dim
    values = np.empty((parts, len(phi), len(phi), dim, dim))
    for k in range(dim):
        for m in range(k, dim):
            outer_products = np.einsum(
                "pq,iq,jq->pij", weights * density[k, m], phi, phi
            )
            # A product of three may have another rounding in the mirrored entry.
            values[..., k, m] = values[..., m, k] = 0.5 * (
                outer_products + outer_products.swapaxes(1, 2)
            )
    integrated = _core.sum_of_cells(
        np.ascontiguousarray(points.corners.T),
        points.nodes,
        dim,
        values.reshape(parts, -1),
    )
    return _matrix(integrated, dim * points.nodes)


def _matrix(entries: tuple[Integers, Integers, Floats], n: int) -> CsrMatrix:
    start, column, data = entries
    shape = len(start) - 1, n
    made: CsrMatrix = sparse.csr_array((data, column, start), shape=shape)
    # Columns ascend by construction: SciPy need not look.
    made.has_canonical_format = True
    return made


def _laws(body: Body) -> Floats:
    """λ and μ of each material, or the entries of all tensors if one is not isotropic."""
    plain = [
        material.lame(body.dim)
        for material in body.materials
        if isinstance(material, Material)
    ]
    if len(plain) == len(body.materials):
        return np.array(plain, dtype=np.float64)
    return np.stack([material.tensor(body.dim).ravel() for material in body.materials])


def _describe_folded_cell(body: Body, cell: int) -> ValueError:
    corners = body.points[body.cells[cell]]
    _, slopes, _ = body.kind.reference
    with np.errstate(divide="ignore", invalid="ignore"):
        _, determinant = inverse(jacobian(corners[None], slopes))
    return ValueError(
        f"cell {cell} of body {body.name!r} is folded or flat, at "
        f"{place(corners.mean(axis=0))}: the determinant of its mapping is from "
        f"{determinant.min():g} to {determinant.max():g}; mesh anew there"
    )


def distinct_cells(corners: Floats) -> tuple[Floats, Ints]:
    """Distinct cells up to translation, and the index of each cell among them.

    ``corners``: ``(cells, corners, d)``.
    Returns ``shapes, which``: corners relative to the first, ``(shapes, corners, d)``, and
    ``(cells,)``. Cells share a shape only if these differences are bitwise equal.
    """
    count = len(corners)
    # Differences first: far from the origin the Jacobian would lose digits.
    offset = corners - corners[:, :1]
    if not count:
        return offset, np.arange(0)
    # Adding zero turns -0.0 into 0.0.
    bits = (offset[:, 1:] + 0.0).reshape(count, -1).view(np.uint64)
    # Powers of an odd number. Short numbers end in zero bits, which products keep, so
    # the upper half is added to them by XOR.
    mix = np.cumprod(np.full(bits.shape[1], 0x9E3779B97F4A7C15, dtype=np.uint64))
    hashes = (bits ^ (bits >> np.uint64(32))) @ mix
    _, first, which = np.unique(hashes, return_index=True, return_inverse=True)
    if 2 * len(first) > count or not np.array_equal(bits[first][which], bits):
        # Few equal cells, or different cells with the same hash.
        return offset, np.arange(count)
    return offset[first], which.astype(np.int64)


def nodal_forces(body: Body, points: Quadrature, value: Field) -> Floats:
    """∫ φ_i value, ``(dim * nodes,)``, over cells or facets.

    In 2D the thickness of the body counts. ``points``: `Body.volume` or `Body.surface`.
    ``value``: density ``(d,)``, values at the quadrature points ``(d, cells, points)``, or a
    function of the positions ``(d, cells, points)`` that returns one of these.
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
        length_found not in (1, wanted)
        for length_found, wanted in zip(
            density.shape[::-1], places.shape[::-1], strict=False
        )
    ):
        raise ValueError(
            f"{what} has shape {density.shape}, expected ({body.dim},) or "
            f"{places.shape}"
        )
    density = np.broadcast_to(density, places.shape)
    forces = [body.depth * points.moment(component) for component in density]
    return np.stack(forces, axis=1).ravel()


def vtk_cells(body: Body) -> tuple[str, Ints]:
    """Kind and nodes of the cells in the order of VTK; mirrored cells are reversed."""
    kind = body.kind
    cells = body.cells[:, kind.order_of_vtk]
    edges = kind.places[: kind.corners] - kind.places[0]
    # The neighbours of corner 0 along the axes.
    axes = [int(np.argmax((edges == axis).all(axis=1))) for axis in np.eye(kind.dim)]
    sides = body.points[cells[:, axes]] - body.points[cells[:, :1]]
    inverted = np.linalg.det(sides) < 0
    cells[inverted] = cells[inverted][:, kind.mirror]
    return kind.vtk, cells


def find_neighbours(bodies: Sequence[Body], first: int, last: int) -> tuple[Ints, Ints]:
    """Nodes that share a cell with each of the nodes ``first`` to ``last - 1``.

    ``bodies``: their nodes are counted body after body.
    ``first, last``: range of nodes.
    Returns ``indptr, indices``: compressed rows ``(last - first,)`` of the graph, without the
    nodes themselves, ascending.
    """
    blocks, before = [], 0
    count = sum(len(body.points) for body in bodies)
    for body in bodies:
        size = len(body.points)
        low, high = (min(max(x - before, 0), size) for x in (first, last))
        if low < high:
            cells = body.cells
            near = ((cells >= low) & (cells < high)).any(axis=1)
            corners = cells[near]
            rows = np.repeat(np.arange(len(corners)), corners.shape[1])
            entries = np.ones(corners.size, np.int32), (rows, corners.ravel() + before)
            of_cells = sparse.csr_array(entries, shape=(len(corners), count))
            cells_of_nodes = of_cells[:, before + low : before + high]
            blocks.append(cells_of_nodes.T.tocsr() @ of_cells)
        before += size
    if not blocks:
        return np.zeros(1, np.int64), np.zeros(0, np.int64)
    graph = sparse.vstack(blocks, "coo")
    off = graph.col != graph.row + first
    rest = (np.ones(off.sum(), np.int8), (graph.row[off], graph.col[off]))
    made = sparse.csr_array(rest, shape=graph.shape)
    made.sort_indices()
    return made.indptr.astype(np.int64), made.indices.astype(np.int64)
