"""Trees over points and boxes, with eight children for each node along Morton's curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints

# Children of a node, and pairs compared at once: some ten megabytes.
WIDTH, AT_ONCE = 8, 2**17


def along_curve(places: Floats) -> Ints:
    """Order of points ``(n, d)`` along Morton's curve, where neighbours are close."""
    low = places.min(axis=0)
    wide = float(np.ptp(places, axis=0).max())
    bits = 60 // places.shape[1]
    cell = (places - low) * ((2**bits - 1) / wide if wide > 0 else 0.0)
    code = np.zeros(len(places), np.int64)
    for k, column in enumerate(cell.astype(np.int64).T):
        for bit in range(bits):
            code |= ((column >> bit) & 1) << (bit * places.shape[1] + k)
    return np.argsort(code, kind="stable")


def starts(count: int) -> Ints:
    """First child of each parent over ``count`` nodes."""
    return np.arange(0, count, WIDTH)


def _children(node: Ints, count: int) -> tuple[Ints, Ints]:
    """Children of nodes in a level of ``count`` nodes, and the index of their parent."""
    parent = np.repeat(np.arange(len(node)), WIDTH)
    child = (node[:, None] * WIDTH + np.arange(WIDTH)).ravel()
    there = child < count
    return parent[there], child[there]


def descend(
    sizes: list[int], queries: int, near: Callable[[int, Ints, Ints], Bools]
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a query and a leaf that are near each other, in portions.

    Memory does not grow with the number of pairs: portions are completed depth first.

    Parameters
    ----------
    sizes
        Number of nodes of each level, from the leaves to the root.
    queries
        Number of queries.
    near
        Function of a level, queries and nodes ``(p,)``: whether each pair may be near.
    """
    work: list[tuple[int, Ints, Ints]] = []
    work.append((len(sizes) - 1, np.arange(queries), np.zeros(queries, np.int64)))
    while work:
        level, query, node = work.pop()
        if len(query) > AT_ONCE:
            half = len(query) // 2
            work.append((level, query[half:], node[half:]))
            work.append((level, query[:half], node[:half]))
            continue
        met = near(level, query, node)
        query, node = query[met], node[met]
        if not query.size:
            continue
        if level == 0:
            yield query, node
        else:
            parent, child = _children(node, sizes[level - 1])
            work.append((level - 1, query[parent], child))


class BoxTree:
    """Boxes ``low <= x <= high``, ``(n, d)`` each, in independent groups ``(n,)``."""

    def __init__(self, low: Floats, high: Floats, group: Ints) -> None:
        curve = along_curve((low + high) / 2)
        self._order = curve[np.argsort(group[curve], kind="stable")]
        low, high = (bound[self._order] for bound in _within(low, high, group))
        self._levels = [(low, high)]
        while len(low) > 1:
            first = starts(len(low))
            low = np.minimum.reduceat(low, first)
            high = np.maximum.reduceat(high, first)
            self._levels.append((low, high))

    def overlapping(
        self, low: Floats, high: Floats, group: Ints
    ) -> Iterator[tuple[Ints, Ints]]:
        """Pairs of indices of the given boxes and of those of the tree that overlap.

        Boxes that share only their boundary do not overlap. In portions, which bound the
        memory; each pair once.
        """
        low, high = _within(low, high, group)

        def near(level: int, query: Ints, node: Ints) -> Bools:
            theirs = tuple(bound[node] for bound in self._levels[level])
            return _overlap(low[query], high[query], *theirs)

        sizes = [len(least) for least, _ in self._levels]
        for query, box in descend(sizes, len(low), near):
            yield query, self._order[box]


def _within(low: Floats, high: Floats, group: Ints) -> tuple[Floats, Floats]:
    """Boxes with the group as an additional coordinate: only equal groups overlap."""
    return np.column_stack([low, group - 0.25]), np.column_stack([high, group + 0.25])


def _overlap(low: Floats, high: Floats, other_low: Floats, other_high: Floats) -> Bools:
    return np.asarray(((high > other_low) & (other_high > low)).all(axis=1))
