"""Small bodies on a rigid plane, assembled by scikit-fem without the package.

The plane is where the last coordinate is 0. The normal is the last axis, the tangents
are the other axes in order. A load is a vector of consistent nodal forces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from skfem.models.elasticity import lame_parameters, linear_elasticity

Array = NDArray[np.float64]


@dataclass
class Body:
    """Stiffness K and contact matrix B of a block, its contacts at `points`."""

    K: Any
    B: Any
    points: Array
    area: Array
    basis: Any

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])

    @property
    def gap(self) -> Array:
        return np.zeros(self.area.size)

    def nodes_where(self, axis: int, value: float) -> NDArray[np.int64]:
        at = self.basis.mesh.p[axis]
        # Coordinates come from linspace: exact to rounding relative to the size of the body.
        return np.flatnonzero(np.abs(at - value) <= 1e-12 * np.ptp(at))

    def dofs(self, axis: int, value: float, component: int) -> NDArray[np.int64]:
        """Degrees of freedom of one component on the face `x[axis] = value`."""
        nodes = self.nodes_where(axis, value)
        return np.asarray(self.basis.nodal_dofs[component][nodes])

    def traction(self, axis: int, value: float, force: Sequence[float]) -> Array:
        """Load of a uniform traction, force per area, on the face `x[axis] = value`."""
        mesh = self.basis.mesh
        size = np.ptp(mesh.p[axis])
        facets = mesh.facets_satisfying(
            lambda x: np.abs(x[axis] - value) <= 1e-9 * size
        )
        face = skfem.FacetBasis(mesh, self.basis.elem, facets=facets, intorder=2)
        form = skfem.LinearForm(lambda v, _: sum(f * v[k] for k, f in enumerate(force)))
        return np.asarray(form.assemble(face))

    def weight(self, force: Sequence[float]) -> Array:
        """Load of a body force whose resultant is `force`."""
        form = skfem.LinearForm(lambda v, _: sum(f * v[k] for k, f in enumerate(force)))
        volume = float(np.prod([np.ptp(x) for x in self.basis.mesh.p]))
        return np.asarray(form.assemble(self.basis)) / volume


def block(
    sizes: Sequence[float], cells: Sequence[int], young: float, nu: float
) -> Body:
    """A box of bilinear cells with a corner at the origin; plane strain in 2D."""
    lines = [np.linspace(0, s, c + 1) for s, c in zip(sizes, cells, strict=True)]
    dim = len(sizes)
    mesh = (skfem.MeshQuad if dim == 2 else skfem.MeshHex).init_tensor(*lines)
    shape = skfem.ElementQuad1() if dim == 2 else skfem.ElementHex1()
    basis = skfem.Basis(mesh, skfem.ElementVector(shape), intorder=2)
    K = linear_elasticity(*lame_parameters(young, nu)).assemble(basis)
    nodes = np.flatnonzero(mesh.p[-1] == 0)
    order = [dim - 1, *range(dim - 1)]
    columns = basis.nodal_dofs[order][:, nodes].T.ravel()
    rows = np.arange(columns.size)
    B = sparse.csr_array(
        (np.ones(columns.size), (rows, columns)), (rows.size, K.shape[0])
    )
    body = Body(K, B, mesh.p[:, nodes].T.copy(), np.zeros(nodes.size), basis)
    unit = [0.0] * (dim - 1) + [1.0]
    body.area = body.traction(dim - 1, 0.0, unit)[columns[::dim]]
    return body


def uniform_shear(body: Body, pressure: float, shear: Sequence[float]) -> Array:
    """Load of the uniform stress `σ_nn = -pressure`, `σ_nt = shear` on all free faces."""
    sizes, last = body.basis.mesh.p.max(axis=1), body.dim - 1
    load = body.traction(last, sizes[last], [*shear, -pressure])
    for axis, tau in enumerate(shear):
        up = [0.0] * last + [tau]
        load += body.traction(axis, sizes[axis], up)
        load -= body.traction(axis, 0.0, up)
    return load
