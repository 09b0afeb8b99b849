"""Write the stiffness matrix of a cube or square to a file that C and Python can read.

The base is in contact and comes last; the top is fixed and left out. The file holds n, m, d
and nnz as 64-bit integers, then the lower triangle by columns: pointers, row indices, values.
"""

from pathlib import Path

import numpy as np
from scipy import sparse
from unit_body import unit_body


def write(path, dim, cells):
    """Write the body with ``cells`` cells along each axis; return n and m."""
    mesh, K, base, top = unit_body(dim, cells)
    inner = np.setdiff1d(np.arange(mesh.nvertices), np.append(base, top))
    order = (dim * np.append(inner, base)[:, None] + np.arange(dim)).ravel()
    lower = sparse.tril(K[order][:, order]).tocsc()
    lower.sort_indices()
    n, m = len(order), dim * len(base)
    with Path(path).open("wb") as file:
        np.array([n, m, dim, lower.nnz], np.int64).tofile(file)
        lower.indptr.astype(np.int64).tofile(file)
        lower.indices.astype(np.int64).tofile(file)
        lower.data.astype(np.float64).tofile(file)
    return n, m
