"""Whether degrees of freedom are in the order that is taken for granted.

``K x`` is zero to rounding for every rigid motion x of an elastic body that nothing
holds. With another order of the degrees of freedom, x is another vector, and ``K x`` is of
the size of ``|K| |x|`` in most rows. This module has the one statement of that test.

It goes row by row. A row of K that a support was written into no longer adds up to zero.
The sum of a row does not depend on the order of the columns, so such rows are known in any
order, and are left out. So are rows that meet a node of which a degree of freedom was
eliminated, whose own row is its diagonal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import Parts

# The two orders: all components of a node, then those of the next; or all u_x, then all
# u_y. Each with the words for it.
ORDERS: Mapping[str, str] = {
    "node": "node after node, degree of freedom = d * row + component",
    "component": "component after component, all u_x, then all u_y",
}
# What may be left of a row, relative to the entries that cancel. Rounding leaves 1e-16,
# six digits of a file 1e-6, six digits of the places of nodes 1e-3 in a mesh of a thousand
# cells a side, and initial stress its ratio to Young's modulus; another order leaves 0.1
# and more, and in some rows of any mesh 0.3.
_LEFT = 0.02
# Of the sum of a row without supports: a hundred times what the digits of K leave of most
# rows, and no less than rounding.
_DIGITS, _ROUNDING = 100.0, 1e-12
# Entries below this share of their row are what the assembly in single precision leaves of
# zeros: they say nothing.
_PRESENT = 1e-5
# Squares of distances, in the extents of the places: what their difference rounds.
_SHORT = 1e-13
# Entries of K that are looked at together, to bound the memory.
_BLOCK = 2**24


@dataclass(frozen=True)
class Fit:
    """What rigid motions leave in the rows of K without supports.

    Attributes
    ----------
    rows
        How many they are.
    moved
        In how many a translation along an axis leaves more than digits do.
    still
        In how many it leaves nothing although all components are there.
    translation
        What it leaves, relative to the entries that should cancel: the median of the
        rows that are moved, or the largest of the others.
    turned : (m,)
        Rows that are still, and that a rotation leaves more of than digits do.
    turnable
        How many rows a rotation says something of.
    rotation
        What it leaves, likewise.
    """

    rows: int
    moved: int
    still: int
    translation: float
    turned: Ints
    turnable: int
    rotation: float

    @property
    def translates(self) -> bool:
        """Whether components are where they are taken to be."""
        # A support across the axes may leave the sum of a row at zero: such are few.
        return self.moved <= self.still

    @property
    def fits(self) -> bool:
        """Whether the order is the right one, as far as K can tell."""
        return self.translates and not len(self.turned)

    def said(self) -> str:
        """What was found and what was expected."""
        kind, rows, of, left = (
            ("rotation", len(self.turned), self.turnable, self.rotation)
            if self.translates
            else ("translation", self.moved, self.rows, self.translation)
        )
        return (
            f"K times a rigid {kind} is not zero in {rows} of {of} rows without supports: "
            f"it leaves {left:.2g} of what should cancel (median), expected rounding"
        )


def components(order: str, n: int, d: int) -> Ints:
    """The component of each of n degrees of freedom."""
    number = np.arange(n, dtype=np.int64)
    return number % d if order == "node" else number // (n // d)


def node_of(order: str, n: int, d: int) -> Ints:
    """The node of each of n degrees of freedom, by the row it has in a list of nodes."""
    number = np.arange(n, dtype=np.int64)
    return number // d if order == "node" else number % (n // d)


def fit(
    parts: Parts, component: Ints, node: Ints, places: Floats | None = None
) -> Fit | None:
    """How well rigid motions of this order are those of K.

    Parameters
    ----------
    parts
        K ``(n, n)`` by rows.
    component, node : (n,)
        What each degree of freedom is, -1 where it is not known: rows that meet such a
        column are left out.
    places : (n, d) or None
        Where each is, in any unit; without them rotations are not looked at.

    Returns
    -------
    Fit or None
        None where K has fewer rows without supports than a simplex has degrees of
        freedom: nothing can be said.
    """
    pointers = np.asarray(parts[0], np.int64)
    d = int(component.max(initial=-1)) + 1
    if places is not None:
        d = max(d, places.shape[1])
    known = (component >= 0) & (node >= 0)
    if places is not None:
        known &= np.isfinite(places).all(axis=1)
        places = _of_unit_size(places, known)
    blocks = _blocks(pointers)
    with np.errstate(over="ignore", invalid="ignore"):
        looked = [_sums(parts, pointers, *block) for block in blocks]
    left, alone = (np.concatenate(one) for one in zip(*looked, strict=True))
    level = float(np.median(left[~alone])) if not alone.all() else 0.0
    free = left <= min(max(_DIGITS * level, _ROUNDING), _LEFT)
    # An eliminated degree of freedom takes its column from the rows of its neighbours.
    known &= ~np.isin(node, node[alone])
    of = np.where(known, component, -1)
    # A stiffness whose sums leave the range of doubles is not judged.
    with np.errstate(over="ignore", invalid="ignore"):
        found = [
            _rows(parts, pointers, *block, d, of, places, free) for block in blocks
        ]
    row, moved, whole, turned = (
        np.concatenate(one) for one in zip(*found, strict=True)
    )
    if len(row) < d * (d + 1):
        return None
    moves = moved > _LEFT
    judged = ~moves & np.isfinite(turned)
    turns = turned[judged] > _LEFT
    return Fit(
        rows=len(row),
        moved=int(moves.sum()),
        still=int((whole & ~moves).sum()),
        translation=_typical(moved, moves),
        turned=row[judged][turns],
        turnable=int(judged.sum()),
        rotation=_typical(turned[judged], turns),
    )


def of_order(
    parts: Parts, order: str, d: int, nodes: Floats | None = None
) -> Fit | None:
    """`fit` in one of `ORDERS`, of the places of nodes in their rows ``(n / d, d)``."""
    n = len(parts[0]) - 1
    node = node_of(order, n, d)
    places = None if nodes is None else nodes[node]
    return fit(parts, components(order, n, d), node, places)


def _of_unit_size(places: Floats, known: Bools) -> Floats:
    """Places about their middle, the longest side of their box 1: turning is the same."""
    if not known.any():
        return places
    low, high = places[known].min(axis=0), places[known].max(axis=0)
    side = float((high - low).max(initial=0.0))
    return np.asarray((places - (low + high) / 2) / (side or 1.0), np.float64)


def _typical(left: Floats, wrong: Bools) -> float:
    """The median of what is wrong, or else the largest of all."""
    if wrong.any():
        return float(np.median(left[wrong]))
    return float(left.max(initial=0.0))


def fitting(parts: Parts, d: int, nodes: Floats | None = None) -> list[str]:
    """The orders of `ORDERS` that K allows, where it decides."""
    n = len(parts[0]) - 1
    if n % d or not n:
        return []
    found = [(order, of_order(parts, order, d, nodes)) for order in ORDERS]
    return [order for order, how in found if how is not None and how.fits]


def told_by(coordinates: Floats, d: int) -> str | None:
    """The order of `ORDERS` that places of degrees of freedom ``(n, d)`` show, if any."""
    n = len(coordinates)
    if n % d or not n:
        return None
    if (coordinates.reshape(-1, d, d) == coordinates[::d, None]).all():
        return "node"
    count = n // d
    if (coordinates.reshape(d, count, d) == coordinates[:count]).all():
        return "component"
    return None


def unlike(
    stiffness: Parts, contact: Parts, coordinates: Floats | None, d: int
) -> str | None:
    """What is wrong with the order of the degrees of freedom of arrays, in a sentence.

    Parameters
    ----------
    stiffness, contact
        K and B by rows.
    coordinates : (n, d) or None
        Places of the degrees of freedom.
    """
    n = len(stiffness[0]) - 1
    if n % d or not n:
        return None
    order = None if coordinates is None else told_by(coordinates, d)
    if coordinates is not None and order is not None:
        said = _unlike_places(stiffness, order, coordinates, d)
        return said or _unlike_contacts(contact, order, n, d, "coordinates")
    own = fitting(stiffness, d)
    if len(own) != 1:
        return None
    return _unlike_contacts(contact, own[0], n, d, "K")


def _unlike_places(
    stiffness: Parts, order: str, coordinates: Floats, d: int
) -> str | None:
    n = len(coordinates)
    nodes = coordinates[::d] if order == "node" else coordinates[: n // d]
    how = of_order(stiffness, order, d, nodes)
    if how is None or how.fits:
        return None
    others = [one for one in fitting(stiffness, d, nodes) if one != order]
    advice = "give the places of the nodes in the order of the rows of K"
    if others:
        arrays = {
            "node": "numpy.repeat(nodes, d, axis=0)",
            "component": "numpy.tile(nodes, (d, 1))",
        }
        advice = (
            f"K is {ORDERS[others[0]]}: coordinates = {arrays[others[0]]} would fit, and B "
            "and loads must have that order too"
        )
    return f"coordinates do not fit K, they are {ORDERS[order]}: {how.said()}; {advice}"


def _unlike_contacts(
    contact: Parts, order: str, n: int, d: int, known: str
) -> str | None:
    """Contacts of one node whose columns of B are its components in the other order."""
    pointers = np.asarray(contact[0], np.int64)[::d]
    columns = np.asarray(contact[1], np.int64)
    other = next(one for one in ORDERS if one != order)

    def of_one_node(of: Ints, order: str) -> bool:
        node, component = of % (n // d), of // (n // d)
        if order == "node":
            node, component = of // d, of % d
        return len(set(node.tolist())) == 1 and len(set(component.tolist())) == d

    wrong, right = [], 0
    for i, (first, last) in enumerate(pairwise(pointers.tolist())):
        of = np.unique(columns[first:last])
        if len(of) != d:
            continue  # of several nodes, or held in part
        if of_one_node(of, order):
            right += 1
        elif of_one_node(of, other):
            wrong.append(i)
    if len(wrong) <= right:
        return None
    by = ", by its rigid translations," if known == "K" else ""
    return (
        f"B does not fit {known}, which{by} {'is' if known == 'K' else 'are'} "
        f"{ORDERS[order]}: at "
        f"{counted(len(wrong), 'contact')}, first contact {wrong[0]}, the columns of B are "
        f"the components of one node where the order is {ORDERS[other]}"
    )


def _blocks(pointers: Ints) -> list[tuple[int, int]]:
    """Ranges of rows of about `_BLOCK` entries."""
    n = len(pointers) - 1
    ends = np.searchsorted(pointers, np.arange(_BLOCK, pointers[-1] + _BLOCK, _BLOCK))
    cuts = np.unique(np.concatenate([[0], np.minimum(ends, n), [n]])).tolist()
    return list(pairwise(cuts))


def _slice(parts: Parts, pointers: Ints, first: int, last: int) -> Any:
    """Some rows of K as they lie in memory, with any columns."""
    from scipy.sparse import csr_array

    inside = slice(pointers[first], pointers[last])
    start = pointers[first : last + 1] - pointers[first]
    shape = (last - first, len(pointers) - 1)
    return csr_array((parts[2][inside], parts[1][inside], start), shape=shape)


def _sums(parts: Parts, pointers: Ints, first: int, last: int) -> tuple[Floats, Bools]:
    """The sum of each row over its size, and whether its diagonal is all it has."""
    K = _slice(parts, pointers, first, last)
    ones = np.ones(K.shape[1])
    size = abs(K) @ ones
    own = np.abs(K.diagonal(first))
    left = np.abs(K @ ones) / np.where(size > 0, size, 1.0)
    return left, size <= own


def _rows(
    parts: Parts,
    pointers: Ints,
    first: int,
    last: int,
    d: int,
    component: Ints,
    places: Floats | None,
    free: Bools,
) -> tuple[Ints, Floats, Bools, Floats]:
    """Which rows are ``free`` of supports, and what rigid motions leave of them.

    Their numbers, what a translation leaves, whether all components are there, and what a
    rotation leaves: not a number where it says nothing.
    """
    K = _slice(parts, pointers, first, last)
    size_of = abs(K)
    unit = (component[:, None] == np.arange(d)).astype(float)
    sums, sizes = K @ unit, size_of @ unit
    size = size_of @ np.ones(len(component))
    present = sizes > _PRESENT * size[:, None]
    judged = free[first:last] & (component[first:last] >= 0) & (size > 0)
    judged &= size_of @ (component < 0).astype(float) == 0
    moved = np.where(present, np.abs(sums) / np.where(present, sizes, 1.0), 0.0)
    turned = np.full(last - first, np.nan)
    if places is not None:
        x = np.where(np.isfinite(places), places, 0.0)
        here = x[first:last]

        def turning(of: int, axis: int) -> tuple[Floats, Floats]:
            """``Σ K (x_j - x_i)`` over a component, and the size of that sum."""
            at = unit[:, of] * x[:, axis]
            own = here[:, axis]
            sum_ = K @ at - own * sums[:, of]
            once, twice = size_of @ at, size_of @ (at * x[:, axis])
            square = twice - 2 * own * once + own**2 * sizes[:, of]
            # Below, it is the rounding of this difference.
            square[square <= _SHORT * sizes[:, of]] = 0.0
            return sum_, np.sqrt(sizes[:, of] * square)

        for a, b in combinations(range(d), 2):
            one, its_size = turning(b, a)
            other, other_size = turning(a, b)
            scale = its_size + other_size
            # Components that do not feel each other, as on springs along the axes, do not
            # turn.
            some = present[:, a] & present[:, b] & (scale > 0)
            ratio = np.abs(one - other)[some] / scale[some]
            turned[some] = np.fmax(turned[some], ratio)
    at = np.flatnonzero(judged)
    return at + first, moved.max(axis=1)[at], present.all(axis=1)[at], turned[at]
