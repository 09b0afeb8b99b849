"""Springs and planes of symmetry."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.resultants import contact_force
from bipot_rs.mesh import elements

Floats = NDArray[np.float64]
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
STEEL = fem.Material(200.0, 0.3, thickness=0.5)


# Rotations: in the plane, about a general axis in space, about a vertical axis.
TURNS = {
    "plane": Rotation.from_rotvec([0, 0, np.pi / 6]).as_matrix()[:2, :2],
    "space": Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix(),
    "upright": Rotation.from_rotvec([0, 0, np.pi / 6]).as_matrix(),
}


def block(cell: str, degree: int = 1) -> fem.Body:
    mesh = fem.box([np.linspace(0, 1, 4)] * CELLS[cell], cell)
    return fem.Body("it", mesh if degree == 1 else elements.second_order(mesh), STEEL)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_spring_resists_a_motion_by_its_stiffness(cell: str, degree: int) -> None:
    """A translation, then a rotation: force k A u, and the moment of a linear field."""
    body, d = block(cell, degree), CELLS[cell]
    depth = 0.5 if d == 2 else 1.0
    k = np.arange(1.0, d + 1) * 10
    K = fem.assemble([body], [], springs=[fem.Spring("it", "top", k)]).K
    assert (K != K.T).nnz == 0
    assert K.has_canonical_format
    assert K.indices.dtype == K.indptr.dtype == np.int32
    for axis in range(d):
        u = np.zeros((len(body.points), d))
        u[:, axis] = 2.0
        force = (K @ u.ravel()).reshape(-1, d)
        wanted = np.zeros(d)
        wanted[axis] = 2.0 * k[axis] * depth
        np.testing.assert_allclose(force.sum(axis=0), wanted, atol=1e-11)
        u[:, axis] = body.points[:, 0] * (axis != 0)
        turning = u[:, axis] @ (K @ u.ravel()).reshape(-1, d)[:, axis]
        plain = u.ravel() @ (fem.stiffness(body) @ u.ravel())
        # ∫ k x² over the top of a unit box.
        assert turning - plain == pytest.approx(
            k[axis] * depth / 3 * (axis != 0), abs=1e-11
        )


@pytest.mark.parametrize("cell", CELLS)
def test_spring_along_the_normal(cell: str) -> None:
    """On an inclined face, compared with the same stiffness in components."""
    body, d = block(cell), CELLS[cell]
    turn = np.linalg.qr(np.random.default_rng(d).normal(size=(d, d)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    mesh = type(body.mesh)(turn @ body.mesh.p, body.mesh.t, body.mesh.boundaries)
    inclined = fem.Body("it", mesh, STEEL)
    k = np.full(d, 3.0)
    k[-1] = 40.0
    straight = fem.assemble(
        [body], [], springs=[fem.Spring("it", "top", k)]
    ).K.toarray()
    spring = fem.Spring("it", "top", normal=40.0, tangential=3.0)
    other = fem.assemble([inclined], [], springs=[spring]).K
    assert (other != other.T).nnz == 0
    block_of = np.kron(np.eye(len(body.points)), turn)
    back = block_of.T @ other.toarray() @ block_of
    assert np.abs(back - straight).max() <= 1e-13 * np.abs(straight).max()


def test_block_on_springs_in_contact() -> None:
    """A punch on springs is pressed on a plane by its load.

    Lifted, the spring alone carries the load. Pressed down, plane and spring share it.
    """
    body = block("hexahedron")
    spring = fem.Spring("it", "top", stiffness=7.0)
    contact = fem.Contact(
        "it", "bottom", 0.0, plane=((0, 0, 0), (0, 0, 1)), clearance=0.01
    )
    model = fem.assemble([body], [contact], springs=[spring])
    problem = model.problem()
    up = problem.solve(model.traction("it", "top", [0.0, 0.0, 0.7]))
    assert not up.reaction.any()
    top = model.displacement_of("it", up.displacement[0])[body.nodes("top")]
    np.testing.assert_allclose(top[:, 2], 0.1, rtol=1e-9)
    down = problem.solve(model.traction("it", "top", [0.0, 0.0, -7.0]))
    # Springs at the top go down by c, and also by the shortening of the block.
    top = model.displacement_of("it", down.displacement[0])[body.nodes("top")]
    pressed = down.reaction[0, :, 0].sum()
    area = model.area
    carried = (
        7.0 * top[:, 2] @ (area / area.sum())
    )  # # all faces are divided in the same way
    assert pressed == pytest.approx(7.0 + carried, rel=1e-8)
    assert -0.1 < top[:, 2].mean() < -0.01
    assert pressed > 6.0


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_contact_areas_have_the_thickness_of_the_body(pairing: str) -> None:
    """Two plane blocks, 2 m wide and half a metre thick: 1 m² of contact."""
    axes = [np.linspace(0.0, 2.0, 5), np.linspace(0.0, 1.0, 3)]
    upper = fem.Body("upper", fem.box(axes, "quadrilateral"), STEEL)
    axes = [axes[0], axes[1] - 1.0]
    lower = fem.Body("lower", fem.box(axes, "quadrilateral"), STEEL)
    contact = fem.Contact(
        "upper", "bottom", 0.2, against=("lower", "top"), pairing=pairing
    )
    model = fem.assemble([upper, lower], [contact])
    # Sums of a few numbers.
    assert model.area.sum() == pytest.approx(1.0, rel=1e-13)
    on_a_plane = fem.Contact("lower", "bottom", 0.2, plane=((0, -1), (0, 1)))
    model = fem.assemble([lower], [on_a_plane])
    assert model.area.sum() == pytest.approx(1.0, rel=1e-13)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_half_a_body_with_symmetry_equals_the_whole(cell: str, degree: int) -> None:
    """A block pressed on a plane with friction, and its half with a plane of symmetry."""
    d = CELLS[cell]
    if degree == 2 and cell in ("tetrahedron", "triangle"):
        cell = "hexahedron" if d == 3 else "quadrilateral"
    results = []
    for low in (-1.0, 0.0):
        axes = [np.linspace(low, 1, 5 if low else 3), *[np.linspace(0, 1, 3)] * (d - 1)]
        mesh = fem.box(axes, cell)
        if cell in ("triangle", "tetrahedron"):
            # The diagonals must be mirrored too, so the half mesh is mirrored.
            right = fem.box([np.linspace(0, 1, 3), *axes[1:]], cell)
            mesh = right if not low else doubled(right)
        mesh = mesh if degree == 1 else elements.second_order(mesh)
        body = fem.Body("it", mesh, STEEL)
        n = np.eye(d)[-1]
        contact = fem.Contact("it", "bottom", 0.2, plane=(0 * n, n))
        symmetries = [] if low else [fem.Symmetry("it", "left")]
        # More pressure at the edge than in the middle: the foot spreads and slips.
        support = fem.Support("it", "top", tuple(range(1, d - 1)))
        model = fem.assemble([body], [contact], [support], symmetries=symmetries)
        load = model.traction(
            "it", "top", lambda x, n=n: -np.multiply.outer(n, 1 + x[0] ** 2)
        )
        result = model.problem().solve(
            load, model.prescribed([[0.0] * (d - 2)]), tol=1e-12
        )
        results.append((model, result))
    (whole, all_of_it), (half, part) = results
    nodes = [int(np.argmin(np.abs(whole.points - x).sum(axis=1))) for x in half.points]
    np.testing.assert_allclose(whole.points[nodes], half.points, atol=1e-14)
    middle = half.points[:, 0] == 0
    share = np.where(middle, 0.5, 1.0)
    np.testing.assert_allclose(half.area, whole.area[nodes] * share, rtol=1e-13)
    normal = all_of_it.reaction[0, nodes, 0] * share
    scale = normal.max()
    np.testing.assert_allclose(part.reaction[0, :, 0], normal, atol=1e-7 * scale)
    np.testing.assert_allclose(
        part.reaction[0, ~middle, 1:],
        all_of_it.reaction[0, nodes][~middle, 1:],
        atol=1e-7 * scale,
    )
    assert 1 in part.status[0]


@pytest.mark.parametrize(
    "turn", [np.eye(3), TURNS["space"]], ids=["straight", "turned"]
)
def test_half_a_mortar_joint_equals_the_whole(turn: Floats) -> None:
    """Facets at the plane are halves: what they move across it cancels in the whole joint."""
    forces, displacements = [], []
    for low in (-1.0, 0.0):

        def body(
            name: str, x: Floats, cells: int, z: list[float], low: float = low
        ) -> Any:
            y = np.linspace(low, 1, cells * (2 if low else 1) + 1)
            mesh = turned(fem.box([x, y, np.array(z)], "hexahedron"), turn)
            return fem.Body(name, mesh, fem.Material(10.0, 0.3))

        bodies = [
            body("lower", np.linspace(0, 2, 5), 3, [0.0, 0.5]),
            body("upper", np.linspace(0.3, 2.4, 4), 2, [0.5, 0.75, 1.0]),
        ]
        contact = fem.Contact(
            "upper", "bottom", 0.2, against=("lower", "top"), pairing="mortar"
        )
        planes = [] if low else [fem.Symmetry(b.name, "front") for b in bodies]
        ends = [("lower", "left"), ("upper", "right")]
        supports = [fem.Support(*end, (0, 1, 2)) for end in ends]
        model = fem.assemble(bodies, [contact], supports, symmetries=planes)
        x, y, z = turn.T

        def pressed(at: Floats, y: Floats = y, z: Floats = z) -> Floats:
            return np.multiply.outer(-0.02 * z, 1 + np.tensordot(y, at, 1) ** 2)

        load = model.traction("upper", "top", pressed)
        values = model.prescribed([np.zeros(3), 1e-2 * x])
        result = model.problem().solve(load, values, tol=1e-12)
        at, moved = [], []
        for b in bodies:
            at.append(b.points @ turn)
            moved.append(model.displacement_of(b.name, result.displacement[0]) @ turn)
        force = np.einsum("cij,ci->cj", model.frame, result.reaction[0]) @ turn
        middle = abs(model.points @ y) < 1e-12
        force *= np.where(middle & (low < 0), 0.5, 1.0)[:, None]
        places = [model.points @ turn, *at]
        order = [np.lexsort(p[p[:, 1] > -1e-9].round(9).T) for p in places]
        fields = [
            v[p[:, 1] > -1e-9][o]
            for v, p, o in zip([force, *moved], places, order, strict=True)
        ]
        forces.append(fields[0])
        displacements.append(np.vstack(fields[1:]))
        assert {1, 2} <= set(result.status[0].tolist())
    for whole, half in (forces, displacements):
        # η of 1e-12 with a condition of 10³.
        np.testing.assert_allclose(half, whole, rtol=0, atol=1e-9 * abs(whole).max())


def doubled(right: object) -> object:
    """A mesh and its mirror image about x = 0 as one mesh, with ``bottom`` and ``top``."""
    p, t = right.p, right.t
    mirrored = p * np.array([-1.0] + [1.0] * (len(p) - 1))[:, None]
    both = np.hstack([p, mirrored])
    _, first, which = np.unique(
        (both + 0.0).round(9), axis=1, return_index=True, return_inverse=True
    )
    cells = which.ravel()[np.hstack([t, t + p.shape[1]])]
    mesh = type(right)(both[:, first], cells)
    return mesh.with_boundaries(
        {
            "bottom": fem.surface(mesh, within={len(p) - 1: (0, 0)}),
            "top": fem.surface(mesh, within={len(p) - 1: (1, 1)}),
        }
    )


def test_supports_and_symmetries_that_disagree() -> None:
    body = block("triangle")
    support = fem.Support("it", "left", (0,))
    model = fem.assemble([body], [], [support], symmetries=[fem.Symmetry("it", "left")])
    assert len(model.fixed) == len(body.nodes("left"))
    np.testing.assert_array_equal(model.prescribed([[0.0]]), 0.0)
    with pytest.raises(ValueError, match=r"prescribe both .* component 0 .*'left'"):
        model.prescribed([[0.1]])
    with pytest.raises(
        ValueError, match="values has 2 entries, expected one for each of the 1"
    ):
        model.prescribed([[0.0], [0.0]])


def turned(
    mesh: Any, turn: np.ndarray, off: float | NDArray[Any] = 0.0, digits: int = 17
) -> Any:
    p = (turn @ mesh.p + np.reshape(off, (-1, 1))).round(digits)
    return type(mesh)(p, mesh.t, mesh.boundaries, mesh.subdomains)


# Distance from the origin, decimals of coordinates, and the allowed difference from the
# unrotated body: η of 1e-13 with a condition of about 1e3; or 1e-7 of coordinates relative
# to displacements of 1e-3.
PLACES = {"": (0.0, 17, 1e-9), "far": (100.0, 17, 1e-9), "seven": (0.0, 7, 1e-4)}


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
    far, digits, close = PLACES[place]
    d = len(turn)
    off = far * np.array([1.0, -0.3, 0.2])[:d]
    cell = "hexahedron" if d == 3 else "quadrilateral"
    models, results = [], []
    for R in (np.eye(d), turn):
        at = (off, digits) if R is turn else (0 * off,)
        axes = [np.linspace(0, 1, 4)] * d
        upper = turned(fem.box(axes, cell), R, *at)
        wide = [np.linspace(0, 1, 3)] * (d - 1)
        lower = turned(fem.box([*wide, np.linspace(-0.5, 0, 2)], cell), R, *at)
        bodies = [fem.Body("upper", upper, STEEL), fem.Body("lower", lower, STEEL)]
        up = R[:, -1]
        if pairing == "mortar":
            contact = fem.Contact(
                "upper", "bottom", 0.3, against=("lower", "top"), pairing="mortar"
            )
            sides = [(b, s) for b in ("upper", "lower") for s in ("left", "front")]
        else:
            bodies = bodies[:1]
            contact = fem.Contact("upper", "bottom", 0.3, plane=(at[0], up))
            sides = [("upper", "left"), ("upper", "front")]
        sides = [(b, s) for b, s in sides if s in upper.boundaries]
        planes = [fem.Symmetry(*side) for side in sides]
        if pairing == "mortar":
            planes.append(fem.Symmetry("lower", "bottom"))
        model = fem.assemble(bodies, [contact], symmetries=planes)
        out = R[:, 0]
        load = model.traction(
            "upper",
            "top",
            lambda x, up=up, out=out, begin=out @ at[0]: (
                np.multiply.outer(-up, 1 + (np.tensordot(out, x, 1) - begin) ** 2)
                + 0.1 * np.multiply.outer(out, 1 + 0 * x[0])
            ),
        )
        load += model.initial_strain("upper", 1e-3 * np.eye(d))
        values = model.prescribed([])
        results.append(model.problem().solve(load, values, tol=1e-13))
        models.append(model)
    (straight, inclined), (straight_result, other) = models, results
    assert straight.inclined is None
    assert inclined.inclined is not None
    assert abs(inclined.K - inclined.K.T).max() == 0
    u, v = (r.displacement[0].reshape(-1, d) for r in results)
    scale = abs(u).max()
    np.testing.assert_allclose(v, u @ turn.T, rtol=0, atol=close * scale)
    assert abs(inclined.inclined.normals.T @ v.ravel()).max() <= 1e-13 * scale
    force = [
        np.einsum("cij,ci->cj", m.frame, r.reaction[0])
        for m, r in zip(models, results, strict=True)
    ]
    largest = abs(force[0]).max()
    np.testing.assert_allclose(
        force[1], force[0] @ turn.T, rtol=0, atol=10 * close * largest
    )
    np.testing.assert_array_equal(straight_result.status, other.status)
    assert {1, 2} <= set(straight_result.status.ravel().tolist())
    fields = [
        m.fields(r.displacement[0], r.reaction[0], r.status[0])
        for m, r in zip(models, results, strict=True)
    ]
    pressure = [f["contact_pressure"] for f in fields]
    np.testing.assert_allclose(
        pressure[1], pressure[0], rtol=0, atol=10 * close * abs(pressure[0]).max()
    )
    stress = [
        fem.stress(m.bodies[0], m.displacement_of("upper", r.displacement[0]))
        for m, r in zip(models, results, strict=True)
    ]
    np.testing.assert_allclose(
        stress[1],
        np.einsum("ia,cab,jb->cij", turn, stress[0], turn),
        rtol=0,
        atol=10 * close * abs(stress[0]).max(),
    )
    for model in models if digits > 7 else ():
        assert not inspect(model, prescribed=model.prescribed([]))


def test_loads_given_as_arrays_respect_an_inclined_plane() -> None:
    """The plane carries nodal forces across it, whatever program made them."""
    turn = TURNS["plane"]
    mesh = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
    answers = []
    for R in (np.eye(2), turn):
        body = fem.Body("it", turned(mesh, R), STEEL)
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
            np.testing.assert_allclose(again, u, rtol=0, atol=1e-10 * abs(u).max())
    scale = abs(answers[0]).max()
    np.testing.assert_allclose(answers[1], answers[0], rtol=0, atol=1e-10 * scale)


def test_coordinates_of_seven_digits_on_an_inclined_plane() -> None:
    """Normals have as few digits, and a component along the plane stays free."""
    mesh = fem.box([np.linspace(0, 1, 3)] * 3, "hexahedron")
    rough = type(mesh)((TURNS["upright"] @ mesh.p).round(7), mesh.t, mesh.boundaries)
    body = fem.Body("it", rough, STEEL)
    supports = [
        fem.Support("it", "left", (0, 1)),
        fem.Support("it", "bottom", (2,)),
    ]
    model = fem.assemble([body], [], supports, symmetries=[fem.Symmetry("it", "left")])
    values = model.prescribed([[0.0, 0.0], [0.1]])
    result = model.problem().solve(np.zeros(model.n), values)
    u = result.displacement[0].reshape(-1, 3)
    np.testing.assert_allclose(u, np.tile([0, 0, 0.1], (27, 1)), rtol=0, atol=1e-6)


def test_a_scene_with_inclined_planes_of_symmetry(tmp_path: Path) -> None:
    """The forces and stresses of the block from the test in the plane, rotated, by a file."""
    turn = TURNS["plane"]
    steps = []
    for name, R in (("straight", np.eye(2)), ("turned", turn)):
        mesh = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
        x = mesh.p.T @ R.T
        lines = [
            "*NODE",
            *(f"{k}, {a!r}, {b!r}" for k, (a, b) in enumerate(x.tolist(), 1)),
        ]
        lines.append("*ELEMENT, TYPE=CPE4, ELSET=ALL")
        lines += [
            ", ".join(map(str, [k, *(cell + 1)])) for k, cell in enumerate(mesh.t.T, 1)
        ]
        body = fem.Body("it", mesh, STEEL)
        for word in ("left", "bottom", "top"):
            lines += [f"*NSET, NSET={word}", *(str(n + 1) for n in body.nodes(word))]
        (tmp_path / f"{name}.inp").write_text("\n".join(lines))
        m = bp.Model(title=name)
        m.material("steel", young=200.0, poisson=0.3)
        m.body("it", mesh=str(tmp_path / f"{name}.inp"), material="steel")
        m.symmetry("it.left")
        push, up = (R @ [0.1, -1.0]).tolist(), R[:, 1].tolist()
        m.traction("it.top", x=push[0], y=push[1])
        m.contact("it.bottom", mu=0.2, plane={"point": [0.0, 0.0], "normal": up})
        case = m.assemble()
        result = case.solve(tol=1e-13)
        file = tmp_path / f"{name}.h5"
        assert result.displacement.any()  # which saves it
        result.save(file)
        again = bp.load(file)
        assert (case.model.inclined is None) == (name == "straight")
        force = contact_force(case.model, result, "it.bottom")[0]
        u = again[0].displacement.reshape(-1, 2)
        steps.append((u, force))
    (u, force), (v, other) = steps
    np.testing.assert_allclose(v, u @ turn.T, rtol=0, atol=1e-10 * abs(u).max())
    np.testing.assert_allclose(
        other, turn @ force, rtol=0, atol=1e-10 * abs(force).max()
    )
    assert force[1] == pytest.approx(1.0, rel=1e-10)


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
    np.testing.assert_allclose(u, exact, rtol=0, atol=1e-12 * abs(exact).max())


def test_invalid_symmetries() -> None:
    mesh = block("quadrilateral").mesh
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    inclined = fem.Body("it", type(mesh)(turn @ mesh.p, mesh.t, mesh.boundaries), STEEL)
    plane = [fem.Symmetry("it", "left")]
    held = fem.assemble(
        [inclined], [], [fem.Support("it", "left", (0,))], symmetries=plane
    )
    assert not held.prescribed([[0.0]]).any()
    with pytest.raises(
        ValueError, match=r"move the node at \(0, 0\) by 0\.08 across its plane"
    ):
        held.prescribed([[0.1]])
    p = mesh.p.copy()
    p[0] += 0.1 * p[1] ** 2
    bent = fem.Body("it", type(mesh)(p, mesh.t, mesh.boundaries), STEEL)
    with pytest.raises(
        ValueError, match="the surface is not plane, its nodes lie up to"
    ):
        fem.assemble([bent], [], symmetries=[fem.Symmetry("it", "left")])
    with pytest.raises(ValueError, match="no body 'that'"):
        fem.assemble([bent], [], symmetries=[fem.Symmetry("that", "left")])


def test_invalid_springs() -> None:
    with pytest.raises(
        ValueError, match="needs either stiffness, or normal and tangential"
    ):
        fem.Spring("it", "top")
    with pytest.raises(
        ValueError, match="needs either stiffness, or normal and tangential"
    ):
        fem.Spring("it", "top", 1.0, normal=2.0)
    with pytest.raises(ValueError, match="stiffness of the spring on 'top' is -1"):
        fem.Spring("it", "top", -1.0)
    with pytest.raises(ValueError, match="expected finite"):
        fem.Spring("it", "top", normal=np.nan)
    body = block("triangle")
    with pytest.raises(ValueError, match=r"shape \(3,\), expected a number or \(2,\)"):
        fem.assemble([body], [], springs=[fem.Spring("it", "top", [1.0, 2.0, 3.0])])
    with pytest.raises(ValueError, match="no surface 'roof'"):
        fem.assemble([body], [], springs=[fem.Spring("it", "roof", 1.0)])


@pytest.mark.parametrize(
    ("within", "said"),
    [
        ({0: (20.0, 50.0)}, "has no nodes: within excludes all"),
        ({0: (0.5, 0.2)}, "expected .* with low <= high"),
        ({5: (0.0, 1.0)}, "has axis 5, expected one of"),
    ],
)
def test_support_without_nodes(within: dict[int, Any], said: str) -> None:
    """A range in wrong units, or with exchanged ends, is not the same as no support."""
    body = block("quadrilateral")
    with pytest.raises(ValueError, match=said):
        fem.assemble([body], [], [fem.Support(body.name, "top", (0,), within)])
