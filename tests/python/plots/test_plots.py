"""Pictures show the numbers of the result with units, and are readable."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy import sparse
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import cKDTree

import bipot_rs as bp
from bipot_rs import fem, plots, scene
from bipot_rs.fem.bodies.stress_recovery import stress, von_mises
from bipot_rs.fem.contact_surface import contact_surface
from bipot_rs.plots import triangles
from bipot_rs.plots.space_axes import project_box
from bipot_rs.plots.surface import span
from bipot_rs.plots.triangles import sharp_edges, skin
from support.children import child
from support.layout import overlaps
from support.masonry import assemble, box

UNITS = {"length": "mm", "force": "N", "stress": "MPa"}


def solved(name: str, *settings: str) -> tuple[fem.Assembly, bp.Result]:
    read = scene.read(name, settings)
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed)
    result.units = read.units.model_dump()
    return case.model, result


def solved_scene(name: str, *settings: str) -> Any:
    return pytest.fixture(scope="module")(lambda: solved(name, *settings))


line = solved_scene("cattaneo_mindlin", "mesh.n=4")
cube = solved_scene("sheared_cube", "mesh.n=7")
cycle = solved_scene("cyclic_cube", "mesh.n=3", "support.0.x.value=0.07")


@pytest.fixture(scope="module")
def worn(line: Any) -> tuple[fem.Assembly, bp.Result]:
    """Ends of cycles of the same contact, dragged to and fro."""
    model, result = line
    press, shear = (step.prescribed for step in result)
    cycle = [shear, 2 * press - shear]
    wear = model.problem().wear(prescribed=cycle, coefficient=1e-5, cycles=40)
    wear.ends.units = result.units
    return model, wear.ends


@pytest.fixture(scope="module")
def decided(line: Any) -> tuple[fem.Assembly, Any]:
    return line[0], dissipation_gradient(line[1])


@pytest.fixture(scope="module")
def decided_in_space(cube: Any) -> tuple[fem.Assembly, Any]:
    return cube[0], dissipation_gradient(cube[1])


@pytest.fixture(scope="module")
def stacked() -> tuple[None, Any]:
    """Two blocks on the ground."""
    ground = box("ground", (-9, -1), (9, 0), support=True)
    tower = [box("a", (0, 0), (2, 2)), box("b", (0, 2), (2, 4))]
    return None, assemble([ground, *tower], 0.5)


def dissipation_gradient(result: bp.Result) -> Any:
    """The gradient of the energy that friction dissipates."""
    bar = np.zeros_like(result.reaction)
    bar[:, :, 1:] = -result.slip
    return result.vjp(reaction=bar, slip=-result.reaction[:, :, 1:])


def drawn_lines(ax: Any) -> dict[str, Any]:
    return {it.get_label(): np.stack(it.get_data(), axis=-1) for it in ax.get_lines()}


def arrows_of(ax: Any) -> Any:
    (quiver,) = (it for it in ax.collections if isinstance(it, Quiver))
    return quiver


def cells_of(ax: Any) -> Any:
    """The cells of bodies in the plane, and then the bands of obstacles."""
    return [it for it in ax.collections if type(it) is PolyCollection]


def test_tractions_are_those_of_the_result(line: Any) -> None:
    model, result = line
    ax = plots.tractions(result)
    assert ax.get_xlabel() == "x [mm]"
    assert ax.get_ylabel() == "traction [MPa]"
    order = np.argsort(model.points[:, 0])
    traction = result.traction[-1][order]
    curves = drawn_lines(ax)
    np.testing.assert_array_equal(curves["pressure"][:, 0], model.points[order, 0])
    np.testing.assert_array_equal(curves["pressure"][:, 1], traction[:, 0])
    np.testing.assert_array_equal(curves["shear"][:, 1], traction[:, 1])
    np.testing.assert_array_equal(curves["±μ × pressure"][:, 1], 0.3 * traction[:, 0])
    (strip,) = (c for c in ax.collections if c.get_array() is not None)
    np.testing.assert_array_equal(np.ravel(strip.get_array()), result.status[-1][order])
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert f"slip ({int(np.sum(result.status[-1] == 1))})" in texts
    # Above the curves, as the strip is below.
    low = min(traction.min(), -0.3 * traction[:, 0].max())
    bottom, top = ax.get_ylim()
    assert (low - bottom) / (top - bottom) > 0.04


def test_an_earlier_step_and_a_part(line: Any) -> None:
    model, result = line
    right = model.points[:, 0] > 0
    ax = plots.tractions(result, step=0, on=right)
    drawn = drawn_lines(ax)["pressure"]
    np.testing.assert_array_equal(drawn[:, 1], result.traction[0][right][:, 0])
    again = plots.tractions(result[0], on=np.flatnonzero(right), contacts=model)
    np.testing.assert_array_equal(drawn_lines(again)["pressure"], drawn)
    # A step does not know its units.
    assert again.get_ylabel() == "traction"


def test_a_line_on_a_surface(cube: Any) -> None:
    model, result = cube
    middle = np.isclose(model.points[:, 1], np.unique(model.points[:, 1])[3])
    ax = plots.tractions(result, along=[2.0, 0, 0], on=middle)
    order = np.flatnonzero(middle)[np.argsort(model.points[middle, 0])]
    shear = np.einsum("ck,ckd->cd", result.traction[-1][:, 1:], model.frame[:, 1:])
    np.testing.assert_allclose(drawn_lines(ax)["shear"][:, 1], shear[order, 0])


def test_friction_by_direction_has_its_own_limit() -> None:
    """Along t1 the limit is the first coefficient, along t2 the second."""
    x = np.stack([np.arange(4.0), np.arange(4.0), np.zeros(4)], axis=1)
    frame = fem.frames(np.tile([0.0, 0, 1], (4, 1)))
    K, B = np.eye(12), np.eye(12)
    load, mu = np.tile([-2.0, 0.1, 0.1], 4), np.tile([0.2, 0.6], (4, 1))
    result = bp.solve(K, B, load, gap=np.zeros(4), mu=mu, points=x, frame=frame)
    for k, axis in ((0, [1.0, 0, 0]), (1, [0, 1.0, 0])):
        ax = plots.tractions(result, along=axis)
        limit = drawn_lines(ax)["±μ × pressure"][:, 1]
        np.testing.assert_allclose(limit, 2.0 * mu[0, k], rtol=1e-9)


def test_cohesion_adds_to_the_limit_until_it_breaks() -> None:
    x = np.stack([np.arange(3.0), np.zeros(3)], axis=1)
    load = [-2.0, 0.1, -2.0, 0.1, 1.0, 0.0]
    law = {"gap": np.zeros(3), "mu": 0.5, "cohesion": [1.0, 2.0, 3.0]}
    places = {"points": x, "frame": np.tile(np.eye(2)[::-1], (3, 1, 1))}
    result = bp.solve(np.eye(6), np.eye(6), load, area=[1.0, 4.0, 1.0], **law, **places)
    ax = plots.tractions(result)
    limit = drawn_lines(ax)["±(c + μ × pressure)"][:, 1]
    np.testing.assert_allclose(limit, [2.0, 0.75, 0.0], rtol=1e-9)
    (band,) = plots.resultants(result).collections
    top = band.get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(2.0 + 4 * 0.75, rel=1e-9)


def test_slip_along_a_line(line: Any) -> None:
    model, result = line
    ax = plots.slip(result)
    order = np.argsort(model.points[:, 0])
    v = ax.get_lines()[0].get_ydata()
    status = result.status[-1][order]
    # Open contacts do not slip, and the slip of sticking ones is rounding.
    assert set(status) == {0, 1, 2}
    exact = np.choose(status, [np.nan, result.slip[-1][order, 0], 0.0])
    np.testing.assert_array_equal(v, exact)
    # A power of 1000 is written with the unit, and ticks are multiples of it.
    assert ax.get_ylabel() == "slip in the step [10⁻⁶ mm]"
    assert ax.yaxis.get_major_formatter()(-2e-4) == "−200"


def test_zones_over_the_path(line: Any) -> None:
    model, result = line
    order = np.argsort(model.points[:, 0])
    ax = plots.status_map(result)
    zones = ax.collections[0].get_array().reshape(len(result), -1)
    np.testing.assert_array_equal(zones, result.status[:, order])
    assert ax.get_ylabel() == "load step"
    zones = plots.status_map(result, step=0).collections[0].get_array()
    np.testing.assert_array_equal(np.ravel(zones), result.status[0][order])


@pytest.mark.parametrize(
    ("quantity", "label"),
    [
        ("pressure", "pressure [MPa]"),
        ("shear", "shear traction [MPa]"),
        ("slip", "slip in the step [10"),
        ("gap", None),
    ],
)
def test_maps_are_those_of_the_result(
    cube: Any, quantity: str, label: str | None
) -> None:
    model, result = cube
    last = result[-1]
    exact = {
        "pressure": last.traction[:, 0],
        "shear": np.linalg.norm(last.traction[:, 1:], axis=1),
        "slip": (last.status == bp.Status.SLIP) * np.linalg.norm(last.slip, axis=1),
        "gap": np.where(last.status == 0, last.relative_displacement[:, 0], 0),
    }[quantity]
    ax = plots.surface_map(result, quantity, arrows=False)
    # On the square of 100 mm, in the rectangles of its mesh, each of two triangles.
    values = np.zeros((8, 8))
    at = np.rint(model.points[:, :2] / (100 / 7)).astype(int)
    values[at[:, 0], at[:, 1]] = exact
    polygons, shown = pieces_of(ax)
    assert area_of(polygons) == pytest.approx(100.0**2, rel=1e-9)
    # The mean of the corners is not the value at the centre of the collapsed pieces.
    grid = np.arange(8) * 100 / 7
    whole = RegularGridInterpolator((grid, grid), values)(polygons.mean(axis=1))
    slope = np.abs(np.diff(values, axis=0)).max() + np.abs(np.diff(values)).max()
    assert np.abs(shown - whole).max() <= 0.3 * slope + 1e-15
    assert [shown.min(), shown.max()] == pytest.approx(
        [values.min(), values.max()], abs=0.2 * slope
    )
    assert ax.get_xlabel() == "x [mm]"
    assert ax.get_title("left") == "load step 2 of 2"
    if label is None:
        # All contacts are closed: a text says so, and no colour bar is needed.
        assert not ax.child_axes
        assert [t.get_text() for t in ax.texts] == ["all contacts are closed"]
    else:
        (bar,) = ax.child_axes
        assert bar.get_ylabel().startswith(label)


def pieces_of(ax: Any) -> tuple[Any, Any]:
    """Corners ``(p, 4, 2)`` of the pieces of a map, and the values that they show."""
    (map_drawn,) = cells_of(ax)
    corners = [path.vertices[:4] for path in map_drawn.get_paths()]
    return np.array(corners), np.asarray(map_drawn.get_array())


def area_of(polygons: Any) -> float:
    """Sum of the areas of quadrilaterals ``(p, 4, 2)``, of any orientation."""
    (a, b), (c, d) = (polygons[:, k + 2].T - polygons[:, k].T for k in (0, 1))
    return float(np.abs(a * d - b * c).sum() / 2)


def test_arrows_have_the_direction_of_shear_and_the_length_of_slip(cube: Any) -> None:
    model, result = cube
    shear, slip = (
        np.einsum("ck,ckd->cd", local, model.frame[:, 1:])[:, :2]
        for local in (result[-1].traction[:, 1:], result[-1].slip)
    )
    for ax, drawn in (
        (
            plots.surface_map(result, "shear"),
            shear / np.linalg.norm(shear, axis=1, keepdims=True),
        ),
        (plots.slip(result), slip),
    ):
        arrows = arrows_of(ax)
        _, at = cKDTree(model.points[:, :2]).query(arrows.XY)
        vectors = np.column_stack([arrows.U, arrows.V])
        np.testing.assert_allclose(vectors, drawn[at], rtol=1e-9, atol=1e-12)
    # The largest slip of all is drawn, with the last colour.
    size = np.linalg.norm(slip, axis=1)
    np.testing.assert_array_equal(arrows.get_array(), size[at])
    assert arrows.get_array().max() == size.max() == arrows.get_clim()[1]


def test_zones_of_a_surface_are_those_of_the_nearest_node(cube: Any) -> None:
    model, result = cube
    polygons, shown = pieces_of(plots.status_map(result))
    assert area_of(polygons) == pytest.approx(100.0**2, rel=1e-9)
    far, nearest = cKDTree(model.points[:, :2]).query(polygons.mean(axis=1))
    assert (far < 0.5 * 100 / 7).all()
    np.testing.assert_array_equal(shown, result.status[-1][nearest])


def sheet(stretch: float, hole: bool) -> tuple[bp.Solution, dict[str, Any]]:
    """Closed contacts on 12 × 12 cells stretched along x, with 6 × 6 of them left out."""
    at = np.array([(x, y) for x in range(13) for y in range(13)])
    share = np.zeros((13, 13))
    for x, y in np.ndindex(12, 12):
        if not (hole and 3 <= x < 9 and 3 <= y < 9):
            share[x : x + 2, y : y + 2] += stretch / 4
    kept = share.ravel() > 0
    x = np.column_stack([stretch * at[kept, 0], at[kept, 1], np.zeros(kept.sum())])
    solution, contacts = pressed_flat(x, np.ones(len(x)))
    return solution, contacts | {"area": share.ravel()[kept]}


def pressed_flat(x: Any, pressure: Any) -> tuple[bp.Solution, dict[str, Any]]:
    """Contacts on springs of their own in the plane of x and y, with these forces."""
    q = np.stack([-pressure, 0 * pressure, 0 * pressure], axis=1)
    solution = bp.ReducedProblem(sparse.eye_array(q.size), q, 0.3).solve()
    return solution, {"x": x, "frame": fem.frames(np.tile([0.0, 0, 1], (len(x), 1)))}


@pytest.mark.parametrize("areas", [True, False])
@pytest.mark.parametrize("stretch", [1.0, 3.0, 40.0])
@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.quick_variants("True-40.0-True", "True-1.0-False", "False-40.0-False")
def test_only_holes_are_blank(stretch: float, hole: bool, areas: bool) -> None:
    """Without facets, by the areas of the contacts, or by the points alone."""
    solution, contacts = sheet(stretch, hole)
    if not areas:
        del contacts["area"]
    drawn, _ = pieces_of(plots.surface_map(solution, contacts=contacts))
    blank = 1 - area_of(drawn) / (144 * stretch)
    # At the hole, a quarter of the surface, the corners may be cut off; without areas,
    # half of it.
    least, most = ((0.2 if areas else 0.12), 0.25) if hole else (0.0, 0.0)
    assert least - 1e-9 <= blank <= most + 1e-9
    zones, _ = pieces_of(plots.status_map(solution, contacts=contacts))
    assert area_of(zones) == pytest.approx(area_of(drawn), rel=1e-12)


def graded() -> tuple[bp.Solution, dict[str, Any]]:
    """Contacts on 30 × 30 cells that grow by 1.4 from the edges; ten times the pressure there."""
    size = 1.4 ** np.minimum(np.arange(30), 29 - np.arange(30))
    grid = np.concatenate([[0.0], np.cumsum(size)]) / size.sum()
    share = np.convolve(np.diff(grid), [0.5, 0.5])
    u, v = (a.ravel() for a in np.meshgrid(grid, grid))
    area = np.outer(share, share).ravel()
    rim = (np.abs(u - 0.5) == 0.5) | (np.abs(v - 0.5) == 0.5)
    pressure = np.where(rim, 10.0, 1 - 0.5 * (u**2 + v**2))
    solution, contacts = pressed_flat(np.column_stack([u, v, 0 * u]), pressure * area)
    first = (31 * np.arange(30)[:, None] + np.arange(30)).ravel()
    return solution, contacts | {
        "area": area,
        "facets": first[:, None] + [0, 1, 32, 31],
    }


def colours_of(ax: Any) -> Any:
    """Colours ``(k, 3)`` of 8 bits inside the frame of axes, as they are drawn."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(ax.figure)
    canvas.draw()
    box = ax.get_window_extent()
    # Without the lines of the frame.
    (left, low), (right, top) = np.rint([box.min + 3, box.max - 3]).astype(int)
    drawn = np.asarray(canvas.buffer_rgba())[::-1][low:top, left:right, :3]
    return np.unique(drawn.reshape(-1, 3), axis=0)


@pytest.mark.slow
def test_maps_of_graded_cells_are_whole_and_in_the_colours_of_the_bar() -> None:
    """Cells of an aspect ratio up to 111, with facets, with areas, and without both."""
    solution, contacts = graded()
    for left_out in ((), ("facets",), ("area",)):
        for name in left_out:
            del contacts[name]
        ax = plots.surface_map(solution, contacts=contacts)
        assert area_of(pieces_of(ax)[0]) == pytest.approx(1.0, rel=1e-9)
        zones = plots.status_map(solution, contacts=contacts)
        assert area_of(pieces_of(zones)[0]) == pytest.approx(1.0, rel=1e-9)
        (image,) = cells_of(ax)
        bar = np.unique(image.cmap(np.arange(256), bytes=True)[:, :3], axis=0)
        drawn = colours_of(ax)
        assert len(drawn) > 50
        assert (drawn[:, None] == bar).all(axis=2).any(axis=1).all()
        if "area" in contacts:
            # The pressure of 10 at the edges, on 0.4 % of the area, is beyond the bar.
            assert 0.95 < image.get_clim()[1] <= 1.0


def test_colours_cover_the_same_part_of_the_area_on_any_mesh() -> None:
    """99 % of the nodes are on the tenth of the area with the large values."""
    values = np.concatenate([np.full(10, 1.0), np.linspace(2, 3, 990)])
    area = np.concatenate([np.full(10, 9.0), np.full(990, 10 / 990)])
    low, high, beyond = span(values, "pressure", area)
    # 90 % of the area has the value 1, and 8 of the other 10 % are below 2.8.
    assert (low, beyond) == (0.0, "max")
    assert high == pytest.approx(2.8, abs=2e-3)
    assert span(values, "pressure", None)[1] == pytest.approx(2.98, abs=2e-3)


@pytest.mark.parametrize("nodes", [3, 4, 6, 8, 9])
def test_facets_of_every_kind_are_drawn_whole(nodes: int) -> None:
    """Of one facet the triangles cover all, and have one orientation."""
    corners = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])
    corners = corners[:3] if nodes in (3, 6) else corners
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    at = np.concatenate([corners, middles, corners.mean(axis=0)[None]])[:nodes]
    facet = triangles.split(triangles.check_facets(np.arange(nodes)[None], nodes))
    (a, b), (c, d) = (at[facet[:, k]].T - at[facet[:, 0]].T for k in (1, 2))
    area = (a * d - b * c) / 2
    assert (area > 0).all()
    assert area.sum() == pytest.approx(2.0 if nodes not in (3, 6) else 1.0)


def test_a_part_of_the_facets_has_new_numbers() -> None:
    facets = triangles.check_facets([[0, 1, 4, 3], [1, 2, 4, -1]], 5)
    facets_of_part = triangles.part(facets, np.array([4, 2, 1]), 5)
    np.testing.assert_array_equal(facets_of_part, [[2, 1, 0, -1]])
    np.testing.assert_array_equal(triangles.alone(facets[1:], 5), [0, 3])


def test_wrong_facets_are_named() -> None:
    for facets, said in (
        ([[0, 1]], "3, 4, 6, 8 or 9 nodes"),
        ([[0, -1, 1, 2]], "-1 only after them"),
        ([[0, 1, 3]], "expected numbers from 0 to 2"),
        ([[0.0, 1.0, 2.0]], "expected rows of integers"),
    ):
        with pytest.raises(ValueError, match=said):
            triangles.check_facets(facets, 3)


@pytest.mark.parametrize("near", [None, 0.5])
def test_deformed_bodies(line: Any, near: float | None) -> None:
    model, result = line
    ax = plots.deformed(model, result, scale=3.0, near=near)
    (cells,) = cells_of(ax)
    u = result[-1].displacement
    places = model.nodes + 3.0 * u.reshape(-1, 2)
    corners = np.concatenate([c for _, c in model.cells])
    drawn = np.array([path.vertices[:4] for path in cells.get_paths()])
    np.testing.assert_array_equal(drawn, places[corners])
    half = model.offset[1]
    upper = von_mises(stress(model.bodies[0], u[:half], space=True))
    np.testing.assert_array_equal(cells.get_array()[: len(upper)], upper)
    longest = np.linalg.norm(result[-1].reaction, axis=1).max()
    title = f"displacements × 3, forces up to {longest:.3g} N, load step 2 of 2"
    assert ax.get_title("left") == title
    # Arrows end at contact nodes and add up to a part of the contact force.
    arrows = arrows_of(ax)
    assert cKDTree(places[model.contact_dofs[:, 0] // 2]).query(arrows.XY)[0].max() == 0
    assert (arrows.V > 0).all()
    assert ax.get_aspect() == 1


@pytest.mark.parametrize("obstacle", ["rests", "moves", "is pushed"])
@pytest.mark.slow_variants("moves")
def test_rigid_obstacles_are_drawn_as_contacts_see_them(obstacle: str) -> None:
    m = bp.Model("A block pressed onto a cylinder")
    m.material("soft", young=1.0, poisson=0.3)
    sides = {"x": np.linspace(-1.0, 1.0, 21), "y": np.linspace(0.0, 0.5, 6)}
    m.body("block", material="soft", cell="quadrilateral", **sides)
    way: dict[str, Any] = {"move": {"x": m.times(0.3, "way")}}
    if obstacle == "rests":
        way = {"move": {"x": m.times(0.0, "way")}}
    if obstacle == "is pushed":
        way["force"] = {"y": 0.02}
    m.obstacle("roller", cylinder={"point": [-0.2, -4.0], "radius": 4.0}, **way)
    m.support("block.top", x=0, y=-2e-2)
    m.contact("block.bottom", against="roller", mu=0.3)
    m.path(way=[0.0, 1.0])
    result = m.solve()
    model = result.case.model

    def edge(step: int, scale: float) -> Any:
        _, bands = cells_of(plots.deformed(result, step=step, scale=scale))
        # A piece for each facet; its first two corners are at its contacts.
        (line,) = (facets for kind, facets in contact_surface(model) if kind == "line")
        places = np.empty_like(model.points)
        for path, facet in zip(bands.get_paths(), line, strict=True):
            places[facet] = path.vertices[:2]
        return places

    if obstacle == "rests":
        # Closest points of the nodes lie on the circle.
        at = edge(0, 1.0) - [-0.2, -4.0]
        np.testing.assert_allclose(np.linalg.norm(at, axis=1), 4.0, rtol=1e-14)
    nodes = model.contact_dofs[:, 0] // 2
    for k, scale in ((0, 3.0), (1, 7.0)):
        step = result[k]
        u = step.displacement[: model.nodes.size].reshape(-1, 2)
        drawn = model.nodes[nodes] + scale * u[nodes]
        normal = model.in_step(step).frame[:, 0]
        apart = np.einsum("cd,cd->c", normal, drawn - edge(k, scale))
        # Its distance from the body is the gap of the open contacts, up to rounding of
        # coordinates of size 4.
        gap = step.relative_displacement[:, 0]
        np.testing.assert_allclose(apart, scale * gap, atol=1e-14)
        assert (step.status > 0).any()


def test_boundary_of_bodies_in_3d_is_drawn(cube: Any) -> None:
    ax = plots.deformed(*cube)
    assert ax.name == "3d"
    (facets,) = (c for c in ax.collections if isinstance(c, Poly3DCollection))
    assert len(facets.get_array()) == 6 * 7**2
    assert ax.get_title("left").startswith("displacements × ")


@pytest.mark.parametrize(("cell", "per_side"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_skin_and_edges_of_a_box(cell: str, per_side: int) -> None:
    mesh = fem.box([[0, 1, 2, 3], [0, 1, 2], [0, 1]], cell)
    body = fem.Body("it", mesh, fem.Material(1.0, 0.3))
    held = [fem.Support("it", "bottom", [0, 1, 2])]
    model = fem.assemble([body, replace(body, name="other")], [], held)
    cells = np.concatenate([c for _, c in model.cells])
    for facets, cells_of_facets in skin(model.cells):
        assert len(facets) == per_side * 2 * (6 + 3 + 2)
        for facet, cell_of in zip(facets, cells_of_facets, strict=True):
            assert set(facet) <= set(cells[cell_of])
        # Counter-clockwise around each facet, seen from outside: ∫ x·n dA = 3 V.
        x = model.nodes[facets]
        flux = 0.0
        for k in range(1, facets.shape[1] - 1):
            normal = np.cross(x[:, k] - x[:, 0], x[:, k + 1] - x[:, 0]) / 2
            flux += np.sum(normal * x[:, 0])
        assert flux == pytest.approx(3 * 6.0)
    edges = model.nodes[sharp_edges(model.nodes, model.cells)]
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum()
    # Twelve edges of each of the two boxes, without the diagonals of facets.
    assert length == pytest.approx(2 * 4 * (3 + 2 + 1))


def test_resultants_and_shares(cycle: Any) -> None:
    _, result = cycle
    curves = drawn_lines(plots.resultants(result))
    total = result.resultant
    np.testing.assert_allclose(curves["normal"][:, 1], total[:, 2], rtol=1e-12)
    rounding = 1e-6 * np.abs(total).max()
    along = np.abs(total[:, 0])
    np.testing.assert_allclose(curves["tangential"][:, 1], along, atol=rounding)
    ax = plots.status_shares(result)
    heights = np.array([bar.get_height() for bar in ax.patches]).reshape(3, -1)
    for k, row in zip((2, 1, 0), heights, strict=True):
        np.testing.assert_allclose(row, np.mean(result.status == k, axis=1))
    # The loop of the contact itself.
    drawn = drawn_lines(plots.force_displacement(result))["force"]
    v = np.einsum("sck,ckd->scd", result.relative_displacement, cycle[0].frame)
    np.testing.assert_allclose(drawn[:, 0], v.mean(axis=1)[:, 0], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(drawn[:, 1], -total[:, 0], atol=rounding)


def loop_area(points: Any) -> float:
    x, y = np.asarray(points).T
    return float(np.sum(y * (np.roll(x, -1) - np.roll(x, 1))) / 2)


def test_area_of_the_loop_is_the_dissipation() -> None:
    """A block pulled to and fro by a rod: a parallelogram with the area of the dissipation."""
    k, N, mu, far = 100.0, 7.0, 0.3, 1.0
    K = np.array([[1.0, 0, 0], [0, k, -k], [0, -k, k]])
    stretch = mu * N / k
    # Steps at its corners, where sliding begins and ends.
    delta = np.array([far, far - 2 * stretch, -far, -far + 2 * stretch, far])
    loads = np.tile([-N, 0.0, 0.0], (5, 1))
    result = bp.solve(
        K, np.eye(3)[:2], loads, delta[:, None], gap=[0.0], mu=mu, fixed=[2], tol=1e-13
    )
    ax = plots.force_displacement(result, delta, units=UNITS)
    drawn = drawn_lines(ax)["force"]
    exact = 4 * mu * N * (far - stretch)
    # Without frames, a tangential force is a force along one component.
    assert abs(loop_area(drawn[1:])) == pytest.approx(exact, rel=1e-10)
    assert result.dissipation[1:].sum() == pytest.approx(exact, rel=1e-10)
    # The force drives the block: it is positive where the block is pulled up.
    assert drawn[0, 1] == pytest.approx(mu * N)
    np.testing.assert_allclose(drawn_lines(ax)["Σ μ × normal"][:, 1], mu * N)
    assert ax.get_xlabel() == "displacement [mm]"
    lost = plots.dissipation(result, units=UNITS)
    np.testing.assert_allclose(
        drawn_lines(lost)["in all"][:, 1], np.cumsum(result.dissipation)
    )
    assert lost.get_ylabel() == "work of friction [N·mm]"


@pytest.mark.parametrize(("tow", "seen"), [(1.3, True), (1.2, False)])
def test_friction_limit_far_above_the_force_is_a_text(tow: float, seen: bool) -> None:
    """Pressed by 10 N with μ = 0.5: the limit is 5 N, up to four times the force drawn."""
    loads = [[-10.0, 0.5], [-10.0, tow]]
    result = bp.solve(1e3 * np.eye(2), np.eye(2), loads, gap=[0.0], mu=0.5)
    ax = plots.force_displacement(result, [0.0, 1.0], units=UNITS)
    assert ("Σ μ × normal" in drawn_lines(ax)) is seen
    title = "" if seen else "friction could hold up to 5 N"
    assert ax.get_title("left") == title


def test_convergence(cycle: Any) -> None:
    _, result = cycle

    def drawn(of: Any, curve: str, **more: Any) -> Any:
        return drawn_lines(plots.convergence(of, **more))[curve]

    assert drawn(result[1], "held to")[0, 1] == result[1].tolerance
    assert plots.convergence(result[1]).get_yscale() == "log"
    for told in (
        drawn(result[2], "residual"),
        drawn(result, "step 3"),
        drawn(result, "residual", step=2),
    ):
        np.testing.assert_array_equal(told, result[2].history)
    with pytest.raises(ValueError, match="history is empty"):
        plots.convergence(replace(result[0], history=np.empty((0, 2))))
    solution = bp.ReducedProblem(np.eye(6), [[-1.0, 0.8]] * 3, 0.3).solve()
    assert plots.convergence(solution).get_ylabel() == "residual η"
    slip = plots.slip(solution, contacts={"x": [[0.0, 0], [1, 0], [2, 0]]})
    (shown,) = (it.get_ydata() for it in slip.get_lines()[:1])
    np.testing.assert_array_equal(shown, solution.relative_displacement[:, 1])


@pytest.mark.parametrize("quantity", ["pressure", "status"])
def test_surface_in_space(cube: Any, quantity: str) -> None:
    model, result = cube
    ax = plots.surface3d(model, result, quantity)
    ((_, corners),) = contact_surface(model)
    (shown,) = (c.get_array() for c in ax.collections if c.get_array() is not None)
    if quantity == "pressure":
        pressure = result[-1].traction[:, 0][corners].mean(axis=1)
        means = shown.reshape(len(corners), -1).mean(axis=1)
        np.testing.assert_allclose(means, pressure)
    else:
        # A quarter of a facet for each of its corners.
        np.testing.assert_array_equal(shown, result[-1].status[corners].ravel())


def data(points: Any, faces: Any = None, lines: Any = None) -> SimpleNamespace:
    """A mesh of PyVista with the data that is set."""
    known = {"points": points, "faces": faces, "lines": lines}
    return SimpleNamespace(**known, point_data={}, cell_data={})


def test_pyvista_is_given_the_surface(
    cube: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a recording module instead of PyVista, which is half a gigabyte."""
    model, result = cube
    module = MagicMock(PolyData=data)
    monkeypatch.setitem(sys.modules, "pyvista", module)
    plotter: Any = plots.surface3d(model, result, "slip", backend="pyvista")
    assert module.Plotter.call_args.kwargs["off_screen"]
    ((surface,), look), ((outline,), _) = plotter.add_mesh.call_args_list
    ((_, corners),) = contact_surface(model)
    faces = surface.faces.reshape(-1, 5)
    assert (faces[:, 0] == 4).all()
    np.testing.assert_array_equal(faces[:, 1:], corners)
    slips = result[-1].status == bp.Status.SLIP
    size = np.where(slips, np.linalg.norm(result[-1].slip, axis=1), 0)
    np.testing.assert_array_equal(surface.point_data[look["scalars"]], size)
    assert look["scalars"] == "slip in the step [mm]"
    assert len(outline.lines) == 3 * 12 * 7
    (places, vectors), _ = plotter.add_arrows.call_args
    # The longest arrow has 12 % of the size of the cube.
    longest = 0.12 * np.ptp(model.nodes) / size.max()
    np.testing.assert_array_equal(places, model.points[slips])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), longest * size[slips])
    # From the side of the pictures of matplotlib.
    ((towards,), _) = plotter.view_vector.call_args
    assert (np.sign(towards) == [1, -1, 1]).all()
    plotter.add_mesh.reset_mock()
    plots.surface3d(model, result, "status", backend="pyvista", bodies=False)
    (((surface,), _),) = plotter.add_mesh.call_args_list
    assert set(surface.cell_data["status"]) <= {0.0, 1.0, 2.0}
    assert len(surface.cell_data["status"]) == len(corners)


def test_pyvista_itself(cube: Any, tmp_path: Path) -> None:
    pytest.importorskip("pyvista", reason="PyVista is not installed")
    plotter = plots.surface3d(*cube, backend="pyvista")
    assert np.ptp(plotter.screenshot(tmp_path / "a.png")) > 100
    plotter.close()


def test_a_missing_library_is_named(
    cube: Any, line: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ModuleNotFoundError, match=r"need pyvista.*bipot-rs\[viz\]"):
        plots.surface3d(*cube, backend="pyvista")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ModuleNotFoundError, match=r"need matplotlib.*bipot-rs\[cli\]"):
        plots.tractions(line[1])


SUPPORTS = np.array([[0.0, 0.0], [1, 0], [2, 0], [3, 0]])


@pytest.fixture(scope="module")
def ranges() -> tuple[None, Any]:
    """A weight on four supports without friction."""
    R = np.zeros((8, 2))
    R[::2] = np.stack([np.ones(4), SUPPORTS[:, 0] - 1.5], axis=1)
    held = {"rigid": (R, [-1.0, 0.0])}
    problem = bp.ReducedProblem(np.zeros((8, 8)), np.zeros((4, 2)), 0.0, **held)
    return None, problem.reaction_ranges()


def test_a_band_of_reactions(ranges: Any) -> None:
    _, ranges = ranges
    ax = plots.reaction_band(ranges, contacts={"x": SUPPORTS}, units=UNITS)
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    # Two supports at d and -d from the weight, or at d and -3 d.
    np.testing.assert_allclose(drawn["largest"], [0.5, 0.75, 0.75, 0.5], rtol=1e-12)
    np.testing.assert_allclose(drawn["least"], 0, atol=1e-12)
    assert drawn["found"].sum() == pytest.approx(1)
    free = replace(ranges[1], largest=np.inf)
    ax = plots.reaction_band([ranges[0], free], contacts={"x": SUPPORTS})
    # A quarter of what is finite beyond it.
    largest = max(ranges[0].largest, free.found)
    np.testing.assert_allclose(ax.get_lines()[0].get_ydata(), [0.5, 1.25 * largest])
    few = plots.reaction_band(ranges, contacts={"x": SUPPORTS}, on=[0, 2])
    assert few.get_lines()[0].get_xdata().tolist() == [0, 2]
    for wrong, places, error, said in (
        ([1], SUPPORTS, TypeError, "ranges"),
        ([], SUPPORTS, ValueError, "ranges are empty"),
        (ranges, SUPPORTS[:2], ValueError, "x of contacts has 2 rows"),
    ):
        with pytest.raises(error, match=said):
            plots.reaction_band(wrong, contacts={"x": places})


# Function, scene, and further arguments.
PICTURES: dict[str, tuple[Callable[..., Any], str, dict[str, Any]]] = {
    "tractions": (plots.tractions, "line", {}),
    "slip": (plots.slip, "line", {}),
    "wear": (plots.wear, "worn", {}),
    "blocks": (plots.blocks, "stacked", {"names": True}),
    "pressure by cycle": (plots.wear, "worn", {"quantity": "pressure"}),
    "band": (plots.reaction_band, "ranges", {"contacts": {"x": SUPPORTS}}),
    "by friction": (plots.sensitivity, "decided", {"of": "energy", "unit": "mJ"}),
    "by gap": (plots.sensitivity, "decided_in_space", {"by": "gap"}),
    "by name": (plots.plot, "line", {"kind": "slip"}),
    "zones": (plots.status_map, "line", {}),
    "pressure": (plots.surface_map, "cube", {}),
    "shear": (plots.surface_map, "cube", {"quantity": "shear"}),
    "slip of a surface": (plots.slip, "cube", {}),
    "status": (plots.status_map, "cube", {}),
    "deformed": (plots.deformed, "line", {}),
    "deformed, near": (plots.deformed, "line", {"near": 0.3}),
    "deformed in space": (plots.deformed, "cube", {}),
    "surface": (plots.surface3d, "cube", {}),
    "status in space": (plots.surface3d, "cube", {"quantity": "status"}),
    "resultants": (plots.resultants, "cycle", {}),
    "shares": (plots.status_shares, "cycle", {}),
    "loop": (plots.force_displacement, "cycle", {}),
    "dissipation": (plots.dissipation, "cycle", {}),
    "convergence": (plots.convergence, "line", {}),
    "convergence of many": (plots.convergence, "cycle", {}),
}


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.quick_variants("band", "blocks", "slip", "wear")
def test_parts_of_a_picture_do_not_overlap(
    name: str, request: pytest.FixtureRequest
) -> None:
    draw, of, more = PICTURES[name]
    model, result = request.getfixturevalue(of)
    bodies = [model] if draw in (plots.deformed, plots.surface3d) else []
    assert overlaps(draw(*bodies, result, **more).figure) == []


def test_every_picture_is_looked_at() -> None:
    drawn = {draw.__name__ for draw, *_ in PICTURES.values()}
    # Frames of an animation are pictures of the others.
    assert drawn == set(plots.__all__) - {"animate"}


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-9, 1e6])
def test_large_and_small_numbers_can_be_read(line: Any, factor: float) -> None:
    """In pascals and metres, and in meganewtons and kilometres."""
    _, result = line
    steps = [
        replace(s, reaction=factor * s.reaction, traction=factor * s.traction)
        for s in result
    ]
    contacts = result.contacts | {"x": factor * np.asarray(result.contacts["x"])}
    other = bp.Result(
        steps, contacts=contacts, shape=result.shape, success=True, message=""
    )
    for picture in (plots.tractions, plots.resultants, plots.slip):
        assert overlaps(picture(other, units=UNITS).figure) == []


@pytest.mark.parametrize(
    ("size", "height"), [(1.0, 0.4), (1e-5, 1.0), (2e4, 1.0), (1.0, 0.05), (1.0, 3.0)]
)
@pytest.mark.quick_variants("1.0-0.4")
def test_bodies_in_space_of_any_size_can_be_read(size: float, height: float) -> None:
    grid = np.linspace(0, size, 3)
    mesh = fem.box([grid, grid, height * grid], "hexahedron")
    body = fem.Body("it", mesh, fem.Material(10.0, 0.3))
    floor = fem.Contact("it", "bottom", 0.3, ([0, 0, 0], [0, 0, 1]))
    model = fem.assemble([body], [floor], [fem.Support("it", "top", [0, 1, 2])])
    down = model.prescribed([[0.01 * size, 0.0, -0.05 * height * size]])
    result = model.problem().solve(prescribed=down)
    result.units = UNITS
    deformed = plots.deformed(model, result, scale=1.0)
    surface = plots.surface3d(model, result, bodies=False)
    for ax in (deformed, surface):
        assert overlaps(ax.figure) == []
        # The box fills the axes, but for 2 % on each side.
        ends = ax.transData.transform(np.array(project_box(ax)))
        assert (np.ptp(ends, axis=0) / ax.bbox.size).max() == pytest.approx(1 / 1.04)


def test_overlaps_are_seen() -> None:
    figure = Figure()
    ax = figure.add_subplot()
    ax.plot([0, 1], [0, 1], label="it")
    ax.legend(loc="center")
    ax.text(0.5, 0.1, "one")
    ax.text(0.5, 0.1, "other")
    ax.set_title("far\n" * 20)
    overlapping = overlaps(figure)
    assert "legend over 'it'" in overlapping
    assert "'one' over 'other'" in overlapping
    assert any(overlap.endswith("beyond the rim") for overlap in overlapping)


def test_given_axes_are_used(line: Any, cube: Any) -> None:
    left, right = Figure().subplots(1, 2)
    assert plots.tractions(line[1], ax=left) is left
    assert plots.surface_map(cube[1], ax=right) is right


@pytest.mark.slow
def test_no_state_is_left(tmp_path: Path) -> None:
    code = (
        "import sys, bipot_rs as bp; early = 'bipot_rs.plots' in sys.modules; "
        "from bipot_rs.plots.run_figure import write_figure; import numpy as np; "
        "r = bp.solve(np.eye(4), np.eye(4), [-1.0, 0.1, -1, 0.1], gap=[0, 0], mu=0.3, "
        "points=[[0, 0], [1, 0]], frame=[np.eye(2)] * 2, area=[1, 1]); r.plot(); "
        "bp.plots.animate(r, 'a.gif', 'slip'); write_figure('a.png', r); "
        "print(early, 'matplotlib.pyplot' in sys.modules, 'skfem' in sys.modules)"
    )
    run = child(code, cwd=tmp_path, PYTHONWARNINGS="error")
    assert run.stdout.split() == ["False"] * 3


def test_wrong_arguments_are_named(line: Any, cube: Any) -> None:
    r, solid = line[1], cube[1]
    flat = Figure().subplots()
    x = np.random.default_rng(0).uniform(size=(64, 3))
    scattered = {"x": x, "frame": cube[0].frame}
    wrong: list[tuple[Any, tuple[Any, ...], dict[str, Any], type[Exception], str]] = [
        (plots.tractions, (3,), {}, TypeError, "result is a int"),
        (plots.tractions, (r,), {"step": 9}, ValueError, "step is 9, expected 0"),
        (plots.tractions, (r[0],), {}, ValueError, "places of the contacts"),
        (plots.tractions, (r,), {"on": [99]}, ValueError, "on is out of range"),
        (plots.tractions, (r,), {"on": []}, TypeError, "on has entries"),
        (plots.tractions, (r,), {"on": [True]}, ValueError, r"on has shape \(1"),
        (plots.tractions, (r,), {"contacts": 1}, TypeError, "contacts is a int"),
        (plots.tractions, (r,), {"units": "mm"}, TypeError, "units is a str"),
        (plots.tractions, (r,), {"along": [0.0, 0]}, ValueError, "along is zero"),
        (plots.tractions, (r,), {"ax": 1}, TypeError, "ax is a int, expected ax"),
        (plots.tractions, (solid,), {}, ValueError, "along is missing"),
        (r.plot, (), {"where": [0]}, TypeError, "where is no argument .*mean 'on'"),
        (plots.surface_map, (r,), {}, ValueError, "two dimensions: use tra"),
        (plots.surface_map, (r, "heat"), {}, ValueError, "quantity is 'heat'"),
        (
            plots.surface_map,
            (solid,),
            {"contacts": scattered},
            ValueError,
            "more than one plane",
        ),
        (
            plots.force_displacement,
            (r, [1.0]),
            {},
            ValueError,
            r"displacement has shape \(1,\)",
        ),
        (plots.resultants, (r[0],), {}, TypeError, "result is a Step"),
        (plots.deformed, (cube[0], r), {}, ValueError, "displacements of shape"),
        (plots.deformed, cube, {"scale": 0}, ValueError, "scale is 0"),
        (plots.surface3d, cube, {"backend": "gl"}, ValueError, "backend is 'gl'"),
        (plots.surface3d, cube, {"ax": flat}, TypeError, "axes with projection"),
        (plots.surface3d, line, {}, ValueError, "has two dimensions, expected three"),
    ]
    for draw, arguments, more, error, said in wrong:
        with pytest.raises(error, match=said):
            draw(*arguments, **more)
