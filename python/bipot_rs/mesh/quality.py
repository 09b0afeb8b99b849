"""Checks of meshes: each message names the cell or node and its position."""

from __future__ import annotations

from itertools import combinations

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.mesh.elements import (
    cell_nodes,
    inverse,
    jacobian,
    kind_of,
)
from bipot_rs.mesh.kinds import ElementMesh, Kind

# Volume over the cube of the longest side, below which the sign is rounding.
_FLAT = 1e-12
_CURES = {
    "flat": "its nodes lie on a line or in a plane: merge nodes, use a finer size there, "
    "or delete the cell and close the hole",
    "folded": "check the order of its nodes, or mesh again with straight sides or a finer "
    "size there",
}
# Two nodes nearer than this fraction of their shortest side are double.
_CLOSE = 1e-6


def check_mesh(mesh: ElementMesh, what: str = "mesh") -> None:
    """Refuse a mesh that is not one valid body.

    Parameters
    ----------
    mesh
        A mesh of scikit-fem.
    what
        Name of the mesh in messages.

    Raises
    ------
    ValueError
        Cells that are folded, flat or overlap their neighbours, more than two cells at a
        facet, separate pieces, or nodes of the boundary that nearly coincide.
    TypeError
        The class of the mesh is not known.
    """
    kind_of(mesh, what)
    if not mesh.t.shape[1]:
        raise ValueError(f"{what} has no cells")
    used = cell_nodes(mesh)
    if not np.isfinite(mesh.p).all():
        at = int(np.argwhere(~np.isfinite(mesh.p).all(axis=0))[0, 0])
        raise ValueError(
            f"{what} has node {at} at {place(mesh.p[:, at])}, expected finite coordinates"
        )
    _cells(mesh, used, what)
    _neighbours(mesh, what)
    _pieces(mesh, what)
    _close(mesh, what)


def find_most_slender(x: Floats, kind: Kind) -> tuple[int, float]:
    """The most slender of cells ``x (cells, nodes, d)``, and its length over its thickness.

    These are the largest and the smallest stretch of the reference cell, at the points of
    integration.
    """
    _, slopes, _ = kind.reference
    stretches = np.linalg.svd(
        jacobian(x, slopes).transpose(0, 3, 1, 2), compute_uv=False
    )
    ratios = (stretches[..., 0] / stretches[..., -1]).max(axis=0)
    cell = int(np.argmax(ratios))
    return cell, float(ratios[cell])


def _cells(mesh: ElementMesh, nodes: Ints, what: str) -> None:
    kind = kind_of(mesh)
    x = np.asarray(mesh.p.T[nodes])
    _, slopes, weights = kind.reference
    with np.errstate(divide="ignore", invalid="ignore"):
        _, determinant = inverse(jacobian(x, slopes))
    volume = np.einsum("q,qp->p", weights, determinant)
    squares = np.zeros(len(x))
    # One pair at a time: all sides of all cells would take more memory than K.
    for a, b in combinations(range(kind.corners), 2):
        side = x[:, b] - x[:, a]
        np.maximum(squares, np.einsum("pd,pd->p", side, side), out=squares)
    longest = np.sqrt(squares)
    flat = np.abs(volume) <= _FLAT * longest**kind.dim
    folded = (determinant * np.sign(volume) <= 0).any(axis=0) & ~flat
    for bad, word in ((flat, "flat"), (folded, "folded")):
        if bad.any():
            cell = int(np.argmax(bad))
            extent = "volume" if kind.dim == 3 else "area"
            raise ValueError(
                f"{what} has {count_noun(int(bad.sum()), f'{word} cell')}, the first is "
                f"cell {cell} at {place(x[cell].mean(axis=0))}: its {extent} is "
                f"{abs(volume[cell]):.3g}, its longest side {longest[cell]:.3g}, and the "
                f"determinant of its mapping is from {determinant[:, cell].min():.3g} to "
                f"{determinant[:, cell].max():.3g}; {_CURES[word]}"
            )


def _neighbours(mesh: ElementMesh, what: str) -> None:
    """Refuse facets with more than two cells, or with two cells on the same side."""
    facets = np.asarray(mesh.facets)
    many = np.bincount(np.asarray(mesh.t2f).ravel(), minlength=facets.shape[1])
    if (many > 2).any():
        at = int(np.argmax(many))
        raise ValueError(
            f"{what} has {many[at]} cells at one facet, at "
            f"{place(mesh.p[:, facets[:, at]].mean(axis=1))}, expected at most two: "
            "remove cells that are double or overlap"
        )
    inner = np.flatnonzero(many == 2)
    x = mesh.p[:, facets[:, inner]]  # (d, corners, facets)
    middle = x.mean(axis=1)
    edge = x[:, 1] - x[:, 0]
    if len(x) == 2:
        normal = np.stack([edge[1], -edge[0]])
    elif x.shape[1] == 3:
        normal = np.cross(edge.T, (x[:, 2] - x[:, 0]).T).T
    else:
        normal = np.cross((x[:, 2] - x[:, 0]).T, (x[:, 3] - x[:, 1]).T).T
    centre = mesh.p[:, mesh.t].mean(axis=1)
    first, second = np.asarray(mesh.f2t)[:, inner]
    sides = [
        np.einsum("df,df->f", normal, centre[:, cells] - middle)
        for cells in (first, second)
    ]
    same = sides[0] * sides[1] > 0
    if same.any():
        at = int(np.argmax(same))
        volumes = f"cells {first[at]} and {second[at]}"
        raise ValueError(
            f"{what} has an inverted cell: {volumes} lie on the same side of the facet "
            f"that they share at {place(middle[:, at])} "
            f"({count_noun(int(same.sum()), 'such facet')}); mesh again there"
        )


def _pieces(mesh: ElementMesh, what: str) -> None:
    from scipy.spatial import cKDTree

    t = np.asarray(mesh.t, np.int64)
    first = np.broadcast_to(t[0], t.shape)
    label = _core.connected(mesh.p.shape[1], first.ravel(), t.ravel())
    of_cells = label[t[0]]
    names, sizes = np.unique(of_cells, return_counts=True)
    if len(names) < 2:
        return
    small = names[np.argmin(sizes)]
    nodes_of_piece, others = t[:, of_cells == small], t[:, of_cells != small]
    nodes_of_piece, others = np.unique(nodes_of_piece), np.unique(others)
    distance, _ = cKDTree(mesh.p[:, others].T).query(mesh.p[:, nodes_of_piece].T)
    at = int(np.argmin(distance))
    volumes = [
        name
        for name, cells in (mesh.subdomains or {}).items()
        if set(np.unique(of_cells[cells])) == {small}
    ]
    which = f" (volume {volumes[0]!r})" if volumes else ""
    advice = "make bodies of them by group="
    if distance[at] <= _CLOSE * np.ptp(mesh.p, axis=1).max():
        advice = "merge double nodes"
    elif not mesh.subdomains:
        advice = f"name the volumes in the mesh, and {advice}"
    raise ValueError(
        f"{what} consists of {len(names)} pieces that share no node, the smallest with "
        f"{count_noun(int(sizes.min()), 'cell')}{which} at "
        f"{place(mesh.p[:, nodes_of_piece].mean(axis=1))}; its distance from the rest is "
        f"{distance[at]:.3g}, at {place(mesh.p[:, nodes_of_piece[at]])}: {advice}"
    )


def _close(mesh: ElementMesh, what: str) -> None:
    """Refuse nodes of the boundary that nearly coincide: the mesh has a slit there."""
    from scipy.spatial import cKDTree

    facets = np.asarray(mesh.facets)[:, mesh.boundary_facets()]
    nodes = np.unique(facets)
    if len(nodes) < 2:
        return
    shortest = np.full(mesh.p.shape[1], np.inf)
    for a, b in zip(facets, np.roll(facets, 1, axis=0), strict=True):
        side = np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        np.minimum.at(shortest, a, side)
        np.minimum.at(shortest, b, side)
    distance, near = cKDTree(mesh.p[:, nodes].T).query(mesh.p[:, nodes].T, k=2)
    # The first of the two nearest is the node itself, except for coincident nodes.
    apart = np.where(near[:, 1] == np.arange(len(nodes)), near[:, 0], near[:, 1])
    close = distance[:, 1] <= _CLOSE * shortest[nodes]
    if close.any():
        at = int(np.argmax(close))
        raise ValueError(
            f"{what} has {count_noun(int(close.sum()), 'node')} on its boundary that nearly "
            f"coincide with others, the first pair {nodes[at]} and {nodes[apart[at]]} at "
            f"{place(mesh.p[:, nodes[at]])}, {distance[at, 1]:.3g} apart: merge them"
        )
