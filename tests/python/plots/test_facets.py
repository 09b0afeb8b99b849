"""Curved surfaces are drawn by their facets; bodies keep or enlarge their gaps."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Path3DCollection, Poly3DCollection

import bipot_rs as bp
from bipot_rs import fem, plots
from bipot_rs.fem.contact_surface import contact_facets, surface_labels
from bipot_rs.plots import triangles
from bipot_rs.plots.data import DrawnContacts, look
from bipot_rs.plots.run_figure import write_figure
from support.layout import overlaps


def bowl(cells: int, cell: str) -> fem.Assembly:
    """A block whose lower side is curved, above a plane."""
    grid = np.linspace(-1, 1, cells + 1)
    mesh = fem.box([grid, grid, np.linspace(0, 1, 3)], cell)
    x, y, z = mesh.p
    mesh.doflocs[2] = z + 0.3 * (1 - z) * (x**2 + y**2)
    body = fem.Body("bowl", mesh, fem.Material(10.0, 0.3))
    floor = fem.Contact("bowl", "bottom", 0.3, ([0, 0, 0], [0, 0, 1]))
    return fem.assemble([body], [floor], [fem.Support("bowl", "top", [0, 1, 2])])


def area_of_triangles(x: Any, corners: Any) -> float:
    a, b, c = x[corners].swapaxes(0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_facets_of_a_curved_surface_cover_it(cell: str) -> None:
    model = bowl(6, cell)
    facets = triangles.check_facets(contact_facets(model), len(model.points))
    assert len(facets) == (36 if cell == "hexahedron" else 72)
    area = area_of_triangles(model.points, triangles.split(facets))
    # Triangles are exact; quadrilaterals are not plane.
    rounding = 1e-2 if cell == "hexahedron" else 1e-9
    assert area == pytest.approx(model.area.sum(), rel=rounding)
    assert not triangles.alone(facets, len(model.points)).size


def drawn_area(seen: DrawnContacts) -> float:
    """Area of the facets and patches that are drawn."""
    x, _, patches = seen.spread(seen.gap)
    assert seen.facets is not None
    return area_of_triangles(x, np.concatenate([triangles.split(seen.facets), patches]))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("side", [(0, 1), (0.35, 1.3), (-0.2, 0.85), (-0.2, 0.8)])
def test_mortar_surfaces_end_where_the_other_does(
    side: tuple[float, float], cell: str, order: int
) -> None:
    """The upper body lies on a part of the lower one; neither mesh fits the border.

    In second order contacts are at the corners only, and still form a surface.
    """
    upper, lower = np.linspace(0, 1, 5), np.linspace(*side, 4)
    bodies = []
    for name, x, z in (("high", upper, [1, 2]), ("low", lower, [0, 1])):
        mesh = fem.box([x, upper, z], cell)
        mesh = fem.second_order(mesh) if order == 2 else mesh
        bodies.append(fem.Body(name, mesh, fem.Material(10.0, 0.3)))
    pair = {"against": ("low", "top"), "pairing": "mortar"}
    contact = fem.Contact("high", "bottom", 0.3, **pair)
    model = fem.assemble(bodies, [contact], [fem.Support("low", "bottom", [0, 1, 2])])
    count = len(model.points)
    result = bp.ReducedProblem(np.eye(3 * count), np.ones((count, 3)), 0.3).solve()
    seen = look(result, contacts=model)
    covered = min(side[1], 1) - max(side[0], 0)
    assert drawn_area(seen) == pytest.approx(covered, rel=1e-12)
    assert drawn_area(seen) == pytest.approx(model.area.sum(), rel=1e-12)
    assert not seen.isolated.size
    x, field, corners = seen.spread(seen.x[:, 0])
    ends = x[corners][..., 0]
    assert bool(len(corners)) is (side != (0, 1))
    assert ends.min(initial=1) >= max(side[0], 0) - 1e-12
    assert ends.max(initial=0) <= min(side[1], 1) + 1e-12
    # A linear field is exact if all corners have a contact. Of the nodes at x = 1, 0.8 covers
    # less than 1/20: the field goes on as the mean of the contacts at 0.75.
    kept = 0.75 if side[1] == 0.8 else 1.0
    if cell == "hexahedron" or kept == 1:
        exact = np.minimum(x[:, 0], kept)
        np.testing.assert_allclose(field, exact, rtol=0, atol=1e-12)
    if kept == 1:
        field = seen.spread(seen.x @ [1.0, -2.0, 3.0])[1]
        np.testing.assert_allclose(field, x @ [1.0, -2.0, 3.0], rtol=0, atol=1e-12)
        # Of a part of the contacts, the facets and patches of these remain.
        part = seen.part(model.points[:, 1] <= 0.5)
        assert drawn_area(part) == pytest.approx(covered / 2, rel=1e-12)


def test_surfaces_that_repeat_themselves_are_whole(tmp_path: Any) -> None:
    """At the cut x = 0 stand the values of the contacts at the cut y = 0."""
    result = bp.Model.from_toml("twisted_pad").with_(**{"mesh.n": 4}).solve()
    result.save(tmp_path / "pad.h5")
    for source in (result, bp.load(tmp_path / "pad.h5")):
        seen = look(source)
        assert drawn_area(seen) == pytest.approx(400.0, rel=1e-12)
        x, pressure, _ = seen.spread(seen.traction[:, 0])
        turned = x[:, [1, 0, 2]]
        for at, value in zip(x[x[:, 0] == 0], pressure[x[:, 0] == 0], strict=True):
            image = np.flatnonzero((turned[: len(seen.x)] == at).all(axis=1))
            assert value == pressure[image].item()


@pytest.mark.parametrize("corners", [3, 4])
def test_pieces_of_facets_have_linear_values(corners: int) -> None:
    """Pieces cover the facets, and a linear field is exact at their centres."""
    rng = np.random.default_rng(corners)
    at = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])[:corners]
    x = at @ rng.normal(size=(5, 3, 3)) + rng.normal(size=(5, 1, 3))
    field = x @ [1.0, -2.0, 3.0]
    polygons, values = triangles.pieces(x, field, 200)
    if corners == 4:
        exact = polygons.mean(axis=1) @ [1.0, -2.0, 3.0]
        np.testing.assert_allclose(values, exact, rtol=0, atol=1e-13)
    sides = polygons - polygons[:, :1]
    whole = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    area = np.linalg.norm(whole, axis=1).sum() * (0.5 if corners == 3 else 1.0)
    halves = [np.cross(sides[:, k], sides[:, k + 1]) for k in (1, 2)]
    covered = sum(np.linalg.norm(half, axis=1).sum() for half in halves) / 2
    assert covered == pytest.approx(area, rel=1e-12)
    assert values.min() >= field.min()
    assert values.max() <= field.max()


@pytest.mark.slow
def test_the_picture_of_a_run_has_facets(tmp_path: Any, monkeypatch: Any) -> None:
    """Not dots; dots only if the facets are not known."""
    model = bowl(4, "hexahedron")
    solved = model.problem().solve(prescribed=model.prescribed([[0.0, 0.0, -0.1]]))
    known = solved.contacts | surface_labels(model)
    kept: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    about = {"shape": solved.shape, "success": True, "message": ""}
    for contacts in (known, {k: v for k, v in known.items() if k != "facets"}):
        result = bp.Result(solved.steps, contacts=contacts, **about)
        write_figure(tmp_path / "a.png", result)
    kinds = [Poly3DCollection, Path3DCollection]
    for figure, (drawn, absent) in zip(kept, (kinds, kinds[::-1]), strict=True):
        panels = [ax for ax in figure.findobj() if getattr(ax, "name", "") == "3d"]
        assert len(panels) == 3
        for ax in panels:
            assert any(isinstance(it, drawn) for it in ax.collections)
            assert not any(type(it) is absent for it in ax.collections)
    assert overlaps(kept[0]) == []


def surfaces(nodes: int) -> Any:
    """Pairs of two equal flat surfaces of one or four facets, one above the other."""
    if nodes == 4:
        at = np.array([[x, y, 0.0] for y in range(3) for x in range(3)])
        facets = np.array([[k, k + 1, k + 4, k + 3] for k in (0, 1, 3, 4)])
    else:
        corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        at = np.concatenate([corner, (corner + np.roll(corner, -1, axis=0)) / 2])
        facets = np.arange(6)[None]
    down = facets[:, [0, 3, 2, 1]] if nodes == 4 else facets[:, [0, 2, 1, 5, 4, 3]]
    return bp.pairs(at, down, at - [0, 0, 0.1], facets), at, down


def pressed_pairs(model: Any) -> bp.Result:
    """Each side on springs of its own, pressed together."""
    K = np.eye(model.B.shape[1])
    known = {"points": model.points, "frame": model.frame, "area": model.area}
    return bp.ContactProblem(K, model.B, gap=model.gap - 0.2, mu=0.3, **known).solve()


@pytest.mark.parametrize("nodes", [4, 6])
def test_mortar_surfaces_know_their_facets(nodes: int) -> None:
    pairs, at, down = surfaces(nodes)
    kept = triangles.check_facets(pairs.facets, len(pairs.points))
    corners = 4 if nodes == 4 else 3
    there = pairs.points[kept[:, :corners]]
    np.testing.assert_array_equal(there, at[down[:, :corners]])
    result = pressed_pairs(pairs)
    ax = plots.surface3d(result, contacts=pairs)
    image = next(c for c in ax.collections if c.get_array() is not None)
    assert len(image.get_array()) % len(down) == 0
    result.contacts["facets"] = pairs.facets
    again = result.plot("pressure_3d")
    same = next(c for c in again.collections if c.get_array() is not None)
    np.testing.assert_array_equal(same.get_array(), image.get_array())


def test_contacts_on_no_facet_are_dots() -> None:
    model, *_ = surfaces(4)
    result = pressed_pairs(model)
    result.contacts["facets"] = model.facets[:1]
    for ax in (result.plot("pressure_3d"), result.plot("pressure_map")):
        sizes = [len(c.get_offsets()) for c in ax.collections]
        assert [size for size in sizes if size > 1] == [9 - 4]


def stacked(gap: float) -> tuple[fem.Assembly, bp.Result]:
    """A block above another, with a gap that closes."""
    grid = np.linspace(0, 1, 4)
    low, high = (
        fem.Body(name, fem.box([grid, y], "quadrilateral"), fem.Material(10.0, 0.3))
        for name, y in (("low", grid), ("high", grid + 1 + gap))
    )
    contact = fem.Contact("high", "bottom", 0.3, against=("low", "top"))
    held = [fem.Support("low", "bottom", [0, 1]), fem.Support("high", "top", [0, 1])]
    model = fem.assemble([low, high], [contact], held)
    down = model.prescribed([[0.0, 0.0], [0.0, -gap - 0.01]])
    return model, model.problem().solve(prescribed=down)


@pytest.mark.parametrize(
    ("gap", "scale", "said"),
    [(0.05, 5.0, True), (0.05, 1.0, False), (0.0, 5.0, False), (1e-9, 5.0, False)],
)
@pytest.mark.quick_variants("0.05-5.0-*")
def test_gaps_between_bodies_are_not_enlarged(
    gap: float, scale: float, said: bool
) -> None:
    model, result = stacked(gap)
    ax = plots.deformed(model, result, scale=scale)
    assert ("gaps between bodies × 1" in ax.get_title("left")) is said
    assert overlaps(ax.figure) == []


def test_a_part_of_the_bodies_is_drawn() -> None:
    model, result = stacked(0.05)
    ax = plots.deformed(model, result, box=[[0.5, 1.2], [0.0, 0.9]])
    assert (ax.get_xlim(), ax.get_ylim()) == ((0.0, 0.5), (0.9, 1.2))
    wide = plots.deformed(model, result, limits=(0.0, 1e-3))
    bar = next(c for c in wide.collections if c.colorbar is not None)
    assert (bar.get_clim(), bar.colorbar.extend) == ((0.0, 1e-3), "max")


@pytest.mark.parametrize("shape", [(1.0, 1.0), (1.0, 3.0), (3.0, 1.0)])
def test_arrows_keep_clear_of_the_colour_bar(shape: tuple[float, float]) -> None:
    """Also in a high or a low map, whose bar is as wide and as high as the map asks."""
    u, v = (side * np.linspace(0, 1, 5) for side in shape)
    x = np.array([[a, b, 0.0] for a in u for b in v])
    # Each is pushed along x, and sticks.
    q = np.tile([-2.0, -0.5, 0.0], (len(x), 1))
    solution = bp.ReducedProblem(np.eye(q.size), q, 0.3).solve()
    frame = np.broadcast_to(np.eye(3)[[2, 0, 1]], (len(x), 3, 3))
    known = {"x": x, "frame": frame, "area": np.ones(len(x))}
    ax = plots.surface_map(solution, "shear", contacts=known)
    ax.figure.canvas.draw()
    (arrows,) = (c for c in ax.collections if hasattr(c, "scale_units"))
    half = 0.5 / arrows.scale
    tips = ax.transData.transform([[arrows.X.max() + half, 0.0]])[0, 0]
    left = ax.child_axes[0].get_window_extent().x0
    assert left - tips > 0.01 * ax.get_window_extent().width
