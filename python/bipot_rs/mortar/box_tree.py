"""Trees over places: eight neighbours in space to a node, from a curve that fills it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints

# Children of a node, and pairs that are compared at once: some ten megabytes.
WIDTH, AT_ONCE = 8, 2**17


def along_curve(places: Floats) -> Ints:
    """Order of places ``(n, d)`` along Morton's curve: neighbours in it lie together."""
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
    """First children of the nodes over so many of them."""
    return np.arange(0, count, WIDTH)


def _children(node: Ints, count: int) -> tuple[Ints, Ints]:
    """Children of nodes, of a level of so many, and the places of their parents."""
    parent = np.repeat(np.arange(len(node)), WIDTH)
    child = (node[:, None] * WIDTH + np.arange(WIDTH)).ravel()
    there = child < count
    return parent[there], child[there]


def descend(
    sizes: list[int], queries: int, near: Callable[[int, Ints, Ints], Bools]
) -> Iterator[tuple[Ints, Ints]]:
    """Queries and leaves that are near each other, a portion at a time.

    Memory does not grow with the pairs: portions wait for those within them.

    Parameters
    ----------
    sizes
        How many nodes each level has, from the leaves up to the root.
    queries
        How many queries there are.
    near
        Of a level, queries and nodes ``(p,)``: which pairs may be near.
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
    """Boxes ``low <= x <= high``, ``(n, d)`` each, in groups that do not meet, ``(n,)``."""

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
        """Numbers of boxes given and of own ones that share more than their borders.

        A portion at a time, which bounds the memory; each pair once.
        """
        low, high = _within(low, high, group)

        def near(level: int, query: Ints, node: Ints) -> Bools:
            theirs = tuple(bound[node] for bound in self._levels[level])
            return _overlap(low[query], high[query], *theirs)

        sizes = [len(least) for least, _ in self._levels]
        for query, box in descend(sizes, len(low), near):
            yield query, self._order[box]


def _within(low: Floats, high: Floats, group: Ints) -> tuple[Floats, Floats]:
    """Boxes with their group as one more place, where only those of one group meet."""
    return np.column_stack([low, group - 0.25]), np.column_stack([high, group + 0.25])


def _overlap(low: Floats, high: Floats, other_low: Floats, other_high: Floats) -> Bools:
    return np.asarray(((high > other_low) & (other_high > low)).all(axis=1))
