"""W, q, u and r agree with computations in doubled precision, on cubes of finite elements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from support import twice
from support.boxes import box

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
EPS = float(np.finfo(float).eps)

# Poisson's ratio, and Young's modulus at a place.
MATERIALS: dict[str, tuple[float, Callable[[Array], float]]] = {
    "steel": (0.3, lambda _: 2.1e11),
    "rubber": (0.4999, lambda _: 1.0),
    "stiff behind": (0.2, lambda x: 1.0 if x[2] < 0.5 else 1e8),
    "stiff in front": (0.2, lambda x: 1e8 if x[2] < 0.5 else 1.0),
    "any": (0.0, lambda x: 10 ** (4 * np.sin(x @ [40.0, 23.0, 57.0]))),
}
# Kind, cells along a side, degree.
SHAPES = {
    "linear tetrahedra": ("tetrahedron", 5, 1),
    "quadratic tetrahedra": ("tetrahedron", 3, 2),
    "quadratic hexahedra": ("hexahedron", 2, 2),
}


@dataclass
class Held:
    """A cube with possible contact at its bottom and prescribed displacement at its top."""

    K: Any
    fixed: Indices
    free: Indices
    # Degrees of freedom of the bottom nodes, (n_c, 3).
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


def held(shape: str, material: str) -> Held:
    """Distorted cells, each with the modulus of its centre."""
    cell, n, degree = SHAPES[shape]
    nu, young = MATERIALS[material]
    mesh = box(cell, n, degree=degree, bent=0.2 / n)
    centres = mesh.p[:, mesh.t].mean(axis=1).T
    mesh = mesh.with_subdomains({str(k): np.array([k]) for k in range(len(centres))})
    materials = {str(k): fem.Material(young(x), nu) for k, x in enumerate(centres)}
    cube = fem.Body("cube", mesh, materials)
    K = sparse.csr_array(fem.stiffness(cube))
    top, bottom = (
        3 * cube.nodes(side)[:, None] + np.arange(3) for side in ("top", "bottom")
    )
    fixed = top.ravel()
    return Held(K, fixed, np.setdiff1d(np.arange(K.shape[0]), fixed), bottom)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.quick_variants("*-linear tetrahedra", "steel-quadratic tetrahedra")
def test_open_contacts(shape: str, material: str) -> None:
    rng = np.random.default_rng(1)
    body = held(shape, material)
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
    body = held(shape, material)
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
