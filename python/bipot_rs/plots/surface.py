"""Pictures of a flat contact surface in 3D: maps of tractions and status, slip arrows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.results.result import Result
from bipot_rs.plots import mpl, style
from bipot_rs.plots.body import polygons_in_plane
from bipot_rs.plots.data import (
    ContactsArgument,
    DrawnContacts,
    contacts_of,
    look,
    selection,
    steps_of,
)
from bipot_rs.plots.line import draw_slip, draw_zones, find_closed_slip
from bipot_rs.plots.triangles import cut, of_points, polygons

if TYPE_CHECKING:
    from typing import Unpack

# Quantities of `surface_map`: label and kind of unit.
QUANTITIES = {
    "pressure": ("pressure", "stress"),
    "shear": ("shear traction", "stress"),
    "slip": ("slip in the step", "length"),
    "gap": ("gap", "length"),
}
# Text in the picture if a quantity is zero everywhere.
NOTHING = {
    "pressure": "all contacts are open",
    "shear": "no friction acts",
    "slip": "no slip in the step",
    "gap": "all contacts are closed",
}
# An open gap below this fraction of the width of the surface is rounding.
_TOUCHES = 1e-12
# Share of the area whose values lie within the range of colours. Of the nodes it would be
# another range on a mesh that is refined at an edge.
_SPAN = 0.98
# About the largest number of pieces of a map.
_PIECES = 40_000
# Number of arrows across the surface.
_ARROWS = 14


def surface_map(
    result: object,
    quantity: str = "pressure",
    *,
    step: int = -1,
    arrows: bool | None = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    limits: tuple[float, float] | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Map of a flat contact surface in 3D, interpolated on its facets.

    A model, its result and their files know the facets. Otherwise the map is drawn on a
    triangulation of the contacts, without triangles across holes.

    At an edge tractions are singular: the colours cover the values on 98 % of the area,
    and an arrow at the colour bar shows that there are larger ones. If the quantity is
    zero everywhere, a text says so.

    The axes are x, y or z if these lie in the plane, else t1 and t2 of the contacts, or
    their mean if the contacts have different ones.

    Parameters
    ----------
    result, step, on, contacts, limits, units, ax
        As in `tractions`; ``limits`` are those of the colours. If there are several
        surfaces, select one with ``on``.
    quantity
        ``"pressure"``, ``"shear"`` (magnitude), ``"slip"`` (magnitude in the step, zero
        at sticking and open contacts), ``"gap"`` (zero at closed contacts).
    arrows
        Whether arrows show the direction; shear is that on the body that has the
        contacts. Default: for shear and slip, if the frames are known.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; the message names it. Contacts that do not lie on one plane.
    """
    if quantity not in QUANTITIES:
        raise ValueError(
            f"quantity is {quantity!r}, expected one of {', '.join(QUANTITIES)}"
        )
    seen = look(result, step, contacts=contacts, on=on, units=units)
    vectors = {"shear": seen.traction[:, 1:], "slip": find_closed_slip(seen)}
    vector = vectors.get(quantity)
    if arrows is None:
        arrows = vector is not None and seen.frame is not None
    ax = style.axes_of(ax)
    limits = style.range_of(limits)
    draw_map(seen, quantity, ax, vector if arrows else None, limits)
    style.fit(ax)
    return ax


def draw_map(
    seen: DrawnContacts,
    quantity: str,
    ax: mpl.Axes,
    vector: Floats | None = None,
    limits: tuple[float, float] | None = None,
) -> mpl.Axes:
    """Draw `surface_map` into existing axes."""
    uv, names = plane_of(seen)
    values, name, unit = values_of(seen, quantity)
    if is_line(uv):
        raise ValueError("the contacts lie on a line: use tractions instead")
    nothing = not values.any()
    if nothing:
        style.say(ax, NOTHING[quantity])
    if nothing and limits is None:
        paint(seen, uv, values, ax, **style.map_colours(style.blank(), 0, 1))
    else:
        low, high, extend = span(values, quantity, seen.area, limits)
        colours = style.map_colours("viridis", low, high)
        image = paint(seen, uv, values, ax, **colours)
        if vector is not None:
            _arrows(seen, uv, vector, ax, color="white", **style.RIM)
    finish(seen, uv, names, ax)
    if limits is not None or not nothing:
        most = float(values.max())
        style.colour_bar(image, ax, name, unit, extend=extend, most=most)
    style.note(ax, seen.said)
    return ax


def paint(
    seen: DrawnContacts,
    uv: Floats,
    values: Floats,
    ax: mpl.Axes,
    *,
    nearest: bool = False,
    **colours: Unpack[style.Colours],
) -> mpl.PolyCollection:
    """Draw values at the contacts ``(n_c,)``, interpolated on the surface in small pieces.

    Shading by the colours of corners would mix colours that are not on the colour bar.
    ``nearest`` draws the values of the nearest contacts. Contacts on no facet are dots.
    """
    places, spread, parts = mesh_of(seen, uv, values, nearest=nearest)
    drawn, at = cut(places, spread, parts, _PIECES, nearest=nearest)
    if seen.facets is not None or not parts:
        u, v = uv[seen.isolated].T
        at_dots = values[seen.isolated]
        ax.scatter(u, v, s=9, c=at_dots, lw=0, zorder=2, **colours)
    return polygons_in_plane(drawn, at, ax, **colours)


def mesh_of(
    seen: DrawnContacts, uv: Floats, values: Floats, *, nearest: bool = False
) -> tuple[Floats, Floats, list[Ints]]:
    """Places, values and polygons: of the facets if these are known, else of the points."""
    if seen.facets is None:
        return uv, values, [] if is_line(uv) else [of_points(uv, seen.area)]
    x, spread, patches = seen.spread(values, nearest=nearest)
    return x @ tangents(seen)[0].T, spread, [*polygons(seen.facets), patches]


def values_of(seen: DrawnContacts, quantity: str) -> tuple[Floats, str, str | None]:
    """Values of a quantity, ``(n_c,)``, its label and its unit."""
    name, kind = QUANTITIES[quantity]
    unit = seen.units.get("length")
    if kind == "stress":
        unit = seen.traction_unit
        if seen.area is None:
            name = {"pressure": "normal force", "shear": "friction force"}[quantity]
    # At closed contacts the gap is rounding.
    width = float(np.ptp(seen.x, axis=0).max())
    apart = (seen.status == Status.OPEN) & (np.abs(seen.gap) > _TOUCHES * width)
    values: dict[str, Floats] = {
        "pressure": seen.traction[:, 0],
        "shear": np.linalg.norm(seen.traction[:, 1:], axis=1),
        "slip": np.linalg.norm(find_closed_slip(seen), axis=1),
        "gap": np.where(apart, seen.gap, 0.0),
    }
    return values[quantity], name, unit


def span(
    values: Floats,
    quantity: str,
    area: Floats | None,
    limits: tuple[float, float] | None = None,
) -> tuple[float, float, str]:
    """Range of the colours, and on which side there are values beyond it.

    The side is in the words of matplotlib: "neither", "min", "max" or "both".

    ``values, area``: ``(n_c,)``; without areas all contacts have the same.
    ``limits``: the range, if it is chosen.
    """
    if limits is not None:
        return *limits, style.beyond(values, *limits)
    low = float(min(values.min(), 0.0)) if quantity == "gap" else 0.0
    order = np.argsort(values, kind="stable")
    below = np.cumsum(np.ones(len(values)) if area is None else area[order])
    high = float(values[order][np.searchsorted(below, _SPAN * below[-1])])
    if high <= low:
        # Only a few values differ from the least one: the range covers them.
        high = float(values.max())
    if high <= low:
        return low, low + 1.0, "neither"
    return low, high, style.beyond(values, low, high)


def status_map(
    result: object,
    *,
    step: int | None = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Map of the contact status.

    In 3D: the flat surface at one step, each point in the colour of a near contact.
    In 2D: the contact line over the load path, one row for each step.

    Parameters
    ----------
    result, on, contacts, units, ax
        As in `surface_map`; in 2D several surfaces have separate rows.
    step
        Step of a result; default the last one, in 2D all.
    """
    last = -1 if step is None else step
    seen = look(result, last, contacts=contacts, on=on, units=units)
    ax = style.axes_of(ax)
    if seen.x.shape[1] == 3:
        draw_status(seen, ax)
        style.fit(ax)
        return ax
    if step is None and isinstance(result, Result):
        path = steps_of(result)
        arrays = contacts_of(path, contacts)
        chosen = selection(on, len(path[0].status), arrays)
        return draw_zones(seen, path.status[:, chosen], ax)
    draw_zones(seen, seen.status[None], ax)
    ax.set_yticks([])
    ax.set_ylabel("")
    return ax


def draw_status(seen: DrawnContacts, ax: mpl.Axes) -> mpl.Axes:
    """Draw `status_map` of a surface into existing axes."""
    uv, names = plane_of(seen)
    status = seen.status.astype(float)
    paint(seen, uv, status, ax, nearest=True, **style.status_colours())
    zones = style.status_handles(seen.status)
    style.legend_above(ax, handles=zones, title=seen.said)
    finish(seen, uv, names, ax)
    return ax


def slip(
    result: object,
    *,
    step: int = -1,
    along: ArrayLike | str | None = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    limits: tuple[float, float] | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Slip of a step: in 2D along a line, in 3D as arrows on a flat surface.

    Arrows are drawn at one slipping contact in each of about 14 × 14 squares; their length
    and colour show the magnitude. Closed contacts are dots, open ones circles. A line has
    gaps at open contacts.

    Parameters
    ----------
    result, step, along, on, contacts, limits, units, ax
        As in `tractions`; in 3D ``along`` draws a line instead of arrows, and the longest
        arrow is that of the upper limit.
    """
    seen = look(result, step, contacts=contacts, on=on, units=units)
    ax, limits = style.axes_of(ax), style.range_of(limits)
    if seen.x.shape[1] == 2 or along is not None:
        return draw_slip(seen, along, ax, limits)
    uv, names = plane_of(seen)
    moved = find_closed_slip(seen)
    size = np.linalg.norm(moved, axis=1)
    closed = seen.status != Status.OPEN
    u, v = uv.T
    ax.scatter(u[closed], v[closed], s=4, color="#c9ced3", lw=0)
    ax.scatter(
        u[~closed], v[~closed], s=9, facecolors="none", edgecolors="#c9ced3", lw=0.6
    )
    most = float(size.max(initial=0.0)) if limits is None else limits[1]
    arrows: mpl.ScalarMappable | None = _arrows(
        seen, uv, moved, ax, cmap="viridis", values=size, most=most, **style.RIM
    )
    finish(seen, uv, names, ax, margin=0.13)
    if arrows is None:
        style.say(ax, NOTHING["slip"])
        # Steps of an animation have the same bar.
        arrows = None if limits is None else style.scale_of("viridis", 0.0, most)
    if arrows is not None:
        unit = seen.units.get("length")
        style.colour_bar(arrows, ax, "slip in the step", unit)
    style.note(ax, seen.said)
    style.fit(ax)
    return ax


def finish(
    seen: DrawnContacts, uv: Floats, names: list[str], ax: mpl.Axes, margin: float = 0.0
) -> None:
    """Set the limits and the labels of the axes of a map, with equal scales."""
    unit = seen.units.get("length")
    if seen.patches is not None:
        uv = seen.spread(seen.gap)[0] @ tangents(seen)[0].T
    around = margin * np.ptp(uv, axis=0).max()
    low, high = uv.min(axis=0) - around, uv.max(axis=0) + around
    ax.set_aspect("equal")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    style.name_axis(ax.xaxis, names[0], unit)
    style.name_axis(ax.yaxis, names[1], unit)


def _arrows(
    seen: DrawnContacts,
    uv: Floats,
    vector: Floats,
    ax: mpl.Axes,
    *,
    values: Floats | None = None,
    most: float = 1.0,
    **look: Unpack[style.ArrowStyle],
) -> mpl.Quiver | None:
    """Draw tangential vectors at some contacts; one of size ``most`` fills its square."""
    axes, _ = tangents(seen)
    size = np.linalg.norm(vector, axis=1)
    largest = float(size.max(initial=0.0))
    # Vectors that are rounding have no direction.
    chosen = _thin(uv, size > 1e-9 * largest, values)
    if not chosen.size or largest == 0:
        return None
    across = np.ptp(uv, axis=0).max() / _ARROWS
    flat = seen.vectors(vector)[chosen] @ axes.T
    if values is None:
        flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        scale = 1 / (0.8 * across)
        colours: tuple[Floats, ...] = ()
    else:
        scale = most / (1.6 * across)
        colours = (values[chosen],)
        look["clim"] = (0.0, most)
    drawn = ax.quiver(
        *uv[chosen].T,
        *flat.T,
        *colours,
        pivot="mid" if values is None else "tail",
        angles="xy",
        scale_units="xy",
        scale=scale,
        width=5e-3,
        # Arrows at the edges are whole, over the frame.
        clip_on=False,
        zorder=3,
        **look,
    )
    # matplotlib takes directions for places in the extent of arrows that are not clipped.
    drawn.set_in_layout(False)
    return drawn


def _thin(uv: Floats, wanted: Bools, values: Floats | None) -> NDArray[np.intp]:
    """Choose one of the wanted contacts in each of about 14 × 14 squares.

    The one with the largest value; without values the one nearest to the middle of the
    square, so that its arrow stays within the frame.
    """
    size = np.ptp(uv, axis=0).max() / _ARROWS or 1.0
    at = (uv - uv.min(axis=0)) / size
    count = np.maximum(np.rint(at.max(axis=0)).astype(int), 1)
    squares = np.minimum(np.floor(at).astype(int), count - 1)
    last = np.linalg.norm(at - squares - 0.5, axis=1) if values is None else -values
    nodes = np.flatnonzero(wanted)
    nodes = nodes[np.argsort(last[nodes], kind="stable")]
    _, first = np.unique(squares[nodes], axis=0, return_index=True)
    return nodes[first]


# Tolerance for nodes on one plane, relative to its width.
_PLANE = 1e-6


def is_plane(seen: DrawnContacts) -> bool:
    """Whether contacts in 3D lie on one plane."""
    off = seen.x - seen.x.mean(axis=0)
    widths = np.ptp(off @ np.linalg.svd(off, full_matrices=False)[2].T, axis=0)
    return bool(widths[-1] <= _PLANE * widths[0]) if len(widths) == 3 else True


def is_line(uv: Floats) -> bool:
    """Whether points on a plane lie on one line, or are fewer than three."""
    if len(uv) < 3:
        return True
    wide, narrow = np.linalg.svd(uv - uv.mean(axis=0), compute_uv=False)
    return bool(narrow <= _PLANE * wide)


def plane_of(seen: DrawnContacts) -> tuple[Floats, list[str]]:
    """Coordinates ``(n_c, 2)`` on the plane of the contacts, and their labels."""
    x = seen.x
    if x.shape[1] != 3:
        raise ValueError("the contacts have two dimensions: use tractions instead")
    if not is_plane(seen):
        surfaces = [name for name, _ in seen.surfaces if name]
        listed = f" ({', '.join(surfaces)})" if len(surfaces) > 1 else ""
        raise ValueError(
            f"the contacts lie on more than one plane: choose one surface{listed}, or a "
            "picture in 3D"
        )
    axes, names = tangents(seen)
    return x @ axes.T, names


def tangents(seen: DrawnContacts) -> tuple[Floats, list[str]]:
    """Axes ``(2, 3)`` on the plane of the contacts, and their labels.

    The tangents of the contacts if these are equal. Otherwise, as for a roller on a plane,
    tangents may point out of the plane, and their mean is used.
    """
    off = seen.x - seen.x.mean(axis=0)
    # Three more rows, so that the SVD has three directions even for two contacts.
    rows = np.concatenate([off, np.zeros((3, 3))])
    normal = np.linalg.svd(rows, full_matrices=False)[2][-1]
    names = ["along t1", "along t2"]
    if seen.frame is None:
        # The two coordinates in which the plane has the largest projection.
        axes = np.delete(np.eye(3), np.argmax(np.abs(normal)), axis=0)
    elif np.abs(seen.frame - seen.frame[0]).max() <= _PLANE:
        axes = seen.frame[0, 1:]
    else:
        axes = _mean_tangents(seen.frame, normal)
        names = ["along mean t1", "along mean t2"]
    at = np.argmax(axes, axis=1)
    if np.allclose(axes, np.eye(3)[at], rtol=0, atol=_PLANE):
        return np.eye(3)[at], ["xyz"[k] for k in at]
    return axes, names


def _mean_tangents(frame: Floats, normal: Floats) -> Floats:
    """The mean t1 projected onto a plane, and the direction at right angles near t2."""
    first, second = frame[:, 1:].mean(axis=0)
    first = first - (first @ normal) * normal
    if np.linalg.norm(first) < 0.1:
        # Around an axis the tangents cancel: use the axis of coordinates nearest the plane.
        axis = np.eye(3)[np.argmin(np.abs(normal))]
        first = axis - (axis @ normal) * normal
    first = first / np.linalg.norm(first)
    across = np.cross(normal, first)
    if np.linalg.norm(second) < 0.1:
        second = np.sign(across[np.argmax(np.abs(across))]) * across
    return np.stack([first, across if across @ second >= 0 else -across])
