"""A square or cube of side 1: stiffness, and the nodes of its base and top."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bipot_rs.fem import Body, Material, box, stiffness


class UnitBody(NamedTuple):
    """Young's modulus 1, Poisson's ratio 0.3, bilinear or trilinear cells."""

    mesh: Any
    K: sparse.csr_array
    base: NDArray[np.int64]
    top: NDArray[np.int64]


def unit_body(dim: int, cells: int) -> UnitBody:
    """Assemble the body with ``cells`` cells along each axis."""
    axis = np.linspace(0.0, 1.0, cells + 1)
    mesh = box([axis] * dim, "hexahedron" if dim == 3 else "quadrilateral")
    K = sparse.csr_array(stiffness(Body("body", mesh, Material(1.0, 0.3))))
    base, top = (np.flatnonzero(mesh.p[-1] == end) for end in (0.0, 1.0))
    return UnitBody(mesh, K, base, top)
