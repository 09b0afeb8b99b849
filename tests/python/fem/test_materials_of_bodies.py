"""Elastic materials: orthotropy from engineering constants, several in one body."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem, scene
from bipot_rs.discretisation import Estimator
from bipot_rs.discretisation.simplices import simplices
from bipot_rs.fem.bodies.body import number_bodies
from bipot_rs.mesh import elements

Floats = NDArray[np.float64]
# Spruce, in the order 12, 13, 23 [Pa].
WOOD = ((11.6e9, 0.9e9, 0.5e9), (0.38, 0.43, 0.46), (0.7e9, 0.75e9, 0.04e9))
ROTATION = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]


def test_orthotropic_compliance_is_that_of_the_constants() -> None:
    """Stress along each axis gives strains 1/E and -ν/E, and shear gives τ/G."""
    material = fem.Orthotropic(*WOOD)
    (E1, E2, E3), (n12, n13, n23), (G12, G13, G23) = WOOD
    strains = {
        (0, 0): np.diag([1 / E1, -n12 / E1, -n13 / E1]),
        (1, 1): np.diag([-n12 / E1, 1 / E2, -n23 / E2]),
        (2, 2): np.diag([-n13 / E1, -n23 / E2, 1 / E3]),
        (0, 1): np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]) / (2 * G12),
        (0, 2): np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0]]) / (2 * G13),
        (1, 2): np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0]]) / (2 * G23),
    }
    for (i, j), strain in strains.items():
        stress = np.zeros((3, 3))
        stress[i, j] = stress[j, i] = 1.0
        stress_back = np.einsum("ijkl,kl->ij", material.tensor(3), strain)
        # The ratio of the moduli, 300, times rounding.
        np.testing.assert_allclose(stress_back, stress, atol=1e-13)


@pytest.mark.parametrize("plane_stress", [False, True])
def test_isotropic_is_orthotropic(plane_stress: bool) -> None:
    young, poisson = 3.0, 0.37
    G = young / (2 * (1 + poisson))
    plain = fem.Material(young, poisson, plane_stress)
    for axes in (None, ROTATION):
        same = fem.Orthotropic(
            (young,) * 3, (poisson,) * 3, (G,) * 3, axes, plane_stress
        )
        np.testing.assert_allclose(same.tensor(3), plain.tensor(3), atol=1e-14 * young)
    flat = fem.Orthotropic((young,) * 3, (poisson,) * 3, (G,) * 3, None, plane_stress)
    np.testing.assert_allclose(flat.tensor(2), plain.tensor(2), atol=1e-14 * young)


@pytest.mark.parametrize("shape", ["triangle", "hexahedron"])
def test_stiffness_of_isotropic_as_orthotropic(shape: str) -> None:
    """The stiffness from the tensor equals the stiffness from Lamé's constants."""
    dim = 2 if shape == "triangle" else 3
    mesh = fem.box([np.array([0, 0.3, 1.0])] * dim, shape)
    plain = fem.Material(3.0, 0.37, thickness=0.2)
    G = 3.0 / (2 * 1.37)
    same = fem.Orthotropic((3.0,) * 3, (0.37,) * 3, (G,) * 3, thickness=0.2)
    K = [fem.stiffness(fem.Body("it", mesh, m)) for m in (plain, same)]
    assert abs(K[0] - K[1]).max() <= 1e-14 * abs(K[0]).max()
    assert (K[1] != K[1].T).nnz == 0


def test_turning_material_and_mesh_turns_the_stiffness() -> None:
    mesh = fem.box([np.array([0, 0.3, 1.0])] * 3, "tetrahedron")
    bent = type(mesh)(mesh.p + 0.05 * np.sin(7 * mesh.p[::-1]), mesh.t)
    Q = ROTATION
    turned_K = fem.stiffness(fem.Body("it", bent, fem.Orthotropic(*WOOD)))
    turned = type(mesh)(Q.T @ bent.p, bent.t)
    other = fem.stiffness(fem.Body("it", turned, fem.Orthotropic(*WOOD, axes=Q)))
    assert (other != other.T).nnz == 0
    block = np.kron(np.eye(bent.p.shape[1]), Q.T)
    back = block.T @ other.toarray() @ block
    assert np.abs(back - turned_K.toarray()).max() <= 1e-13 * abs(turned_K).max()


@pytest.mark.parametrize("plane_stress", [False, True])
def test_orthotropic_in_the_plane(plane_stress: bool) -> None:
    """Tension along an inclined grain: Poisson's ratios in the plane, by hand."""
    (E1, E2, E3), (n12, n13, n23), _ = WOOD
    n21, n31, n32 = n12 * E2 / E1, n13 * E3 / E1, n23 * E3 / E2
    c, s = np.cos(0.6), np.sin(0.6)
    axes = np.array([[c, s], [-s, c]])
    material = fem.Orthotropic(*WOOD, axes=axes, plane_stress=plane_stress)
    along, aside = 1 / E1, -n12 / E1
    if not plane_stress:  # σ_3 = ν13 E3/E1 σ_1 keeps ε_3 = 0
        along, aside = along * (1 - n13 * n31), aside - n31 * n23 / E2
        assert n32 == pytest.approx(n23 * E3 / E2)
    strain = along * np.outer(axes[0], axes[0]) + aside * np.outer(axes[1], axes[1])
    stress_back = np.einsum("ijkl,kl->ij", material.tensor(2), strain)
    np.testing.assert_allclose(stress_back, np.outer(axes[0], axes[0]), atol=1e-13)
    assert n21 < n12


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"young": (1.0, 0.0, 1.0)}, r"young is \[1\.0, 0\.0, 1\.0\], expected three"),
        ({"young": (1.0, 2.0)}, r"young has shape \(2,\), expected \(3,\)"),
        ({"shear": (1.0, -1.0, 1.0)}, "shear is"),
        (
            {"poisson": (1.1, 0, 0), "young": (1, 1, 1)},
            r"ν12 = 1.1, expected \|ν12\| < ",
        ),
        ({"poisson": (0.6, 0.6, 0.6), "young": (1, 1, 1)}, "1 - ν12 ν21 .* is -0.512"),
        (
            {"poisson": (0.5, 0.5, 0.5), "young": (1, 1, 1)},
            "expected a positive number",
        ),
        ({"axes": [[1, 0, 0], [1, 1, 0], [0, 0, 1]]}, "axes are not orthogonal"),
        ({"axes": [[1, 0], [0, 0]]}, "axes has a row of zeros"),
        ({"axes": [[1, 0, 0], [0, 1, 0]]}, r"axes has shape \(2, 3\)"),
        ({"thickness": 0.0}, "thickness is 0"),
    ],
)
def test_invalid_materials(change: dict[str, object], said: str) -> None:
    constants = dict(zip(("young", "poisson", "shear"), WOOD, strict=True)) | change
    with pytest.raises(ValueError, match=said):
        fem.Orthotropic(**constants)


def test_poisson_ratio_above_one_is_allowed() -> None:
    """Along stiff fibres: a positive energy only needs |ν12| < √(E1/E2)."""
    C = fem.Orthotropic((100.0, 1.0, 1.0), (5.0, 0.0, 0.0), (1.0, 1.0, 1.0)).tensor(3)
    assert np.linalg.eigvalsh(C.reshape(9, 9)).min() > -1e-12
    with pytest.raises(ValueError, match="ν12 = 10"):
        fem.Orthotropic((100.0, 1.0, 1.0), (10.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def test_grain_out_of_the_plane_is_refused() -> None:
    mesh = fem.box([[0, 1], [0, 1]], "triangle")
    with pytest.raises(ValueError, match=r"direction 3 along .*expected .* the normal"):
        fem.Body("it", mesh, fem.Orthotropic(*WOOD, axes=ROTATION))


# A bar of two volumes in tension: strains differ as the moduli do.
def layered(shape: str, degree: int) -> fem.Body:
    dim = 2 if shape in ("triangle", "quadrilateral") else 3
    mesh = fem.box([np.linspace(0, 2, 5)] + [np.linspace(0, 1, 3)] * (dim - 1), shape)
    x = mesh.p[0, mesh.t].mean(axis=0)
    mesh = mesh.with_subdomains(
        {"soft": np.flatnonzero(x < 1), "hard": np.flatnonzero(x > 1)}
    )
    mesh = mesh if degree == 1 else elements.second_order(mesh)
    G = 5.0 / 2
    return fem.Body(
        "bar",
        mesh,
        {
            "soft": fem.Material(1.0, 0.0),
            "hard": fem.Orthotropic((5.0, 7.0, 7.0), (0, 0, 0), (G, G, G)),
        },
    )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    "shape", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]
)
def test_two_materials_in_a_row(shape: str, degree: int) -> None:
    body = layered(shape, degree)
    names = ["left", "bottom", *(["front"] if body.dim == 3 else [])]
    model = fem.assemble([body], [], symmetries=[fem.Symmetry("bar", n) for n in names])
    assert (model.K != model.K.T).nnz == 0
    pull = np.eye(body.dim)[0]
    gone = np.delete(np.arange(model.n), model.fixed)
    u = np.zeros(model.n)
    f = model.traction("bar", "right", pull)
    u[gone] = spsolve(model.K.tocsc()[gone][:, gone], f[gone])
    x = body.points[:, 0]
    wanted = np.where(x < 1, x, 1 + (x - 1) / 5)
    np.testing.assert_allclose(u.reshape(-1, body.dim)[:, 0], wanted, rtol=1e-11)
    stresses = fem.stress(body, u)
    np.testing.assert_allclose(stresses - np.outer(pull, pull), 0.0, atol=1e-11)


def test_volumes_of_equal_cells_do_not_share_a_matrix() -> None:
    """All cells of a grid have one shape, so only the material distinguishes them."""
    mesh = fem.box([[0.0, 1, 2], [0.0, 1]], "quadrilateral")
    mesh = mesh.with_subdomains({"a": np.array([0]), "b": np.array([1])})
    parts = {"a": fem.Material(1.0, 0.3), "b": fem.Material(7.0, 0.1)}
    whole = fem.stiffness(fem.Body("it", mesh, parts)).toarray()
    sums = np.zeros_like(whole)
    for k, material in enumerate(parts.values()):
        alone = type(mesh)(mesh.p, mesh.t[:, [k]])
        # Rows of nodes outside the single cell stay zero.
        K = fem.stiffness(fem.Body("it", alone, material)).toarray()
        sums[: len(K), : len(K)] += K
    np.testing.assert_allclose(whole, sums, atol=1e-15 * np.abs(whole).max())


def test_volumes_that_do_not_fit() -> None:
    mesh = layered("triangle", 1).mesh
    steel = fem.Material(1.0, 0.3)
    with pytest.raises(ValueError, match="no volume 'sof', expected one of hard, soft"):
        fem.Body("bar", mesh, {"sof": steel})
    with pytest.raises(ValueError, match=r"'bar' is missing for 8 cells, .* at \("):
        fem.Body("bar", mesh, {"soft": steel})
    both = mesh.with_subdomains({"all": np.arange(16)})
    with pytest.raises(ValueError, match="'all' of body 'bar' shares 8 cells"):
        fem.Body("bar", both, {"soft": steel, "all": steel})
    thin = fem.Material(1.0, 0.3, thickness=0.5)
    with pytest.raises(ValueError, match="differ in plane_stress, thickness or"):
        fem.Body("bar", mesh, {"soft": steel, "hard": thin})
    with pytest.raises(ValueError, match="has no volume 'a'"):
        fem.Body("bar", fem.box([[0, 1], [0, 1]], "triangle"), {"a": steel})


def test_estimator_refuses_unsupported_materials() -> None:
    body = layered("triangle", 1)
    with pytest.raises(ValueError, match="'bar' has several materials, expected one"):
        _ = body.isotropic
    wood = fem.Body("bar", body.mesh, fem.Orthotropic(*WOOD))
    with pytest.raises(ValueError, match="has an orthotropic material, expected one"):
        _ = wood.isotropic
    curved = fem.Body("bar", elements.second_order(body.mesh), fem.Material(1.0, 0.3))
    with pytest.raises(ValueError, match=r"cells of 6 nodes, expected .*first order"):
        simplices(curved)


def test_estimator_refuses_unsupported_models() -> None:
    read = scene.read("sheared_cube", ["mesh.n=2", "mesh.element=P1"])
    (cube,) = scene.bodies(read)
    case = scene.assemble(read, [cube])
    hung = fem.Spring("cube", "bottom", 1.0)
    with pytest.raises(ValueError, match="does not support springs"):
        Estimator(replace(case, model=replace(case.model, springs=(hung,))))
    wood = fem.Body("cube", cube.mesh, fem.Orthotropic(*WOOD))
    model = replace(case.model, numbered=number_bodies([wood]))
    with pytest.raises(ValueError, match="'cube' has an orthotropic material"):
        Estimator(replace(case, model=model))
