"""Stiffness matrices of cubes and squares in a file that C and Python read alike.

The base is the contact and comes last; the top is held and taken out. The file holds n,
m, d and nnz as 64-bit integers, then the lower triangle by columns: pointers, row
indices, values.
"""

from pathlib import Path

import numpy as np
from scipy import sparse

from bipot_rs.fem import Body, Material, box, stiffness


def write(path, dim, cells):
    """Write the body with ``cells`` cells a side; returns n and m."""
    axis = np.linspace(0.0, 1.0, cells + 1)
    mesh = box([axis] * dim, "hexahedron" if dim == 3 else "quadrilateral")
    K = sparse.csr_array(stiffness(Body("body", mesh, Material(1.0, 0.3))))
    base, top = (np.flatnonzero(mesh.p[-1] == end) for end in (0.0, 1.0))
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


def head(path):
    """Sizes n, m, d and nnz of a file."""
    return tuple(int(x) for x in np.fromfile(path, np.int64, 4))
