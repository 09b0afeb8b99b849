"""Mistakes in meshes, each told before any work: which cell or node, and where."""

from __future__ import annotations

from typing import Any

import numpy as np

from bipot_rs._lib.messages import counted, place
from bipot_rs._lib.types import Ints
from bipot_rs.mesh.elements import KINDS, cell_nodes, inverse, jacobian, reference

# Volume over the cube of the longest side, below which rounding makes the sign.
_FLAT = 1e-12
_CURES = {
    "flat": "its nodes lie in a line or a plane: mesh anew, with merged nodes or a finer "
    "size there, or delete the cell and close the hole",
    "folded": "are its nodes in the order of its kind? Else mesh anew there, with straight "
    "sides or a finer size",
}
# Distance of two nodes over the shortest side at them: cut open, not meshed so.
_CLOSE = 1e-6


def check_mesh(mesh: Any, what: str = "mesh") -> None:
    """Refuse a mesh that is no body.

    Parameters
    ----------
    mesh
        Of scikit-fem.
    what
        Its name in messages.

    Raises
    ------
    ValueError
        Cells that are folded, flat or overlap their neighbours, more than two cells at a
        facet, pieces that share no node, nodes of the border that nearly coincide.
    TypeError
        A type of mesh that is not known.
    """
    if type(mesh) not in KINDS:
        raise TypeError(
            f"{what} is a {type(mesh).__name__}, expected "
            + ", ".join(t.__name__ for t in KINDS)
        )
    if not mesh.t.shape[1]:
        raise ValueError(f"{what} has no cells")
    used = cell_nodes(mesh)
    if not np.isfinite(mesh.p).all():
        at = int(np.argwhere(~np.isfinite(mesh.p).all(axis=0))[0, 0])
        raise ValueError(f"{what} has node {at} at {place(mesh.p[:, at])}")
    _cells(mesh, used, what)
    _neighbours(mesh, what)
    _pieces(mesh, what)
    _close(mesh, what)


def _cells(mesh: Any, nodes: Ints, what: str) -> None:
    kind = KINDS[type(mesh)]
    x = np.asarray(mesh.p.T[nodes])
    _, slopes, weights = reference(kind.scalar, kind.order)
    with np.errstate(divide="ignore", invalid="ignore"):
        _, determinant = inverse(jacobian(x, slopes))
    volume = np.einsum("q,qp->p", weights, determinant)
    corners = x[:, : kind.corners]
    sides = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1)
    longest = sides.max(axis=(1, 2))
    flat = np.abs(volume) <= _FLAT * longest**kind.dim
    folded = (determinant * np.sign(volume) <= 0).any(axis=0) & ~flat
    for bad, word in ((flat, "flat"), (folded, "folded")):
        if bad.any():
            cell = int(np.argmax(bad))
            extent = "volume" if kind.dim == 3 else "area"
            raise ValueError(
                f"{what} has {counted(int(bad.sum()), f'{word} cell')}, the first is "
                f"cell {cell} at {place(x[cell].mean(axis=0))}: its {extent} is "
                f"{abs(volume[cell]):.3g}, its longest side {longest[cell]:.3g}, and the "
                f"determinant of its mapping from {determinant[:, cell].min():.3g} to "
                f"{determinant[:, cell].max():.3g}; {_CURES[word]}"
            )


def _neighbours(mesh: Any, what: str) -> None:
    """Two cells of a facet lie on its two sides."""
    facets = np.asarray(mesh.facets)
    many = np.bincount(np.asarray(mesh.t2f).ravel(), minlength=facets.shape[1])
    if (many > 2).any():
        at = int(np.argmax(many))
        raise ValueError(
            f"{what} has {many[at]} cells at one facet, at "
            f"{place(mesh.p[:, facets[:, at]].mean(axis=1))}, expected two at most: "
            "cells that are there twice, or overlap"
        )
    inner = np.flatnonzero(many == 2)
    x = mesh.p[:, facets[:, inner]]  # (d, corners, facets)
    middle = x.mean(axis=1)
    one = x[:, 1] - x[:, 0]
    if len(x) == 2:
        normal = np.stack([one[1], -one[0]])
    elif x.shape[1] == 3:
        normal = np.cross(one.T, (x[:, 2] - x[:, 0]).T).T
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
            f"that they share at {place(middle[:, at])}, so that one of them is turned "
            f"inside out ({counted(int(same.sum()), 'such facet')})"
        )


def _pieces(mesh: Any, what: str) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    t = np.asarray(mesh.t)
    count = mesh.p.shape[1]
    first = np.broadcast_to(t[0], t.shape)
    graph = coo_array(
        (np.ones(t.size), (first.ravel(), t.ravel())), shape=(count, count)
    )
    _, label = connected_components(graph, directed=False)
    of_cells = label[t[0]]
    names, sizes = np.unique(of_cells, return_counts=True)
    if len(names) < 2:
        return
    small = names[np.argmin(sizes)]
    own, others = t[:, of_cells == small], t[:, of_cells != small]
    own, others = np.unique(own), np.unique(others)
    distance, _ = cKDTree(mesh.p[:, others].T).query(mesh.p[:, own].T)
    at = int(np.argmin(distance))
    volumes = [
        name
        for name, cells in (mesh.subdomains or {}).items()
        if set(np.unique(of_cells[cells])) == {small}
    ]
    which = f" (volume {volumes[0]!r})" if volumes else ""
    advice = "make bodies of them by group="
    if distance[at] <= _CLOSE * np.ptp(mesh.p, axis=1).max():
        advice = "nodes that are there twice: merge them"
    elif not mesh.subdomains:
        advice = f"name the volumes in the mesh, and {advice}"
    raise ValueError(
        f"{what} falls into {len(names)} pieces that share no node, the smallest of "
        f"{counted(int(sizes.min()), 'cell')}{which} at "
        f"{place(mesh.p[:, own].mean(axis=1))}; it comes as near as {distance[at]:.3g} to "
        f"the rest, at {place(mesh.p[:, own[at]])}: {advice}"
    )


def _close(mesh: Any, what: str) -> None:
    """Nodes of the border in one place: the mesh is cut open there."""
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
    # The nearest of two in one place may be either.
    apart = np.where(near[:, 1] == np.arange(len(nodes)), near[:, 0], near[:, 1])
    close = distance[:, 1] <= _CLOSE * shortest[nodes]
    if close.any():
        at = int(np.argmax(close))
        raise ValueError(
            f"{what} has {counted(int(close.sum()), 'node')} on its border that nearly "
            f"coincide with others, the first pair {nodes[at]} and {nodes[apart[at]]} at "
            f"{place(mesh.p[:, nodes[at]])}, {distance[at, 1]:.3g} apart: the mesh is cut "
            "open there, merge them"
        )
