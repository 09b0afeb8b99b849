"""A diagonal matrix as a sparse array."""

from __future__ import annotations

from typing import Any

from scipy import sparse

from bipot_rs._lib.types import Floats


def diagonal_matrix(values: Floats) -> Any:
    """CSR array with ``values (n,)`` on its diagonal; SciPy has `diags_array` since 1.11."""
    return sparse.csr_array(sparse.diags(values))
