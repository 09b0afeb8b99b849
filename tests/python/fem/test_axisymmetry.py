"""Bodies of revolution against closed forms, an independent quadrature, and a body in space."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skfem import MeshQuad

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs._lib.types import Floats
from bipot_rs.cli.commands.new import write_deck
from bipot_rs.discretisation import discretisation_error
from bipot_rs.fem.bodies.boundary import spring_stiffness
from bipot_rs.fem.checks.free_bodies import describe_free_bodies
from cases.revolution import KINDS, ring
from support.boxes import box
from support.comparisons import close, refused

YOUNG, NU = 210e9, 0.3


def steel(young: float = YOUNG, nu: float = NU) -> fem.Material:
    return fem.Material(young, nu, axisymmetric=True)


def solve(model: Any, load: Floats, prescribed: Any = None, **options: Any) -> Any:
    return model.problem(**options).solve(load, prescribed)


@pytest.mark.parametrize(
    ("kind", "least"), [("P1", 0.9), ("Q1", 1.9), ("P2", 1.9), ("Q2", 3.7)]
)
def test_a_thick_cylinder_under_pressure(kind: str, least: float) -> None:
    """Displacement and hoop stress of Lamé, in plane strain, with the observed order."""
    a, b, p = 0.02, 0.05, 1e8
    A, C = p * a**2 / (b**2 - a**2), p * a**2 * b**2 / (b**2 - a**2)
    ends = [fem.Support("tube", s, (1,)) for s in ("bottom", "top")]
    shift, hoop = [], []
    for n in (4, 8, 16):
        body = fem.Body("tube", ring(kind, n, a, b, 0.015), steel())
        model = fem.assemble([body], [], ends)
        load = model.nodal_forces(fem.Load("tube", "left", pressure=p))
        u = solve(model, load)[0].displacement.reshape(-1, 2)
        r = body.points[:, 0]
        exact = (1 + NU) / YOUNG * ((1 - 2 * NU) * A * r + C / r)
        shift.append(np.abs(u[:, 0] - exact).max() / exact.max())
        stress = fem.stress(body, u, space=True)[:, 2, 2]
        centre = r[body.cells[:, : body.kind.corners]].mean(axis=1)
        hoop.append(np.abs(stress - A - C / centre**2).max() / (A + C / a**2))
    assert np.log2(shift[-2] / shift[-1]) >= least
    assert hoop[-1] < 0.06


def test_one_cell_against_an_independent_quadrature() -> None:
    """K of a distorted quadrilateral, by its own shape functions and 2 by 2 Gauss points."""
    x = np.array([[0.3, 0.0], [1.1, -0.1], [1.3, 0.9], [0.2, 0.7]])
    E, nu = 3.0, 0.2
    D = np.diag([1 - 2 * nu] * 3 + [0.5 - nu])
    D[:3, :3] += nu
    D *= E / (1 + nu) / (1 - 2 * nu)
    K = np.zeros((8, 8))
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for s, t in corner / np.sqrt(3):
        a, b = 1 + corner[:, 0] * s, 1 + corner[:, 1] * t
        N, dN = a * b / 4, np.stack([corner[:, 0] * b, corner[:, 1] * a]) / 4
        J = dN @ x
        g, r = np.linalg.solve(J, dN), N @ x[:, 0]
        B = np.zeros((4, 8))
        B[0, ::2] = B[3, 1::2] = g[0]
        B[1, 1::2] = B[3, ::2] = g[1]
        B[2, ::2] = N / r
        K += B.T @ D @ B * 2 * np.pi * r * np.linalg.det(J)
    body = fem.Body("it", MeshQuad(x.T.copy(), np.arange(4)[:, None]), steel(E, nu))
    made = fem.assemble([body], []).K.toarray()
    close(made, K, 1e-14)  # sums of 16 terms of one sign or another
    assert (made == made.T).all()
    free = np.linalg.eigvalsh(made)
    assert (free < 1e-12 * free[-1]).sum() == 1  # only translation along z


KIND: dict[str, Any] = {"plane": "axisymmetric", "cell": "quadrilateral"}


def test_a_solid_shaft_in_plane_stress_from_a_scene() -> None:
    """Ends are free and nothing holds r = 0 but the axis: p = E δ (c² - b²) / (2 b c²)."""
    m = bp.Model("fit")
    m.material("steel", young=210e9, poisson=0.3)
    length = np.linspace(0.0, 0.01, 9)
    m.body("shaft", material="steel", x=length, y=length, **KIND)
    m.body("hub", material="steel", x=0.01 + length, y=length, **KIND)
    m.contact("shaft.right", against="hub.left", mu=0.0, clearance=-1e-5)
    m.symmetry("shaft.bottom")
    m.symmetry("hub.bottom")
    result = m.solve()
    b, c, delta = 0.01, 0.02, 1e-5
    # Δr = δ = p b/E [(c² + b²)/(c² - b²) + ν + 1 - ν] in plane stress, uniform along z.
    pressure = 210e9 * delta * (c**2 - b**2) / (2 * b * c**2)
    # The ends lengthen unequally within the first cells: the mean is better than the corner.
    area = 2 * np.pi * b * 0.01
    assert result.reaction[0, :, 0].sum() == pytest.approx(pressure * area, rel=2e-3)
    assert result.traction[0, :-1, 0] == pytest.approx(pressure, rel=3e-3)
    with refused("does not support axisymmetric bodies"):
        discretisation_error(result.case, result)


@pytest.mark.parametrize("kind", KINDS)
def test_loads_of_a_full_turn_reach_the_axis(kind: str) -> None:
    """Forces of pressure, part of a surface, traction and weight, with nodes at r = 0."""
    body, whole = fem.Body("it", ring(kind, 4, 0.0, 2.0, 3.0), steel()), np.pi * 2.0**2
    for load, wanted in (
        (fem.Load("it", "top", pressure=3.0), -3 * whole),
        (fem.Load("it", "top", traction=(0.0, 2.0)), 2 * whole),
        (
            fem.Load("it", "top", pressure=3.0, within={0: (0.0, 0.7)}),
            -3 * np.pi * 0.49,
        ),
        (fem.Load("it", force=(0.0, -1.0)), -whole * 3),
    ):
        # Sums of positive terms: rounding.
        along = float(load.forces(body)[1::2].sum())
        assert along == pytest.approx(wanted, rel=1e-12)
    if kind in ("P1", "Q1"):
        forces = fem.Load("it", "top", pressure=3.0).forces(body)[1::2]
        axis = (body.points[:, 0] == 0) & (body.points[:, 1] == 3)
        # ∫ (1 - r/h) 2 π r dr = π h²/3.
        assert forces[axis] == pytest.approx(-3 * np.pi * 0.5**2 / 3, rel=1e-13)


def test_heating_of_a_free_body() -> None:
    """A constant thermal strain causes no stress, and u_r = α T r."""
    body = fem.Body("it", ring("Q2", 4, 0.0, 1.0, 1.0), steel())
    model = fem.assemble([body], [], [fem.Support("it", "bottom", (1,))])
    strain = fem.thermal(1e-5, 100.0)
    load = model.nodal_forces(fem.Load("it", strain=strain))
    u = solve(model, load)[0].displacement
    assert u.reshape(-1, 2) == pytest.approx(1e-3 * body.points, rel=1e-10, abs=1e-14)
    stress = fem.stress(body, u, strain, space=True)
    assert np.abs(stress).max() < 1e-9 * YOUNG * 1e-3


def test_derivatives_by_materials_pressure_and_initial_strain() -> None:
    """Against central differences; the strain along r, z and around the axis."""

    def solved(E: float = 2.0, nu: float = 0.3, p: float = 1.0, *strain: float) -> Any:
        body = fem.Body("it", ring("Q1", 4, 0.0, 1.0, 1.0), steel(E, nu))
        contact = fem.Contact("it", "bottom", mu=0.3, plane=((0, 0), (0, 1)))
        model = fem.assemble([body], [contact], [fem.Support("it", "right", (0,))])
        grown = np.diag(np.array([0.01, 0.0, 0.02]) + (strain or 0.0))
        loads = [fem.Load("it", "top", pressure=p), fem.Load("it", strain=grown)]
        return solve(model, sum(map(model.nodal_forces, loads))), model, loads

    weight = np.random.default_rng(3).normal(size=(1, 5, 2))
    result, model, loads = solved()
    found = model.gradient(result.vjp(reaction=weight), loads)
    by_strain = np.diag(found.initial_strain[1])
    wanted = [found.young["it"][0], found.poisson["it"][0], found.load_factor[0]]
    at, step = np.array([2.0, 0.3, 1.0, 0.0, 0.0, 0.0]), 1e-5
    for derivative, way in zip([*wanted, *by_strain], step * np.eye(6), strict=True):
        change = solved(*at + way)[0].reaction - solved(*at - way)[0].reaction
        slope = float(np.sum(weight * change)) / (2 * step)
        # Differences of second order, and rounding over the step.
        assert derivative == pytest.approx(
            slope, rel=1e-6, abs=1e-8 * np.abs(weight).max()
        )
    with refused("node coordinates is not available for bodies of"):
        _ = found.nodes
    with refused("of revolution have no thickness"):
        _ = found.thickness


def test_what_a_body_of_revolution_cannot_have() -> None:
    tube, solid = (
        fem.Body("it", ring("Q1", 2, low, 2.0, 1.0), steel()) for low in (1.0, 0.0)
    )
    slab = fem.Body("slab", tube.mesh, fem.Material(1.0, 0.3))
    contact = fem.Contact("it", "left", mu=0.0, plane=((0, 0), (1, 0)))
    remote = fem.Remote("r", "it", "left", (0.0, 0.0))
    plane = fem.Symmetry("it", "left")
    make: Any
    for make, message in (
        (
            lambda: fem.Body("it", ring("Q1", 2, -1.0, 1.0, 1.0), steel()),
            "nodes at r = -1",
        ),
        (
            lambda: fem.Body("it", box("hexahedron"), steel()),
            "its mesh must be in the plane",
        ),
        (lambda: replace(steel(), thickness=2.0), "a body of revolution has neither"),
        (lambda: fem.assemble([tube, slab], []), "body 'slab' is plane and others are"),
        (
            lambda: fem.assemble([tube], [], symmetries=[plane]),
            "symmetry on 'left' of body 'it'",
        ),
        (
            lambda: fem.assemble([tube], [], remotes=[remote]),
            "remote 'r': bodies of revolution have no re",
        ),
        (lambda: fem.assemble([solid], [contact]), "contact on 'left' of body 'it'"),
    ):
        with refused(message):
            make()


def test_only_the_motion_along_the_axis_is_free() -> None:
    """A ring that nothing holds moves along z; contact with a plane holds it."""
    tube = fem.Body("tube", ring("Q1", 2, 1.0, 2.0, 1.0), steel())
    wall = fem.Contact("tube", "right", mu=0.0, plane=((2, 0), (-1, 0)))
    (words,) = describe_free_bodies(fem.assemble([tube], [wall]))
    assert "translation along the axis" in words
    held = fem.Contact("tube", "bottom", mu=0.0, plane=((0, 0), (0, 1)))
    model = fem.assemble([tube], [held])
    assert not list(describe_free_bodies(model))
    load = model.nodal_forces(fem.Load("tube", "top", pressure=2.0))
    force = solve(model, load).reaction[0, :, 0].sum()
    assert force == pytest.approx(2 * np.pi * 3, rel=1e-10)


@pytest.mark.parametrize("radius", [30.0, 100.0])
def test_hoops_alone_hold_thin_rings_in_the_iterative_engine(radius: float) -> None:
    """Two rings of thickness 1, held along z: their hoop stiffness is that of weak springs."""
    bodies = [
        fem.Body(name, ring("Q1", 4, low, low + 1, 1.0), steel())
        for name, low in (("in", radius - 1), ("out", radius))
    ]
    contact = fem.Contact("in", "right", 0.2, against=("out", "left"))
    held = [fem.Support(body.name, "bottom", (1,)) for body in bodies]
    model = fem.assemble(bodies, [contact], held)
    load = model.nodal_forces(fem.Load("out", "right", pressure=10.0))
    one, other = (
        model.problem(engine=engine).solve(load)[-1]
        for engine in ("iterative", "direct")
    )
    assert "krylov" in one.stats
    # The digits of K that hoops have: (thickness / radius)^2.
    close(one.reaction, other.reaction, 1e-9)


def test_a_sphere_that_a_force_presses_and_a_spring() -> None:
    """The force on an obstacle is that of a full turn, and so is the stiffness of a spring."""
    m = bp.Model("ball")
    m.material("rubber", young=1.0, poisson=0.3)
    grid = np.linspace(0, 2, 9)
    m.body("pad", material="rubber", x=grid, y=grid, **KIND)
    m.support("pad.bottom", y=0.0)
    ball = {"centre": [0.0, 5.0], "radius": 3.0}
    m.obstacle("ball", sphere=ball, force={"y": -0.01})
    m.contact("pad.top", against="ball", mu=0.3, pairing="mortar")
    result = m.solve()
    assert result.contact_force("pad.top")[0, 1] == pytest.approx(-0.01, rel=1e-9)
    body = fem.Body("b", ring("Q2", 4, 0, 2, 1), steel())
    K = spring_stiffness(body, fem.Spring("b", "bottom", 3.0))
    along = np.tile([0.0, 1.0], len(body.points))
    assert along @ K @ along == pytest.approx(3 * np.pi * 2**2, rel=1e-12)


def test_a_deck_of_axisymmetric_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CAX4R: the scene says axisymmetric, and a pressure on a disk gives p π r²."""
    deck = """*NODE
1, 0., 0.\n2, 1., 0.\n3, 2., 0.\n4, 0., 1.\n5, 1., 1.\n6, 2., 1.
*ELEMENT, TYPE=CAX4R, ELSET=ALL
1, 1, 2, 5, 4\n2, 2, 3, 6, 5
*SURFACE, NAME=TOP\n1, S3\n2, S3
*SURFACE, NAME=FOOT\n1, S1\n2, S1
*MATERIAL, NAME=STEEL\n*ELASTIC\n210000., 0.3
*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL
*STEP\n*STATIC\n*DSLOAD\nTOP, P, 5.\n*END STEP
"""
    path = tmp_path / "disk.inp"
    path.write_text(deck)
    scene = tmp_path / "disk.toml"
    monkeypatch.chdir(tmp_path)
    write_deck("disk", path)
    m = bp.Model.from_toml(scene)
    m.contact("ALL.FOOT", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.3)
    with refused('type CAX: add plane = "axisymmetric"'):
        m.with_(**{"body.ALL.plane": "strain"}).assemble()
    force = m.solve().contact_force("ALL.FOOT")[-1, 1]
    assert force == pytest.approx(5 * np.pi * 2**2, rel=1e-10)


def test_a_seal_that_contact_alone_holds() -> None:
    """A ring between plates and a bore: to the last digits, in balance along z."""
    m = bp.Model("seal")
    m.material("rubber", young=5.0, poisson=0.45)
    grid = np.linspace(0, 4, 13)
    m.body("ring", material="rubber", x=18 + grid, y=grid, order=2, **KIND)
    m.obstacle("plate", plane={"point": [0, 4], "normal": [0, -1]}, move={"y": -0.2})
    bore = {"point": [22.05, 0], "normal": [-1, 0]}
    m.contact("ring.top", against="plate", mu=0.3, pairing="mortar")
    floor = {"point": [0, 0], "normal": [0, 1]}
    m.contact("ring.bottom", plane=floor, mu=0.3, pairing="mortar")
    m.contact("ring.right", plane=bore, mu=0.3, pairing="mortar")
    m.pressure("ring.left", value=0.5)
    result = m.solve()
    # A rigid motion found with few digits raises the tolerance instead.
    assert result.residual.max() <= 1e-12
    sides = [
        result.contact_force(f"ring.{s}")[-1, 1] for s in ("top", "bottom", "right")
    ]
    assert sum(sides) == pytest.approx(0, abs=1e-10 * max(np.abs(sides)))
    assert (np.abs(sides) > 10).all()
