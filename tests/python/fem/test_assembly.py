"""Assembly compared with scikit-fem's own forms, and cells that must stay distinct."""

from itertools import product

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy import sparse

from bipot_rs import fem
from bipot_rs.fem.bodies import elasticity
from bipot_rs.fem.contact import meeting
from support.boxes import CELLS, box, placed

Floats = NDArray[np.float64]
ELEMENTS = {
    "triangle": (skfem.ElementTriP1, 1),
    "quadrilateral": (skfem.ElementQuad1, 2),
    "tetrahedron": (skfem.ElementTetP1, 1),
    "hexahedron": (skfem.ElementHex1, 2),
}


def named(cell: str) -> fem.Body:
    return fem.Body("it", box(cell, 5, bent=0.05), fem.Material(1.0, 0.3))


@pytest.mark.parametrize("cell", CELLS)
def test_far_from_the_origin_no_digits_are_lost(cell: str) -> None:
    """Jacobians here are made of differences; scikit-fem's are sums of coordinates."""
    mesh = box(cell, 4)
    far = placed(mesh, mesh.p + 1e6)  # exact, because coordinates are quarters
    K = [fem.stiffness(fem.Body("it", m, fem.Material(1.0, 0.3))) for m in (mesh, far)]
    np.testing.assert_array_equal(K[0].toarray(), K[1].toarray())


def test_each_body_keeps_its_material() -> None:
    bodies = [
        fem.Body("soft", box("hexahedron", 2), fem.Material(1.0, 0.2)),
        fem.Body("hard", box("hexahedron", 2, bent=0.1), fem.Material(1e3, 0.4)),
        fem.Body("tets", box("tetrahedron", 2, bent=0.1), fem.Material(10.0, 0.3)),
    ]
    K = fem.assemble(bodies, []).K
    apart = sparse.block_diag([fem.stiffness(body) for body in bodies], format="csr")
    np.testing.assert_array_equal(K.toarray(), apart.toarray())
    assert K.has_canonical_format
    assert K.indices.dtype == K.indptr.dtype == np.int32


def test_only_bitwise_equal_cells_share_a_matrix() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    nearly = square.copy()
    nearly[2, 0] = np.nextafter(1.0, 2.0)
    negative = square * [[1, 1], [1, -0.0], [1, 1], [-0.0, 1]]
    corners = np.stack([square, nearly, square + 4, nearly, square, negative])
    shapes, which = elasticity.distinct_cells(corners)
    assert len(shapes) == 2
    np.testing.assert_array_equal(which[[0, 2, 4, 5]], which[0])
    np.testing.assert_array_equal(which[[1, 3]], which[1])
    assert which[0] != which[1]
    np.testing.assert_array_equal(shapes[which], corners - corners[:, :1])


def test_hash_collisions_of_cells_are_detected() -> None:
    """Two triangles that collide by design: the hash is linear in its input."""
    odd, whole = 0x9E3779B97F4A7C15, 2**64
    weights = [pow(odd, k, whole) for k in range(1, 5)]

    def fold(x: float) -> int:
        bits = int(np.float64(x).view(np.uint64))
        return bits ^ (bits >> 32)

    def unfold(folded: int) -> float:
        # The upper half is unchanged, so hashing again gives the inverse.
        return float(np.uint64(folded ^ (folded >> 32)).view(np.float64))

    first = [1.0, 0.5, 0.25, 2.0]
    value = sum(fold(x) * w for x, w in zip(first, weights, strict=True))
    second = [3.0, 0.5, 0.25]
    rest = value - sum(fold(x) * w for x, w in zip(second, weights, strict=False))
    second.append(unfold(rest * pow(weights[3], -1, whole) % whole))
    assert np.isfinite(second[3])
    corners = np.zeros((6, 3, 2))
    corners[::2, 1:] = np.reshape(first, (2, 2))
    corners[1::2, 1:] = np.reshape(second, (2, 2))
    shapes, which = elasticity.distinct_cells(corners)
    np.testing.assert_array_equal(shapes[which], corners)


@pytest.mark.parametrize("cell", CELLS)
def test_integrals_are_those_of_scikit_fem(cell: str) -> None:
    body, (element, order) = named(cell), ELEMENTS[cell]
    mesh, dim = body.mesh, body.dim

    def density(x: Floats) -> Floats:
        return x[0] ** 2 + np.sin(3 * x[dim - 1])

    for name, k in product(mesh.boundaries, range(dim)):
        ours = body.surface(name)
        integral = ours.moment(density(ours.places) * np.asarray(ours.normals)[k])
        facets = mesh.boundaries[name]
        basis = skfem.FacetBasis(mesh, element(), facets=facets, intorder=2)
        form = skfem.LinearForm(lambda v, w, k=k: density(w.x) * w.n[k] * v)
        # Sums of at most 16 terms per node, of areas 1/25.
        wanted = form.assemble(basis)
        np.testing.assert_allclose(integral, wanted, rtol=1e-13, atol=1e-13 / 25)
    basis = skfem.Basis(mesh, element(), intorder=order)
    form = skfem.LinearForm(lambda v, w: np.exp(w.x[0]) * v)
    ours = body.volume()
    integral = ours.moment(np.exp(ours.places[0]))
    # Sums of some 200 positive terms.
    np.testing.assert_allclose(integral, form.assemble(basis), rtol=1e-13)


def test_partners_are_the_same_with_and_without_a_tree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = np.random.default_rng(5)
    ours, theirs = random.normal(size=(40, 3)), random.normal(size=(70, 3))
    few = meeting.nearest_points(ours, theirs)
    monkeypatch.setattr(meeting, "ALL_PAIRS", 0)
    np.testing.assert_array_equal(few, meeting.nearest_points(ours, theirs))
