"""Check that the index arrays of a sparse matrix fit its shape.

SciPy does not check them: with wrong indices it reads and writes outside its arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Integers


def check(what: str, matrix: Any) -> None:
    """Refuse a sparse matrix whose arrays contradict its shape.

    Raises
    ------
    ValueError
        Indices outside the shape, or row pointers that do not ascend from 0 to the number
        of entries.
    """
    rows, columns = matrix.shape
    kind = matrix.format
    if kind in ("csr", "csc", "bsr"):
        height, width = getattr(matrix, "blocksize", (1, 1))
        major, minor = rows // height, columns // width
        if kind == "csc":
            major, minor = minor, major
        _pointers(what, matrix.indptr, len(matrix.indices), len(matrix.data), major)
        _within(what, matrix.indices[: int(matrix.indptr[-1])], minor)
    elif kind == "coo":
        row, column = matrix.row, matrix.col
        if not len(row) == len(column) == len(matrix.data):
            raise ValueError(
                f"{what} has {len(row)} row indices, {len(column)} column indices and "
                f"{len(matrix.data)} entries, expected as many of each"
            )
        _within(what, row, rows)
        _within(what, column, columns)


def _pointers(
    what: str, pointer: Integers, indices: int, entries: int, major: int
) -> None:
    if len(pointer) != major + 1:
        raise ValueError(
            f"{what} has {count_noun(len(pointer), 'pointer')} to its rows, expected {major + 1}"
        )
    if pointer[0] != 0 or (np.diff(pointer) < 0).any():
        raise ValueError(
            f"{what} has pointers to its rows that do not go up from 0: a broken "
            "sparse matrix"
        )
    if pointer[-1] > min(indices, entries):
        raise ValueError(
            f"{what} has {count_noun(min(indices, entries), 'entry')}, its pointers to rows end at "
            f"{pointer[-1]}"
        )


def _within(what: str, indices: Integers, limit: int) -> None:
    # Least and greatest take no memory, where a comparison takes a byte for each entry.
    if len(indices) and (indices.min() < 0 or indices.max() >= limit):
        at = int(np.argmax((indices < 0) | (indices >= limit)))
        raise ValueError(
            f"{what} has an entry at index {indices[at]}, expected 0 to {limit - 1}: a "
            "broken sparse matrix"
        )
