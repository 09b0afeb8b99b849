"""Second-order bodies of scikit-fem, coupled with plain arrays by `bp.pairs`."""

from typing import Any, NamedTuple

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy import sparse
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

import bipot_rs as bp

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
NU, P, MU = 0.3, 1e-3, 0.5


class Part(NamedTuple):
    """Arrays as any program has them."""

    K: Any
    load: Array  # # of the pressure P on top
    points: Array
    dofs: Ints
    facets: Ints  # # facets of the contact surface, with outward normals


ELEMENTS = {
    "line2": (skfem.MeshTri, skfem.ElementTriP1()),
    "line3": (skfem.MeshTri, skfem.ElementTriP2()),
    "triangle3": (skfem.MeshTet, skfem.ElementTetP1()),
    "triangle6": (skfem.MeshTet, skfem.ElementTetP2()),
    "quadrilateral4": (skfem.MeshHex, skfem.ElementHex1()),
    "quadrilateral9": (skfem.MeshHex, skfem.ElementHex2()),
}

SECOND = {"line3", "triangle6", "quadrilateral9"}


def part(kind: str, n: int, up: float, seed: int) -> Part:
    """A unit block above or below z = 0, with n cells per side.

    Inner nodes on z = 0 are moved at random.
    """
    kinds, element = ELEMENTS[kind]
    dim = 2 if kind.startswith("line") else 3
    line = np.linspace(0, 1, n + 1)
    mesh = kinds.init_tensor(*[line] * (dim - 1), np.sort([0.0, up]))
    x = mesh.p.copy()
    inner = ((x[:-1] > 0) & (x[:-1] < 1)).all(axis=0) & (x[-1] == 0)
    random = np.random.default_rng(seed)
    # Edges stay straight, with midside nodes in the middle.
    x[:-1, inner] += 0.2 / n * random.uniform(-1, 1, (dim - 1, inner.sum()))
    mesh = kinds(x, mesh.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=4)
    K = linear_elasticity(*lame_parameters(1.0, NU)).assemble(basis)
    top = mesh.facets_satisfying(lambda p: p[-1] == max(up, 0.0))
    side = skfem.FacetBasis(mesh, basis.elem, facets=top, intorder=4)
    load = skfem.LinearForm(lambda v, w: -P * dot(w.n, v)).assemble(side)
    meets = mesh.facets_satisfying(lambda p: p[-1] == 0)
    # One node per point; all degrees of freedom of a point belong to its node.
    rounded, first, which = np.unique(
        np.round(basis.doflocs.T, 9), axis=0, return_index=True, return_inverse=True
    )
    places = basis.doflocs.T[first]
    dofs = np.argsort(which.ravel(), kind="stable").reshape(-1, dim)
    number = {tuple(p): i for i, p in enumerate(rounded.tolist())}

    def at(p: Array) -> Ints:
        return np.array([number[tuple(q)] for q in np.round(p, 9).tolist()])

    corners = mesh.p.T[mesh.facets[:, meets]]  # (c, facets, d)
    normal = _normal(corners)
    flip = normal[:, -1] * up > 0
    corners[:, flip] = corners[::-1, flip]
    columns = [at(c) for c in corners]
    if kind in SECOND:
        following = np.roll(corners, -1, axis=0)[: 1 if dim == 2 else None]
        columns += [at((a + b) / 2) for a, b in zip(corners, following, strict=False)]
        if kind == "quadrilateral9":
            columns.append(at(corners.mean(axis=0)))
    return Part(K, load, places, dofs, np.stack(columns, axis=1))


def _normal(corners: Array) -> Array:
    if len(corners) == 2:
        along = corners[1] - corners[0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    return np.cross(corners[1] - corners[0], corners[2] - corners[0])


PAIRS = [
    ("line3", "line2"),
    ("line2", "line3"),
    ("line3", "line3"),
    ("triangle6", "triangle3"),
    ("triangle3", "triangle6"),
    ("triangle6", "quadrilateral9"),
    ("quadrilateral9", "triangle6"),
    ("quadrilateral9", "quadrilateral4"),
    ("quadrilateral4", "quadrilateral9"),
]


@pytest.mark.parametrize(("above", "below"), PAIRS)
@pytest.mark.slow_variants("*quadrilateral9*")
def test_patch(above: str, below: str) -> None:
    """Uniform stress -P along z, sides free, ends guided: u linear, all nodes stick."""
    up, low = part(above, 2, 1.0, 1), part(below, 3, -1.0, 2)
    dim = up.points.shape[1]
    n = up.K.shape[0] + low.K.shape[0]
    numbers = (up.dofs, low.dofs + up.K.shape[0])
    pairs = bp.pairs(
        up.points,
        up.facets,
        low.points,
        low.facets,
        dofs_slave=numbers[0],
        dofs_master=numbers[1],
        n=n,
    )
    assert pairs.area.sum() == pytest.approx(1, rel=1e-13)
    u = np.zeros(n)
    along, aside = (1 - NU**2, NU * (1 + NU)) if dim == 2 else (1.0, NU)
    ends = []
    for side_body, node_numbers in zip((up, low), numbers, strict=True):
        x = side_body.points
        u[node_numbers[:, :-1]] = P * aside * x[:, :-1]
        u[node_numbers[:, -1]] = -P * along * (x[:, -1] + 1)
        ends.append(
            node_numbers[
                x[:, -1] == x[:, -1].max() if side_body is up else x[:, -1] == -1
            ]
        )
    fixed = np.sort(np.concatenate([ends[0][:, :-1].ravel(), ends[1].ravel()]))
    problem = bp.ContactProblem(
        sparse.block_diag([up.K, low.K], format="csr"),
        pairs.B,
        gap=pairs.gap,
        mu=MU,
        fixed=fixed,
        area=pairs.area,
    )
    load = np.concatenate([up.load, np.zeros(low.K.shape[0])])
    result: Any = problem.solve(load, u[fixed], tol=1e-15)
    # Some thousand second-order unknowns: their condition, 1e4, times rounding.
    assert abs(result.displacement[0] - u).max() < 1e-11 * abs(u).max()
    np.testing.assert_allclose(result.traction[0][:, 0], P, rtol=1e-10)
