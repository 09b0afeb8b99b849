"""Check arguments once, before any work.

Each message names the argument, what was found and what was expected.
"""

from __future__ import annotations

import numbers
import operator
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, SupportsIndex, SupportsInt, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun, meant
from bipot_rs._lib.types import CsrMatrix, Floats, Integers, Ints

R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")

# Real numbers of NumPy and Python, fractions included; no complex numbers or booleans.
_REAL = numbers.Real
_LARGEST = float(np.finfo(np.float64).max)


# Row pointers, columns and values of a matrix by rows.
Parts = tuple[Integers, Integers, Floats]


class Csr(NamedTuple):
    """A checked sparse matrix, and its arrays in the form that the core takes."""

    matrix: CsrMatrix
    shape: tuple[int, int]
    parts: Parts


def floats(
    what: str,
    value: object,
    *,
    ndim: int | None = None,
    shape: tuple[int, ...] | None = None,
    finite: bool = True,
    copy: bool = True,
    but: Ints | None = None,
) -> Floats:
    """``value`` as a C-ordered array of float64, by default a copy.

    Columns ``but`` may be NaN.
    """
    plain = type(value) is np.ndarray and value.dtype == np.float64
    given = cast("NDArray[Any]", value) if plain else _as_numbers(what, value)
    if copy:
        array = np.array(given, dtype=np.float64, order="C")
    elif plain and given.flags.c_contiguous and given.flags.aligned:
        array = given
    else:
        array = np.require(given, np.float64, ["C", "A"]).reshape(given.shape)
    if shape is not None and array.shape != shape:
        raise ValueError(f"{what} has shape {array.shape}, expected {shape}")
    if ndim is not None and array.ndim != ndim:
        raise ValueError(
            f"{what} has {count_noun(array.ndim, 'dimension')}, expected {ndim}"
        )
    if finite and _core.find_outside(array, -_LARGEST, _LARGEST) is not None:
        wrong = ~np.isfinite(array)
        if but is not None and array.ndim:
            # An array of another shape is refused by the caller.
            there = but[but < array.shape[-1]]
            wrong[..., there] &= ~np.isnan(array[..., there])
        if wrong.any():
            at = tuple(int(i) for i in np.argwhere(wrong)[0])
            place = at[0] if len(at) == 1 else at
            where = f" at {place}" if at else ""
            raise ValueError(f"{what} is {array[at]}{where}, expected finite numbers")
    return array


def shaped(what: str, value: object, *shapes: tuple[int, ...]) -> Floats:
    """``value`` as array of float64 of one of several shapes; ``()`` is a number."""
    array = floats(what, value)
    if array.shape not in shapes:
        named = [str(shape) if shape else "a number" for shape in shapes]
        expected = f"{', '.join(named[:-1])} or {named[-1]}"
        raise ValueError(f"{what} has shape {array.shape}, expected {expected}")
    return array


def _as_numbers(what: str, value: object) -> NDArray[Any]:
    """Real numbers as float64 where they have another type; none of them is masked."""
    array = _as_array(what, value)
    if array.dtype.kind not in "iuf":
        raise TypeError(
            f"{what} has entries of type {array.dtype}, expected real numbers"
        )
    if np.ma.is_masked(value) or (isinstance(value, (list, tuple)) and _hides(value)):
        raise ValueError(f"{what} has masked entries, expected an array without a mask")
    # Numbers too large for float64 become infinite, which the caller refuses.
    with np.errstate(over="ignore"):
        return array.astype(np.float64, copy=False)


def _as_array(what: str, value: object) -> NDArray[Any]:
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{what} is not an array: {error}") from None


def vectors(
    what: str, value: object, *, rows: str = "n_c", copy: bool = True
) -> Floats:
    """Vectors of two or three components, one for each row."""
    rows_of_vectors = floats(what, value, ndim=2, copy=copy)
    if rows_of_vectors.shape[1] not in (2, 3):
        raise ValueError(
            f"{what} has shape {rows_of_vectors.shape}, expected ({rows}, 2) or ({rows}, 3)"
        )
    return rows_of_vectors


def integers(what: str, value: object) -> Integers:
    """An array of integers."""
    whole_numbers = _as_array(what, value)
    if whole_numbers.dtype.kind not in "iu":
        raise TypeError(
            f"{what} has entries of type {whole_numbers.dtype}, expected integers"
        )
    return whole_numbers


def _hides(rows: Sequence[object]) -> bool:
    """Whether a row has masked entries, which `numpy.asarray` would unmask."""
    return any(isinstance(row, np.ma.MaskedArray) and row.mask.any() for row in rows)


def csr(what: str, value: Any) -> Csr:
    """A sparse or dense matrix in CSR form, without duplicates, with sorted indices."""
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
                f"{what} has {count_noun(value.ndim, 'dimension')}, expected 2"
            )
        _check_structure(what, value)
        matrix = csr_array(value)
    else:
        matrix = csr_array(floats(what, value, ndim=2, finite=False, copy=False))
    if not matrix.has_canonical_format:
        matrix = matrix.copy()
        matrix.sum_duplicates()
    with np.errstate(over="ignore"):
        data = np.require(matrix.data, np.float64, ["C", "A"])
    at = _core.find_outside(data, -_LARGEST, _LARGEST)
    if at is not None:
        row = int(np.searchsorted(matrix.indptr, at, side="right")) - 1
        # The same message as that of the core, which checks dense matrices.
        entry = "NaN" if np.isnan(data[at]) else data[at]
        raise ValueError(
            f"{what} is not finite at row {row}, column {int(matrix.indices[at])}: {entry}"
        )
    # Indices of 32 bits are not copied: a copy would take much memory.
    wide = np.int32 if matrix.indices.dtype == np.int32 else np.int64
    parts = (
        np.require(matrix.indptr, wide, ["C", "A"]),
        np.require(matrix.indices, wide, ["C", "A"]),
        data,
    )
    rows, columns = matrix.shape
    return Csr(matrix, (int(rows), int(columns)), parts)


def one_triangle(parts: Parts) -> str:
    """End of a message about a matrix that stores one triangle only; "" otherwise."""
    pointers, columns, _ = parts
    rows = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    below, above = bool((columns < rows).any()), bool((columns > rows).any())
    if below == above:
        return ""
    held, other = ("lower", "-1") if below else ("upper", "1")
    of = "tril" if below else "triu"
    return f"; K stores its {held} triangle only, expected K + scipy.sparse.{of}(K, {other}).T"


def describe_enforced(parts: Parts) -> str:
    """End of a message about a matrix into which supports were written; "" otherwise.

    Rows of supports then contain the diagonal only, but their columns contain more.
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
                f"; {count_noun(int(held.sum()), word[:-1])} of K, first {int(np.argmax(held))}, "
                f"{'contains' if held.sum() == 1 else 'contain'} the diagonal only, but the "
                f"{what} more: supports were written into K, as by skfem.enforce; expected K "
                "as assembled, with fixed= for the supported degrees of freedom"
            )
    return ""


# Products of squares of such numbers do not overflow or underflow.
_LEAST, _MOST = 1e-75, _core.largest_friction
RATIO = _core.largest_friction_ratio


def friction(mu: ArrayLike, contacts: int, d: int, *, ratio: float = np.inf) -> Floats:
    """Friction coefficients ``(n_c,)``, or in 3D one for each tangent, ``(n_c, 2)``.

    The two of one contact are within a factor ``ratio`` of each other, or both zero.
    """
    coefficients = floats("mu", mu)
    if coefficients.ndim == 0:
        coefficients = np.full(contacts, float(coefficients))
    shapes = [(contacts,), (contacts, 2)][: d - 1]
    if coefficients.shape not in shapes:
        wished = " or ".join(map(str, shapes))
        raise ValueError(
            f"mu has shape {coefficients.shape}, expected a number or {wished}"
        )
    wrong = _core.find_outside(coefficients, 0.0, _MOST)
    if wrong is not None:
        at = np.unravel_index(wrong, coefficients.shape)
        along = "" if len(at) == 1 else f" along tangent {at[1] + 1}"
        value = coefficients[at]
        expected = "zero or positive"
        if value > 0:
            expected = f"at most {_MOST:g}: products of larger squares overflow"
        raise ValueError(
            f"mu of contact {at[0]}{along} is {value}, expected {expected}"
        )
    if coefficients.ndim == 2:
        _two_coefficients(coefficients, ratio)
    return coefficients


def by_contact(what: str, value: ArrayLike, contacts: int) -> Floats:
    """One number for all contacts, or one for each, as ``(n_c,)``."""
    given = shaped(what, value, (), (contacts,))
    return given if given.ndim else np.full(contacts, float(given))


def coulomb(mu: ArrayLike, contacts: int) -> Floats:
    """Friction coefficients ``(n_c,)``, one for each contact."""
    return friction(mu, contacts, 2)


def _two_coefficients(mu: Floats, ratio: float) -> None:
    least, most = mu.min(axis=1), mu.max(axis=1)
    apart = least != most
    for wrong, expected in (
        (apart & (least == 0), "two positive numbers, or two zeros"),
        (
            apart & (least < _LEAST),
            f"numbers from {_LEAST:g} to {_MOST:g} if they differ",
        ),
        (
            apart & (least < most / ratio),
            f"numbers within a factor of {ratio:g} of each other",
        ),
    ):
        if wrong.any():
            at = int(np.argmax(wrong))
            raise ValueError(
                f"mu of contact {at} is {show_value(mu[at].tolist())}, expected {expected}"
            )


def indices(what: str, value: ArrayLike | None, limit: int) -> Ints:
    """Distinct indices below ``limit``."""
    index_array = _as_array(what, [] if value is None else value)
    if index_array.dtype == np.bool_:
        raise TypeError(
            f"{what} is a boolean mask, expected integers: use numpy.flatnonzero(mask)"
        )
    if index_array.size == 0:
        return np.empty(0, np.int64)
    integers(what, index_array)
    if index_array.ndim != 1:
        raise ValueError(
            f"{what} has {count_noun(index_array.ndim, 'dimension')}, expected 1"
        )
    outside = (index_array < 0) | (index_array >= limit)
    if outside.any():
        at = int(np.argmax(outside))
        raise ValueError(
            f"{what} holds {index_array[at]} at position {at}, expected 0 to {limit - 1}"
        )
    listed, first, counts = np.unique(
        index_array, return_index=True, return_counts=True
    )
    if (counts > 1).any():
        at = int(np.argmax(counts > 1))
        raise ValueError(
            f"{what} holds {listed[at]} repeated, {counts[at]} times, first at position "
            f"{first[at]}: expected each index once"
        )
    return np.array(index_array, dtype=np.int64)


def positive(what: str, value: object) -> int:
    """An integer of 1 or more."""
    return integer(what, value, least=1)


def threads(value: object) -> int:
    """A number of threads; the core limits environment variables to the same range."""
    return integer("num_threads", value, least=1, most=1024)


def integer(what: str, value: object, *, least: int, most: int | None = None) -> int:
    """An integer from ``least`` to ``most``."""
    number = value if type(value) is int else None
    # `operator.index` takes a logical value, of NumPy with a warning before NumPy 1.25.
    if number is None and not isinstance(value, (bool, np.bool_)):
        with suppress(TypeError):
            number = operator.index(cast("SupportsIndex", value))
    if number is None:
        raise TypeError(f"{what} is {show_value(value)}, expected an integer")
    if not least <= number <= (2**31 - 1 if most is None else most):
        end = "or more, below 2**31" if most is None else f"to {most}"
        raise ValueError(f"{what} is {show_value(number)}, expected {least} {end}")
    return number


def show_value(value: object) -> str:
    """``repr`` of a value on one line, short enough for a message."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - any value must be refused with a clear message
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:76]} ..."


def choice_of_dimension(
    dim: SupportsInt | None, contacts: int, rows: int, gap: Floats
) -> int:
    """``d`` from the rows of ``B``, or from ``dim`` if there are no contacts."""
    if dim is not None and (not isinstance(dim, _REAL) or dim not in (2, 3)):
        raise ValueError(f"dim is {show_value(dim)}, expected 2 or 3")
    if contacts == 0:
        if rows:
            raise ValueError(
                f"B has {count_noun(rows, 'row')}, expected none: gap has no contacts"
            )
        if gap.ndim == 2 and gap.shape[1] in (2, 3):
            dim = dim or gap.shape[1]
        if dim is None:
            raise ValueError("dim is missing: without contacts B does not determine it")
        if gap.ndim == 2 and gap.shape[1] != dim:
            raise ValueError(f"gap has shape {gap.shape}, expected (0,) or (0, {dim})")
        return int(dim)
    if rows not in (2 * contacts, 3 * contacts):
        raise ValueError(
            f"gap has {count_noun(contacts, 'contact')} and B {count_noun(rows, 'row')}: "
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
    """An optional array with one row for each contact."""
    return None if value is None else floats(what, value, shape=(contacts, d))


# Files give axes with six digits or more.
_TILT = 1e-6


def frames(value: ArrayLike | None, contacts: int, d: int) -> Floats | None:
    """Optional local bases ``(n_c, d, d)``, orthonormal to 1e-6, of either handedness."""
    if value is None:
        return None
    bases = floats("frame", value, shape=(contacts, d, d))
    # Vectors whose product overflows are refused below as well.
    with np.errstate(over="ignore", invalid="ignore"):
        lack = np.abs(bases @ bases.swapaxes(1, 2) - np.eye(d)).max(axis=(1, 2))
    wrong = ~(lack <= _TILT)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(
            f"frame of contact {at} has the rows {show_value(bases[at].tolist())}, expected "
            f"unit vectors at right angles, to {_TILT:g}"
        )
    return bases


def matrices(K: object, B: object) -> tuple[Csr, Csr]:
    """A stiffness ``(n, n)`` and a contact operator with n columns."""
    stiffness, contact = csr("K", K), csr("B", B)
    n = stiffness.shape[0]
    if stiffness.shape != (n, n):
        raise ValueError(f"K has shape {stiffness.shape}, expected a square matrix")
    columns = contact.shape[1]
    if columns != n:
        fewer, other = ("K", "B") if n < columns else ("B", "K")
        raise ValueError(
            f"B has shape {contact.shape}, expected {count_noun(n, 'column')}, as many "
            f"as K has rows: were degrees of freedom removed from {fewer}, as by "
            f"skfem.condense, but not from {other}? Pass both complete, and fixed= for the "
            "supported degrees of freedom"
        )
    return stiffness, contact


def areas(area: ArrayLike | None, contacts: int) -> Floats | None:
    """Tributary areas, ``(n_c,)``, all positive."""
    if area is None:
        return None
    checked_areas = floats("area", area, shape=(contacts,))
    if not (checked_areas > 0).all():
        at = int(np.argmin(checked_areas > 0))
        raise ValueError(
            f"area of contact {at} is {checked_areas[at]}, expected a positive number"
        )
    return checked_areas


def places(coordinates: ArrayLike | None, n: int) -> Floats | None:
    """Coordinates of degrees of freedom, three for each, as the core takes them."""
    if coordinates is None:
        return None
    as_given = floats("coordinates", coordinates, ndim=2)
    if as_given.shape[0] != n or as_given.shape[1] not in (2, 3):
        raise ValueError(
            f"coordinates has shape {as_given.shape}, expected ({n}, 2) or ({n}, 3): "
            "a row for each degree of freedom, as numpy.repeat(nodes, d, axis=0)"
        )
    return np.pad(as_given, ((0, 0), (0, 3 - as_given.shape[1])))


def rows_of_steps(
    what: str, value: ArrayLike | None, length: int, but: Ints | None = None
) -> Floats:
    """Values of each step, ``(steps, length)``; zeros of one step for None.

    Columns ``but`` may be NaN.
    """
    if value is None:
        return np.zeros((1, length))
    totals = floats(what, value, but=but)
    if totals.ndim not in (1, 2) or totals.shape[-1] != length:
        raise ValueError(
            f"{what} has shape {totals.shape}, expected ({length},) or (steps, {length})"
        )
    return totals[None] if totals.ndim == 1 else totals


def loads(
    load: ArrayLike | None, prescribed: ArrayLike | None, n: int, fixed: int
) -> list[tuple[Floats, Floats]]:
    """Total load and prescribed displacement of each step."""
    forces = list(rows_of_steps("load", load, n))
    motions = list(rows_of_steps("prescribed", prescribed, fixed))
    return together("prescribed", motions, "load", forces, lambda u, f: (f, u))


def together(
    what: str,
    ours: Sequence[S],
    other: str,
    theirs: Sequence[T],
    both: Callable[[S, T], R],
) -> list[R]:
    """Combine two sequences step by step; one with a single step is used for all steps."""
    counts = len(ours), len(theirs)
    steps = 0 if 0 in counts else max(counts)
    if len(set(counts)) == 2 and 1 not in counts:
        raise ValueError(
            f"{what} has {count_noun(len(ours), 'step')} but {other} has {len(theirs)}: "
            "expected the same number, or one step in either"
        )
    return [
        both(ours[min(k, len(ours) - 1)], theirs[min(k, len(theirs) - 1)])
        for k in range(steps)
    ]


def gap(value: ArrayLike, contacts: int, d: int, what: str = "gap") -> Floats:
    """Gaps ``(n_c, d)``, from normal gaps ``(n_c,)`` or all components ``(n_c, d)``."""
    gaps_at_start = floats(what, value)
    if gaps_at_start.ndim == 0:
        gaps_at_start = np.full(contacts, float(gaps_at_start))
    if gaps_at_start.shape not in ((contacts,), (contacts, d)):
        raise ValueError(
            f"{what} has shape {gaps_at_start.shape}, expected ({contacts},) or ({contacts}, {d})"
        )
    return gaps_at_start if gaps_at_start.ndim == 2 else by_component(gaps_at_start, d)


def gaps(value: ArrayLike, contacts: int, d: int, what: str = "gap") -> Floats:
    """Gaps ``(steps, n_c, d)``, from the same, ``(steps, n_c)`` or ``(n_c,)``."""
    by_step = floats(what, value)
    if by_step.ndim == 0:
        by_step = np.full(contacts, float(by_step))
    if by_step.shape == (contacts,):
        by_step = by_step[None]
    if by_step.shape[1:] not in ((contacts,), (contacts, d)):
        raise ValueError(
            f"{what} has shape {by_step.shape}, expected ({contacts},), (steps, {contacts}) "
            f"or (steps, {contacts}, {d})"
        )
    return by_step if by_step.ndim == 3 else by_component(by_step, d)


def by_component(normal: Floats, d: int) -> Floats:
    """Gaps ``(..., d)`` from normal gaps ``(...)``; the other components are zero."""
    whole = np.zeros((*normal.shape, d))
    whole[..., 0] = normal
    return whole


def settings(
    method: str, tol: float, max_iterations: int | None, max_seconds: float | None
) -> _core.Settings:
    """Check the settings of a solve."""
    if not isinstance(method, str):
        raise TypeError(f"method is {show_value(method)}, expected a name")
    if method not in _core.METHODS:
        names = ", ".join(map(repr, _core.METHODS))
        raise ValueError(
            f"method is {method!r}, expected one of {names}{meant(method, _core.METHODS)}"
        )
    limit = (
        None if max_iterations is None else positive("max_iterations", max_iterations)
    )
    seconds = None if max_seconds is None else number("max_seconds", max_seconds)
    return _core.Settings(method, number("tol", tol), limit, seconds)


def logical(what: str, value: object) -> None:
    """Refuse what is neither True nor False."""
    if not isinstance(value, bool):
        raise TypeError(f"{what} is {show_value(value)}, expected a bool")


def callback(what: str, value: object) -> None:
    """Refuse a callback that is neither callable nor None."""
    if value is not None and not callable(value):
        raise TypeError(f"{what} is {show_value(value)}, expected a function, or None")


def number(what: str, value: object) -> float:
    """A real number, or an array without dimensions, as float."""
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, _REAL):
        raise TypeError(f"{what} is {show_value(value)}, expected a number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(
            f"{what} is {show_value(value)}, expected a number below 1e308"
        ) from None


def one_of(what: str, value: object, known: Sequence[str]) -> str:
    """``value``, which must be one of the names ``known``."""
    if isinstance(value, str) and value in known:
        return value
    names = " or ".join(map(repr, known))
    similar = meant(value, known) if isinstance(value, str) else ""
    raise ValueError(f"{what} is {value!r}, expected {names}{similar}")


def _check_structure(what: str, matrix: Any) -> None:
    """Refuse a sparse matrix whose arrays contradict its shape: SciPy would read outside them."""
    make = type(matrix)
    try:
        if matrix.format == "coo":
            make((matrix.data, (matrix.row, matrix.col)), shape=matrix.shape)
        elif matrix.format in ("csr", "csc", "bsr"):
            # A new matrix of the same arrays: the check may change the type of its indices.
            parts = matrix.data, matrix.indices, matrix.indptr
            make(parts, shape=matrix.shape).check_format(full_check=True)
    except ValueError as error:
        raise ValueError(f"{what} is a broken sparse matrix: {error}") from None
