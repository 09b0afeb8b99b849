"""Stresses from displacements, and initial strains, compared with closed forms."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem
from bipot_rs.fem.bodies import stress_recovery
from bipot_rs.mesh import elements
from support.comparisons import near, refused

Floats = NDArray[np.float64]
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
# Rotated about the axes by arbitrary angles.
ROTATION = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
YOUNG, POISSON, ALPHA, HEAT = 210e9, 0.3, 12e-6, 80.0


def mesh(cell: str, degree: int = 1, bent: float = 0.06) -> object:
    made = fem.box([np.linspace(0, 1, 4)] * CELLS[cell], cell)
    random = np.random.default_rng(5)
    moved = made.p + bent * random.uniform(-1, 1, made.p.shape)
    made = type(made)(moved, made.t).with_boundaries(made.boundaries)
    return made if degree == 1 else elements.second_order(made)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("plane_stress", [False, True])
def test_linear_displacement_has_the_stress_of_hooke(
    cell: str, degree: int, plane_stress: bool
) -> None:
    d = CELLS[cell]
    material = fem.Material(YOUNG, POISSON, plane_stress=plane_stress)
    body = fem.Body("it", mesh(cell, degree), material)
    gradient = 1e-3 * np.random.default_rng(1).uniform(-1, 1, (d, d))
    stresses = stress_recovery.stress(body, body.points @ gradient.T, space=True)
    strain = np.zeros((3, 3))
    strain[:d, :d] = 0.5 * (gradient + gradient.T)
    if d == 2 and plane_stress:
        strain[2, 2] = -POISSON / (1 - POISSON) * np.trace(strain)
    # Hooke's law in terms of E and ν, not of Lamé's constants.
    bulk = YOUNG / (3 * (1 - 2 * POISSON))
    G = YOUNG / (2 * (1 + POISSON))
    mean = np.trace(strain) / 3 * np.eye(3)
    wanted = 3 * bulk * mean + 2 * G * (strain - mean)
    # Gradients on cells of size 1/3 lose a digit of the displacement.
    np.testing.assert_allclose(
        stresses, np.broadcast_to(wanted, stresses.shape), atol=1e-12 * YOUNG * 1e-3
    )
    np.testing.assert_array_equal(
        stress_recovery.stress(body, (body.points @ gradient.T).ravel()),
        stresses[:, :d, :d],
    )


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_mean_stress_is_the_integral_over_the_cell(cell: str, degree: int) -> None:
    """Compared with the integral of the stress at each point, for two materials and an
    initial strain, which the averaged gradients do not contain."""
    made = mesh(cell, degree)
    left = made.p[0, made.t].mean(axis=0) < 0.5
    made = made.with_subdomains(
        {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    )
    wood = fem.Orthotropic((11e9, 0.9e9, 0.5e9), (0.3, 0.4, 0.4), (0.7e9, 0.6e9, 0.1e9))
    body = fem.Body("it", made, {"left": fem.Material(YOUNG, POISSON), "right": wood})
    random = np.random.default_rng(2)
    u = 1e-3 * random.normal(size=body.points.shape)
    heat = stress_recovery.thermal(ALPHA, lambda x: HEAT * np.sin(3 * x[0]))
    at_points = stress_recovery.stress_at_points(body, u, heat)
    weights = body.volume().weights
    wanted = np.einsum("abcq,cq->cab", at_points, weights)
    wanted /= weights.sum(axis=1)[:, None, None]
    stresses = stress_recovery.stress(body, u, heat, space=True)
    # Sums of 27 points of 27 nodes in another order.
    atol = 1e-12 * np.abs(at_points).max()
    near(stresses, wanted, atol)
    np.testing.assert_array_equal(stresses, stresses.swapaxes(1, 2))


def free(body: fem.Body, strain: stress_recovery.Initial) -> tuple[Floats, Floats]:
    """Displacement and stress of a body without supports, held at three nodes."""
    model = fem.assemble([body], [])
    d, x = body.dim, body.points
    f = model.initial_strain("it", strain)
    # Resultant force and moment of loads in equilibrium: rounding.
    size = np.abs(f).max()
    near(f.reshape(-1, d).sum(axis=0), 0, 1e-12 * size)
    # Held at three nodes, like a table on three legs: the supports carry no force.
    corner = [int(np.argmin(np.abs(x - at).sum(axis=1))) for at in np.eye(d + 1, d, -1)]
    held = [d * corner[0] + k for k in range(d)]
    held += [d * corner[1] + k for k in range(1, d)]
    held += [d * corner[2] + 2] if d == 3 else []
    gone = np.delete(np.arange(model.n), held)
    u = np.zeros(model.n)
    K = model.K.tocsc()
    u[gone] = spsolve(K[gone][:, gone], f[gone])
    return u.reshape(-1, d), stress_recovery.stress(body, u, strain, space=True)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("material", ["plane strain", "plane stress", "wood"])
def test_free_expansion_has_no_stress(cell: str, degree: int, material: str) -> None:
    d = CELLS[cell]
    heat_by_volume = {
        "plane strain": fem.Material(YOUNG, POISSON, thickness=0.3),
        "plane stress": fem.Material(YOUNG, POISSON, plane_stress=True),
        "wood": fem.Orthotropic(
            (12e9, 0.8e9, 0.5e9),
            (0.4, 0.35, 0.5),
            (0.7e9, 0.6e9, 0.05e9),
            axes=[[0.8, 0.6], [-0.6, 0.8]] if d == 2 else ROTATION,
            plane_stress=d == 2,
        ),
    }[material]
    body = fem.Body("it", mesh(cell, degree), heat_by_volume)
    alpha = (5e-6, 30e-6, 40e-6) if material == "wood" else ALPHA
    heat = fem.thermal(alpha, HEAT, axes=heat_by_volume.directions)
    u, stresses = free(body, heat)
    heat_strain = np.asarray(heat)[:d, :d].copy()
    out = np.zeros((3, 3))
    if d == 2 and material == "plane strain":
        # Expansion that the plane prevents becomes in-plane expansion and stress.
        heat_strain *= 1 + POISSON
        out[2, 2] = -YOUNG * ALPHA * HEAT
    # Condition of the mesh, 1e3, times rounding of the strain times the modulus.
    scale = YOUNG * ALPHA * HEAT
    np.testing.assert_allclose(
        stresses, np.broadcast_to(out, stresses.shape), atol=1e-10 * scale
    )
    grown = u - u[0] - (body.points - body.points[0]) @ heat_strain.T
    # Up to a rotation, whose gradient is skew.
    gradient = np.linalg.lstsq(body.points - body.points[0], grown, rcond=None)[0]
    near(gradient + gradient.T, 0, 1e-10 * ALPHA * HEAT)


def test_second_order_bends_without_stress_in_a_linear_temperature() -> None:
    """A temperature that is linear in space bends a body without stress (Boley)."""
    body = fem.Body(
        "it", mesh("tetrahedron", 2, bent=0.0), fem.Material(YOUNG, POISSON)
    )
    heat = fem.thermal(ALPHA, lambda x: HEAT * (1 + x[0] - 2 * x[2]))
    _, stresses = free(body, heat)
    near(stresses, 0, 1e-10 * YOUNG * ALPHA * HEAT)
    # Linear elements cannot bend in this way: their error is discretisation, not rounding.
    coarse = fem.Body(
        "it", mesh("tetrahedron", 1, bent=0.0), fem.Material(YOUNG, POISSON)
    )
    assert np.abs(free(coarse, heat)[1]).max() > 1e-3 * YOUNG * ALPHA * HEAT


@pytest.mark.parametrize("cell", CELLS)
def test_clamped_bar_heated(cell: str) -> None:
    """Between walls, free laterally: -E α ΔT along it, in plane strain / (1 - ν) more."""
    d = CELLS[cell]
    body = fem.Body("it", mesh(cell, 1, bent=0.0), fem.Material(YOUNG, POISSON))
    names = ["left", "right", "bottom", *(["front"] if d == 3 else [])]
    planes = [fem.Symmetry("it", name) for name in names]
    model = fem.assemble([body], [], symmetries=planes)
    heat = fem.thermal(ALPHA, HEAT)
    gone = np.delete(np.arange(model.n), model.fixed)
    u = np.zeros(model.n)
    f = model.initial_strain("it", heat)
    K = model.K.tocsc()
    u[gone] = spsolve(K[gone][:, gone], f[gone])
    stresses = stress_recovery.stress(body, u, heat, space=True)
    wanted = np.zeros((3, 3))
    along = -YOUNG * ALPHA * HEAT
    if d == 2:  # held along x and z: σ_x = σ_z = -E α ΔT/(1 - ν)
        along /= 1 - POISSON
        wanted[2, 2] = along
    wanted[0, 0] = along
    np.testing.assert_allclose(
        stresses, np.broadcast_to(wanted, stresses.shape), atol=1e-10 * abs(along)
    )
    # The resultant of the reactions at the walls is the stress times the area.
    pull = (K @ u - f).reshape(-1, d)[body.nodes("left"), 0].sum()
    assert pull == pytest.approx(-along, rel=1e-10)


def test_heat_of_one_volume_only() -> None:
    """One half of a bar between walls is heated: both have σ = -E α ΔT/2."""
    made = fem.box([np.linspace(0, 2, 5), np.linspace(0, 1, 3)], "quadrilateral")
    warm = np.flatnonzero(made.p[0, made.t].mean(axis=0) < 1)
    body = fem.Body(
        "it",
        made.with_subdomains({"warm": warm}),
        fem.Material(YOUNG, 0.0, plane_stress=True),
    )
    planes = [fem.Symmetry("it", name) for name in ("left", "right", "bottom")]
    model = fem.assemble([body], [], symmetries=planes)
    heat = {"warm": np.diag([ALPHA * HEAT, 0.0])}
    gone = np.delete(np.arange(model.n), model.fixed)
    u = np.zeros(model.n)
    u[gone] = spsolve(
        model.K.tocsc()[gone][:, gone], model.initial_strain("it", heat)[gone]
    )
    stresses = stress_recovery.stress(body, u, heat)
    wanted = np.diag([-YOUNG * ALPHA * HEAT / 2, 0.0])
    np.testing.assert_allclose(
        stresses,
        np.broadcast_to(wanted, stresses.shape),
        atol=1e-11 * YOUNG * ALPHA * HEAT,
    )


def test_invalid_initial_strains() -> None:
    body = fem.Body("it", mesh("triangle"), fem.Material(YOUNG, POISSON))
    model = fem.assemble([body], [])
    with refused(r"strain of body 'it' has shape \(2,\)"):
        model.initial_strain("it", [1.0, 2.0])
    with refused("is not symmetric"):
        model.initial_strain("it", [[0.0, 1.0], [0.0, 0.0]])
    with refused("has shear out of the plane"):
        model.initial_strain("it", [[0, 0, 1.0], [0, 0, 0], [1.0, 0, 0]])
    with refused("no volume 'warm': its mesh"):
        model.initial_strain("it", {"warm": np.eye(2)})
    with refused(r"expansion has shape \(2,\)"):
        fem.thermal([1.0, 2.0], 3.0)
    with refused("temperature has shape"):
        model.initial_strain("it", fem.thermal(1.0, lambda _: np.zeros(3)))
    with refused(r"displacement has shape \(3,\), expected"):
        stress_recovery.stress(body, np.zeros(3))
    with refused("space=True"):
        fem.von_mises(np.zeros((4, 2, 2)))


def test_internal_forces_are_those_of_the_stiffness() -> None:
    """K u computed in another way: ∫ σ : ∇φ with the stress of u."""
    for cell, d in CELLS.items():
        body = fem.Body("it", mesh(cell, 2), fem.Material(2.0, 0.3, thickness=0.4))
        u = np.random.default_rng(d).uniform(-1, 1, body.points.size)
        theirs = fem.stiffness(body) @ u
        ours = stress_recovery.internal_forces(
            body, stress_recovery.stress_at_points(body, u)
        )
        np.testing.assert_allclose(ours, theirs, atol=1e-12 * np.abs(theirs).max())
