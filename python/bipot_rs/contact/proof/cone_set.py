"""Least values of linear functions over a product of circular cones, found by the core."""

from __future__ import annotations

from typing import Any

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats


def make_cone_set(
    G: Any, h: Floats, equations: Any = None, right: Floats | None = None
) -> _core.ConeSet:
    """The ``y`` with ``h + G y`` in the cones and, if given, ``equations y = right``.

    ``G, h``: matrix ``(m d, k)``, dense or sparse, and ``(m, d)``: each row of ``h + G y (m,
    d)`` lies in the cone ``s_0 >= |(s_1, ..)|``. A row whose other components are zero is a
    half-line.
    """
    from scipy.sparse import csr_array

    sparse = csr_array(G)
    other = csr_array((0, sparse.shape[1])) if equations is None else equations
    right = np.empty(0) if right is None else right
    sizes = np.full(len(h), h.shape[1], np.int64)
    return _core.ConeSet(
        csr_parts(sparse),
        np.ascontiguousarray(h, np.float64).ravel(),
        sizes,
        csr_parts(csr_array(other)),
        np.asarray(right, np.float64),
        sparse.shape[1],
    )


def csr_parts(matrix: Any) -> tuple[Any, Any, Floats]:
    """Row pointers, columns and values of a matrix in CSR form, for the core."""
    return (
        np.asarray(matrix.indptr, np.int64),
        np.asarray(matrix.indices, np.int64),
        np.asarray(matrix.data, np.float64),
    )
