"""Assembly: resultants of loads, frames, pairs of matching surfaces, planes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray

from bipot_rs import fem
from bipot_rs.discretisation.contact_facets import contact_facets
from support.boxes import CELLS, box, placed
from support.comparisons import refused

Floats = NDArray[np.float64]


def body(cell: str, bend: float = 0.2, **material: Any) -> fem.Body:
    """Unit square or cube of three cells a side; inner nodes move by up to ``bend`` cells."""
    mesh = box(cell)
    inside = ((mesh.p > 0) & (mesh.p < 1)).all(axis=0)
    moved = bend / 3 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape)
    mesh = placed(mesh, mesh.p + inside * moved)
    return fem.Body("it", mesh, fem.Material(210e3, 0.3, **material))


@pytest.mark.parametrize("cell", CELLS)
def test_resultants_and_moments_of_loads(cell: str) -> None:
    meshed = body(cell, thickness=2.0)
    model, dim = fem.assemble([meshed], []), meshed.dim
    depth = 2.0 if dim == 2 else 1.0
    direction, up = np.array([3.0, -1.0, 2.0])[:dim], np.eye(dim)[-1]

    def total(f: Floats) -> Floats:
        return f.reshape(-1, dim).sum(axis=0)

    # Sums over tens of nodes: rounding only.
    pull = model.traction("it", "top", direction)
    for load in (pull, model.body_force("it", direction)):
        np.testing.assert_allclose(total(load), depth * direction, rtol=1e-13)
    # Shape functions of other nodes are zero on the surface, to rounding.
    size = abs(pull.reshape(-1, dim)).max(axis=1)
    loaded = np.flatnonzero(size > 1e-14 * size.max())
    np.testing.assert_array_equal(loaded, meshed.nodes("top"))
    pressure = total(model.pressure("it", "top", 5.0))
    np.testing.assert_allclose(pressure, -5 * depth * up, atol=1e-12)
    # ∫ x dA = 1/2 and ∫ x² dA = 1/3, of an interpolant exact for linear fields.
    hill = model.traction("it", "top", lambda x: np.multiply.outer(up, x[0]))
    assert total(hill)[-1] == pytest.approx(depth / 2, rel=1e-13)
    moment = hill.reshape(-1, dim)[:, -1] @ meshed.points[:, 0]
    assert moment == pytest.approx(depth / 3, rel=1e-13)


def test_frames_are_orthonormal_and_follow_the_axes() -> None:
    random = np.random.default_rng(2)
    for dim in (2, 3):
        frame = fem.frames(random.normal(size=(200, dim)))
        product = frame @ frame.swapaxes(1, 2)
        # Two passes of Gram–Schmidt leave only rounding.
        assert abs(product - np.eye(dim)).max() <= 1e-15 * 8
    np.testing.assert_array_equal(
        fem.frames([[0.0, 0.0, 2.0]])[0], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    )
    np.testing.assert_array_equal(fem.frames([[0.0, -3.0]])[0], [[0, -1], [1, 0]])
    with refused("normal 1 has length zero"):
        fem.frames([[0.0, 1.0], [0.0, 0.0]])


@pytest.mark.parametrize("exponent", [-1060, -700, 500, 1020])
def test_frames_of_normals_of_any_size(exponent: int) -> None:
    """Powers of two change no bit, although squares exceed the range of doubles."""
    normals = np.random.default_rng(2).integers(-9, 9, size=(50, 3)) + 0.5
    np.testing.assert_array_equal(
        fem.frames(np.ldexp(normals, exponent)), fem.frames(normals)
    )


PAIR = fem.Contact("upper", "bottom", 0.3, against=("lower", "top"))


def two_blocks(lift: float = 0.0) -> list[fem.Body]:
    g = np.linspace(0, 1, 4)
    steel = fem.Material(1.0, 0.3)
    return [
        fem.Body("upper", fem.box([g, g, g + lift], "hexahedron"), steel),
        fem.Body("lower", fem.box([g, g, g - 1], "hexahedron"), steel),
    ]


def test_pair_of_bodies() -> None:
    model = fem.assemble(two_blocks(lift=0.25), [PAIR])
    # Normals point upwards: the obstacle is the lower block.
    np.testing.assert_array_equal(model.frame[:, 0], [[0, 0, 1]] * 16)
    np.testing.assert_array_equal(model.gap, 0.25)
    assert model.area.sum() == pytest.approx(1, rel=1e-14)
    moved = np.repeat([[1.0, 2.0, 3.0], [0.5, 0.0, 1.0]], model.offset[1] // 3, axis=0)
    v = (model.B @ moved.ravel()).reshape(-1, 3)
    np.testing.assert_array_equal(v, [[2.0, 0.5, 2.0]] * 16)
    # Action and reaction.
    force = (model.B.T @ np.random.default_rng(3).normal(size=48)).reshape(-1, 3)
    assert abs(force.sum(axis=0)).max() <= 1e-14 * abs(force).sum()
    assert (model.K[: model.offset[1], model.offset[1] :]).nnz == 0


@pytest.mark.parametrize("ends", [(0.0, 1.0), (0.3, 0.4), (0.0, 0.0)])
def test_opposite_nodes_are_found_for_any_part_of_a_surface(
    ends: tuple[float, float],
) -> None:
    """Coordinates of one node differ in their last digits, as from two mesh generators."""
    upper, lower = two_blocks()
    lower = replace(lower, mesh=placed(lower.mesh, lower.mesh.p * (1 + 1e-9)))
    within = {0: ends, 1: ends}
    model = fem.assemble([upper, lower], [replace(PAIR, within=within)])
    assert len(model.gap) == (16 if ends[1] == 1 else 1)
    away = model.nodes[model.contact_dofs[:, 1] // 3] - model.points
    assert abs(away).max() <= 2e-9


def test_faces_of_a_crack_in_one_body() -> None:
    """A slit from the left to the middle of a square; its tip stays whole."""
    mesh = fem.box([np.linspace(0, 2, 5), np.linspace(-1, 1, 5)], "quadrilateral")
    doubled = np.flatnonzero((mesh.p[1] == 0) & (mesh.p[0] < 1))
    number = np.arange(mesh.p.shape[1])
    number[doubled] = len(number) + np.arange(len(doubled))
    t = np.where(mesh.p[1, mesh.t].mean(axis=0) > 0, number[mesh.t], mesh.t)
    mesh = skfem.MeshQuad(np.hstack([mesh.p, mesh.p[:, doubled]]), t)
    slit, sides = {0: (0, 1), 1: (0, 0)}, {"above": (0, -1), "below": (0, 1)}
    faces = {name: fem.surface(mesh, slit, normal=n) for name, n in sides.items()}
    rock = fem.Body("rock", fem.with_surfaces(mesh, faces), fem.Material(1.0, 0.3))
    contact = fem.Contact("rock", "above", 0.3, against=("rock", "below"))
    model = fem.assemble([rock], [contact])
    np.testing.assert_array_equal(model.points, [[0, 0], [0.5, 0]])
    np.testing.assert_array_equal(model.frame[:, 0], [[0, 1], [0, 1]])
    np.testing.assert_array_equal(model.gap, 0)
    np.testing.assert_allclose(model.area, [0.25, 0.5], rtol=1e-15)
    pairs = np.column_stack([number[doubled], doubled])
    np.testing.assert_array_equal(model.contact_dofs // 2, pairs)
    # The upper part rises by 0.1: so much do the faces open.
    u = np.zeros((len(model.nodes), 2))
    u[number[doubled], 1] = 0.1
    np.testing.assert_allclose((model.B @ u.ravel())[::2], 0.1, rtol=1e-15)
    # Its tractions beside the tip have no contact there.
    with refused("the faces of a crack: the discretisation"):
        contact_facets(model, [])
    for wrong in ({"surface": "below"}, {"pairing": "mortar"}, {"pairing": "nodes"}):
        with refused("contact with itself"):
            fem.assemble([rock], [replace(contact, **wrong)])


def test_plane_that_is_not_a_coordinate_plane() -> None:
    normal = np.array([1.0, 2.0, 2.0]) / 3
    contact = fem.Contact("it", "bottom", 0.3, plane=([0, 0, -3.0], 5 * normal))
    model = fem.assemble([body("hexahedron")], [contact])
    gap = (model.points - [0, 0, -3.0]) @ normal
    np.testing.assert_allclose(model.gap, gap, rtol=1e-14)
    u = np.array([1.0, -1.0, 4.0])
    v = (model.B @ np.tile(u, model.n // 3)).reshape(-1, 3)
    np.testing.assert_allclose(v, model.frame @ u, rtol=1e-14)


def test_friction_where_nothing_can_slide() -> None:
    plane = ([0, 0, 0], [0, 0, 1.0])
    contact = fem.Contact("it", "bottom", 0.3, plane=plane)
    meshed = body("hexahedron")
    held = fem.assemble([meshed], [contact], [fem.Support("it", "left", (0, 1))])
    on_left = held.points[:, 0] == 0
    np.testing.assert_array_equal(held.mu, np.where(on_left, 0.0, 0.3))
    # With one free tangent, friction has a direction to act in.
    guided = fem.assemble([meshed], [contact], [fem.Support("it", "left", (0,))])
    np.testing.assert_array_equal(guided.mu, 0.3)
    # If only one side of a pair is held, the pair can still slide.
    below = fem.Support("lower", "top", (0, 1, 2))
    assert np.all(fem.assemble(two_blocks(), [PAIR], [below]).mu == 0.3)


def test_part_of_a_surface_keeps_its_areas_and_clearances() -> None:
    plane, within = ([0, 0], [0, 1.0]), {0: (1 / 3, 1.0)}
    contact = fem.Contact("it", "bottom", 0.3, plane=plane, within=within)
    contact = replace(contact, clearance=lambda x: x[:, 0] ** 2)
    model = fem.assemble([body("quadrilateral", bend=0.0)], [contact])
    np.testing.assert_allclose(model.points[:, 0], [1 / 3, 2 / 3, 1], rtol=1e-15)
    np.testing.assert_allclose(model.area, [1 / 3, 1 / 3, 1 / 6], rtol=1e-14)
    np.testing.assert_array_equal(model.gap, model.points[:, 0] ** 2)


def test_prescribed_values_in_the_order_of_fixed() -> None:
    supports = [fem.Support("it", "top", (1,)), fem.Support("it", "left", (0, 1))]
    model = fem.assemble([body("quadrilateral")], [], supports)
    value = model.prescribed([[2.0], [1.0, 2.0]])
    assert np.all(np.diff(model.fixed) > 0)
    np.testing.assert_array_equal(value, np.where(model.fixed % 2 == 0, 1.0, 2.0))
    with refused(r"both 2 and 3 for component 1.*\(0, 1\)"):
        model.prescribed([[2.0], [1.0, 3.0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"against": None}, "needs exactly one of plane"),
        ({"against": ("lower", "left")}, "do not match: no node lies opposite to the"),
        ({"against": ("lower", "bottom")}, "do not face each other at"),
        ({"within": {0: (2, 3)}}, "has no nodes"),
        ({"against": None, "plane": ([0, 0], [0, 1.0])}, r"shapes \(2,\)"),
        ({"against": ("upper", "top")}, "contact with itself"),
    ],
)
def test_invalid_contacts(changes: dict[str, Any], message: str) -> None:
    with refused(message):
        fem.assemble(two_blocks(1.0), [replace(PAIR, **changes)])


def test_invalid_bodies() -> None:
    with pytest.raises(TypeError, match="MeshWedge1"):
        fem.Body("it", skfem.MeshWedge1(), fem.Material(1.0, 0.3))
    with refused("names of bodies repeat"):
        fem.assemble([body("triangle"), body("triangle")], [])
    with refused("axis 1 needs two"):
        fem.box([[0, 1], [0, 0]], "triangle")
    with refused("has shape"):
        fem.assemble([body("triangle")], []).body_force("it", [1.0, 2.0, 3.0])
