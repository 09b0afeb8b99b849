"""Second-order bodies coupled by mortar: planes, parts of surfaces, spheres."""

from typing import Any

import numpy as np
import pytest

from bipot_rs import analytic, fem
from bipot_rs import obstacle as ob

pytestmark = pytest.mark.needs_extra

E, NU, P = 1000.0, 0.3, 2.0
# Some thousand second-order unknowns: their condition, 1e4, times rounding.
PATCH = 1e-11

KINDS = {
    "T3": ("tetrahedron", None),
    "T6": ("tetrahedron", False),
    "Q4": ("hexahedron", None),
    "Q8": ("hexahedron", True),
    "Q9": ("hexahedron", False),
}


def cube(
    kind: str,
    name: str,
    low: float,
    grid: list[float],
    up: tuple[float, ...] = (0.0, 0.4, 1.0),
) -> fem.Body:
    """A unit cube above ``low`` with unequal divisions."""
    cell, serendipity = KINDS[kind]
    mesh = fem.box([grid, grid, low + np.array(up)], cell)
    if serendipity is not None:
        mesh = fem.second_order(mesh, serendipity=serendipity)
    return fem.Body(name, mesh, fem.Material(E, NU))


def solved(bodies: list[fem.Body], contacts: list[fem.Contact]) -> tuple[Any, Any]:
    """Pressed from above on a held body; the sides x = 0 and y = 0 are symmetry planes."""
    sides = [fem.Symmetry(b.name, s) for b in bodies for s in ("left", "front")]
    below = [b for b in bodies if b.name == "low"]
    ground = [fem.Support("low", "bottom", (2,)) for _ in below]
    model = fem.assemble(bodies, contacts, ground, symmetries=sides)
    load = model.pressure("high", "top", P)
    values = model.prescribed([[0.0]] * len(ground))
    return model, model.problem().solve(load, values, tol=1e-15)


def is_uniform(model: fem.Assembly, result: Any, base: float) -> None:
    x = model.nodes
    exact = P / E * np.column_stack([NU * x[:, 0], NU * x[:, 1], base - x[:, 2]])
    u = result.displacement[0].reshape(-1, 3)
    np.testing.assert_allclose(u, exact, rtol=0, atol=PATCH * np.abs(exact).max())
    np.testing.assert_allclose(result.traction[0][:, 0], P, rtol=10 * PATCH)


@pytest.mark.parametrize("kind", ["T6", "Q8", "Q9"])
def test_patch_on_a_plane(kind: str) -> None:
    body = cube(kind, "high", 0.0, [0.0, 0.45, 1.0])
    floor = ([0, 0, 0], [0, 0, 1.0])
    contact = fem.Contact("high", "bottom", 0.0, plane=floor, pairing="mortar")
    model, result = solved([body], [contact])
    is_uniform(model, result, 0.0)
    # At nodes, these faces have areas that are not positive; faces of 9 nodes do not.
    at_nodes = fem.Contact("high", "bottom", 0.0, plane=floor)
    if kind == "Q9":
        is_uniform(*solved([body], [at_nodes]), 0.0)
    else:
        with pytest.raises(ValueError, match='use pairing="mortar"'):
            solved([body], [at_nodes])


@pytest.mark.parametrize("kind", ["T6", "Q8"])
def test_two_parts_of_a_surface_are_the_whole(kind: str) -> None:
    """Facets on both sides of x = 0.45, which share the nodes on the line."""
    body = cube(kind, "high", 0.0, [0.0, 0.45, 1.0])
    floor = ([0, 0, 0], [0, 0, 1.0])
    halves = [
        fem.Contact(
            "high",
            "bottom",
            0.0,
            plane=floor,
            pairing="mortar",
            within={0: part},
        )
        for part in ((0.0, 0.45), (0.45, 1.0))
    ]
    model, result = solved([body], halves)
    areas = [model.area[model.group == k].sum() for k in (0, 1)]
    np.testing.assert_allclose(areas, [0.45, 0.55], rtol=1e-13)
    np.testing.assert_allclose(result.reaction[0][:, 0].sum(), P, rtol=10 * PATCH)
    # The shared nodes get forces from both parts; their pressures add up to that of the whole.
    fields = model.fields(result.displacement[0], result.reaction[0], result.status[0])
    at = body.nodes("bottom")
    whole = fem.Contact("high", "bottom", 0.0, plane=floor, pairing="mortar")
    whole_model, other = solved([body], [whole])
    np.testing.assert_allclose(
        (model.B.T @ result.reaction[0].ravel()),
        whole_model.B.T @ other.reaction[0].ravel(),
        atol=10 * PATCH * P,
    )
    assert (fields["contact_status"][at[fields["contact_pressure"][at] > 0]] == 1).all()


@pytest.mark.parametrize("kind", ["T6", "Q8", "Q4"])
@pytest.mark.quick_variants("Q4")
def test_a_sphere_by_mortar(kind: str) -> None:
    """The gap is a mean distance, so forces are similar on cells of all kinds.

    The contact radius is 0.2, four cells. A strip of half a cell around it has a fourth of
    the area, but small pressures: a tenth of the force.
    """
    ball = ob.Sphere([0.0, 0.0, 2.98], 2.0)
    grid = [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.45, 1.0]
    up = (0.0, 0.5, 0.75, 0.88, 0.95, 1.0)
    forces = []
    for name, pairing in ((kind, "mortar"), ("Q9", "match")):
        body = cube(name, "low", 0.0, grid, up)
        contact = fem.Contact("low", "top", 0.0, obstacle=ball, pairing=pairing)
        sides = [fem.Symmetry("low", s) for s in ("left", "front")]
        ground = fem.Support("low", "bottom", (0, 1, 2))
        model = fem.assemble([body], [contact], [ground], symmetries=sides)
        result = model.problem().solve()
        force = np.einsum("ck,ckd->d", result.reaction[0], model.frame)
        # It pushes down; the horizontal forces along x and y are equal.
        assert force[2] < 0
        assert force[0] == pytest.approx(force[1], rel=0.05)
        forces.append(-force[2])
    assert forces[0] == pytest.approx(forces[1], rel=0.1)
    # A quarter of Hertz's force on a half-space; the rigid ground five radii below makes it
    # stiffer.
    modulus = analytic.contact_modulus(E, NU)
    hertz = 4 / 3 * modulus * np.sqrt(2.0) * 0.02**1.5 / 4
    assert hertz < forces[0] < 1.4 * hertz


@pytest.mark.parametrize("kind", ["T6", "Q8", "Q4"])
def test_an_obstacle_that_moves_is_a_body_that_moves(kind: str) -> None:
    """A tilted plane that moves by s is equivalent to supports that move by -s."""
    body = cube(kind, "low", 0.0, [0.0, 0.45, 1.0])
    way = np.array([[0.0, 0.0, -0.02], [0.01, 0.004, -0.03], [-0.01, 0.0, -0.01]])
    tilted = ob.Plane([0.5, 0.5, 1.0], [0.02, 0.01, -1.0])
    ground = [fem.Support("low", "bottom", (0, 1, 2))]
    results = []
    for motion in (ob.Motion(way), None):
        contact = fem.Contact(
            "low", "top", 0.3, obstacle=tilted, motion=motion, pairing="mortar"
        )
        model = fem.assemble([body], [contact], ground)
        moved = np.zeros_like(way) if motion else -way
        values = np.array([model.prescribed([one]) for one in moved])
        results.append(model.problem().solve(None, values, tol=1e-13))
    assert (results[0].status != 0).any()
    # Two solutions with η of 1e-13, for problems whose data differ by rounding.
    size = np.abs(results[0].reaction).max()
    np.testing.assert_allclose(
        results[0].reaction, results[1].reaction, rtol=0, atol=1e-9 * size
    )


@pytest.mark.parametrize("kind", ["T6", "Q8", "Q4"])
@pytest.mark.slow_variants("Q8")
def test_clearances_at_nodes(kind: str) -> None:
    """For a body, a plane and a moving plane: a linear clearance is reproduced."""
    bodies = [
        cube(kind, "high", 0.0, [0.0, 0.45, 1.0]),
        cube("T3", "low", -1.0, [0.0, 0.3, 0.7, 1.0]),
    ]
    floor = ob.Plane([0, 0, 0], [0, 0, 1.0])
    way = ob.Motion([[0, 0, -0.1], [0, 0, -0.2]])
    against: list[dict[str, Any]] = [
        {"against": ("low", "top")},
        {"obstacle": floor},
        {"obstacle": floor, "motion": way},
    ]
    for within in (None, {0: (0.0, 0.45)}):
        nodes = bodies[0].nodes("bottom", within)
        values = 0.1 + bodies[0].points[nodes] @ [0.3, -0.2, 0.0]
        for other in against:
            gaps = []
            for clearance in (values, lambda x: 0.1 + x @ [0.3, -0.2, 0.0]):
                contact = fem.Contact(
                    "high",
                    "bottom",
                    0.2,
                    clearance=clearance,
                    pairing="mortar",
                    within=within,
                    **other,
                )
                model = fem.assemble(bodies, [contact])
                moved = model.gaps(2) if "motion" in other else None
                gaps.append((model.gap, moved))
            (first_model, first), (two, second) = gaps
            # No skewed quadrilaterals, so the quadrature is exact to rounding.
            np.testing.assert_allclose(first_model, two, rtol=0, atol=1e-13)
            if first is not None and second is not None:
                np.testing.assert_allclose(first, second, rtol=0, atol=1e-13)
                np.testing.assert_allclose(
                    first[1, :, 0], first_model + 0.2, rtol=0, atol=1e-13
                )
    contact = fem.Contact(
        "high", "bottom", 0.2, clearance=values[1:], pairing="mortar", obstacle=floor
    )
    with pytest.raises(
        ValueError, match=r"clearance of the contact on 'bottom' has sha"
    ):
        fem.assemble(bodies, [contact])
