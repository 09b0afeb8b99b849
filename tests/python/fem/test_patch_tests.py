"""Assembly: patch tests, resultants, rates of convergence, and scikit-fem's own forms."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from bipot_rs import fem
from bipot_rs.discretisation.contact_facets import contact_facets
from bipot_rs.fem.bodies.elasticity import vtk_cells

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
Floats = NDArray[np.float64]


def body(cell: str, n: int = 3, bend: float = 0.2, **material: object) -> fem.Body:
    """Unit square or cube whose inner nodes are moved by up to ``bend`` cells."""
    mesh = fem.box([np.linspace(0, 1, n + 1)] * CELLS[cell], cell)
    inside = ((mesh.p > 0) & (mesh.p < 1)).all(axis=0)
    moved = mesh.p.copy()
    random = np.random.default_rng(1)
    moved[:, inside] += bend / n * random.uniform(-1, 1, moved[:, inside].shape)
    mesh = type(mesh)(moved, mesh.t).with_boundaries(mesh.boundaries)
    return fem.Body("it", mesh, fem.Material(210e3, 0.3, **material))  # type: ignore[arg-type]


def boundary(one: fem.Body) -> NDArray[np.int64]:
    return np.unique(one.mesh.facets[:, one.mesh.boundary_facets()])


def solve(
    K: sparse.csr_array, f: Floats, fixed: NDArray[np.int64], value: Floats
) -> Floats:
    u = np.zeros(len(f))
    u[fixed] = value
    free = np.setdiff1d(np.arange(len(f)), fixed)
    u[free] = spsolve(K[free][:, free].tocsc(), (f - K @ u)[free])
    return u


@pytest.mark.parametrize("cell", CELLS)
def test_patch(cell: str) -> None:
    """A linear displacement on the boundary continues inside, also on distorted cells."""
    meshed = body(cell)
    dim = meshed.dim
    gradient = np.arange(1.0, 1 + dim * dim).reshape(dim, dim) * 1e-3
    linear = meshed.points @ gradient.T
    fixed = (dim * boundary(meshed)[:, None] + np.arange(dim)).ravel()
    K = fem.stiffness(meshed)
    u = solve(K, np.zeros(linear.size), fixed, linear.ravel()[fixed])
    # The condition of these few cells, about 1e2, times rounding.
    assert abs(u - linear.ravel()).max() <= 1e-13 * abs(linear).max()


@pytest.mark.parametrize("cell", CELLS)
def test_resultants_and_moments_of_loads(cell: str) -> None:
    meshed = body(cell, thickness=2.0)
    model, dim = fem.assemble([meshed], []), meshed.dim
    depth = 2.0 if dim == 2 else 1.0
    direction = np.array([3.0, -1.0, 2.0])[:dim]

    def total(f: Floats) -> Floats:
        return f.reshape(-1, dim).sum(axis=0)

    # Sums over tens of nodes: rounding only.
    weight = model.body_force("it", direction)
    np.testing.assert_allclose(total(weight), depth * direction, rtol=1e-13)
    pull = model.traction("it", "top", direction)
    np.testing.assert_allclose(total(pull), depth * direction, rtol=1e-13)
    # Shape functions of other nodes are zero on the surface, to rounding.
    size = abs(pull.reshape(-1, dim)).max(axis=1)
    loaded = np.flatnonzero(size > 1e-14 * size.max())
    np.testing.assert_array_equal(loaded, meshed.nodes("top"))
    up = np.eye(dim)[-1]
    np.testing.assert_allclose(
        total(model.pressure("it", "top", 5.0)), -5 * depth * up, atol=1e-12
    )

    def slope(x: Floats) -> Floats:
        return up.reshape(-1, *[1] * (x.ndim - 1)) * x[0]

    # ∫ x dA = 1/2 and ∫ x² dA = 1/3, of an interpolant exact for linear fields.
    hill = model.traction("it", "top", slope)
    assert total(hill)[-1] == pytest.approx(depth / 2, rel=1e-13)
    moment = hill.reshape(-1, dim)[:, -1] @ meshed.points[:, 0]
    assert moment == pytest.approx(depth / 3, rel=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_cells_for_files_have_positive_volume(cell: str) -> None:
    _, corners = vtk_cells(body(cell))
    x = body(cell).points
    axes = {"triangle": [1, 2], "quadrilateral": [1, 3], "tetrahedron": [1, 2, 3]}
    edges = x[corners[:, axes.get(cell, [1, 3, 4])]] - x[corners[:, :1]]
    assert np.all(np.linalg.det(edges) > 0)
    # Corners are in ring order: opposite ones differ in two coordinates, neighbours in one.
    if cell == "hexahedron":
        ring = body(cell, bend=0.0).points[corners]
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (0, 4), (1, 5), (2, 6)):
            assert np.all((abs(ring[:, a] - ring[:, b]) > 1e-9).sum(axis=1) == 1)


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
    with pytest.raises(ValueError, match="normal 1 has length zero"):
        fem.frames([[0.0, 1.0], [0.0, 0.0]])


@pytest.mark.parametrize("exponent", [-1060, -700, 500, 1020])
def test_frames_of_normals_of_any_size(exponent: int) -> None:
    """Powers of two change no bit, although squares exceed the range of doubles."""
    normals = np.random.default_rng(2).integers(-9, 9, size=(50, 3)) + 0.5
    np.testing.assert_array_equal(
        fem.frames(np.ldexp(normals, exponent)), fem.frames(normals)
    )


def two_blocks(lift: float = 0.0) -> list[fem.Body]:
    g = np.linspace(0, 1, 4)
    steel = fem.Material(1.0, 0.3)
    return [
        fem.Body("upper", fem.box([g, g, g + lift], "hexahedron"), steel),
        fem.Body("lower", fem.box([g, g, g - 1], "hexahedron"), steel),
    ]


def test_pair_of_bodies() -> None:
    contact = fem.Contact("upper", "bottom", 0.3, against=("lower", "top"))
    model = fem.assemble(two_blocks(lift=0.25), [contact])
    # Normals point upwards: the obstacle is the lower block.
    np.testing.assert_array_equal(model.frame[:, 0], [[0, 0, 1]] * 16)
    np.testing.assert_array_equal(model.gap, 0.25)
    assert model.area.sum() == pytest.approx(1, rel=1e-14)
    u = np.zeros(model.n)
    u[: model.offset[1]] = np.tile([1.0, 2.0, 3.0], model.offset[1] // 3)
    u[model.offset[1] :] = np.tile([0.5, 0.0, 1.0], (model.n - model.offset[1]) // 3)
    np.testing.assert_array_equal((model.B @ u).reshape(-1, 3), [[2.0, 0.5, 2.0]] * 16)
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
    p = lower.mesh.p * (1 + 1e-9)
    lower = fem.Body(
        "lower",
        type(lower.mesh)(p, lower.mesh.t, lower.mesh.boundaries),
        lower.material,
    )
    contact = fem.Contact(
        "upper", "bottom", 0.3, against=("lower", "top"), within={0: ends, 1: ends}
    )
    model = fem.assemble([upper, lower], [contact])
    assert len(model.gap) == (16 if ends[1] == 1 else 1)
    away = model.nodes[model.contact_dofs[:, 1] // 3] - model.points
    assert abs(away).max() <= 2e-9


def test_faces_of_a_crack_in_one_body() -> None:
    """A slit from the left to the middle of a square; its tip stays whole."""
    mesh = fem.box([np.linspace(0, 2, 5), np.linspace(-1, 1, 5)], "quadrilateral")
    doubled = np.flatnonzero((mesh.p[1] == 0) & (mesh.p[0] < 1))
    number = np.arange(mesh.p.shape[1])
    number[doubled] = mesh.p.shape[1] + np.arange(len(doubled))
    upper = mesh.p[1, mesh.t].mean(axis=0) > 0
    t = np.where(upper, number[mesh.t], mesh.t)
    mesh = skfem.MeshQuad(np.hstack([mesh.p, mesh.p[:, doubled]]), t)
    slit = {0: (0, 1), 1: (0, 0)}
    faces = {
        "above": fem.surface(mesh, slit, normal=(0, -1)),
        "below": fem.surface(mesh, slit, normal=(0, 1)),
    }
    rock = fem.Body("rock", fem.with_surfaces(mesh, faces), fem.Material(1.0, 0.3))
    contact = fem.Contact("rock", "above", 0.3, against=("rock", "below"))
    model = fem.assemble([rock], [contact])
    np.testing.assert_array_equal(model.points, [[0, 0], [0.5, 0]])
    np.testing.assert_array_equal(model.frame[:, 0], [[0, 1], [0, 1]])
    np.testing.assert_array_equal(model.gap, 0)
    np.testing.assert_allclose(model.area, [0.25, 0.5], rtol=1e-15)
    np.testing.assert_array_equal(model.contact_dofs[:, 0] // 2, number[doubled])
    np.testing.assert_array_equal(model.contact_dofs[:, 1] // 2, doubled)
    # The upper part rises by 0.1: so much do the faces open.
    u = np.zeros((len(model.nodes), 2))
    u[number[doubled], 1] = 0.1
    np.testing.assert_allclose((model.B @ u.ravel())[::2], 0.1, rtol=1e-15)
    # Its tractions beside the tip have no contact there.
    with pytest.raises(ValueError, match="the faces of a crack: the discretisation"):
        contact_facets(model, [])
    for wrong in ({"surface": "below"}, {"pairing": "mortar"}, {"pairing": "nodes"}):
        with pytest.raises(ValueError, match="contact with itself"):
            fem.assemble([rock], [replace(contact, **wrong)])


def test_plane_that_is_not_a_coordinate_plane() -> None:
    normal = np.array([1.0, 2.0, 2.0]) / 3
    contact = fem.Contact("it", "bottom", 0.3, plane=([0, 0, -3.0], 5 * normal))
    model = fem.assemble([body("hexahedron")], [contact])
    np.testing.assert_allclose(
        model.gap, (model.points - [0, 0, -3.0]) @ normal, rtol=1e-14
    )
    u = np.tile([1.0, -1.0, 4.0], model.n // 3)
    np.testing.assert_allclose(
        (model.B @ u).reshape(-1, 3), model.frame @ [1.0, -1.0, 4.0], rtol=1e-14
    )


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
    pair = fem.Contact("upper", "bottom", 0.3, against=("lower", "top"))
    below = fem.Support("lower", "top", (0, 1, 2))
    assert np.all(fem.assemble(two_blocks(), [pair], [below]).mu == 0.3)


def test_part_of_a_surface_keeps_its_areas() -> None:
    plane = ([0, 0], [0, 1.0])
    contact = fem.Contact("it", "bottom", 0.3, plane=plane, within={0: (1 / 3, 1.0)})
    model = fem.assemble([body("quadrilateral", bend=0.0)], [contact])
    np.testing.assert_allclose(model.points[:, 0], [1 / 3, 2 / 3, 1], rtol=1e-15)
    np.testing.assert_allclose(model.area, [1 / 3, 1 / 3, 1 / 6], rtol=1e-14)


def test_clearance_as_a_function_of_position() -> None:
    contact = fem.Contact(
        "it", "bottom", 0.3, plane=([0, 0], [0, 1.0]), clearance=lambda x: x[:, 0] ** 2
    )
    model = fem.assemble([body("quadrilateral")], [contact])
    np.testing.assert_array_equal(model.gap, model.points[:, 0] ** 2)


def test_prescribed_values_in_the_order_of_fixed() -> None:
    supports = [fem.Support("it", "top", (1,)), fem.Support("it", "left", (0, 1))]
    model = fem.assemble([body("quadrilateral")], [], supports)
    value = model.prescribed([[2.0], [1.0, 2.0]])
    assert np.all(np.diff(model.fixed) > 0)
    np.testing.assert_array_equal(value, np.where(model.fixed % 2 == 0, 1.0, 2.0))
    with pytest.raises(ValueError, match=r"both 2 and 3 for component 1.*\(0, 1\)"):
        model.prescribed([[2.0], [1.0, 3.0]])


@pytest.mark.parametrize(
    ("contact", "message"),
    [
        (fem.Contact("up", "bottom", 0.3, against=("lower", "top")), "no body 'up'"),
        (
            fem.Contact("upper", "base", 0.3, against=("lower", "top")),
            "no surface 'base'",
        ),
        (fem.Contact("upper", "bottom", -1, against=("lower", "top")), "mu .* is -1"),
        (fem.Contact("upper", "bottom", 0.3), "needs exactly one of plane"),
        (
            fem.Contact("upper", "bottom", 0.3, against=("lower", "left")),
            r"do not match: no node lies opposite to the node at",
        ),
        (
            fem.Contact(
                "upper", "bottom", 0.3, plane=([0] * 3, [0, 0, 1.0]), within={0: (2, 3)}
            ),
            "has no nodes",
        ),
        (
            fem.Contact("upper", "bottom", 0.3, plane=([0, 0], [0, 1.0])),
            r"shapes \(2,\)",
        ),
        (
            fem.Contact("upper", "bottom", 0.3, against=("upper", "top")),
            "contact with itself",
        ),
    ],
)
def test_invalid_contacts(contact: fem.Contact, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fem.assemble(two_blocks(), [contact])


def test_invalid_bodies() -> None:
    with pytest.raises(ValueError, match=r"poisson is 0\.5"):
        fem.Material(1.0, 0.5)
    with pytest.raises(ValueError, match="young is 0"):
        fem.Material(0.0, 0.3)
    with pytest.raises(TypeError, match="MeshWedge1"):
        fem.Body("it", skfem.MeshWedge1(), fem.Material(1.0, 0.3))
    with pytest.raises(ValueError, match="names of bodies repeat"):
        fem.assemble([body("triangle"), body("triangle")], [])
    with pytest.raises(ValueError, match="axis 1 needs two"):
        fem.box([[0, 1], [0, 0]], "triangle")
    with pytest.raises(ValueError, match="cell is 'hexagon'"):
        fem.box([[0, 1], [0, 1]], "hexagon")
    with pytest.raises(ValueError, match="has shape"):
        fem.assemble([body("triangle")], []).body_force("it", [1.0, 2.0, 3.0])


def test_matching_surfaces_that_face_the_same_way() -> None:
    side = np.linspace(0.0, 1.0, 3)
    low = fem.box([side, side], "quadrilateral")
    up = fem.box([side, side + 1.0], "quadrilateral")
    steel = fem.Material(1.0, 0.3)
    bodies = [fem.Body("up", up, steel), fem.Body("low", low, steel)]
    with pytest.raises(ValueError, match="do not face each other at"):
        fem.assemble(
            bodies, [fem.Contact("up", "bottom", 0.3, against=("low", "bottom"))]
        )
