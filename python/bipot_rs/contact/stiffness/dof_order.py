"""Check of the order of the degrees of freedom: by nodes or by components.

``K x`` is zero to rounding for every rigid motion x of an elastic body without supports.
With a wrong order of the degrees of freedom x is another vector, and ``K x`` is of the size
of ``|K| |x|`` in most rows.

The check goes row by row. A row of K with a support in it does not add up to zero. The
sum of a row does not depend on the order of the columns, so that such rows can be left out
for any order. Rows coupled to a node with an eliminated degree of freedom, whose row has
only its diagonal, are also left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import Parts

# The two orders and their descriptions.
ORDERS: Mapping[str, str] = {
    "node": "node after node, degree of freedom = d * row + component",
    "component": "component after component, all u_x, then all u_y",
}
# Allowed remainder of a row, relative to the terms that cancel. Rounding gives 1e-16, six
# digits in a file 1e-6, coordinates with six digits 1e-3 in a mesh of 1000 cells per side,
# and initial stress its ratio to Young's modulus. A wrong order gives 0.1 and more, and
# 0.3 in some rows of any mesh.
_LEFT = 0.02
# A row has no support if its sum is below 100 times the median of all rows, which the
# digits of K cause, or below rounding.
_DIGITS, _ROUNDING = 100.0, 1e-12
# Entries below this part of their row are zeros of an assembly in single precision.
_PRESENT = 1e-5
# Rounding of squared distances, relative to the extent of the coordinates.
_SHORT = 1e-13
# Entries of K in one block, to bound the memory.
_BLOCK = 2**24
# A larger K is first checked in some of its rows: so many blocks of so many rows.
_SAMPLES, _SAMPLE = 32, 512


@dataclass(frozen=True)
class Fit:
    """Remainder of rigid motions in the rows of K without supports."""

    rows: int  # number of rows without supports
    moved: int  # number of rows in which a translation leaves a force above the limit
    still: int  # number of rows with all components in which it leaves no such force
    # Remainder of translations, relative to the terms that should cancel: the median of the
    # moved rows, or the maximum if there are none.
    translation: float
    # (m,): rows in which translations cancel, but a rotation leaves a force above the limit.
    turned: Ints
    turnable: int  # number of rows in which rotations can be checked
    rotation: float  # remainder of rotations, as for translations

    @property
    def translates(self) -> bool:
        """Whether the translations of this order fit."""
        # A few rows of inclined supports may also have the sum zero.
        return self.moved <= self.still

    @property
    def fits(self) -> bool:
        """Whether translations and rotations of this order fit."""
        return self.translates and not len(self.turned)

    def describe_misfit(self) -> str:
        """Describe the misfit for a message."""
        kind, rows, of, left = (
            ("rotation", len(self.turned), self.turnable, self.rotation)
            if self.translates
            else ("translation", self.moved, self.rows, self.translation)
        )
        return (
            f"K times a rigid {kind} is not zero in {rows} of {of} rows without supports: "
            f"a median part of {left:.2g} does not cancel, expected only rounding errors"
        )


def components(order: str, n: int, d: int) -> Ints:
    """Component of each of n degrees of freedom."""
    number = np.arange(n, dtype=np.int64)
    return number % d if order == "node" else number // (n // d)


def node_of(order: str, n: int, d: int) -> Ints:
    """Node of each of n degrees of freedom: its row in the list of nodes."""
    number = np.arange(n, dtype=np.int64)
    return number // d if order == "node" else number % (n // d)


def fit(
    parts: Parts,
    component: Ints,
    node: Ints,
    places: Floats | None = None,
    *,
    sample: bool = False,
) -> Fit | None:
    """Compare the rigid motions of an order with K.

    ``parts``: K ``(n, n)`` by rows.
    ``component, node (n,)``: component and node of each degree of freedom, -1 if not known.
    Rows coupled to such a column are left out.
    ``places (n, d) or None``: coordinates in any unit; without them rotations are not checked.
    ``sample``: whether to check only some of the rows.
    Returns ``Fit or None``: None if K has fewer rows without supports than a simplex has
    degrees of freedom, which are too few for the check.
    """
    pointers = np.asarray(parts[0], np.int64)
    d = int(component.max(initial=-1)) + 1
    if places is not None:
        d = max(d, places.shape[1])
    located = (component >= 0) & (node >= 0)
    if places is not None:
        located &= np.isfinite(places).all(axis=1)
        places = _scale_to_one(places, located)
    n = len(pointers) - 1
    blocks = _split_rows(pointers)
    if sample:
        # Ranges of rows that are spread over the matrix.
        starts = np.linspace(0, n - _SAMPLE, _SAMPLES).astype(np.int64).tolist()
        blocks = [(first, first + _SAMPLE) for first in starts]
    left, alone, looked = np.full(n, np.inf), np.zeros(n, bool), np.zeros(n, bool)
    with np.errstate(over="ignore", invalid="ignore"):
        for first, last in blocks:
            sums = _sum_rows(parts, pointers, first, last)
            left[first:last], alone[first:last] = sums
            looked[first:last] = True
    coupled = looked & ~alone
    level = float(np.median(left[coupled])) if coupled.any() else 0.0
    free = left <= min(max(_DIGITS * level, _ROUNDING), _LEFT)
    # Eliminating a degree of freedom removes its column from the rows of its neighbours.
    located &= ~np.isin(node, node[alone])
    of = np.where(located, component, -1)
    # A stiffness whose sums overflow passes.
    with np.errstate(over="ignore", invalid="ignore"):
        arrays = [
            _check_rows(parts, pointers, *block, d, of, places, free)
            for block in blocks
        ]
    row, moved, whole, turned = (
        np.concatenate(parts_of_array) for parts_of_array in zip(*arrays, strict=True)
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
        translation=_find_typical(moved, moves),
        turned=row[judged][turns],
        turnable=int(judged.sum()),
        rotation=_find_typical(turned[judged], turns),
    )


def fit_order(
    parts: Parts,
    order: str,
    d: int,
    nodes: Floats | None = None,
    *,
    sample: bool = False,
) -> Fit | None:
    """`fit` for one of `ORDERS`, with the coordinates of the nodes ``(n / d, d)``."""
    n = len(parts[0]) - 1
    node = node_of(order, n, d)
    places = None if nodes is None else nodes[node]
    return fit(parts, components(order, n, d), node, places, sample=sample)


def _scale_to_one(places: Floats, given: Bools) -> Floats:
    """Coordinates shifted to their centre and scaled to an extent of 1."""
    if not given.any():
        return places
    there = places if given.all() else places[given]
    low, high = there.min(axis=0), there.max(axis=0)
    side = float((high - low).max(initial=0.0))
    return np.asarray((places - (low + high) / 2) / (side or 1.0), np.float64)


def _find_typical(left: Floats, wrong: Bools) -> float:
    """Median of the wrong values, or the largest value if none is wrong."""
    if wrong.any():
        return float(np.median(left[wrong]))
    return float(left.max(initial=0.0))


def list_fitting(parts: Parts, d: int, nodes: Floats | None = None) -> list[str]:
    """The orders of `ORDERS` that fit K."""
    n = len(parts[0]) - 1
    if n % d or not n:
        return []
    candidates = [(order, fit_order(parts, order, d, nodes)) for order in ORDERS]
    return [order for order, how in candidates if how is not None and how.fits]


def find_order(coordinates: Floats, d: int) -> str | None:
    """The order of `ORDERS` of coordinates ``(n, d)``, in which equal rows form nodes."""
    n = len(coordinates)
    if n % d or not n:
        return None
    if (coordinates.reshape(-1, d, d) == coordinates[::d, None]).all():
        return "node"
    count = n // d
    if (coordinates.reshape(d, count, d) == coordinates[:count]).all():
        return "component"
    return None


def describe_disorder(
    stiffness: Parts,
    contact: Parts,
    coordinates: Floats | None,
    order: str | None,
    d: int,
) -> str | None:
    """Describe how the orders of K, B and the coordinates differ, or return None.

    ``stiffness, contact``: K and B by rows.
    ``coordinates (n, d) or None``: coordinates of the degrees of freedom.
    ``order``: the one that they show; None if they show none.
    """
    n = len(stiffness[0]) - 1
    if n % d or not n:
        return None
    if coordinates is not None and order is not None:
        mismatch = _compare_places(stiffness, order, coordinates, d)
        return mismatch or _compare_contacts(contact, order, n, d, "coordinates")
    fits = list_fitting(stiffness, d)
    if len(fits) != 1:
        return None
    return _compare_contacts(contact, fits[0], n, d, "K")


def _compare_places(
    stiffness: Parts, order: str, coordinates: Floats, d: int
) -> str | None:
    n = len(coordinates)
    nodes = coordinates[::d] if order == "node" else coordinates[: n // d]
    if n > 2 * _SAMPLES * _SAMPLE:
        how = fit_order(stiffness, order, d, nodes, sample=True)
        if how is not None and how.fits:
            return None
    how = fit_order(stiffness, order, d, nodes)
    if how is None or how.fits:
        return None
    others = [
        order_of_points
        for order_of_points in list_fitting(stiffness, d, nodes)
        if order_of_points != order
    ]
    advice = "give the coordinates in the order of the rows of K"
    if others:
        arrays = {
            "node": "numpy.repeat(nodes, d, axis=0)",
            "component": "numpy.tile(nodes, (d, 1))",
        }
        advice = (
            f"K is {ORDERS[others[0]]}: coordinates = {arrays[others[0]]} would fit, and B "
            "and loads must have this order too"
        )
    return f"coordinates do not fit K: they are {ORDERS[order]}; {how.describe_misfit()}; {advice}"


def _compare_contacts(
    contact: Parts, order: str, n: int, d: int, base: str
) -> str | None:
    """Describe contacts of one node whose columns of B are in the other order."""
    pointers = np.asarray(contact[0], np.int64)[::d]
    columns = np.asarray(contact[1], np.int64)
    other = next(candidate for candidate in ORDERS if candidate != order)
    # The different columns of each contact, ascending.
    of_contact = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    contacts, columns = np.divmod(np.unique(of_contact * n + columns), n)
    # Not: contacts of several nodes, or with prescribed components.
    whole = np.flatnonzero(np.bincount(contacts, minlength=len(pointers) - 1) == d)
    whole_columns = columns[np.isin(contacts, whole)].reshape(-1, d)

    def of_one_node(order: str) -> Bools:
        node = whole_columns // d if order == "node" else whole_columns % (n // d)
        return np.asarray((node == node[:, :1]).all(axis=1))

    fits = of_one_node(order)
    wrong, right = whole[~fits & of_one_node(other)], int(fits.sum())
    if len(wrong) <= right:
        return None
    shown = "the rigid translations of K" if base == "K" else base
    return (
        f"B does not fit {base}: {shown} are {ORDERS[order]}, but the columns of B at "
        f"{count_noun(len(wrong), 'contact')}, first contact {wrong[0]}, are the components of "
        f"one node if the order is {ORDERS[other]}; give K, B and coordinates in one order"
    )


def _split_rows(pointers: Ints) -> list[tuple[int, int]]:
    """Ranges of rows of about `_BLOCK` entries."""
    n = len(pointers) - 1
    ends = np.searchsorted(pointers, np.arange(_BLOCK, pointers[-1] + _BLOCK, _BLOCK))
    cuts = np.unique(np.concatenate([[0], np.minimum(ends, n), [n]])).tolist()
    return list(pairwise(cuts))


def magnitude(K: CsrMatrix) -> CsrMatrix:
    """``|K|`` with the index arrays of K, which `abs` would copy."""
    from scipy.sparse import csr_array

    moduli: CsrMatrix = csr_array((np.abs(K.data), K.indices, K.indptr), shape=K.shape)
    return moduli


def _slice(
    parts: Parts, pointers: Ints, first: int, last: int
) -> tuple[CsrMatrix, slice]:
    """Some rows of K, in the range of columns that they have."""
    from scipy.sparse import csr_array

    inside = slice(pointers[first], pointers[last])
    start = pointers[first : last + 1] - pointers[first]
    index = parts[1][inside]
    low = min(first, int(index.min(initial=first)))
    high = max(last, int(index.max(initial=last - 1)) + 1)
    shape = (last - first, high - low)
    return csr_array((parts[2][inside], index - low, start), shape=shape), slice(
        low, high
    )


def _sum_rows(
    parts: Parts, pointers: Ints, first: int, last: int
) -> tuple[Floats, Bools]:
    """Relative sum of each row, and whether it has only a diagonal entry."""
    K, columns = _slice(parts, pointers, first, last)
    ones = np.ones(K.shape[1])
    size = magnitude(K) @ ones
    diagonal = np.abs(K.diagonal(first - columns.start))
    left = np.abs(K @ ones) / np.where(size > 0, size, 1.0)
    return left, size <= diagonal


def _check_rows(
    parts: Parts,
    pointers: Ints,
    first: int,
    last: int,
    d: int,
    component: Ints,
    places: Floats | None,
    free: Bools,
) -> tuple[Ints, Floats, Bools, Floats]:
    """Remainder of rigid motions in the rows that are ``free`` of supports.

    Returns the numbers of the rows, the remainder of translations, whether all components
    are present, and the remainder of rotations, NaN if it cannot be checked.
    """
    K, columns = _slice(parts, pointers, first, last)
    size_of = magnitude(K)
    own_component, component = component[first:last], component[columns]
    unit = (component[:, None] == np.arange(d)).astype(float)
    sums, sizes = K @ unit, size_of @ unit
    size = size_of @ np.ones(len(component))
    present = sizes > _PRESENT * size[:, None]
    judged = free[first:last] & (own_component >= 0) & (size > 0)
    judged &= size_of @ (component < 0).astype(float) == 0
    moved = np.where(present, np.abs(sums) / np.where(present, sizes, 1.0), 0.0)
    turned = np.full(last - first, np.nan)
    if places is not None:
        x = np.where(np.isfinite(places[columns]), places[columns], 0.0)
        here = x[first - columns.start : last - columns.start]

        def turning(of: int, axis: int) -> tuple[Floats, Floats]:
            """``Σ K (x_j - x_i)`` over a component, and the size of its terms."""
            at = unit[:, of] * x[:, axis]
            coordinate = here[:, axis]
            sum_ = K @ at - coordinate * sums[:, of]
            once, twice = size_of @ at, size_of @ (at * x[:, axis])
            square = twice - 2 * coordinate * once + coordinate**2 * sizes[:, of]
            # Below this it is rounding error of the difference.
            square[square <= _SHORT * sizes[:, of]] = 0.0
            return sum_, np.sqrt(sizes[:, of] * square)

        for a, b in combinations(range(d), 2):
            turned_back, its_size = turning(b, a)
            other, other_size = turning(a, b)
            scale = its_size + other_size
            # Rotations are not checked for uncoupled components, as of springs along axes.
            some = present[:, a] & present[:, b] & (scale > 0)
            ratio = np.abs(turned_back - other)[some] / scale[some]
            turned[some] = np.fmax(turned[some], ratio)
    at = np.flatnonzero(judged)
    return at + first, moved.max(axis=1)[at], present.all(axis=1)[at], turned[at]
