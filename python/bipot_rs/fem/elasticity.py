"""Stiffness and nodal forces of (1) for one elastic body.

Degrees of freedom are numbered ``dim * node + component``. In cells of second order,
nodes on edges, faces and inside the cell are treated like nodes at corners.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.fem.body import Body, Field, Quadrature
from bipot_rs.fem.materials import Material
from bipot_rs.mesh.elements import inverse, jacobian, reference


def stiffness(body: Body) -> Any:
    """Stiffness of one body, CSR ``(dim * nodes, dim * nodes)``, bitwise symmetric.

    With ``E_kl = ∫ ∂_k φ_i ∂_l φ_j`` the block of nodes i, j is

        K_kl = Σ_ab C_kalb E_ab = λ E_kl + μ E_lk + δ_kl μ Σ_m E_mm,

    the last for isotropic materials, so that d(d+1)/2 scalar forms replace a vector
    form. Cells of the same shape and material share one matrix, and all d² components
    share one sparsity pattern.

    Raises
    ------
    ValueError
        A cell is folded or flat; the message gives its index and position.
    """
    dim, nodes = body.dim, int(body.mesh.p.shape[1])
    cells = body.cells
    shapes, which = distinct_cells(body.points[cells])
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
        # Sum over cells: `gather` has a row for each pair of nodes that share a cell.
        data[k, m] = gather @ values.ravel()
        if m != k:
            data[m, k] = gather @ values.swapaxes(0, 1).ravel()
    return _matrix(data, column, start)


def surface_stiffness(body: Body, surface: str, density: Floats) -> Any:
    """``∫ φ_i k φ_j`` over a surface, in the form of `stiffness`, bitwise symmetric.

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
    """CSR from components ``(d, d, pairs)`` on a sparsity pattern of nodes."""
    n = len(data) * (len(start) - 1)
    blocks = (np.ascontiguousarray(data.transpose(2, 0, 1)), column, start)
    return sparse.bsr_array(blocks, shape=(n, n)).tocsr()


def distinct_cells(corners: Floats) -> tuple[Floats, Ints]:
    """Distinct cells up to translation, and the index of each cell among them.

    Parameters
    ----------
    corners
        ``(cells, corners, d)``.

    Returns
    -------
    shapes, which
        Corners relative to the first, ``(shapes, corners, d)``, and ``(cells,)``. Cells
        share a shape only if these differences are bitwise equal.
    """
    count = len(corners)
    # Differences first: far from the origin the Jacobian would lose digits.
    offset = corners - corners[:, :1]
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


def _gradients(body: Body, shapes: Floats, which: Ints) -> Floats:
    """``∂_a φ_i √(weight)``, ``(q, i, a, shapes)``: products of two sum to integrals."""
    _, slopes, weights = reference(body.kind.scalar, body.kind.order)
    with np.errstate(divide="ignore", invalid="ignore"):
        inner, determinant = inverse(jacobian(shapes, slopes))
    # A mirrored numbering has one sign at all points; a folded cell has both signs.
    good = (determinant * np.sign(determinant[0]) > 0).all(axis=0)
    if not good.all():
        cell = int(np.argmin(good[which]))
        centre = body.points[body.cells[cell]].mean(axis=0)
        raise ValueError(
            f"cell {cell} of body {body.name!r} is folded or flat, at "
            f"{place(centre)}: the determinant of its mapping is from "
            f"{determinant[:, which[cell]].min():g} to "
            f"{determinant[:, which[cell]].max():g}; mesh anew there"
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
        Index of the material of each shape.

    Yields
    ------
    k, m, values
        ``(corners, corners, shapes)``, bitwise symmetric for k = m.
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
        # A matrix product may sum mirrored entries in another order.
        yield k, k, 0.5 * (own + own.swapaxes(0, 1))
        for m in range(k + 1, dim):
            mixed = integral(k, m)
            yield k, m, lame_lambda * mixed + lame_mu * mixed.swapaxes(0, 1)


def _anisotropic(
    body: Body, integral: Callable[[int, int], Floats], material: Ints
) -> Iterator[tuple[int, int, Floats]]:
    """`_components` for any elasticity tensor."""
    dim = body.dim
    tensors = np.stack([one.tensor(dim) for one in body.materials], axis=-1)
    forms = {(a, b): integral(a, b) for a in range(dim) for b in range(a, dim)}
    # E_ba of nodes i, j equals E_ab of nodes j, i.
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
    """Sparsity pattern of nodes that share a cell, and how to sum its entries.

    Returns
    -------
    start, column
        CSR of the pattern, columns ascending, int32 if possible.
    gather
        Sparse ``(pairs, corners² * shapes)`` of ones: the entries of cell matrices to
        sum for each pair of nodes, in the order of the cells.
    """
    count, corners = cells.shape
    entries = count * corners**2
    integer = np.dtype(np.int32 if entries < 2**31 else np.int64)
    nodes_of = cells.astype(integer)
    # A sparse transpose is a counting sort: linear in time and stable, so that the
    # entries of a pair and of the mirrored pair stay in the order of the cells. First
    # the rows are corners of cells, then the nodes of the columns.
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
        The body; its thickness counts in 2D.
    points
        `Body.volume` or `Body.surface`.
    value
        Density ``(d,)``, values at the quadrature points ``(d, cells, points)``, or a
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
