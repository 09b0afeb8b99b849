"""Boundary facets of bodies, those of one cell only, and their sharp edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.mesh.kinds import FACETS, OF_VTK
from bipot_rs.plots.style import round_number


def skin(cells: Sequence[tuple[str, Ints]]) -> list[tuple[Ints, Ints]]:
    """Boundary facets of each body, and the cell of each facet.

    ``cells``: as `fem.Assembly.cells`; numbers of cells continue from body to body.
    Returns ``list of (facets, cell)``: nodes ``(m, corners)`` in order around the facet, and
    cells ``(m,)``.
    """
    facets_of_bodies: list[tuple[Ints, Ints]] = []
    first = 0
    for kind, nodes in cells:
        # Reversed, they are seen from outside.
        sides = FACETS[OF_VTK[kind].shape]
        facets = np.concatenate([nodes[:, list(side[::-1])] for side in sides])
        _, at, count = np.unique(
            np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
        )
        outside = np.sort(at[count == 1])
        facets_of_bodies.append((facets[outside], first + outside % len(nodes)))
        first += len(nodes)
    return facets_of_bodies


def deformed_nodes(
    nodes: Floats, displacement: Floats, scale: float | None, share: float
) -> tuple[Floats, float]:
    """Points ``nodes + scale * u``, and the scale; u may continue with reference points.

    The default scale is a round number, 1 or more, for which the largest displacement is
    about ``share`` of the largest extent of the bodies.
    """
    u = displacement[: nodes.size].reshape(nodes.shape)
    if scale is None:
        largest = float(np.linalg.norm(u, axis=1).max(initial=0.0))
        extent = float(np.ptp(nodes, axis=0).max())
        scale = max(round_number(share * extent / largest), 1.0) if largest else 1.0
    return nodes + scale * u, scale


def sharp_edges(x: Floats, cells: Sequence[tuple[str, Ints]]) -> Ints:
    """Edges ``(m, 2)`` of the boundary at which it turns by 30 degrees or more."""
    sharp_ones = []
    for facets, _ in skin(cells):
        a, b, c = x[facets[:, :3]].swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        ends = np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1)
        owner = np.repeat(np.arange(len(facets)), facets.shape[1])
        edges, which, count = np.unique(
            np.sort(ends.reshape(-1, 2), axis=1),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        order = np.argsort(which.ravel(), kind="stable")
        first = np.cumsum(count) - count
        # An edge with more than two facets, where parts of a body touch, is sharp.
        sharp = count != 2
        first_owner, other = (
            owner[order[first[~sharp]]],
            owner[order[first[~sharp] + 1]],
        )
        sharp[~sharp] = np.sum(normal[first_owner] * normal[other], axis=1) < np.cos(
            np.pi / 6
        )
        sharp_ones.append(edges[sharp])
    return np.concatenate(sharp_ones)
