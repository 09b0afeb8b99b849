"""Stiffness of one body, with extended precision as the oracle."""

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from bipot_rs import fem
from bipot_rs.fem.bodies.materials import Elastic
from bipot_rs.mesh import elements, kinds
from support.boxes import placed

KINDS = {kind.vtk: kind for kind in elements.KINDS.values()}
STEEL = fem.Material(2.0, 0.3)
RUBBER = fem.Material(2.0, 0.4999)
WOOD = fem.Orthotropic(
    (3.0, 2.0, 1.0),
    (0.1, 0.2, 0.3),
    (1.0, 2.0, 1.5),
    axes=[[1.0, 2.0, 0.0], [-2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
)


def mesh_of(vtk: str, moved: float) -> Any:
    """Cells that are unequal, or moved, of any kind; three or, of many nodes, two a side."""
    kind = KINDS[vtk]
    grid = (
        [-0.7, -0.4, 0.8] if vtk.startswith("hexahedron2") else [-0.7, -0.4, 0.2, 0.8]
    )
    made: Any = fem.box([grid] * kind.dim, kind.shape)
    if kind.degree == 2:
        made = elements.second_order(made, serendipity=vtk in ("quad8", "hexahedron20"))
    random = np.random.default_rng(1)
    return placed(made, made.p + moved * random.uniform(-0.02, 0.02, made.p.shape))


def in_long_numbers(body: fem.Body) -> Any:
    """``∫ ε(φ_i):C:ε(φ_j)`` in extended precision, dense, from differences of positions."""
    d, long = body.dim, np.longdouble
    _, slopes, weights = kinds.reference(body.kind.scalar, body.kind.order)
    x = body.points[body.cells].astype(long)
    jacobian = np.einsum("qbi,cia->cqba", slopes.astype(long), x - x[:, :1])
    rows = [jacobian[..., b, :] for b in range(d)]
    if d == 2:
        turned = [np.stack([r[..., 1], -r[..., 0]], axis=-1) for r in rows]
        cofactors = np.stack([turned[1], -turned[0]], axis=-2)
    else:
        pairs = [(rows[(b + 1) % 3], rows[(b + 2) % 3]) for b in range(3)]
        cofactors = np.stack([np.cross(*pair) for pair in pairs], axis=-2)
    determinant = (rows[0] * cofactors[..., 0, :]).sum(axis=-1)
    inner = cofactors / determinant[..., None, None]
    gradient = np.einsum("qbi,cqba->cqia", slopes.astype(long), inner)
    weight = weights * abs(determinant) * body.depth
    forms = np.einsum("cq,cqia,cqjb->cijab", weight, gradient, gradient)
    C = body.materials[0].tensor(d).astype(long)
    blocks = np.einsum("kalb,cijab->cikjl", C, forms)
    n = d * len(body.points)
    K = np.zeros((n, n), dtype=long)
    dofs = (d * body.cells[:, :, None] + np.arange(d)).reshape(len(x), -1)
    for dofs_of_cell, block in zip(dofs, blocks, strict=True):
        K[np.ix_(dofs_of_cell, dofs_of_cell)] += block.reshape(len(dofs_of_cell), -1)
    return K


@pytest.mark.parametrize(
    "material", [RUBBER, WOOD], ids=["nearly incompressible", "orthotropic"]
)
@pytest.mark.parametrize("moved", [0.0, 1.0])
@pytest.mark.parametrize("vtk", KINDS)
def test_stiffness_has_all_digits(vtk: str, moved: float, material: Elastic) -> None:
    """Also of cells of one shape, which share their matrices."""
    body = fem.Body("it", mesh_of(vtk, moved), material)
    exact, K = in_long_numbers(body), fem.stiffness(body)
    size = np.sqrt(np.diag(exact))
    # Some twenty roundings of 1.1e-16; the largest found is 1.5e-15.
    assert (abs(K.toarray() - exact) <= 4e-15 * size * size[:, None]).all()
    assert (K != K.T).nnz == 0
    assert K.has_canonical_format


@pytest.mark.parametrize("vtk", ["triangle6", "quad", "tetra", "hexahedron20"])
def test_blocks_are_those_of_nodes_that_share_a_cell(vtk: str) -> None:
    """Entries that are zero stay: solvers use one pattern for all materials."""
    body = fem.Body("it", mesh_of(vtk, 0.0), fem.Material(1.0, 0.0))
    K, cells = fem.stiffness(body), body.cells
    row = np.repeat(cells, cells.shape[1], axis=1).ravel()
    column = np.tile(cells, cells.shape[1]).ravel()
    pairs = sparse.coo_array((np.ones(row.size), (row, column))).tocsr()
    blocks = sparse.kron(pairs, np.ones((body.dim, body.dim))).tocsr()
    blocks.sort_indices()
    np.testing.assert_array_equal(K.indptr, blocks.indptr)
    np.testing.assert_array_equal(K.indices, blocks.indices)
    assert K.indptr.dtype == K.indices.dtype == np.int32


def test_each_volume_has_its_own_law() -> None:
    """All cells of the grid have one shape, so only the material distinguishes them."""
    mesh = fem.box([[0.0, 1.0, 2.0, 3.0]] * 3, "hexahedron")
    parts = {"a": np.arange(9), "b": np.arange(9, 27)}
    laws = {"a": STEEL, "b": WOOD}
    K = fem.stiffness(fem.Body("it", mesh.with_subdomains(parts), laws))
    # All nodes stay, so that the numbers stay.
    apart = sum(
        fem.stiffness(
            fem.Body("part", type(mesh)(mesh.p, mesh.t[:, k], validate=False), laws[n])
        )
        for n, k in parts.items()
    )
    # The same sums in another order.
    size = np.sqrt(K.diagonal())
    assert (abs((K - apart).toarray()) <= 1e-14 * size * size[:, None]).all()


SCRIPT = """
import hashlib, json, resource, sys
import numpy as np
from bipot_rs import fem
n, moved = int(sys.argv[1]), float(sys.argv[2])
mesh = fem.box([np.linspace(0, 1, n + 1)] * 3, "hexahedron")
shift = moved * np.random.default_rng(0).uniform(-0.1 / n, 0.1 / n, mesh.p.shape)
body = fem.Body("it", type(mesh)(mesh.p + shift, mesh.t), fem.Material(1.0, 0.3))
# Code and pools are loaded before.
fem.stiffness(fem.Body("it", fem.box([[0, 1]] * 3, "hexahedron"), body.material))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
K = fem.stiffness(body)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
bits = hashlib.sha256(K.data.tobytes() + K.indices.tobytes() + K.indptr.tobytes())
size = K.data.nbytes + K.indices.nbytes + K.indptr.nbytes
print(json.dumps([bits.hexdigest(), 1024 * peak / size]))
"""


@pytest.mark.parametrize("moved", [0.0, 1.0])
@pytest.mark.slow_variants("1.0")
@pytest.mark.slow
def test_bits_do_not_depend_on_threads_and_memory_is_that_of_the_matrix(
    moved: float,
) -> None:
    digests = []
    for threads in (1, 2, 3):
        run = subprocess.run(
            [sys.executable, "-c", SCRIPT, "30", str(moved)],
            env=os.environ | {"BIPOT_NUM_THREADS": str(threads)},
            capture_output=True,
            text=True,
            check=True,
        )
        digests.append(json.loads(run.stdout))
    bits, memory = zip(*digests, strict=True)
    assert len(set(bits)) == 1
    # K itself, the nodes of cells and matrices of a few of them.
    assert max(memory) <= 1.5


def test_stiffness_does_not_depend_on_units() -> None:
    mesh = mesh_of("tetra10", 1.0)
    K = fem.stiffness(fem.Body("it", mesh, STEEL))
    small = type(mesh)(mesh.p * 2.0**-30, mesh.t)
    scaled_down = fem.stiffness(
        fem.Body("it", small, fem.Material(2.0 * 2.0**40, STEEL.poisson))
    )
    # Powers of two, of which roots are whole: no digit changes, up to the root of 2⁻⁹⁰.
    np.testing.assert_array_equal(scaled_down.toarray(), K.toarray() * 2.0**10)
