"""Meshes rotated, in other units, far away, numbered at random; obstacles with bad facets.

The tests look for a wrong solution that is reported as converged.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bipot_rs import analytic, fem
from bipot_rs import obstacle as ob
from support.boxes import box, placed
from support.comparisons import close, near
from support.spheres import cube

Floats = NDArray[np.float64]
E, NU, P = 1000.0, 0.3, 2.0
KINDS: dict[str, tuple[str, bool | None]] = {
    "T3": ("tetrahedron", None),
    "T6": ("tetrahedron", False),
    "Q4": ("hexahedron", None),
    "Q8": ("hexahedron", True),
    "Q9": ("hexahedron", False),
}
# Named surfaces of a box above `low`, by position: its base and its top, and two sides.
SIDES: dict[str, tuple[int, float]] = {"left": (0, 0.0), "front": (1, 0.0)}


def made(
    kind: str, axes: list[Any], turn: Floats, unit: float, name: str = "it"
) -> fem.Body:
    """A box numbered at random, rotated, in other units of length; second order by kind.

    Forces keep their unit, so stresses scale with ``1/unit²``.
    """
    cell, few = KINDS[kind]
    mesh = fem.box(axes, cell)
    random = np.random.default_rng(len(axes[0]))
    order = random.permutation(mesh.p.shape[1])
    p = np.empty_like(mesh.p)
    p[:, order] = mesh.p
    cells = order[mesh.t][:, random.permutation(mesh.t.shape[1])]
    mesh = type(mesh)(p, cells)
    if few is not None:
        mesh = fem.second_order(mesh, serendipity=few)
    ends = {"bottom": (2, min(axes[2])), "top": (2, max(axes[2]))}
    named = {
        word: fem.surface(mesh, within={k: (at, at)})
        for word, (k, at) in (SIDES | ends).items()
    }
    placed = type(mesh)(unit * (turn @ mesh.p), mesh.t, named)
    return fem.Body(name, placed, fem.Material(E / unit**2, NU))


@pytest.mark.parametrize("unit", [1e-6, 1e6])
@pytest.mark.parametrize(
    ("high", "low"),
    [
        ("T6", "Q8"),
        ("Q8", "T6"),
        ("T3", "Q9"),
        ("Q4", "Q8"),
        ("Q9", "T3"),
        ("Q8", "Q9"),
    ],
)
def test_patch_turned_and_in_other_units(high: str, low: str, unit: float) -> None:
    """Two non-matching bodies on symmetry planes whose normals are not along axes."""
    turn = Rotation.random(random_state=len(high + low) + int(unit > 1)).as_matrix()
    grids, up = ([0, 0.45, 1.0], [0, 0.3, 0.7, 1.0]), np.array([0, 0.4, 1.0])
    bodies = [
        made(high, [grids[0], grids[0], up], turn, unit, "high"),
        made(low, [grids[1], grids[1], up - 1], turn, unit, "low"),
    ]
    on: Any = {"against": ("low", "top"), "pairing": "mortar"}
    planes = [fem.Symmetry(b.name, s) for b in bodies for s in ("left", "front")]
    planes.append(fem.Symmetry("low", "bottom"))
    contacts = [fem.Contact("high", "bottom", 0.5, **on)]
    model = fem.assemble(bodies, contacts, symmetries=planes)
    assert model.area.sum() == pytest.approx(unit**2, rel=1e-13)
    assert (model.area > 0).all()
    load = model.pressure("high", "top", P / unit**2)
    result = model.problem().solve(load, model.prescribed([]), tol=1e-14)
    x = model.nodes @ turn / unit
    exact = P / E * np.column_stack([NU * x[:, 0], NU * x[:, 1], -1 - x[:, 2]])
    # Some hundred unknowns: a condition of 1e3 times rounding.
    close(result.displacement[0].reshape(-1, 3) @ turn / unit, exact, 1e-12)
    assert result.traction is not None
    near(unit**2 * result.traction[0, :, 0], P, 1e-11 * P)


@pytest.mark.parametrize("kind", ["T6", "Q8"])
@pytest.mark.slow_variants("T6")
def test_hertz_turned_and_in_other_units(kind: str) -> None:
    """A rigid ball on a quarter of a block: equal to the unrotated result, close to Hertz's."""
    radius, a = 1.0, 0.1
    g = np.append(np.linspace(0, 1.4 * a, 4), 1.4 * a * np.geomspace(1, 7, 4)[1:])
    planes = [fem.Symmetry("it", s) for s in ("left", "front", "bottom")]
    results = []
    turned = Rotation.random(random_state=3).as_matrix()
    for turn, unit in ((np.eye(3), 1.0), (turned, 1e6)):
        body = made(kind, [g, g, np.sort(-g)], turn, unit)
        ball = ob.Sphere(unit * (radius - a**2 / radius) * turn[:, 2], unit * radius)
        contact = fem.Contact("it", "top", 0.0, obstacle=ball, pairing="mortar")
        model = fem.assemble([body], [contact], symmetries=planes)
        result = model.problem().solve(None, model.prescribed([]), tol=1e-12)
        force = np.einsum("cij,ci->j", model.frame, result.reaction[0]) @ turn
        u = result.displacement[0].reshape(-1, 3) @ turn / unit
        results.append((force, u, result.status[0]))
    (force, u, status), (other, v, again) = results
    close(other, force, 1e-9)
    close(v, u, 1e-9)
    np.testing.assert_array_equal(status, again)
    e_star = analytic.contact_modulus(E, NU)
    half, _, _ = analytic.hertz_sphere(-4 * force[2], radius, e_star)
    # Three facets over the contact radius, and a block ten radii deep.
    assert half == pytest.approx(a, rel=0.06)


def floor(kind: str, n: int) -> tuple[Floats, Any]:
    """``[-1, 2]²`` in z = 0 of n × n squares: one-sided, two-sided, or a slab."""
    line = np.linspace(-1, 2, n + 1)
    x = np.array([(a, b, 0.0) for a in line for b in line])
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    cells = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], -1)
    cells = cells.reshape(-1, 4)
    up = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    if kind == "sheet":
        return x, up
    if kind == "two sides":
        return x, np.concatenate([up, up[:, ::-1]])
    rim = np.concatenate([i[:, 0], i[-1, 1:], i[-2::-1, -1], i[0, -2:0:-1]])
    on, m = np.roll(rim, -1), len(x)
    sides = [np.c_[rim, rim + m, on + m], np.c_[rim, on + m, on]]
    below = np.concatenate([up, up[:, ::-1] + m, *sides])
    return np.concatenate([x, x - [0, 0, 0.5]]), below


@pytest.mark.parametrize("pairing", ["match", "mortar"])
@pytest.mark.parametrize("n", [3, 7])
@pytest.mark.parametrize("kind", ["sheet", "two sides", "slab"])
def test_a_floor_of_triangles_is_a_plane(kind: str, n: int, pairing: str) -> None:
    """Nodes of the body touch corners, edges and facets of the floor, and its edge."""
    turn = Rotation.random(random_state=n).as_matrix()
    x, facets = floor(kind, n)
    obstacles = [ob.Surface(x @ turn.T, facets), ob.Plane([0, 0, 0], turn[:, 2])]
    for lower in (0.0, -1.0):  # over the middle; and two-sided, at the edge
        grid = np.linspace(0, 1, 4)
        mesh = fem.box([grid + lower, grid + lower, grid], "hexahedron")
        body = fem.Body("it", placed(mesh, turn @ mesh.p), fem.Material(E, NU))
        answers = []
        for obstacle in obstacles:
            contact = fem.Contact(
                "it", "bottom", 0.5, obstacle=obstacle, pairing=pairing
            )
            model = fem.assemble([body], [contact])
            load = model.traction("it", "top", turn @ np.array([0.3, 0.2, -1.0]))
            answers.append((model, model.problem().solve(load, tol=1e-13)))
        (model, result), (plain, other) = answers
        near(model.gap, 0, 1e-15)
        # A dozen roundings of numbers of size 1.
        np.testing.assert_allclose(model.frame[:, 0], plain.frame[:, 0], atol=1e-14)
        close(result.displacement, other.displacement, 1e-10)
        np.testing.assert_array_equal(result.status, other.status)


@pytest.mark.parametrize("width", [1 / 3, 0.7])
@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_a_punch_of_seven_digits_has_straight_normals_at_its_edge(
    width: float, angle: float, tmp_path: Path
) -> None:
    """A block on a cube from a file: the rounded digits must not tilt the normals."""
    turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    x, facets = cube()
    lines = ["solid cube"]
    for face in (width * (x - [0, 0, 1]) @ turn.T)[facets]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{x:.6e}" for x in corner) for corner in face]
        lines += ["endloop", "endfacet"]
    file = tmp_path / "cube.stl"
    file.write_text("\n".join([*lines, "endsolid cube", ""]))
    mesh = box("hexahedron", width * np.linspace(0, 1, 4))
    block = fem.Body("block", placed(mesh, turn @ mesh.p), fem.Material(210e9, 0.3))
    top = fem.Support("block", "top", (0, 1, 2))
    forces = []
    for obstacle in (ob.Surface.from_file(file), ob.Plane((0, 0, 0), (0, 0, 1))):
        contact = fem.Contact("block", "bottom", 0.3, obstacle=obstacle)
        model = fem.assemble([block], [contact], [top])
        result = model.problem().solve(None, model.prescribed([[0, 0, -0.01 * width]]))
        forces.append(np.einsum("cij,ci->j", model.frame, result.reaction[0]))
    # Seven digits of coordinates relative to a penetration of a hundredth.
    close(forces[0], forces[1], 1e-4)
