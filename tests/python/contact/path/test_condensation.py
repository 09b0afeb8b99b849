"""W, q, u and r agree with computations in doubled precision, on bodies of scikit-fem."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import Delaunay
from skfem.helpers import ddot, eye, sym_grad, trace

import bipot_rs as bp
from support import twice

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Young = Callable[[Array], Array]
EPS = float(np.finfo(float).eps)

# Poisson's ratio, and Young's modulus as a function of place.
MATERIALS: dict[str, tuple[float, Young]] = {
    "steel": (0.3, lambda x: np.full(x.shape[1], 2.1e11)),
    "rubber": (0.4999, lambda x: np.ones(x.shape[1])),
    "stiff behind": (0.2, lambda x: np.where(x[2] < 0.5, 1.0, 1e8)),
    "stiff in front": (0.2, lambda x: np.where(x[2] < 0.5, 1e8, 1.0)),
    "any": (0.0, lambda x: 10 ** (4 * np.sin(40 * x[0] + 23 * x[1] + 57 * x[2]))),
}
SHAPES = ("linear tetrahedra", "quadratic tetrahedra", "quadratic hexahedra")


def tetrahedra(points: int, rng: np.random.Generator) -> Any:
    """Delaunay tetrahedra of a lattice in the unit cube, with its inner points moved."""
    line = np.linspace(0, 1, points)
    at = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    step = rng.uniform(-0.3, 0.3, at.shape) / (points - 1)
    at = np.where((at > 0) & (at < 1), at + step, at)
    cells = Delaunay(at).simplices.T
    edges = at.T[:, cells[1:]] - at.T[:, cells[:1]]
    volume = np.abs(np.linalg.det(np.moveaxis(edges, 2, 0)))
    # Four points of one face form a cell without volume.
    return skfem.MeshTet(at.T.copy(), cells[:, volume > 1e-4 * volume.max()])


def hexahedra(cells: int, rng: np.random.Generator) -> Any:
    mesh = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, cells + 1)] * 3)
    step = rng.uniform(-0.2, 0.2, mesh.p.shape) / cells
    return skfem.MeshHex(
        np.where((mesh.p > 0) & (mesh.p < 1), mesh.p + step, mesh.p), mesh.t
    )


@dataclass
class Held:
    """A cube with possible contact at its bottom and prescribed displacement at its top."""

    K: Any
    fixed: Indices
    free: Indices
    # Unknowns of the bottom nodes, (n_c, 3).
    bottom: Indices

    def operator(self, frames: Array) -> Any:
        """B for bases ``(n_c, 3, 3)`` with rows n, t1, t2."""
        rows = np.repeat(np.arange(self.bottom.size), 3)
        columns = np.repeat(self.bottom, 3, axis=0).ravel()
        shape = self.bottom.size, self.K.shape[0]
        return sparse.csr_array((frames.ravel(), (rows, columns)), shape=shape)

    def known(
        self, load: Array, dofs: Indices, values: Array
    ) -> tuple[Indices, twice.Pair]:
        """The other unknowns, with the load and the forces of the known unknowns on them.

        `dofs` are distinct.
        """
        rest = np.setdiff1d(np.arange(len(load)), dofs)
        moved = twice.product(self.K[rest][:, dofs], twice.exactly(values[:, None]))
        force = twice.add(twice.exactly(load[rest, None]), (-moved[0], -moved[1]))
        return rest, force


def held(shape: str, material: str, rng: np.random.Generator) -> Held:
    mesh, element = {
        "linear tetrahedra": lambda: (tetrahedra(6, rng), skfem.ElementTetP1()),
        "quadratic tetrahedra": lambda: (tetrahedra(4, rng), skfem.ElementTetP2()),
        "quadratic hexahedra": lambda: (hexahedra(2, rng), skfem.ElementHex2()),
    }[shape]()
    nu, young = MATERIALS[material]
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=4)
    # One value per cell: with negative weights in the rule, a jump makes K indefinite.
    modulus = young(mesh.p[:, mesh.t].mean(axis=1))[:, None]

    def energy(u: Any, v: Any, _: Any) -> Any:
        strain = sym_grad(u)
        stress = strain + nu / (1 - 2 * nu) * eye(trace(strain), 3)
        return modulus / (1 + nu) * ddot(stress, sym_grad(v))

    K = skfem.BilinearForm(energy).assemble(basis)
    K = sparse.csr_array((K + K.T) / 2)
    kinds = basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs
    dofs = np.hstack([kind for kind in kinds if kind.size]).astype(np.int64)
    height = basis.doflocs[2][dofs[0]]
    fixed = dofs[:, height == 1].ravel()
    free = np.setdiff1d(np.arange(K.shape[0]), fixed)
    return Held(K, fixed, free, dofs[:, height == 0].T)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.quick_variants("*-linear tetrahedra", "steel-quadratic tetrahedra")
def test_open_contacts(shape: str, material: str) -> None:
    rng = np.random.default_rng(1)
    body = held(shape, material, rng)
    n, contacts = body.K.shape[0], len(body.bottom)
    B = body.operator(np.linalg.qr(rng.normal(size=(contacts, 3, 3)))[0])
    load = body.K.diagonal().max() * rng.normal(size=n)
    prescribed = rng.normal(size=body.fixed.size)

    free, force = body.known(load, body.fixed, prescribed)
    some = rng.choice(3 * contacts, 6, replace=False)
    columns = twice.exactly(B[some][:, free].toarray().T)
    right = [np.hstack(pair) for pair in zip(columns, force, strict=True)]
    x = twice.solve(body.K[free][:, free], (right[0], right[1]))
    W, v = np.split(twice.product(B[:, free], x)[0], [-1], axis=1)
    u = np.zeros(n)
    u[free], u[body.fixed] = x[0][:, -1], prescribed
    # All contacts are open: the displacement is that of the loads alone.
    gap = np.zeros((contacts, 3))
    gap[:, 0] = 2 * np.abs(v).max()
    q = v.reshape(-1, 3) + gap

    problem = bp.ContactProblem(body.K, B, gap=gap, mu=0.3, fixed=body.fixed)
    # An inverse loses at most cond(S) roundings; a tenth of that is reached here. The
    # displacement is refined with K and loses none.
    rounding = EPS * problem.stats["cond_S"]
    compliance = problem.compliance
    assert (compliance == compliance.T).all()
    assert np.abs(compliance[:, some] - W).max() <= rounding * np.abs(W).max()
    free_part = problem.reduced(load, prescribed).q
    assert np.abs(free_part - q).max() <= rounding * np.abs(q).max()
    result = problem.solve(load, prescribed)
    assert (result.status == bp.Status.OPEN).all()
    assert np.abs(result.displacement - u).max() <= 4 * EPS * np.abs(u).max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.quick_variants("*-linear tetrahedra")
def test_sticking_contacts(shape: str, material: str) -> None:
    """If every contact sticks, contacts act as supports with known displacements."""
    rng = np.random.default_rng(2)
    body = held(shape, material, rng)
    n, contacts = body.K.shape[0], len(body.bottom)
    B = body.operator(np.tile(np.eye(3)[[2, 0, 1]], (contacts, 1, 1)))
    load = body.K.diagonal().max() * 1e-3 * rng.normal(size=n)
    load[body.bottom] = 0
    prescribed = 1e-3 * rng.normal(size=body.fixed.size)
    dofs = np.concatenate([body.fixed, body.bottom.ravel()])

    def supported() -> tuple[Array, Array]:
        values = np.concatenate([prescribed, np.zeros(body.bottom.size)])
        rest, force = body.known(load, dofs, values)
        x = twice.solve(body.K[rest][:, rest], force)
        u = np.zeros((n, 1)), np.zeros((n, 1))
        for part, value in zip(u, x, strict=True):
            part[rest] = value
        u[0][body.fixed, 0] = prescribed
        support = twice.add(
            twice.product(body.K, u), (-load[:, None], np.zeros((n, 1)))
        )
        return u[0][:, 0], support[0][body.bottom[:, [2, 0, 1]], 0]

    # The pressing load is three times the pulling one.
    _, r = supported()
    load[body.bottom[:, 2]] = -3 * np.abs(r).max()
    u, r = supported()
    assert (r[:, 0] > 0).all()

    gap = np.zeros(contacts)
    problem = bp.ContactProblem(body.K, B, gap=gap, mu=10.0, fixed=body.fixed)
    result = problem.solve(load, prescribed)
    assert (result.status == bp.Status.STICK).all()
    # Sums of some hundred terms, for any cond(S); up to 30 roundings are reached.
    assert np.abs(result.reaction - r).max() <= 100 * EPS * np.abs(r).max()
    # A rounding of every reaction moves the contacts by this; 2.4 times it is reached.
    moved = np.abs(problem.compliance) @ np.abs(r).ravel()
    size = max(moved.max(), np.abs(u).max())
    assert np.abs(result.displacement - u).max() <= 10 * EPS * size
