"""Order contacts along a straight or curved line, and compute their positions on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats

Ints = NDArray[np.intp]

# Tolerance for points on one line, relative to its length.
_STRAIGHT = 1e-6
# A chain is closed if its ends are at most this many spacings apart: it is one spacing in
# a ring, two in a ring with one contact missing.
_CLOSED = 1.7
# A chain longer than this many times its extent goes back and forth: half a circle has
# the ratio π/2.
_ONCE = 3.0


@dataclass(frozen=True)
class Places:
    """Contacts in the order of a line."""

    # (m,): numbers of the contacts; for a closed line the first one is repeated at the end.
    order: Ints
    s: Floats  # (m,): their positions, ascending
    towards: Floats  # (m, d): unit vectors in the direction of growing s
    name: str  # label of s
    once: bool = True  # whether the contacts form one line, so that they can be joined


def places(x: Floats, along: ArrayLike | str | None) -> Places:
    """Positions of contacts ``x (n_c, d)`` along a line.

    ``along``: a direction ``(d,)`` or ``"x"``, ``"y"``, ``"z"``, onto which contacts are
    projected; or ``"arc"`` for the arc length of the chain of contacts. Default in 2D: the
    direction of a straight line, else the arc length. Required in 3D.
    Raises `ValueError`: a wrong ``along``; contacts in 3D that do not lie on a line.
    """
    d = x.shape[1]
    if isinstance(along, str):
        if along == "arc":
            return _arc(x)
        if along not in tuple("xyz"[:d]):
            raise ValueError(
                f"along is {along!r}, expected {', '.join('xyz'[:d])}, arc or a direction"
            )
        return _project(x, np.eye(d)["xyz".index(along)])
    if along is not None:
        return _project(x, _unit(along, d))
    if d == 3:
        raise ValueError(
            "along is missing: in three dimensions pass a direction or 'arc', and select the "
            "contacts of a line by on=; or draw the whole surface by surface_map"
        )
    direction = _straight(x)
    return _arc(x) if direction is None else _project(x, direction)


def _unit(along: ArrayLike, d: int) -> Floats:
    direction = floats("along", along, shape=(d,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ValueError("along is zero, expected a direction")
    return direction / length


def _straight(x: Floats) -> Floats | None:
    """Direction of a straight line, ascending along the nearest axis; None if curved."""
    off = x - x.mean(axis=0)
    main = np.linalg.svd(off, full_matrices=False)[2]
    length = np.ptp(off @ main[0])
    axes: Floats = np.eye(x.shape[1])
    if length == 0:
        return np.asarray(axes[0])
    if len(main) > 1 and np.ptp(off @ main[-1]) > _STRAIGHT * length:
        return None
    nearest = int(np.argmax(np.abs(main[0])))
    axis = axes[nearest]
    direction = main[0] * np.sign(main[0][nearest])
    # Use the axis itself if it is the direction up to rounding: s is then a coordinate.
    near = np.abs(direction - axis).max() <= _STRAIGHT
    return np.asarray(axis if near else direction)


def _project(x: Floats, direction: Floats) -> Places:
    s = x @ direction
    order = np.argsort(s, kind="stable")
    way = np.linalg.norm(np.diff(x[order], axis=0), axis=1).sum()
    once = bool(way <= _ONCE * np.linalg.norm(np.ptp(x, axis=0)))
    towards = np.broadcast_to(direction, x.shape)
    return Places(order, s[order], towards, _name(direction), once)


def _name(direction: Floats) -> str:
    axis = int(np.argmax(direction))
    if direction[axis] == 1:
        return "xyz"[axis]
    return f"along ({', '.join(f'{c:.2g}' for c in direction)})"


def _arc(x: Floats) -> Places:
    """Arc length along a chain: from one end to the other, or once around."""
    if len(x) < 2:
        return _project(x, np.eye(x.shape[1])[0])
    order = _chain(x)
    step = np.linalg.norm(np.diff(x[order], axis=0), axis=1)
    near = max(step[0], step[-1])
    size = np.ptp(x, axis=0)
    # The first axis along which the chain has an extent.
    axis = int(np.argmax(size > _STRAIGHT * size.max()))
    apart = x[order[-1]] - x[order[0]]
    if len(x) > 3 and np.linalg.norm(apart) <= _CLOSED * near:
        order, seen = _order_ring(x, order, axis)
        name = f"arc length from largest {'xyz'[axis]}, counter-clockwise{seen}"
    else:
        # The axis by which its ends differ.
        axis = int(np.argmax(np.abs(apart) > _STRAIGHT * size.max()))
        order = order if apart[axis] >= 0 else order[::-1]
        name = f"arc length from the end of least {'xyz'[axis]}"
    step = np.linalg.norm(np.diff(x[order], axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(step)])
    return Places(order, s, _tangents(x[order]), name)


def _order_ring(x: Floats, order: Ints, axis: int) -> tuple[Ints, str]:
    """Order of a ring, counter-clockwise from its largest coordinate, and the view side."""
    ring = x[order] - x.mean(axis=0)
    a, b = ring, np.roll(ring, -1, axis=0)
    seen = ""
    if x.shape[1] == 2:
        area = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    else:
        area_vector = np.cross(a, b).sum(axis=0)
        up = int(np.argmax(np.abs(area_vector)))
        area, seen = float(area_vector[up]), f" seen from +{'xyz'[up]}"
    if area < 0:
        order = order[::-1]
    value = x[order, axis]
    # If several are equally far out, begin with the first of them in this order.
    far = set(np.flatnonzero(value >= value.max() - _STRAIGHT * np.ptp(value)).tolist())
    first = next(k for k in sorted(far) if (k - 1) % len(order) not in far)
    return np.append(np.roll(order, -first), order[first]), seen


def _tangents(x: Floats) -> Floats:
    """Unit vectors along a chain, from the chord between the two neighbours of a point."""
    chord = np.gradient(x, axis=0)
    if len(x) > 2 and (x[0] == x[-1]).all():
        chord[0] = chord[-1] = (x[1] - x[-2]) / 2
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    return np.asarray(chord / np.where(length > 0, length, 1.0))


def _chain(x: Floats) -> Ints:
    """Order of points of a curve from one end to the other.

    If the points are dense enough, their minimum spanning tree is the curve; for a closed
    curve, without its longest segment.
    """
    links = _tree(x)
    if max(map(len, links)) > 2:
        if x.shape[1] == 3:
            raise ValueError(
                "the contacts do not lie on one line: select those of a line by on="
            )
        return _greedy(x, links)
    end = next(k for k, near in enumerate(links) if len(near) == 1)
    return np.array(_walk(links, end))


def _tree(x: Floats) -> list[list[int]]:
    """Neighbours of each point in the minimum spanning tree, by Prim's algorithm."""
    links: list[list[int]] = [[] for _ in x]
    left = np.ones(len(x), dtype=np.bool_)
    apart = np.full(len(x), np.inf)
    nearest = np.zeros(len(x), dtype=np.intp)
    at = 0
    for _ in range(len(x) - 1):
        left[at] = False
        from_here = np.linalg.norm(x - x[at], axis=1)
        closer = from_here < apart
        nearest[closer], apart[closer] = at, from_here[closer]
        at = int(np.argmin(np.where(left, apart, np.inf)))
        links[at].append(int(nearest[at]))
        links[nearest[at]].append(at)
    return links


def _walk(links: Sequence[Sequence[int]], start: int) -> list[int]:
    order, before = [start], -1
    while True:
        ahead = [k for k in links[order[-1]] if k != before]
        if not ahead:
            return order
        before = order[-1]
        order.append(ahead[0])


def _greedy(x: Floats, links: Sequence[Sequence[int]]) -> Ints:
    """Order by nearest neighbour, for a curve that turns sharply between its points."""
    ends = [k for k, near in enumerate(links) if len(near) == 1]
    far = np.linalg.norm(x[ends] - x.mean(axis=0), axis=1)
    order = [ends[int(np.argmax(far))]]
    left = np.ones(len(x), dtype=np.bool_)
    for _ in range(len(x) - 1):
        left[order[-1]] = False
        apart = np.linalg.norm(x - x[order[-1]], axis=1)
        order.append(int(np.argmin(np.where(left, apart, np.inf))))
    return np.array(order)


def common(
    x: Floats, parts: Sequence[Ints], along: ArrayLike | str | None
) -> list[Places]:
    """Positions on several lines of contacts, along the same direction.

    If the lines differ in direction, the arc length of each.
    """
    lines = [places(x[part], along) for part in parts]
    if along is None and len({line.name for line in lines}) > 1:
        lines = [places(x[part], "arc") for part in parts]
    return [
        Places(part[line.order], line.s, line.towards, line.name, line.once)
        for part, line in zip(parts, lines, strict=True)
    ]
