"""Places along a line of contacts, straight or curved: their order and what they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats

Ints = NDArray[np.intp]

# Points on one line, to this part of its length.
_STRAIGHT = 1e-6
# The ends of a chain whose distance is at most so many times the spacing there are
# neighbours: of a ring with one contact less it is twice.
_CLOSED = 1.7
# A chain longer than so many times what it spans goes to and fro: half a circle has π/2.
_ONCE = 3.0


@dataclass(frozen=True)
class Places:
    """Contacts in the order of a line.

    Attributes
    ----------
    order : (m,)
        Numbers of the contacts; of a closed line the first one stands at the end again.
    s : (m,)
        Their places, ascending.
    towards : (m, d)
        Unit vectors along which places grow.
    name
        What places are, for an axis.
    once
        Whether the contacts are one line, which is drawn as one.
    """

    order: Ints
    s: Floats
    towards: Floats
    name: str
    once: bool = True


def places(x: Floats, along: ArrayLike | str | None) -> Places:
    """Places of contacts ``x (n_c, d)``.

    Parameters
    ----------
    along
        A direction ``(d,)`` or ``"x"``, ``"y"``, ``"z"``, on which contacts are projected;
        ``"arc"`` for the length of the chain of contacts. By default in the plane the
        direction of the line where it is straight, else the arc; in space it must be
        given.

    Raises
    ------
    ValueError
        What is wrong with ``along``; contacts in space that are on no line.
    """
    d = x.shape[1]
    if isinstance(along, str):
        if along == "arc":
            return _arc(x)
        if along not in tuple("xyz"[:d]):
            raise ValueError(
                f"along is {along!r}, expected {', '.join('xyz'[:d])}, arc or a direction"
            )
        return _projected(x, np.eye(d)["xyz".index(along)])
    if along is not None:
        return _projected(x, _unit(along, d))
    if d == 3:
        raise ValueError(
            "along is missing: of contacts in space, a line is drawn along a direction or "
            "its arc, with where= those on it; a whole surface is drawn by surface_map"
        )
    direction = _straight(x)
    return _arc(x) if direction is None else _projected(x, direction)


def _unit(along: ArrayLike, d: int) -> Floats:
    direction = floats("along", along, shape=(d,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ValueError("along is zero, expected a direction")
    return direction / length


def _straight(x: Floats) -> Floats | None:
    """Direction of a straight line, upwards along the axis nearest to it."""
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
    # Coordinates as they were given, not but for rounding.
    near = np.abs(direction - axis).max() <= _STRAIGHT
    return np.asarray(axis if near else direction)


def _projected(x: Floats, direction: Floats) -> Places:
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
    """Along a chain: from an end to the other, or once around."""
    if len(x) < 2:
        return _projected(x, np.eye(x.shape[1])[0])
    order = _chain(x)
    step = np.linalg.norm(np.diff(x[order], axis=0), axis=1)
    near = max(step[0], step[-1])
    size = np.ptp(x, axis=0)
    # The first axis along which the chain has an extent.
    axis = int(np.argmax(size > _STRAIGHT * size.max()))
    apart = x[order[-1]] - x[order[0]]
    if len(x) > 3 and np.linalg.norm(apart) <= _CLOSED * near:
        order, seen = _around(x, order, axis)
        name = f"arc length from largest {'xyz'[axis]}, counter-clockwise{seen}"
    else:
        # The axis by which its ends differ.
        axis = int(np.argmax(np.abs(apart) > _STRAIGHT * size.max()))
        order = order if apart[axis] >= 0 else order[::-1]
        name = f"arc length from the end of least {'xyz'[axis]}"
    step = np.linalg.norm(np.diff(x[order], axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(step)])
    return Places(order, s, _tangents(x[order]), name)


def _around(x: Floats, order: Ints, axis: int) -> tuple[Ints, str]:
    """A ring from its largest coordinate counter-clockwise, and from where that is seen."""
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
    # Of several as far out, the one from which the others follow.
    far = set(np.flatnonzero(value >= value.max() - _STRAIGHT * np.ptp(value)).tolist())
    first = next(k for k in sorted(far) if (k - 1) % len(order) not in far)
    return np.append(np.roll(order, -first), order[first]), seen


def _tangents(x: Floats) -> Floats:
    """Unit vectors along a chain: of the chord from the one before to the one behind."""
    chord = np.gradient(x, axis=0)
    if len(x) > 2 and (x[0] == x[-1]).all():
        chord[0] = chord[-1] = (x[1] - x[-2]) / 2
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    return np.asarray(chord / np.where(length > 0, length, 1.0))


def _chain(x: Floats) -> Ints:
    """Points of a curve from one end to the other.

    The shortest tree that connects points of a curve, close enough to each other, is the
    curve; of a closed one without its longest part.
    """
    links = _tree(x)
    if max(map(len, links)) > 2:
        if x.shape[1] == 3:
            raise ValueError(
                "the contacts do not lie on one line, along which they have an arc: choose "
                "those of a line by where="
            )
        return _greedy(x, links)
    return np.array(_walk(links, _end(links)))


def _tree(x: Floats) -> list[list[int]]:
    """Neighbours of each point in the shortest tree, by Prim."""
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


def _end(links: Sequence[Sequence[int]]) -> int:
    return next(k for k, near in enumerate(links) if len(near) == 1)


def _walk(links: Sequence[Sequence[int]], start: int) -> list[int]:
    order, before = [start], -1
    while True:
        ahead = [k for k in links[order[-1]] if k != before]
        if not ahead:
            return order
        before = order[-1]
        order.append(ahead[0])


def _greedy(x: Floats, links: Sequence[Sequence[int]]) -> Ints:
    """Each the nearest of the rest: where a curve turns sharper than its points tell."""
    ends = [k for k, near in enumerate(links) if len(near) == 1]
    far = np.linalg.norm(x[ends] - x.mean(axis=0), axis=1)
    order = [ends[int(np.argmax(far))]]
    left = np.ones(len(x), dtype=np.bool_)
    for _ in range(len(x) - 1):
        left[order[-1]] = False
        apart = np.linalg.norm(x - x[order[-1]], axis=1)
        order.append(int(np.argmin(np.where(left, apart, np.inf))))
    return np.array(order)


def common(x: Floats, parts: Sequence[Ints], along: Any) -> list[Places]:
    """Places of several lines of contacts, the same along each.

    Where they differ in direction, the arc of each.
    """
    found = [places(x[part], along) for part in parts]
    if along is None and len({one.name for one in found}) > 1:
        found = [places(x[part], "arc") for part in parts]
    return [
        Places(part[one.order], one.s, one.towards, one.name, one.once)
        for part, one in zip(parts, found, strict=True)
    ]
