"""Pictures show the numbers of the result with units, and are readable."""

import doctest
import subprocess
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
from scipy import sparse
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import cKDTree

import bipot_rs as bp
from bipot_rs import fem, plots, scene
from bipot_rs.fem.bodies.stress_recovery import stress, von_mises
from bipot_rs.fem.contact_surface import contact_surface
from bipot_rs.plots import style
from bipot_rs.plots.geometry import triangles
from bipot_rs.plots.geometry.boundary_facets import sharp_edges, skin
from bipot_rs.plots.surface import span
from support.layout import overlaps
from support.masonry import assemble, box

UNITS = {"length": "mm", "force": "N", "stress": "MPa"}


def solved(name: str, *settings: str) -> tuple[fem.Assembly, bp.Result]:
    read = scene.read(name, settings)
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed)
    result.units = read.units.model_dump()
    return case.model, result


@pytest.fixture(scope="module")
def line() -> tuple[fem.Assembly, bp.Result]:
    return solved("cattaneo_mindlin", "mesh.n=4")


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
def cube() -> tuple[fem.Assembly, bp.Result]:
    return solved("sheared_cube", "mesh.n=7")


@pytest.fixture(scope="module")
def cycle() -> tuple[fem.Assembly, bp.Result]:
    return solved("cyclic_cube", "mesh.n=3", "support.0.x.value=0.07")


@pytest.fixture(scope="module")
def decided(line: Any) -> tuple[fem.Assembly, Any]:
    """The gradient of the energy that friction dissipates."""
    model, result = line
    return model, dissipation_gradient(result)


@pytest.fixture(scope="module")
def stacked() -> tuple[None, Any]:
    """Two blocks on the ground."""
    ground = box("ground", (-9, -1), (9, 0), support=True)
    tower = [box("a", (0, 0), (2, 2)), box("b", (0, 2), (2, 4))]
    return None, assemble([ground, *tower], 0.5)


@pytest.fixture(scope="module")
def ranges() -> tuple[None, Any]:
    return None, supported()


@pytest.fixture(scope="module")
def decided_in_space(cube: Any) -> tuple[fem.Assembly, Any]:
    model, result = cube
    return model, dissipation_gradient(result)


def dissipation_gradient(result: bp.Result) -> Any:
    bar = np.zeros_like(result.reaction)
    bar[:, :, 1:] = -result.slip
    return result.vjp(reaction=bar, slip=-result.reaction[:, :, 1:])


def drawn_lines(ax: Any) -> dict[str, Any]:
    return {it.get_label(): np.stack(it.get_data(), axis=-1) for it in ax.get_lines()}


def arrows_of(ax: Any) -> Any:
    from matplotlib.quiver import Quiver

    (quiver,) = (it for it in ax.collections if isinstance(it, Quiver))
    return quiver


def test_examples_of_the_docstrings() -> None:
    assert doctest.testmod(style).failed == 0
    assert doctest.testmod(style).attempted


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
    np.testing.assert_array_equal(
        drawn_lines(ax)["pressure"][:, 1], result.traction[0][right][:, 0]
    )
    again = plots.tractions(result[0], on=np.flatnonzero(right), contacts=model)
    np.testing.assert_array_equal(
        drawn_lines(again)["pressure"], drawn_lines(ax)["pressure"]
    )
    # A step does not know its units.
    assert again.get_ylabel() == "traction"


def test_a_curve_is_drawn_by_its_length() -> None:
    angle = np.random.default_rng(0).permutation(np.linspace(0.2, 2.4, 30))
    x = 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    frame = fem.frames(-x)
    n = len(x)
    K, B = np.eye(2 * n), np.eye(2 * n)
    load = np.tile([-1.0, 0.0], n) * np.repeat(1 + angle, 2)
    result = bp.solve(K, B, load, gap=np.zeros(n), mu=0.3, points=x, frame=frame)
    ax = plots.tractions(result, units=UNITS)
    assert ax.get_xlabel() == "arc length from the end of least x [mm]"
    # Without areas the curves show forces.
    assert ax.get_ylabel() == "contact force [N]"
    place, force = drawn_lines(ax)["normal"].T
    # Chords of 29 equal parts of an arc, from its left end: the largest angle.
    chord = 6.0 * np.sin(2.2 / 29 / 2)
    np.testing.assert_allclose(place, chord * np.arange(30), rtol=1e-12)
    np.testing.assert_array_equal(force, np.sort(result.reaction[-1, :, 0])[::-1])


def test_a_line_on_a_surface(cube: Any) -> None:
    model, result = cube
    middle = np.isclose(model.points[:, 1], np.unique(model.points[:, 1])[3])
    ax = plots.tractions(result, along=[2.0, 0, 0], on=middle)
    order = np.flatnonzero(middle)[np.argsort(model.points[middle, 0])]
    shear = np.einsum("ck,ckd->cd", result.traction[-1][:, 1:], model.frame[:, 1:])
    np.testing.assert_allclose(drawn_lines(ax)["shear"][:, 1], shear[order, 0])
    with pytest.raises(ValueError, match="along is missing"):
        plots.tractions(result)


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
    np.testing.assert_array_equal(
        ax.collections[0].get_array().reshape(len(result), -1), result.status[:, order]
    )
    assert ax.get_ylabel() == "load step"
    axes_of_step = plots.status_map(result, step=0)
    np.testing.assert_array_equal(
        np.ravel(axes_of_step.collections[0].get_array()), result.status[0][order]
    )


@pytest.mark.parametrize("quantity", ["pressure", "shear", "slip", "gap"])
def test_maps_are_those_of_the_result(cube: Any, quantity: str) -> None:
    model, result = cube
    last = result[-1]
    size = np.linalg.norm
    exact = {
        "pressure": (last.traction[:, 0], "pressure [MPa]"),
        "shear": (size(last.traction[:, 1:], axis=1), "shear traction [MPa]"),
        "slip": (
            np.where(last.status == bp.Status.SLIP, size(last.slip, axis=1), 0),
            "slip in the step [10",
        ),
        "gap": (np.where(last.status == 0, last.relative_displacement[:, 0], 0), "gap"),
    }
    ax = plots.surface_map(result, quantity, arrows=False)
    # On the square of 100 mm, in the rectangles of its mesh, each of two triangles.
    values = np.zeros((8, 8))
    at = np.rint(model.points[:, :2] / (100 / 7)).astype(int)
    values[at[:, 0], at[:, 1]] = exact[quantity][0]
    polygons, shown = pieces_of(ax)
    assert area_of(polygons) == pytest.approx(100.0**2, rel=1e-9)
    # The mean of the corners is not the value at the centre of the collapsed pieces.
    grid = np.arange(8) * 100 / 7
    whole = RegularGridInterpolator((grid, grid), values)(polygons.mean(axis=1))
    slope = np.abs(np.diff(values, axis=0)).max() + np.abs(np.diff(values)).max()
    assert np.abs(shown - whole).max() <= 0.3 * slope + 1e-15
    assert (values.min(), values.max()) == (
        pytest.approx(shown.min(), abs=0.2 * slope),
        pytest.approx(shown.max(), abs=0.2 * slope),
    )
    assert ax.get_xlabel() == "x [mm]"
    if quantity == "gap":
        # All contacts are closed: a text says so, and no colour bar is needed.
        assert not ax.child_axes
        assert [t.get_text() for t in ax.texts] == ["all contacts are closed"]
    else:
        (bar,) = ax.child_axes
        assert bar.get_ylabel().startswith(exact[quantity][1])
    assert ax.get_title("left") == "load step 2 of 2"


def pieces_of(ax: Any) -> tuple[Any, Any]:
    """Corners ``(p, 4, 2)`` of the pieces of a map, and the values that they show."""
    (map_drawn,) = (c for c in ax.collections if type(c) is PolyCollection)
    corners = [path.vertices[:4] for path in map_drawn.get_paths()]
    return np.array(corners), np.asarray(map_drawn.get_array())


def area_of(polygons: Any) -> float:
    """Sum of the areas of quadrilaterals ``(p, 4, 2)``, of any orientation."""
    (a, b), (c, d) = (polygons[:, k + 2].T - polygons[:, k].T for k in (0, 1))
    return float(np.abs(a * d - b * c).sum() / 2)


def test_arrows_of_shear_have_its_direction(cube: Any) -> None:
    model, result = cube
    arrows = arrows_of(plots.surface_map(result, "shear"))
    shear = np.einsum("ck,ckd->cd", result[-1].traction[:, 1:], model.frame[:, 1:])
    for place, u, v in zip(arrows.XY, arrows.U, arrows.V, strict=True):
        at = np.argmin(np.linalg.norm(model.points[:, :2] - place, axis=1))
        direction = shear[at, :2] / np.linalg.norm(shear[at])
        np.testing.assert_allclose([u, v], direction, rtol=1e-9, atol=1e-12)


def test_length_of_slip_arrows(cube: Any) -> None:
    model, result = cube
    ax = plots.slip(result)
    arrows = arrows_of(ax)
    slip = np.einsum("ck,ckd->cd", result[-1].slip, model.frame[:, 1:])
    size = np.linalg.norm(slip, axis=1)
    # The largest slip of all is drawn, with the last colour.
    assert arrows.get_array().max() == size.max() == arrows.get_clim()[1]
    for place, u, v, c in zip(
        arrows.XY, arrows.U, arrows.V, arrows.get_array(), strict=True
    ):
        at = np.argmin(np.linalg.norm(model.points[:, :2] - place, axis=1))
        np.testing.assert_allclose([u, v], slip[at, :2], rtol=1e-9)
        assert c == size[at]


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
    cells = [(x, y) for x in range(12) for y in range(12)]
    if hole:
        cells = [c for c in cells if not all(3 <= k < 9 for k in c)]
    area = np.zeros(len(at))
    for x, y in cells:
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            area[13 * (x + i) + y + j] += stretch / 4
    kept = area > 0
    x = np.column_stack([stretch * at[kept, 0], at[kept, 1], np.zeros(kept.sum())])
    q = np.tile([-1.0, 0.0, 0.0], (len(x), 1))
    solution = bp.ReducedProblem(np.eye(3 * len(x)), q, 0.3).solve()
    frame = np.tile(np.roll(np.eye(3), 1, axis=0), (len(x), 1, 1))
    return solution, {"x": x, "area": area[kept], "frame": frame}


@pytest.mark.parametrize("areas", [True, False])
@pytest.mark.parametrize("stretch", [1.0, 3.0, 40.0])
@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.slow_variants("True-3.0-True")
def test_only_holes_are_blank(stretch: float, hole: bool, areas: bool) -> None:
    """Without facets, by the areas of the contacts, or by the points alone."""
    solution, contacts = sheet(stretch, hole)
    if not areas:
        del contacts["area"]
    whole = 144 * stretch
    drawn, _ = pieces_of(plots.surface_map(solution, contacts=contacts))
    blank = 1 - area_of(drawn) / whole
    # At the hole, a quarter of the surface, the corners may be cut off; without areas,
    # half of it.
    least, most = ((0.2 if areas else 0.12), 0.25) if hole else (0.0, 0.0)
    assert least - 1e-9 <= blank <= most + 1e-9
    drawn, _ = pieces_of(plots.status_map(solution, contacts=contacts))
    assert 1 - area_of(drawn) / whole == pytest.approx(blank, abs=1e-12)


def graded() -> tuple[bp.Solution, dict[str, Any]]:
    """Contacts on 30 × 30 cells that grow by 1.4 from the edges; ten times the pressure there."""
    size = 1.4 ** np.minimum(np.arange(30), 29 - np.arange(30))
    grid = np.concatenate([[0.0], np.cumsum(size)]) / size.sum()
    share = np.convolve(np.diff(grid), [0.5, 0.5])
    u, v = (a.ravel() for a in np.meshgrid(grid, grid))
    area = np.outer(share, share).ravel()
    rim = (np.abs(u - 0.5) == 0.5) | (np.abs(v - 0.5) == 0.5)
    pressure = np.where(rim, 10.0, 1 - 0.5 * (u**2 + v**2))
    q = np.stack([-pressure * area, 0 * u, 0 * u], axis=1)
    solution = bp.ReducedProblem(sparse.eye_array(3 * len(u)), q, 0.3).solve()
    first = (31 * np.arange(30)[:, None] + np.arange(30)).ravel()
    facets = first[:, None] + [0, 1, 32, 31]
    frame = np.tile(np.roll(np.eye(3), 1, axis=0), (len(u), 1, 1))
    x = np.column_stack([u, v, 0 * u])
    return solution, {"x": x, "area": area, "frame": frame, "facets": facets}


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
    ratio = np.ptp(np.diff(np.unique(contacts["x"][:, 0])))
    assert ratio > 100 * np.diff(np.unique(contacts["x"][:, 0])).min()
    for left_out in ((), ("facets",), ("facets", "area")):
        arrays_left = {k: v for k, v in contacts.items() if k not in left_out}
        ax = plots.surface_map(solution, contacts=arrays_left)
        assert area_of(pieces_of(ax)[0]) == pytest.approx(1.0, rel=1e-9)
        zones = plots.status_map(solution, contacts=arrays_left)
        assert area_of(pieces_of(zones)[0]) == pytest.approx(1.0, rel=1e-9)
        (image,) = (c for c in ax.collections if type(c) is PolyCollection)
        bar = np.unique(image.cmap(np.arange(256), bytes=True)[:, :3], axis=0)
        drawn = colours_of(ax)
        assert len(drawn) > 50
        assert (drawn[:, None] == bar).all(axis=2).any(axis=1).all()
        if "area" in arrays_left:
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


@pytest.mark.parametrize(
    ("facets", "said"),
    [
        ([[0, 1]], "3, 4, 6, 8 or 9 nodes"),
        ([[0, -1, 1, 2]], "-1 only after them"),
        ([[0, 1, 3]], "expected numbers from 0 to 2"),
        ([[0.0, 1.0, 2.0]], "expected rows of integers"),
    ],
)
def test_wrong_facets_are_named(facets: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        triangles.check_facets(facets, 3)


@pytest.mark.parametrize("near", [None, 0.5])
def test_deformed_bodies(line: Any, near: float | None) -> None:
    model, result = line
    ax = plots.deformed(model, result, scale=3.0, near=near)
    (cells,) = (c for c in ax.collections if type(c) is PolyCollection)
    u = result[-1].displacement
    places = model.nodes + 3.0 * u.reshape(-1, 2)
    corners = np.concatenate([c for _, c in model.cells])
    for path, cell in zip(cells.get_paths(), corners, strict=True):
        np.testing.assert_array_equal(path.vertices[:4], places[cell])
    half = model.offset[1]
    upper = von_mises(stress(model.bodies[0], u[:half], space=True))
    np.testing.assert_array_equal(cells.get_array()[: len(upper)], upper)
    longest = np.linalg.norm(result[-1].reaction, axis=1).max()
    title = f"displacements × 3, forces up to {longest:.3g} N, load step 2 of 2"
    assert ax.get_title("left") == title
    # Arrows end at contact nodes and add up to a part of the contact force.
    arrows = arrows_of(ax)
    tips = places[model.contact_dofs[:, 0] // 2]
    for place in arrows.XY:
        assert np.linalg.norm(tips - place, axis=1).min() == 0
    assert (arrows.V > 0).all()
    assert ax.get_aspect() == 1


@pytest.mark.parametrize("obstacle", ["rests", "moves", "is pushed"])
def test_rigid_obstacles_are_drawn_as_contacts_see_them(obstacle: str) -> None:
    m = bp.Model("A block pressed onto a cylinder")
    m.material("soft", young=1.0, poisson=0.3)
    m.body(
        "block",
        material="soft",
        cell="quadrilateral",
        x={"from": -1.0, "to": 1.0, "cells": 20},
        y={"from": 0.0, "to": 0.5, "cells": 5},
    )
    way: dict[str, Any] = {
        "rests": {"move": {"x": m.times(0.0, "way")}},
        "moves": {"move": {"x": m.times(0.3, "way")}},
        "is pushed": {"force": {"y": 0.02}, "move": {"x": m.times(0.3, "way")}},
    }[obstacle]
    m.obstacle("roller", cylinder={"point": [-0.2, -4.0], "radius": 4.0}, **way)
    m.support("block.top", x=0, y=-2e-2)
    m.contact("block.bottom", against="roller", mu=0.3)
    m.path(way=[0.0, 1.0])
    result = m.solve()
    model = result.case.model

    def edge(step: int, scale: float) -> Any:
        ax = plots.deformed(result, step=step, scale=scale)
        _, bands = (c for c in ax.collections if type(c) is PolyCollection)
        # A piece for each facet; its first two corners are at its contacts.
        (line,) = (facets for kind, facets in contact_surface(model) if kind == "line")
        assert len(line) == 20
        points_at_facets = np.empty_like(model.points)
        for path, facet in zip(bands.get_paths(), line, strict=True):
            points_at_facets[facet] = path.vertices[:2]
        return points_at_facets

    if obstacle == "rests":
        # Closest points of the nodes lie on the circle.
        at = edge(0, 1.0) - [-0.2, -4.0]
        np.testing.assert_allclose(np.linalg.norm(at, axis=1), 4.0, rtol=1e-14)
    for step, scale in ((0, 3.0), (1, 7.0)):
        points_at_facets = result[step]
        nodes = model.contact_dofs[:, 0] // 2
        u = points_at_facets.displacement[: model.nodes.size].reshape(-1, 2)
        drawn = model.nodes[nodes] + scale * u[nodes]
        normal = model.in_step(points_at_facets).frame[:, 0]
        apart = np.einsum("cd,cd->c", normal, drawn - edge(step, scale))
        # Its distance from the body is the gap of the open contacts, up to rounding of
        # coordinates of size 4.
        np.testing.assert_allclose(
            apart, scale * points_at_facets.relative_displacement[:, 0], atol=1e-14
        )
        assert (points_at_facets.status > 0).any()


def test_boundary_of_bodies_in_3d_is_drawn(cube: Any) -> None:
    model, result = cube
    ax = plots.deformed(model, result)
    assert ax.name == "3d"
    (facets,) = (
        c
        for c in ax.collections
        if hasattr(c, "set_verts") and c.get_array() is not None
    )
    assert len(facets.get_array()) == 6 * 7**2
    assert ax.get_title("left").startswith("displacements × ")


def test_skin_and_edges_of_a_box() -> None:
    for cell, per_side in (("hexahedron", 1), ("tetrahedron", 2)):
        mesh = fem.box([[0, 1, 2, 3], [0, 1, 2], [0, 1]], cell)
        body = fem.Body("it", mesh, fem.Material(1.0, 0.3))
        held = [fem.Support("it", "bottom", [0, 1, 2])]
        model = fem.assemble([body, replace(body, name="other")], [], held)
        parts = skin(model.cells)
        for facets, cells in parts:
            assert len(facets) == per_side * 2 * (6 + 3 + 2)
            for facet, cell_of in zip(facets, cells, strict=True):
                both = np.concatenate([c for _, c in model.cells])
                assert set(facet) <= set(both[cell_of])
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
    size = np.abs(total).max()
    np.testing.assert_allclose(
        curves["tangential"][:, 1], np.abs(total[:, 0]), atol=1e-6 * size
    )
    ax = plots.status_shares(result)
    heights = np.array([bar.get_height() for bar in ax.patches]).reshape(3, -1)
    for k, row in zip((2, 1, 0), heights, strict=True):
        np.testing.assert_allclose(row, np.mean(result.status == k, axis=1))


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


def test_the_loop_of_the_contact_itself(cycle: Any) -> None:
    model, result = cycle
    drawn = drawn_lines(plots.force_displacement(result))["force"]
    v = np.einsum("sck,ckd->scd", result.relative_displacement, model.frame)
    np.testing.assert_allclose(drawn[:, 0], v.mean(axis=1)[:, 0], rtol=1e-6, atol=1e-9)
    size = np.abs(result.resultant).max()
    np.testing.assert_allclose(drawn[:, 1], -result.resultant[:, 0], atol=1e-6 * size)


def test_convergence(cycle: Any) -> None:
    _, result = cycle
    axes = plots.convergence(result[1])
    curves = drawn_lines(axes)
    np.testing.assert_array_equal(curves["residual"], result[1].history)
    assert curves["held to"][0, 1] == result[1].tolerance
    assert axes.get_yscale() == "log"
    every = drawn_lines(plots.convergence(result))
    np.testing.assert_array_equal(every["step 3"], result[2].history)
    np.testing.assert_array_equal(
        drawn_lines(plots.convergence(result, step=2))["residual"], result[2].history
    )
    with pytest.raises(ValueError, match="history is empty"):
        plots.convergence(replace(result[0], history=np.empty((0, 2))))


def test_plots_of_a_reduced_problem() -> None:
    problem = bp.ReducedProblem(np.eye(6), [[-1.0, 0.8]] * 3, 0.3)
    solution = problem.solve()
    assert plots.convergence(solution).get_ylabel() == "residual η"
    x = np.array([[0.0, 0], [1, 0], [2, 0]])
    ax = plots.slip(solution, contacts={"x": x})
    np.testing.assert_array_equal(
        ax.get_lines()[0].get_ydata(), solution.relative_displacement[:, 1]
    )


@pytest.mark.parametrize("quantity", ["pressure", "status"])
def test_surface_in_space(cube: Any, quantity: str) -> None:
    model, result = cube
    ax = plots.surface3d(model, result, quantity)
    ((_, corners),) = contact_surface(model)
    facets = next(c for c in ax.collections if c.get_array() is not None)
    last = result[-1]
    values = (
        last.traction[:, 0] if quantity == "pressure" else last.status.astype(float)
    )
    if quantity == "pressure":
        pieces = facets.get_array().reshape(len(corners), -1).mean(axis=1)
        np.testing.assert_allclose(pieces, values[corners].mean(axis=1))
    else:
        # A quarter of a facet for each of its corners.
        np.testing.assert_array_equal(facets.get_array(), values[corners].ravel())


def data(points: Any, faces: Any = None, lines: Any = None) -> SimpleNamespace:
    """A mesh of PyVista with the data that is set."""
    return SimpleNamespace(
        points=points, faces=faces, lines=lines, point_data={}, cell_data={}
    )


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


def supported() -> list[bp.ReactionRange]:
    """A weight on four supports without friction."""
    turned = np.stack([np.ones(4), SUPPORTS[:, 0] - 1.5], axis=1)
    R = np.zeros((8, 2))
    R[::2] = turned
    problem = bp.ReducedProblem(
        np.zeros((8, 8)), np.zeros((4, 2)), 0.0, rigid=(R, [-1.0, 0.0])
    )
    return problem.reaction_ranges()


def test_a_band_of_reactions() -> None:
    ranges = supported()
    ax = plots.reaction_band(ranges, contacts={"x": SUPPORTS}, units=UNITS)
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    # Two supports at d and -d from the weight, or at d and -3 d.
    np.testing.assert_allclose(drawn["largest"], [0.5, 0.75, 0.75, 0.5], rtol=1e-12)
    np.testing.assert_allclose(drawn["least"], 0, atol=1e-12)
    assert drawn["found"].sum() == pytest.approx(1)
    free = replace(ranges[1], largest=np.inf)
    ax = plots.reaction_band([ranges[0], free], contacts={"x": SUPPORTS})
    top = ax.get_lines()[0].get_ydata()
    # A quarter of what is finite beyond it.
    largest = max(ranges[0].largest, free.found)
    np.testing.assert_allclose(top, [0.5, 1.25 * largest])
    few = plots.reaction_band(ranges, contacts={"x": SUPPORTS}, on=[0, 2])
    assert few.get_lines()[0].get_xdata().tolist() == [0, 2]
    with pytest.raises(TypeError, match="ranges"):
        plots.reaction_band([1], contacts={"x": SUPPORTS})  # type: ignore[list-item]
    with pytest.raises(ValueError, match="ranges are empty"):
        plots.reaction_band([], contacts={"x": SUPPORTS})
    with pytest.raises(ValueError, match="x of contacts has 2 rows"):
        plots.reaction_band(ranges, contacts={"x": SUPPORTS[:2]})


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
@pytest.mark.quick_variants(
    "band",
    "blocks",
    "by friction",
    "by gap",
    "by name",
    "pressure by cycle",
    "slip",
    "status in space",
    "wear",
    "zones",
)
@pytest.mark.slow_variants("by gap")
def test_parts_of_a_picture_do_not_overlap(
    name: str, request: pytest.FixtureRequest
) -> None:
    draw, of, more = PICTURES[name]
    model, result = request.getfixturevalue(of)
    bodies = [model] if draw in (plots.deformed, plots.surface3d) else []
    ax = draw(*bodies, result, **more)
    assert overlaps(ax.figure) == []


def test_every_picture_is_looked_at() -> None:
    drawn = {draw.__name__ for draw, *_ in PICTURES.values()}
    # Frames of an animation are pictures of the others.
    assert drawn == set(plots.__all__) - {"animate"}


@pytest.mark.slow
def test_large_and_small_numbers_can_be_read(line: Any) -> None:
    """In pascals and metres, and in meganewtons and kilometres."""
    _, result = line
    for factor in (1e-9, 1e6):
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


@pytest.mark.parametrize("size", [1.0, 1e-5, 2e4])
@pytest.mark.quick_variants("1.0")
def test_bodies_in_space_of_any_size_can_be_read(size: float) -> None:
    grid = np.linspace(0, size, 3)
    body = fem.Body("it", fem.box([grid] * 3, "hexahedron"), fem.Material(10.0, 0.3))
    floor = fem.Contact("it", "bottom", 0.3, ([0, 0, 0], [0, 0, 1]))
    model = fem.assemble([body], [floor], [fem.Support("it", "top", [0, 1, 2])])
    down = model.prescribed([[0.01 * size, 0.0, -0.05 * size]])
    result = model.problem().solve(prescribed=down)
    result.units = UNITS
    for picture in (plots.deformed, plots.surface3d):
        assert overlaps(picture(model, result).figure) == []


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
    with pytest.raises(TypeError, match="ax is a int, expected axes"):
        plots.tractions(line[1], ax=1)
    with pytest.raises(TypeError, match="expected axes with projection"):
        plots.surface3d(*cube, ax=left)


@pytest.mark.slow
def test_no_state_is_left(tmp_path: Path) -> None:
    code = (
        "import sys, bipot_rs as bp; early = 'bipot_rs.plots' in sys.modules; "
        "import numpy as np; "
        "r = bp.solve(np.eye(4), np.eye(4), [-1.0, 0.1, -1, 0.1], gap=[0, 0], mu=0.3, "
        "points=[[0, 0], [1, 0]], frame=[np.eye(2)] * 2, area=[1, 1]); "
        "bp.plots.tractions(r); bp.plots.animate(r, 'a.gif', 'slip'); "
        "from bipot_rs.plots.run_figure import write_figure; write_figure('a.png', r); "
        "print(early, 'matplotlib.pyplot' in sys.modules, 'skfem' in sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert run.stdout.split() == ["False"] * 3


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda _: plots.tractions(3), TypeError, "result is a int"),
        (
            lambda r: plots.tractions(r, step=9),
            ValueError,
            "step is 9, expected 0 to",
        ),
        (lambda r: plots.tractions(r[0]), ValueError, "places of the contacts"),
        (lambda r: plots.tractions(r, on=[99]), ValueError, "on is out of range"),
        (lambda r: r.plot(where=[0]), TypeError, "where is no argument .* mean 'on'"),
        (lambda r: plots.tractions(r, on=[]), TypeError, "on has entries"),
        (
            lambda r: plots.tractions(r, on=[True]),
            ValueError,
            r"on has shape \(1",
        ),
        (lambda r: plots.tractions(r, contacts=1), TypeError, "contacts is a int"),
        (lambda r: plots.tractions(r, units="mm"), TypeError, "units is a str"),
        (lambda r: plots.tractions(r, along=[0.0, 0]), ValueError, "along is zero"),
        (lambda r: plots.surface_map(r), ValueError, "have two dimensions: use tra"),
        (lambda r: plots.surface_map(r, "heat"), ValueError, "quantity is 'heat'"),
        (
            lambda r: plots.force_displacement(r, [1.0]),
            ValueError,
            r"displacement has shape \(1,\)",
        ),
        (lambda r: plots.resultants(r[0]), TypeError, "result is a Step"),
    ],
)
def test_wrong_arguments_are_named(
    line: Any, call: Callable[[Any], Any], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        call(line[1])


def test_wrong_bodies_are_named(line: Any, cube: Any) -> None:
    with pytest.raises(ValueError, match="result has displacements of shape"):
        plots.deformed(cube[0], line[1])
    with pytest.raises(ValueError, match="scale is 0"):
        plots.deformed(*line, scale=0)
    with pytest.raises(ValueError, match="model has two dimensions, expected three"):
        plots.surface3d(*line)
    with pytest.raises(ValueError, match="backend is 'gl'"):
        plots.surface3d(*cube, backend="gl")
    two = np.random.default_rng(0).uniform(size=(64, 3))
    wrong_contacts = {"x": two, "frame": cube[0].frame}
    with pytest.raises(ValueError, match="more than one plane"):
        plots.surface_map(cube[1], contacts=wrong_contacts)


def test_units_are_kept_in_the_file(line: Any, tmp_path: Path) -> None:
    _, result = line
    result.save(tmp_path / "a.h5")
    again = bp.load(tmp_path / "a.h5")
    assert again.units == UNITS
    assert plots.tractions(again).get_ylabel() == "traction [MPa]"
    assert plots.status_map(again).get_xlabel() == "x [mm]"
