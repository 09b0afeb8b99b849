"""Pictures of the contact surface in 3D, with matplotlib or PyVista."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.results.result import Result
from bipot_rs.plots import mpl, style
from bipot_rs.plots.body import (
    box_in_space,
    draw_edges,
    facets_in_space,
    find_view,
)
from bipot_rs.plots.data import (
    ContactsArgument,
    DrawnContacts,
    look,
    model_of,
    require_model,
)
from bipot_rs.plots.line import find_closed_slip
from bipot_rs.plots.surface import NOTHING, QUANTITIES, is_plane, span, values_of
from bipot_rs.plots.triangles import corners, cut, sharp_edges

if TYPE_CHECKING:
    from bipot_rs.fem.assembly.assembly import Assembly

BACKENDS = ("matplotlib", "pyvista")
# About the largest number of polygons that show values between contacts.
_PIECES = 4000


def surface3d(
    model: object,
    result: object = None,
    quantity: str = "pressure",
    *,
    step: int = -1,
    backend: str = "matplotlib",
    bodies: bool = True,
    arrows: bool = True,
    contacts: ContactsArgument | None = None,
    limits: tuple[float, float] | None = None,
    units: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Contact facets in 3D, on surfaces of any shape, coloured by a quantity.

    Contacts on no facet are dots.

    Parameters
    ----------
    model
        The bodies, in 3D, as in `deformed`. Or a `Result` alone, also one from a file: its
        facets are drawn without the bodies.
    result, step, units
        As in `tractions`; not needed if ``model`` is a result.
    quantity
        As in `surface_map`, or ``"status"``.
    backend
        ``"matplotlib"``, or ``"pyvista"`` if installed: that picture can be rotated, and
        near facets hide far ones correctly.
    bodies
        Whether to draw the outlines of the bodies.
    arrows
        Whether to draw arrows if the quantity is slip.
    limits
        Least and largest value of the colours, to compare load steps.
    contacts
        As in `tractions`, with ``facets`` if they are not known; default the model.
    ax
        For matplotlib: axes in 3D to draw into. For PyVista: a ``Plotter``; default a new
        one, off screen, which ``.screenshot("a.png")`` writes.

    Returns
    -------
    matplotlib.axes.Axes or pyvista.Plotter

    Raises
    ------
    ModuleNotFoundError
        The backend is not installed.
    """
    if backend not in BACKENDS:
        raise ValueError(
            f"backend is {backend!r}, expected one of {', '.join(BACKENDS)}"
        )
    if quantity != "status" and quantity not in QUANTITIES:
        raise ValueError(
            f"quantity is {quantity!r}, expected one of {', '.join(QUANTITIES)}, status"
        )
    if result is None:
        result, model = model, model_of(model)[0] if isinstance(model, Result) else None
    else:
        model, _ = require_model(model)
    seen = look(
        result, step, contacts=model if contacts is None else contacts, units=units
    )
    if seen.x.shape[1] != 3:
        raise ValueError("model has two dimensions, expected three")
    outlined = model if bodies else None
    vectors, limits = arrows and quantity == "slip", style.range_of(limits)
    if backend == "pyvista":
        return _pyvista(seen, quantity, outlined, vectors, limits, ax)
    ax = style.axes_of(ax, size=(5.4, 4.2), space=True)
    draw_space(seen, quantity, ax, outlined, vectors, limits)
    style.fit(ax)
    return ax


def _values(
    seen: DrawnContacts, quantity: str, limits: tuple[float, float] | None
) -> tuple[Floats, str, str | None, tuple[float, float, str]]:
    if quantity == "status":
        return seen.status.astype(float), "status", None, (0.0, 2.0, "neither")
    values, name, unit = values_of(seen, quantity)
    return values, name, unit, span(values, quantity, seen.area, limits)


def _polygons(
    seen: DrawnContacts, values: Floats, *, nearest: bool
) -> tuple[Floats, Floats, list[Ints]]:
    """Places, values, and corners of facets, ``(m, 3)`` and ``(m, 4)``; [] if unknown."""
    x, spread, patches = seen.spread(values, nearest=nearest)
    parts = [] if seen.facets is None else corners(seen.facets)
    return x, spread, parts if seen.patches is None else [*parts, patches]


def draw_space(
    seen: DrawnContacts,
    quantity: str,
    ax: mpl.Axes3D,
    model: Assembly | None = None,
    arrows: bool = False,
    limits: tuple[float, float] | None = None,
    *,
    below: bool = False,
) -> mpl.Axes3D:
    """Draw `surface3d` by matplotlib into existing axes.

    ``model``: the `fem.Assembly` whose outline is drawn; None for none.
    ``below``: whether the colour bar is below the axes.
    """
    values, name, unit, (low, high, extend) = _values(seen, quantity, limits)
    x, spread, parts = _polygons(seen, values, nearest=quantity == "status")
    nothing = not values.any()
    colours = style.map_colours("viridis", low, high)
    if quantity == "status":
        colours["cmap"] = style.status_colours()["cmap"]
    elif nothing and limits is None:
        colours["cmap"] = style.blank()
    image: Any = None
    if parts:
        polygons, at = cut(x, spread, parts, _PIECES, nearest=quantity == "status")
        smooth: style.FacetStyle = {**colours, "lw": 0.0, "edgecolor": "none"}
        image = facets_in_space(polygons, at, ax, **smooth)
        # Without seams between the pieces.
        image.set_antialiased(False)
    dots = seen.isolated
    if dots.size:
        drawn = ax.scatter(
            *seen.x[dots].T, c=values[dots], s=8, depthshade=False, **colours
        )
        image = drawn if image is None else image
    places = seen.x
    if model is not None:
        draw_edges(model, model.nodes, ax, lw=0.7)
        places = model.nodes
    if parts and not is_plane(seen):
        ax.view_init(*find_view(_outward(seen, x, parts))[0])
    if arrows:
        ax.quiver(*_arrows(seen, places, limits), color=style.SHEAR, lw=0.8, zorder=4)
        # By depth matplotlib would hide arrows that lie in the facets.
        ax.computed_zorder = False
    box_in_space(places, ax)
    if quantity == "status":
        zones = style.status_handles(seen.status)
        style.legend_above(ax, handles=zones, title=seen.said)
    else:
        if limits is not None or not nothing:
            largest = float(values.max(initial=0.0))
            style.colour_bar(
                image, ax, name, unit, extend=extend, below=below, most=largest
            )
        if nothing:
            style.say(ax, NOTHING[quantity])
        style.note(ax, seen.said)
    style.name_axes(ax, "xyz", seen.units.get("length"))
    return ax


def _outward(seen: DrawnContacts, x: Floats, parts: list[Ints]) -> Floats:
    """Normals of the facets times their areas, of a flat surface none."""
    a, b, c = x[np.concatenate([p[:, :3] for p in parts])].swapaxes(0, 1)
    return np.cross(b - a, c - a) * (0.0 if is_plane(seen) else 1.0)


def _arrows(
    seen: DrawnContacts, places: Floats, limits: tuple[float, float] | None
) -> Floats:
    """Tails and vectors of up to some 150 arrows of the slip, ``(6, arrows)``."""
    vectors = seen.vectors(find_closed_slip(seen))
    size = np.linalg.norm(vectors, axis=1)
    largest = float(size.max(initial=0.0))
    moving = np.flatnonzero(size > 1e-3 * largest)
    moving = moving[:: -(-len(moving) // 150) or 1]
    longest = 0.12 * np.ptp(places, axis=0).max()
    scale = longest / ((largest if limits is None else limits[1]) or 1.0)
    return np.concatenate([seen.x[moving].T, scale * vectors[moving].T])


def _pyvista(
    seen: DrawnContacts,
    quantity: str,
    model: Assembly | None,
    arrows: bool,
    limits: tuple[float, float] | None,
    ax: Any,
) -> Any:
    pv = load_library("pyvista", extra="viz", need="pictures that turn")
    plotter = ax
    if ax is None:
        plotter = pv.Plotter(off_screen=True, window_size=(1000, 800))
    values, name, unit, (low, high, extend) = _values(seen, quantity, limits)
    name = style.label(name, unit)
    x, spread, parts = _polygons(seen, values, nearest=quantity == "status")
    if not parts:
        raise ValueError(
            "the facets of the contacts are not known: pass the model, or contacts= with "
            'facets, or use backend="matplotlib"'
        )
    # PyVista: for each polygon the number of corners, and the corners.
    faces = [np.column_stack([np.full(len(c), c.shape[1]), c]).ravel() for c in parts]
    surface = pv.PolyData(x, faces=np.concatenate(faces))
    look = {"clim": (low, high), "show_edges": True, "lighting": False}
    if quantity == "status":
        zones = [np.median(spread[part], axis=1).round() for part in parts]
        surface.cell_data[name] = np.concatenate(zones)
        colours = list(style.COLOURS)
        plotter.add_mesh(
            surface, scalars=name, cmap=colours, show_scalar_bar=False, **look
        )
        handles = style.status_handles(seen.status)
        legend = [[h.get_label(), h.get_facecolor()[:3]] for h in handles]
        plotter.add_legend(legend, bcolor=None, face="rectangle", size=(0.2, 0.15))
    else:
        surface.point_data[name] = spread
        # On the right of the bodies.
        bar: dict[str, object] = {
            "vertical": True,
            "position_x": 0.86,
            "position_y": 0.15,
            "height": 0.7,
        }
        bar |= {"fmt": "%.3g", "color": "black", "title": name}
        if extend in ("max", "both"):
            bar["title"] = f"{name}\nmax {values.max():.3g}"
        plotter.add_mesh(
            surface, scalars=name, cmap="viridis", scalar_bar_args=bar, **look
        )
    places = seen.x
    if model is not None:
        places, edges = model.nodes, sharp_edges(model.nodes, model.cells)
        lines = np.column_stack([np.full(len(edges), 2), edges]).ravel()
        outline = pv.PolyData(model.nodes, lines=lines)
        plotter.add_mesh(outline, color=style.QUIET, line_width=2)
    if arrows:
        tails, tips = _arrows(seen, places, limits).reshape(2, 3, -1).swapaxes(1, 2)
        if tails.size:
            plotter.add_arrows(tails, tips, mag=1.0, color=style.SHEAR)
    if quantity != "status" and not values.any():
        plotter.add_text(NOTHING[quantity], position="upper_edge", font_size=12)
    plotter.show_axes()
    # Last, when all is there to be seen.
    plotter.view_vector(find_view(_outward(seen, x, parts))[1])
    plotter.camera.zoom(0.95)
    return plotter
