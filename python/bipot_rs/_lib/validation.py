"""What crosses the border is checked here, once, before any work.

Each message names the argument, what was found and what was expected.
"""

from __future__ import annotations

import numbers
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, SupportsIndex, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs import _core
from bipot_rs._lib import sparse_structure
from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Floats, Ints

R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")

# NumPy's and Python's numbers, fractions too; not its complex ones, nor its booleans.
_REAL = numbers.Real


# Row pointers, columns and values of a matrix by rows.
Parts = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]], Floats]


class Csr(NamedTuple):
    """A checked sparse matrix and its parts as the core takes them."""

    matrix: Any
    shape: tuple[int, int]
    parts: Parts


def floats(
    what: str,
    value: Any,
    *,
    ndim: int | None = None,
    shape: tuple[int, ...] | None = None,
    finite: bool = True,
    copy: bool = True,
) -> Floats:
    """``value`` as a C-ordered array of float64, by default one of our own."""
    try:
        found = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{what} is not an array: {error}") from None
    if found.dtype.kind not in "iuf":
        raise TypeError(
            f"{what} has entries of type {found.dtype}, expected real numbers"
        )
    if np.ma.is_masked(value) or (isinstance(value, (list, tuple)) and _hides(value)):
        raise ValueError(f"{what} has masked entries, expected an array without a mask")
    # What is too large for a double becomes infinite, and is refused as that below.
    with np.errstate(over="ignore"):
        if copy:
            array = np.array(found, dtype=np.float64, order="C")
        else:
            array = np.require(found, np.float64, ["C", "A"]).reshape(found.shape)
    if shape is not None and array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, expected {shape}")
    if ndim is not None and array.ndim != ndim:
        raise ValueError(
            f"{what} has {counted(array.ndim, 'dimension')}, expected {ndim}"
        )
    if finite and not np.isfinite(array).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        place = at[0] if len(at) == 1 else at
        where = f" at {place}" if at else ""
        raise ValueError(f"{what} is {array[at]}{where}, expected finite numbers")
    return array


def _hides(rows: Sequence[Any]) -> bool:
    """Whether a mask would be lost among rows that are put together."""
    return any(isinstance(row, np.ma.MaskedArray) and row.mask.any() for row in rows)


def csr(what: str, value: Any) -> Csr:
    """A sparse or dense matrix in CSR form, without duplicates, indices sorted."""
    from scipy.sparse import csr_array, issparse

    if what == "K" and isinstance(value, tuple) and value and issparse(value[0]):
        raise TypeError(
            f"{what} is a tuple of {len(value)} that begins with a matrix, as "
            "skfem.condense and skfem.enforce return: expected the matrix as it was "
            "assembled, with fixed= for the degrees of freedom that are held"
        )
    if issparse(value):
        kind = np.dtype(value.dtype).kind
        if kind not in "iufb":
            raise TypeError(
                f"{what} has entries of type {value.dtype}, expected real numbers"
            )
        if value.ndim != 2:
            raise ValueError(
                f"{what} has {counted(value.ndim, 'dimension')}, expected 2"
            )
        sparse_structure.check(what, value)
        matrix = csr_array(value)
    else:
        matrix = csr_array(floats(what, value, ndim=2, finite=False, copy=False))
    if not matrix.has_canonical_format:
        matrix = matrix.copy()
        matrix.sum_duplicates()
    with np.errstate(over="ignore"):
        data = np.require(matrix.data, np.float64, ["C", "A"])
    if not np.isfinite(data).all():
        at = int(np.argmin(np.isfinite(data)))
        row = int(np.searchsorted(matrix.indptr, at, side="right")) - 1
        # In the words of the core, which looks at dense matrices itself.
        found = "NaN" if np.isnan(data[at]) else data[at]
        raise ValueError(
            f"{what} is not finite at row {row}, column {int(matrix.indices[at])}: {found}"
        )
    # 32 bits are taken as they are: a copy would be a good part of K.
    wide = np.int32 if matrix.indices.dtype == np.int32 else np.int64
    parts = (
        np.require(matrix.indptr, wide, ["C", "A"]),
        np.require(matrix.indices, wide, ["C", "A"]),
        data,
    )
    rows, columns = matrix.shape
    return Csr(matrix, (int(rows), int(columns)), parts)


def one_triangle(parts: Parts) -> str:
    """What to say of a matrix by rows that holds one triangle alone, else nothing."""
    pointers, columns, _ = parts
    rows = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    below, above = bool((columns < rows).any()), bool((columns > rows).any())
    if below == above:
        return ""
    held, other = ("lower", "-1") if below else ("upper", "1")
    of = "tril" if below else "triu"
    return f"; K holds its {held} triangle alone, expected K + scipy.sparse.{of}(K, {other}).T"


def enforced(parts: Parts) -> str:
    """What to say of a matrix by rows that supports were written into, else nothing.

    Their rows hold the diagonal alone, and their columns more: it is not symmetric.
    """
    pointers, columns, values = parts
    n = len(pointers) - 1
    rows = np.repeat(np.arange(n), np.diff(pointers))
    off = (rows != columns) & (values != 0)
    by_row = np.bincount(rows[off], minlength=n)
    by_column = np.bincount(columns[off], minlength=n)
    for held, word, what in (
        ((by_row == 0) & (by_column > 0), "rows", "columns"),
        ((by_column == 0) & (by_row > 0), "columns", "rows"),
    ):
        if held.any() and not held.all():
            return (
                f"; {counted(int(held.sum()), word[:-1])} of K, first {int(np.argmax(held))}, "
                f"{'holds' if held.sum() == 1 else 'hold'} the diagonal alone and the {what} "
                "more: supports were written into K, as by skfem.enforce; expected K as it "
                "was assembled, with fixed= for the degrees of freedom that are held"
            )
    return ""


# Squares of these, and what they are multiplied by, stay in the range of doubles.
_LEAST, _MOST = 1e-75, 1e75
RATIO = _core.largest_friction_ratio


def friction(mu: ArrayLike, contacts: int, d: int, *, ratio: float = np.inf) -> Floats:
    """Friction coefficients ``(n_c,)``, or in space one a tangent, ``(n_c, 2)``.

    Those of one contact are within ``ratio`` of each other, or both zero.
    """
    found = floats("mu", mu)
    if found.ndim == 0:
        found = np.full(contacts, float(found))
    shapes = [(contacts,), (contacts, 2)][: d - 1]
    if found.shape not in shapes:
        wished = " or ".join(map(str, shapes))
        raise ValueError(f"mu has shape {found.shape}, expected a number or {wished}")
    if (found < 0).any():
        at = np.argwhere(found < 0)[0]
        along = "" if len(at) == 1 else f" along its tangent {at[1] + 1}"
        raise ValueError(
            f"mu of contact {at[0]}{along} is {found[tuple(at)]}, expected zero or positive"
        )
    if found.ndim == 2:
        _two_coefficients(found, ratio)
    return found


def by_contact(what: str, value: ArrayLike, contacts: int) -> Floats:
    """A number, the same for all contacts, or one each ``(n_c,)``."""
    found = floats(what, value)
    if found.ndim == 0:
        found = np.full(contacts, float(found))
    if found.shape != (contacts,):
        raise ValueError(
            f"{what} has shape {found.shape}, expected a number or ({contacts},)"
        )
    return found


def coulomb(mu: ArrayLike, contacts: int) -> Floats:
    """Friction coefficients ``(n_c,)``, where one a contact is all that is understood."""
    return friction(mu, contacts, 2)


def _two_coefficients(mu: Floats, ratio: float) -> None:
    least, most = mu.min(axis=1), mu.max(axis=1)
    apart = least != most
    for wrong, expected in (
        (
            apart & (least == 0),
            "two positive numbers, or twice zero",
        ),
        (
            apart & ((least < _LEAST) | (most > _MOST)),
            f"numbers from {_LEAST:g} to {_MOST:g} where they differ",
        ),
        (
            apart & (least < most / ratio),
            f"numbers within a factor of {ratio:g} of each other",
        ),
    ):
        if wrong.any():
            at = int(np.argmax(wrong))
            raise ValueError(
                f"mu of contact {at} is {shown(mu[at].tolist())}, expected {expected}"
            )


def indices(what: str, value: ArrayLike | None, limit: int) -> Ints:
    """Distinct indices below ``limit``."""
    found = np.asarray([] if value is None else value)
    if found.dtype == np.bool_:
        raise TypeError(
            f"{what} is a boolean mask, expected integers: give numpy.flatnonzero of it"
        )
    if found.size == 0:
        return np.empty(0, np.int64)
    if found.dtype.kind not in "iu":
        raise TypeError(f"{what} has entries of type {found.dtype}, expected integers")
    if found.ndim != 1:
        raise ValueError(f"{what} has {counted(found.ndim, 'dimension')}, expected 1")
    outside = (found < 0) | (found >= limit)
    if outside.any():
        at = int(np.argmax(outside))
        raise ValueError(
            f"{what} holds {found[at]} at position {at}, expected 0 to {limit - 1}"
        )
    listed, first, counts = np.unique(found, return_index=True, return_counts=True)
    if (counts > 1).any():
        at = int(np.argmax(counts > 1))
        raise ValueError(
            f"{what} holds {listed[at]} repeated, {counts[at]} times, first at position "
            f"{first[at]}: expected each index once"
        )
    return np.array(found, dtype=np.int64)


def positive(what: str, value: Any) -> int:
    """An integer of 1 or more."""
    return integer(what, value, least=1)


def threads(value: Any) -> int:
    """A number of threads; the core holds what the environment says to the same range."""
    return integer("num_threads", value, least=1, most=1024)


def integer(what: str, value: Any, *, least: int, most: int | None = None) -> int:
    """An integer of ``least`` or more, ``most`` at the most."""
    try:
        number = operator.index(cast("SupportsIndex", value))
    except TypeError:
        number = None
    if number is None or isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{what} is {shown(value)}, expected an integer")
    if not least <= number <= (2**31 - 1 if most is None else most):
        end = "or more, below 2**31" if most is None else f"to {most}"
        raise ValueError(f"{what} is {shown(number)}, expected {least} {end}")
    return number


def shown(value: Any) -> str:
    """What was found, on one line and short enough for a message."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - whatever is handed over must be refused in words
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:76]} ..."


def choice_of_dimension(dim: Any, contacts: int, rows: int, gap: Floats) -> int:
    """``d`` from the rows of ``B``, or from ``dim`` where there are no contacts."""
    if dim is not None and (not isinstance(dim, _REAL) or dim not in (2, 3)):
        raise ValueError(f"dim is {shown(dim)}, expected 2 or 3")
    if contacts == 0:
        if rows:
            raise ValueError(
                f"B has {counted(rows, 'row')}, expected none: gap has no contacts"
            )
        if gap.ndim == 2 and gap.shape[1] in (2, 3):
            dim = dim or gap.shape[1]
        if dim is None:
            raise ValueError(
                "dim is missing: without contacts it cannot be told from B"
            )
        if gap.ndim == 2 and gap.shape[1] != dim:
            raise ValueError(f"gap has shape {gap.shape}, expected (0,) or (0, {dim})")
        return int(dim)
    if rows not in (2 * contacts, 3 * contacts):
        raise ValueError(
            f"gap has {counted(contacts, 'contact')} and B {counted(rows, 'row')}: "
            "expected 2 or 3 rows of B for each contact"
        )
    d = rows // contacts
    if dim is not None and dim != d:
        raise ValueError(f"dim is {dim}, but B has {d} rows for each contact of gap")
    if gap.ndim == 2 and gap.shape[1] != d:
        raise ValueError(
            f"gap has shape {gap.shape}, expected ({contacts},) or ({contacts}, {d})"
        )
    return d


def contact_array(
    what: str, value: ArrayLike | None, contacts: int, d: int
) -> Floats | None:
    """An optional array of one row a contact."""
    return None if value is None else floats(what, value, shape=(contacts, d))


# Axes that are written down have six digits or more.
_TILT = 1e-6


def frames(value: ArrayLike | None, contacts: int, d: int) -> Floats | None:
    """Optional local bases ``(n_c, d, d)``, orthonormal to 1e-6, of either hand."""
    if value is None:
        return None
    found = floats("frame", value, shape=(contacts, d, d))
    # What overflows is no unit vector either.
    with np.errstate(over="ignore", invalid="ignore"):
        lack = np.abs(found @ found.swapaxes(1, 2) - np.eye(d)).max(axis=(1, 2))
    wrong = ~(lack <= _TILT)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(
            f"frame of contact {at} has the rows {shown(found[at].tolist())}, expected "
            f"unit vectors at right angles, to {_TILT:g}"
        )
    return found


def matrices(K: Any, B: Any) -> tuple[Csr, Csr]:
    """A stiffness ``(n, n)`` and a contact operator of as many columns."""
    stiffness, contact = csr("K", K), csr("B", B)
    n = stiffness.shape[0]
    if stiffness.shape != (n, n):
        raise ValueError(f"K has shape {stiffness.shape}, expected a square matrix")
    columns = contact.shape[1]
    if columns != n:
        fewer, other = ("K", "B") if n < columns else ("B", "K")
        raise ValueError(
            f"B has shape {contact.shape}, expected {counted(n, 'column')}, as many "
            f"as K has rows: were degrees of freedom taken out of {fewer}, as by "
            f"skfem.condense, and not out of {other}? Give both whole, and fixed= for the "
            "degrees of freedom that are held"
        )
    return stiffness, contact


def areas(area: ArrayLike | None, contacts: int) -> Floats | None:
    """Tributary areas, ``(n_c,)``, all positive."""
    if area is None:
        return None
    found = floats("area", area, shape=(contacts,))
    if not (found > 0).all():
        at = int(np.argmin(found > 0))
        raise ValueError(
            f"area of contact {at} is {found[at]}, expected a positive number"
        )
    return found


def places(coordinates: ArrayLike | None, n: int) -> Floats | None:
    """Places of degrees of freedom as the core takes them, three coordinates each."""
    if coordinates is None:
        return None
    given = floats("coordinates", coordinates, ndim=2)
    if given.shape[0] != n or given.shape[1] not in (2, 3):
        raise ValueError(
            f"coordinates has shape {given.shape}, expected ({n}, 2) or ({n}, 3)"
        )
    found = np.zeros((n, 3))
    found[:, : given.shape[1]] = given
    return found


def loads(
    load: ArrayLike | None, prescribed: ArrayLike | None, n: int, fixed: int
) -> list[tuple[Floats, Floats]]:
    """Total load and prescribed displacement of each step."""

    def rows(what: str, value: ArrayLike | None, length: int) -> Floats:
        if value is None:
            return np.zeros((1, length))
        found = floats(what, value)
        if found.ndim not in (1, 2) or found.shape[-1] != length:
            raise ValueError(
                f"{what} has shape {found.shape}, expected ({length},) or (steps, {length})"
            )
        return found[None] if found.ndim == 1 else found

    forces = list(rows("load", load, n))
    motions = list(rows("prescribed", prescribed, fixed))
    return together("prescribed", motions, "load", forces, lambda u, f: (f, u))


def together(
    what: str,
    ours: Sequence[S],
    other: str,
    theirs: Sequence[T],
    both: Callable[[S, T], R],
) -> list[R]:
    """What is given step by step, put together; of one step it stands for all."""
    counts = len(ours), len(theirs)
    steps = 0 if 0 in counts else max(counts)
    if len(set(counts)) == 2 and 1 not in counts:
        raise ValueError(
            f"{what} has {counted(len(ours), 'step')} but {other} has {len(theirs)}: "
            "expected as many, or one of them with one"
        )
    return [
        both(ours[min(k, len(ours) - 1)], theirs[min(k, len(theirs) - 1)])
        for k in range(steps)
    ]


def gap(value: ArrayLike, contacts: int, d: int, what: str = "gap") -> Floats:
    """Gaps of contacts ``(n_c,)``, or by component ``(n_c, d)``, as the latter."""
    found = floats(what, value)
    if found.shape not in ((contacts,), (contacts, d)):
        raise ValueError(
            f"{what} has shape {found.shape}, expected ({contacts},) or ({contacts}, {d})"
        )
    return found if found.ndim == 2 else by_component(found, d)


def gaps(value: ArrayLike, contacts: int, d: int) -> Floats:
    """Gaps of each step, ``(steps, n_c)`` or ``(steps, n_c, d)``, as the latter.

    Of one step also ``(n_c,)``.
    """
    found = floats("gap", value)
    if found.shape == (contacts,):
        found = found[None]
    if found.shape[1:] not in ((contacts,), (contacts, d)):
        raise ValueError(
            f"gap has shape {found.shape}, expected ({contacts},), (steps, {contacts}) "
            f"or (steps, {contacts}, {d})"
        )
    return found if found.ndim == 3 else by_component(found, d)


def by_component(normal: Floats, d: int) -> Floats:
    """Gaps of all components ``(..., d)`` from those along the normals ``(...)``."""
    whole = np.zeros((*normal.shape, d))
    whole[..., 0] = normal
    return whole


def settings(
    method: str, tol: float, max_iterations: int | None, max_seconds: float | None
) -> tuple[str, float, int | None, float | None]:
    """Settings of the solver, as the core takes them; it checks their ranges."""
    if not isinstance(method, str):
        raise TypeError(f"method is {shown(method)}, expected a name")
    limit = (
        None if max_iterations is None else positive("max_iterations", max_iterations)
    )
    seconds = None if max_seconds is None else number("max_seconds", max_seconds)
    return method, number("tol", tol), limit, seconds


def callback(what: str, value: Any) -> None:
    """Something to call, or nothing."""
    if value is not None and not callable(value):
        raise TypeError(
            f"{what} is {shown(value)}, expected something to call, or None"
        )


def number(what: str, value: Any) -> float:
    """A real number; an array without dimensions is one."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, _REAL):
        raise TypeError(f"{what} is {shown(value)}, expected a number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(
            f"{what} is {shown(value)}, expected a number below 1e308"
        ) from None
