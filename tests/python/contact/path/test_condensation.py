"""u and r agree with computations in doubled precision, on cubes of finite elements."""

from collections.abc import Callable
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


def held(shape: str, material: str) -> tuple[Any, Indices, Indices]:
    """K of a cube of distorted cells, each with the modulus of its centre.

    Also the degrees of freedom of its top, and those of its bottom nodes ``(n_c, 3)``.
    """
    cell, n, degree = SHAPES[shape]
    nu, young = MATERIALS[material]
    mesh = box(cell, n, degree=degree, bent=0.2 / n)
    centres = mesh.p[:, mesh.t].mean(axis=1).T
    mesh = mesh.with_subdomains({str(k): np.array([k]) for k in range(len(centres))})
    materials = {str(k): fem.Material(young(x), nu) for k, x in enumerate(centres)}
    cube = fem.Body("cube", mesh, materials)
    top, bottom = (
        3 * cube.nodes(side)[:, None] + np.arange(3) for side in ("top", "bottom")
    )
    return sparse.csr_array(fem.stiffness(cube)), top.ravel(), bottom


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.quick_variants("*-linear tetrahedra")
def test_sticking_contacts(shape: str, material: str) -> None:
    """If every contact sticks, contacts act as supports with known displacements."""
    rng = np.random.default_rng(2)
    K, fixed, bottom = held(shape, material)
    n, columns = K.shape[0], bottom[:, [2, 0, 1]].ravel()
    rows = np.arange(len(columns))
    B = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(rows), n))
    load = K.diagonal().max() * 1e-3 * rng.normal(size=n)
    load[columns] = 0
    prescribed = 1e-3 * rng.normal(size=fixed.size)
    known, rest = np.zeros((n, 1)), np.setdiff1d(np.arange(n), [*fixed, *columns])
    known[fixed, 0] = prescribed

    def supported() -> tuple[Array, Array]:
        moved = twice.product(K[rest], twice.exactly(known))
        force = twice.add(twice.exactly(load[rest, None]), (-moved[0], -moved[1]))
        u = known.copy(), np.zeros((n, 1))
        for part, value in zip(u, twice.solve(K[rest][:, rest], force), strict=True):
            part[rest] = value
        support = twice.add(twice.product(K, u), (-load[:, None], np.zeros((n, 1))))
        return u[0][:, 0], support[0][columns, 0].reshape(-1, 3)

    # The pressing load is three times the pulling one.
    _, r = supported()
    load[bottom[:, 2]] = -3 * np.abs(r).max()
    u, r = supported()
    assert (r[:, 0] > 0).all()

    gap = np.zeros(len(bottom))
    problem = bp.ContactProblem(K, B, gap=gap, mu=10.0, fixed=fixed)
    result = problem.solve(load, prescribed)
    assert (result.status == bp.Status.STICK).all()
    # Sums of some hundred terms, for any cond(S); up to 30 roundings are reached.
    assert np.abs(result.reaction - r).max() <= 100 * EPS * np.abs(r).max()
    # A rounding of every reaction moves the contacts by this; 2.4 times it is reached.
    moved = np.abs(problem.compliance) @ np.abs(r).ravel()
    size = max(moved.max(), np.abs(u).max())
    assert np.abs(result.displacement - u).max() <= 10 * EPS * size
