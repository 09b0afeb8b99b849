"""Flat and curved surfaces of facets with randomly moved nodes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def sheet(
    nodes: int,
    n: int,
    *,
    up: bool,
    seed: int = 0,
    low: float = 0.0,
    high: float = 1.0,
    bend: float = 0.25,
) -> tuple[Array, Ints]:
    """A square in z = 0 of n × n cells: facets with 3, 4, 6, 8 or 9 nodes, straight edges.

    `up` gives normals along +z. Inner nodes move by up to `bend` cells.
    """
    random = np.random.default_rng(seed)
    line = np.linspace(low, high, n + 1)
    x = np.stack(
        [*np.meshgrid(line, line, indexing="ij"), np.zeros((n + 1, n + 1))], -1
    )
    x[1:-1, 1:-1, :2] += (
        bend * (high - low) / n * random.uniform(-1, 1, (n - 1, n - 1, 2))
    )
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    cells = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], -1).reshape(
        -1, 4
    )
    if nodes in (3, 6):
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    if not up:
        cells = cells[:, ::-1]
    points = x.reshape(-1, 3)
    return (points, cells) if nodes < 5 else second_order(points, cells, nodes)


def second_order(points: Array, cells: Ints, nodes: int) -> tuple[Array, Ints]:
    """The same with midside nodes, and midface nodes if facets have 9 nodes."""
    corners = cells.shape[1]
    edges = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    pairs, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    facets = [cells, len(points) + which.reshape(-1, corners)]
    places = [points, points[pairs].mean(axis=1)]
    if nodes == 9:
        first = len(points) + len(pairs)
        facets.append(first + np.arange(len(cells))[:, None])
        places.append(points[cells].mean(axis=1))
    return np.concatenate(places), np.concatenate(facets, axis=1)


def line(x: Array, *, up: bool, middles: bool = False) -> tuple[Array, Ints]:
    """Segments along the x axis with the normals along +y, or -y."""
    points = np.column_stack([x, np.zeros(len(x))])
    i = np.arange(len(x))
    cells = np.column_stack([i[1:], i[:-1]] if up else [i[:-1], i[1:]])
    if not middles:
        return points, cells
    between = points[cells].mean(axis=1)
    extra = len(x) + np.arange(len(cells))[:, None]
    return np.concatenate([points, between]), np.concatenate([cells, extra], axis=1)


def rotation(seed: int, d: int = 3) -> Array:
    """A random rotation without reflection."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(d, d)))
    return np.asarray(Q * np.append(np.ones(d - 1), np.linalg.det(Q)))
