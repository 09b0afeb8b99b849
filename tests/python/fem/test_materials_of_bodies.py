"""Elastic materials: orthotropy from engineering constants, several in one body."""

from dataclasses import replace

import numpy as np
import pytest

from bipot_rs import fem
from support.boxes import CELLS, box, placed
from support.comparisons import close, near, refused

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
    """Also K by the tensor and by Lamé's constants."""
    E, nu = 3.0, 0.37
    plain = fem.Material(E, nu, plane_stress, thickness=0.2)
    for axes in (None, ROTATION):
        same = fem.Orthotropic(*[(v,) * 3 for v in (E, nu, E / (2 + 2 * nu))], axes)
        same = replace(same, plane_stress=plane_stress, thickness=0.2)
        near(same.tensor(3), plain.tensor(3), 1e-14 * E)
        dim = 2 if axes is None else 3
        near(same.tensor(dim), plain.tensor(dim), 1e-14 * E)
        if dim == 3 and plane_stress:
            continue
        mesh = box("triangle" if dim == 2 else "hexahedron", [0, 0.3, 1.0])
        K = [fem.stiffness(fem.Body("it", mesh, m)) for m in (plain, same)]
        assert abs(K[0] - K[1]).max() <= 1e-14 * abs(K[0]).max()
        assert (K[1] != K[1].T).nnz == 0


def test_turning_material_and_mesh_turns_the_stiffness() -> None:
    mesh, Q = box("tetrahedron", [0, 0.3, 1.0], bent=0.05), ROTATION
    K = fem.stiffness(fem.Body("it", mesh, fem.Orthotropic(*WOOD)))
    wood = fem.Orthotropic(*WOOD, axes=Q)
    other = fem.stiffness(fem.Body("it", placed(mesh, Q.T @ mesh.p), wood))
    assert (other != other.T).nnz == 0
    block = np.kron(np.eye(mesh.p.shape[1]), Q.T)
    close(block.T @ other.toarray() @ block, K.toarray(), 1e-13)


@pytest.mark.parametrize("plane_stress", [False, True])
def test_orthotropic_in_the_plane(plane_stress: bool) -> None:
    """Tension along an inclined grain: Poisson's ratios in the plane, by hand."""
    (E1, E2, E3), (n12, n13, n23), _ = WOOD
    c, s = np.cos(0.6), np.sin(0.6)
    axes = np.array([[c, s], [-s, c]])
    material = fem.Orthotropic(*WOOD, axes=axes, plane_stress=plane_stress)
    along, aside = 1 / E1, -n12 / E1
    if not plane_stress:  # σ_3 = ν13 E3/E1 σ_1 keeps ε_3 = 0
        n31 = n13 * E3 / E1
        along, aside = along * (1 - n13 * n31), aside - n31 * n23 / E2
    strain = along * np.outer(axes[0], axes[0]) + aside * np.outer(axes[1], axes[1])
    stress = np.einsum("ijkl,kl->ij", material.tensor(2), strain)
    np.testing.assert_allclose(stress, np.outer(axes[0], axes[0]), atol=1e-13)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"young": (1.0, 0.0, 1.0)}, r"young is \[1\.0, 0\.0, 1\.0\], expected three"),
        ({"young": (1.0, 2.0)}, r"young has shape \(2,\), expected \(3,\)"),
        ({"shear": (1.0, -1.0, 1.0)}, "shear is"),
        ({"poisson": (1.1, 0, 0), "young": (1, 1, 1)}, r"ν12 = 1.1, expected \|ν12\|"),
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
    with refused(said):
        fem.Orthotropic(**constants)


def test_poisson_ratio_above_one_is_allowed() -> None:
    """Along stiff fibres: a positive energy only needs |ν12| < √(E1/E2)."""
    E, G = (100.0, 1.0, 1.0), (1.0, 1.0, 1.0)
    C = fem.Orthotropic(E, (5.0, 0.0, 0.0), G).tensor(3)
    assert np.linalg.eigvalsh(C.reshape(9, 9)).min() > -1e-12
    with refused("ν12 = 10"):
        fem.Orthotropic(E, (10.0, 0.0, 0.0), G)


def test_grain_out_of_the_plane_is_refused() -> None:
    mesh = fem.box([[0, 1], [0, 1]], "triangle")
    with refused(r"direction 3 along .*expected .* the normal"):
        fem.Body("it", mesh, fem.Orthotropic(*WOOD, axes=ROTATION))


def layered(cell: str, degree: int) -> fem.Body:
    """A bar of two volumes in tension: strains differ as the moduli do."""
    mesh = fem.box([np.linspace(0, 2, 5)] + [[0, 0.5, 1]] * (CELLS[cell] - 1), cell)
    soft = mesh.p[0, mesh.t].mean(axis=0) < 1
    parts = {"soft": np.flatnonzero(soft), "hard": np.flatnonzero(~soft)}
    mesh = mesh.with_subdomains(parts)
    mesh = mesh if degree == 1 else fem.second_order(mesh)
    hard = fem.Orthotropic((5.0, 7.0, 7.0), (0, 0, 0), (2.5,) * 3)
    return fem.Body("bar", mesh, {"soft": fem.Material(1.0, 0.0), "hard": hard})


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_two_materials_in_a_row(cell: str, degree: int) -> None:
    body = layered(cell, degree)
    names = ["left", "bottom", "front"][: body.dim]
    model = fem.assemble([body], [], symmetries=[fem.Symmetry("bar", n) for n in names])
    assert (model.K != model.K.T).nnz == 0
    pull = np.eye(body.dim)[0]
    u = model.problem().solve(model.traction("bar", "right", pull)).displacement[0]
    x = body.points[:, 0]
    wanted = np.where(x < 1, x, 1 + (x - 1) / 5)
    np.testing.assert_allclose(u.reshape(-1, body.dim)[:, 0], wanted, rtol=1e-11)
    near(fem.stress(body, u) - np.outer(pull, pull), 0, 1e-11)


def test_volumes_that_do_not_fit() -> None:
    mesh = layered("triangle", 1).mesh
    steel = fem.Material(1.0, 0.3)
    with refused("no volume 'sof', expected one of hard, soft"):
        fem.Body("bar", mesh, {"sof": steel})
    with refused(r"'bar' is missing for 8 cells, .* at \("):
        fem.Body("bar", mesh, {"soft": steel})
    both = mesh.with_subdomains({"all": np.arange(16)})
    with refused("'all' of body 'bar' shares 8 cells"):
        fem.Body("bar", both, {"soft": steel, "all": steel})
    thin = fem.Material(1.0, 0.3, thickness=0.5)
    with refused("differ in plane_stress, thickness or"):
        fem.Body("bar", mesh, {"soft": steel, "hard": thin})
    with refused("has no volume 'a'"):
        fem.Body("bar", fem.box([[0, 1], [0, 1]], "triangle"), {"a": steel})
