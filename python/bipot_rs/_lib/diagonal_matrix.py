"""A diagonal matrix as a sparse array."""

from __future__ import annotations

from scipy import sparse

from bipot_rs._lib.types import CsrMatrix, Floats


def diagonal_matrix(values: Floats) -> CsrMatrix:
    """CSR array with ``values (n,)`` on its diagonal; SciPy has `diags_array` since 1.11."""
    diagonal: CsrMatrix = sparse.csr_array(sparse.diags(values))
    return diagonal
