"""Springs and planes of symmetry."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bipot_rs import fem
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.shapes import Plane, Sphere, Union
from support.boxes import CELLS, box, placed
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
STEEL = fem.Material(200.0, 0.3, thickness=0.5)


# Rotations: in the plane, about a general axis in space, about a vertical axis.
TURNS = {
    "plane": Rotation.from_rotvec([0, 0, np.pi / 6]).as_matrix()[:2, :2],
    "space": Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix(),
    "upright": Rotation.from_rotvec([0, 0, np.pi / 6]).as_matrix(),
}


def block(cell: str, degree: int = 1) -> fem.Body:
    return fem.Body("it", box(cell, degree=degree), STEEL)


def turned(
    mesh: Any, turn: np.ndarray, off: float | NDArray[Any] = 0.0, digits: int = 17
) -> Any:
    return placed(mesh, (turn @ mesh.p + np.reshape(off, (-1, 1))).round(digits))


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_spring_resists_a_motion_by_its_stiffness(cell: str, degree: int) -> None:
    """A translation, then a rotation: force k A u, and the moment of a linear field."""
    body, d = block(cell, degree), CELLS[cell]
    depth = 0.5 if d == 2 else 1.0
    k = np.arange(1.0, d + 1) * 10
    K = fem.assemble([body], [], springs=[fem.Spring("it", "top", k)]).K
    springs = K - fem.stiffness(body)
    assert (K != K.T).nnz == 0
    assert K.has_canonical_format
    assert K.indices.dtype == K.indptr.dtype == np.int32
    for axis in np.eye(d):
        force = (springs @ np.tile(2.0 * axis, len(body.points))).reshape(-1, d)
        wanted = 2.0 * k * depth * axis
        np.testing.assert_allclose(force.sum(axis=0), wanted, atol=1e-11)
        # ∫ k x² over the top of a unit box.
        u = np.outer(body.points[:, 0], axis).ravel()
        assert u @ springs @ u == pytest.approx(k @ axis * depth / 3, abs=1e-11)


@pytest.mark.parametrize("cell", CELLS)
def test_spring_along_the_normal(cell: str) -> None:
    """On an inclined face, compared with the same stiffness in components."""
    body, d = block(cell), CELLS[cell]
    turn = np.linalg.qr(np.random.default_rng(d).normal(size=(d, d)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    inclined = fem.Body("it", turned(body.mesh, turn), STEEL)
    k = np.full(d, 3.0)
    k[-1] = 40.0
    springs = [fem.Spring("it", "top", k)]
    straight = fem.assemble([body], [], springs=springs).K.toarray()
    spring = fem.Spring("it", "top", normal=40.0, tangential=3.0)
    other = fem.assemble([inclined], [], springs=[spring]).K
    assert (other != other.T).nnz == 0
    block_of = np.kron(np.eye(len(body.points)), turn)
    close(block_of.T @ other.toarray() @ block_of, straight, 1e-13)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_contact_areas_have_the_thickness_of_the_body(pairing: str) -> None:
    """Two plane blocks, 1 m wide and half a metre thick: half a m² of contact."""
    upper = replace(block("quadrilateral"), name="upper")
    lower = fem.Body("lower", turned(upper.mesh, np.eye(2), np.array([0, -1])), STEEL)
    for contact in (
        fem.Contact("upper", "bottom", 0.2, against=("lower", "top"), pairing=pairing),
        fem.Contact("lower", "bottom", 0.2, plane=((0, -1), (0, 1)), pairing=pairing),
    ):
        model = fem.assemble([upper, lower], [contact])
        # Sums of a few numbers.
        assert model.area.sum() == pytest.approx(0.5, rel=1e-13)


@pytest.mark.parametrize(
    "turn", [np.eye(3), TURNS["space"]], ids=["straight", "turned"]
)
def test_half_a_mortar_joint_equals_the_whole(turn: Floats) -> None:
    """Facets at the plane are halves: what they move across it cancels in the whole joint."""
    across, along, up = turn.T
    material = fem.Material(10.0, 0.3)
    on = {"against": ("lower", "top"), "pairing": "mortar"}
    held = [
        fem.Support(*end, (0, 1, 2)) for end in (("lower", "left"), ("upper", "right"))
    ]
    shapes = {
        "lower": (np.linspace(0, 2, 5), 3, [0.0, 0.5]),
        "upper": (np.linspace(0.3, 2.4, 4), 2, [0.5, 0.75, 1.0]),
    }

    def pressed(at: Floats) -> Floats:
        return np.multiply.outer(-0.02 * up, 1 + np.tensordot(along, at, 1) ** 2)

    def solved(low: float) -> list[Floats]:
        """Forces and displacements of the half y >= 0, in the axes of the joint."""
        bodies = []
        for name, (x, cells, z) in shapes.items():
            y = np.linspace(low, 1, cells * (2 if low else 1) + 1)
            mesh = turned(fem.box([x, y, z], "hexahedron"), turn)
            bodies.append(fem.Body(name, mesh, material))
        planes = [] if low else [fem.Symmetry(name, "front") for name in shapes]
        contact = fem.Contact("upper", "bottom", 0.2, **on)
        model = fem.assemble(bodies, [contact], held, symmetries=planes)
        load = model.traction("upper", "top", pressed)
        values = model.prescribed([np.zeros(3), 1e-2 * across])
        result = model.problem().solve(load, values, tol=1e-12)
        assert {1, 2} <= set(result.status[0].tolist())
        force = np.einsum("cij,ci->cj", model.frame, result.reaction[0])
        middle = abs(model.points @ along) < 1e-12
        force *= np.where(middle & (low < 0), 0.5, 1.0)[:, None]
        fields = [(model.points, force)]
        for b in bodies:
            moved = model.displacement_of(b.name, result.displacement[0])
            fields.append((b.points, moved))
        kept = [(p @ turn, v @ turn) for p, v in fields]
        kept = [(p[p[:, 1] > -1e-9], v[p[:, 1] > -1e-9]) for p, v in kept]
        return [v[np.lexsort(p.round(9).T)] for p, v in kept]

    (force, *moved), (half, *others) = solved(-1.0), solved(0.0)
    # η of 1e-12 with a condition of 10³.
    close(half, force, 1e-9)
    close(np.vstack(others), np.vstack(moved), 1e-9)


def test_supports_and_symmetries_that_disagree() -> None:
    body = block("triangle")
    support, plane = fem.Support("it", "left", (0,)), fem.Symmetry("it", "left")
    model = fem.assemble([body], [], [support], symmetries=[plane])
    assert len(model.fixed) == len(body.nodes("left"))
    np.testing.assert_array_equal(model.prescribed([[0.0]]), 0.0)
    with refused(r"prescribe both .* component 0 .*'left'"):
        model.prescribed([[0.1]])
    with refused("values has 2 entries, expected one for each of the 1"):
        model.prescribed([[0.0], [0.0]])
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    inclined = fem.Body("it", turned(body.mesh, turn), STEEL)
    held = fem.assemble([inclined], [], [support], symmetries=[plane])
    assert not held.prescribed([[0.0]]).any()
    # The other component follows, so that the node stays in the plane.
    assert held.prescribed([[0.1]]).max() == 0.1
    clamped = fem.assemble(
        [inclined], [], [replace(support, components=(0, 1))], symmetries=[plane]
    )
    with refused(r"near \(0, 0\) contradict a plane of symmetry"):
        clamped.prescribed([[0.1, 0.0]])
    # The plane is normal to x within 0.1 degrees: a millimetre would become half a metre.
    little = np.array([[1.0, -0.002], [0.002, 1.0]]) / np.hypot(1.0, 0.002)
    nearly = fem.Body("it", turned(body.mesh, little), STEEL)
    far = fem.assemble([nearly], [], [support], symmetries=[plane])
    assert not far.prescribed([[0.0]]).any()
    with refused(
        r"support 'it\.left' moves the node at .* by 0\.001 along x, .* by 0\.5 "
    ):
        far.prescribed([[0.001]])
    bent = fem.Body("it", placed(body.mesh, body.mesh.p.copy()), STEEL)
    bent.mesh.p[0] += 0.1 * bent.mesh.p[1] ** 2
    with refused("the surface is not plane, its nodes lie up to"):
        fem.assemble([bent], [], symmetries=[plane])
    with refused("no body 'that'"):
        fem.assemble([bent], [], symmetries=[fem.Symmetry("that", "left")])


# Distance from the origin, decimals of coordinates, and the allowed difference from the
# unrotated body: η of 1e-13 with a condition of about 1e3; or 1e-7 of coordinates relative
# to displacements of 1e-3.
PLACES = {"": (0.0, 17, 1e-9), "far": (100.0, 17, 1e-9), "seven": (0.0, 7, 1e-4)}


STRAIGHT = {2: np.eye(2), 3: np.eye(3)}


@pytest.mark.parametrize("pairing", ["match", "mortar"])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", TURNS)
def test_planes_of_symmetry_turn_with_the_body(
    name: str, place: str, pairing: str
) -> None:
    """Two planes that meet in an edge, friction below, heat, and all of it rotated.

    A second body with a non-matching mesh may lie under the first.
    """
    turn = TURNS[name]
    far, digits, part = PLACES[place]
    d = len(turn)
    off = far * np.array([1.0, -0.3, 0.2])[:d]
    cell = "hexahedron" if d == 3 else "quadrilateral"
    below = [*[np.linspace(0, 1, 3)] * (d - 1), np.linspace(-0.5, 0, 2)]

    def solved(R: Any, off: Any, digits: int) -> dict[str, Any]:
        """What is rotated with the body, in its own axes."""
        meshes = {"upper": box(cell), "lower": fem.box(below, cell)}
        bodies = [
            fem.Body(name, turned(mesh, R, off, digits), STEEL)
            for name, mesh in meshes.items()
        ]
        contact = fem.Contact("upper", "bottom", 0.3, plane=(off, R[:, -1]))
        on = {"against": ("lower", "top"), "plane": None, "pairing": "mortar"}
        if pairing == "mortar":
            contact = replace(contact, **on)
        else:
            del bodies[1]
        sides = [(b.name, s) for b in bodies for s in ("left", "front")[: d - 1]]
        sides += [("lower", "bottom")] * (pairing == "mortar")
        planes = [fem.Symmetry(*side) for side in sides]
        model = fem.assemble(bodies, [contact], symmetries=planes)
        out, up = R[:, 0], R[:, -1]

        def pressed(x: Any) -> Any:
            along = np.tensordot(out, x, 1) - out @ off
            return np.multiply.outer(-up, 1 + along**2) + 0.1 * np.multiply.outer(
                out, np.ones_like(along)
            )

        load = model.traction("upper", "top", pressed)
        load += model.initial_strain("upper", 1e-3 * np.eye(d))
        result = model.problem().solve(load, model.prescribed([]), tol=1e-13)
        assert (model.inclined is None) == (R is STRAIGHT[d])
        assert abs(model.K - model.K.T).max() == 0
        if model.inclined is not None:
            v = result.displacement[0]
            assert abs(model.inclined.normals.T @ v).max() <= 1e-13 * abs(v).max()
        if digits > 7:
            assert not inspect(model, prescribed=model.prescribed([]))
        u, r, status = result.displacement[0], result.reaction[0], result.status[0]
        stress = fem.stress(model.bodies[0], model.displacement_of("upper", u))
        return {
            "status": status,
            "displacement": u.reshape(-1, d) @ R,
            "force": np.einsum("cij,ci->cj", model.frame, r) @ R,
            "pressure": model.fields(u, r, status)["contact_pressure"],
            "stress": np.einsum("ai,cab,bj->cij", R, stress, R),
        }

    straight, inclined = solved(STRAIGHT[d], 0 * off, 17), solved(turn, off, digits)
    np.testing.assert_array_equal(inclined.pop("status"), straight["status"])
    assert {1, 2} <= set(straight["status"].tolist())
    for name, found in inclined.items():
        close(found, straight[name], part * (1 if name == "displacement" else 10))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("between", "pairing"),
    [
        ("plane", "match"),
        ("plane", "mortar"),
        ("bodies", "match"),
        ("bodies", "mortar"),
        ("bodies", "nodes"),
    ],
)
def test_held_nodes_that_touch(seed: int, between: str, pairing: Any) -> None:
    """However the body is turned: its gap is the rounding of coordinates, of either sign."""
    turn = Rotation.random(random_state=seed).as_matrix()
    mesh, out = fem.box([np.linspace(0, 1, 4)] * 3, "hexahedron"), turn[:, 0]
    bodies = [
        fem.Body("it", turned(mesh, turn), STEEL),
        fem.Body("beside", turned(mesh, turn, out), STEEL),
    ]
    contact = fem.Contact(
        "it", "right", 0.3, against=("beside", "left"), pairing=pairing
    )
    if between == "plane":
        del bodies[1]
        contact = replace(contact, against=None, plane=(out, -out))
    held = [fem.Support(body.name, "bottom", (0, 1, 2)) for body in bodies]
    model = fem.assemble(bodies, [contact], held)
    assert not model.gap.any()
    assert model.problem().solve(model.pressure("it", "top", 1.0)).success


def test_held_nodes_on_a_floor_that_slides_far() -> None:
    """Places in the frame of the floor have the rounding of its motion."""
    for angle in (0.1, 0.3, 0.7, 1.1):
        along, up = np.array(
            [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        )
        mesh = box("quadrilateral", 6)
        places = np.outer(along, mesh.p[0]) + np.outer(up, mesh.p[1])
        slide = Motion(translation=np.outer([370.0, 1000.0], along))
        model = fem.assemble(
            [fem.Body("it", placed(mesh, places), STEEL)],
            [
                fem.Contact(
                    "it", "bottom", 0.3, obstacle=Plane([0, 0], up), motion=slide
                )
            ],
            [fem.Support("it", "bottom", (0, 1))],
        )
        press = model.pressure("it", "top", 1.0)
        assert model.problem().solve([press, press]).success


@pytest.mark.parametrize("radius", [30.0, 3e3, 1e5])
@pytest.mark.parametrize("united", [False, True])
def test_held_nodes_that_touch_a_large_disc(radius: float, united: bool) -> None:
    """Distances have the rounding of the radius, which is larger than all coordinates."""
    disc: Any = Sphere([0.0, -radius], radius)
    obstacle = Union([disc, Sphere([50.0, 0.0], 1.0)]) if united else disc
    for cells in (5, 7, 11, 13):
        mesh = fem.box([np.linspace(0, 1, cells + 1)] * 2, "quadrilateral")
        angle, r = (mesh.p[0] - 0.5) / radius, radius + mesh.p[1]
        bent = placed(mesh, np.array([r * np.sin(angle), r * np.cos(angle) - radius]))
        model = fem.assemble(
            [fem.Body("it", bent, STEEL)],
            [fem.Contact("it", "bottom", 0.3, obstacle=obstacle)],
            [fem.Support("it", "bottom", (0, 1))],
        )
        assert not model.gap.any()
        assert model.problem().solve(model.pressure("it", "top", 1.0)).success


def test_loads_given_as_arrays_respect_an_inclined_plane() -> None:
    """The plane carries nodal forces across it, whatever program made them."""
    answers = []
    for R in (STRAIGHT[2], TURNS["plane"]):
        body = fem.Body("it", turned(box("quadrilateral"), R), STEEL)
        planes = [fem.Symmetry("it", "left"), fem.Symmetry("it", "bottom")]
        model = fem.assemble([body], [], symmetries=planes)
        force = np.zeros((len(body.points), 2))
        force[body.nodes("top")] = R @ [0.3, -1.0]
        force[body.nodes("left")] += R @ [0.5, 0.0]
        problem = model.problem()
        u = problem.solve(force.ravel()).displacement[0].reshape(-1, 2) @ R
        answers.append(u)
        if model.inclined is not None:
            # K without the planes equals that of the same bodies.
            problem.update(fem.assemble([body], []).K)
            again = problem.solve(force.ravel()).displacement[0].reshape(-1, 2) @ R
            close(again, u, 1e-10)
    close(answers[1], answers[0], 1e-10)


def test_coordinates_of_seven_digits_on_an_inclined_plane() -> None:
    """Normals have as few digits, and a component along the plane stays free."""
    rough = turned(box("hexahedron", 2), TURNS["upright"], digits=7)
    supports = [fem.Support("it", "left", (0, 1)), fem.Support("it", "bottom", (2,))]
    body, planes = fem.Body("it", rough, STEEL), [fem.Symmetry("it", "left")]
    model = fem.assemble([body], [], supports, symmetries=planes)
    values = model.prescribed([[0.0, 0.0], [0.1]])
    u = model.problem().solve(np.zeros(model.n), values).displacement[0]
    near(u.reshape(-1, 3) - [0, 0, 0.1], 0, 1e-6)


@pytest.mark.parametrize("angle", [30.0, 60.0])
def test_a_sector_of_a_ring(angle: float) -> None:
    """Two planes at an oblique angle, one along an axis, and a pressure: σ = -p, exactly."""
    mesh = fem.box([np.linspace(0, 1, 4)] * 2, "triangle")
    # Half of a square, below its diagonal, sheared to this angle.
    x, y = mesh.p
    keep = (y[mesh.t] <= x[mesh.t] + 1e-9).all(axis=0)
    end = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    places = np.array([x - y, 0 * x]) + y * end[:, None]
    wedge = type(mesh)(places, mesh.t).restrict(np.flatnonzero(keep))
    middle = wedge.p[:, wedge.facets].mean(axis=1)
    border = wedge.boundary_facets()
    on = {
        "low": np.abs(middle[1]) <= 1e-9,
        "high": np.abs(middle[0] * end[1] - middle[1] * end[0]) <= 1e-9,
    }
    named = {k: border[v[border]] for k, v in on.items()}
    named["rim"] = np.setdiff1d(border, np.concatenate(list(named.values())))
    body = fem.Body("it", fem.with_surfaces(wedge, named), STEEL)
    model = fem.assemble(
        [body], [], symmetries=[fem.Symmetry("it", "low"), fem.Symmetry("it", "high")]
    )
    problem = model.problem()
    result = problem.solve(model.pressure("it", "rim", 1.0), model.prescribed([]))
    u = result.displacement[0].reshape(-1, 2)
    # Plane strain: ε = -(1 + ν)(1 - 2ν) p/E along both axes.
    exact = -1.3 * 0.4 / STEEL.young * body.points
    close(u, exact, 1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "needs either stiffness, or normal and tangential"),
        ({"stiffness": 1.0, "normal": 2.0}, "needs either stiffness, or normal and"),
        ({"stiffness": -1.0}, "stiffness of the spring on 'top' is -1"),
        ({"normal": np.nan}, "expected finite"),
        ({"stiffness": [1.0, 2.0, 3.0]}, r"shape \(3,\), expected a number or \(2,\)"),
        ({"surface": "roof", "stiffness": 1.0}, "no surface 'roof'"),
    ],
)
def test_invalid_springs(arguments: dict[str, Any], message: str) -> None:
    with refused(message):
        spring = fem.Spring(**{"body": "it", "surface": "top"} | arguments)
        fem.assemble([block("triangle")], [], springs=[spring])
