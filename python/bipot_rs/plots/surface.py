"""Contact on a plane surface in space: maps of tractions and zones, arrows of slip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.result import Result
from bipot_rs.contact.status import Status
from bipot_rs.plots import style
from bipot_rs.plots.data import Contacts, Given, contacts_of, look, selection, steps_of
from bipot_rs.plots.line import closed_slip, draw_slip, draw_zones

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What `surface_map` draws: its name, and of what unit.
QUANTITIES = {
    "pressure": ("pressure", "stress"),
    "shear": ("shear traction", "stress"),
    "slip": ("slip in the step", "length"),
    "gap": ("gap", "length"),
}
# What is said where a quantity is zero everywhere.
NOTHING = {
    "pressure": "all contacts are open",
    "shear": "no friction acts",
    "slip": "no slip in the step",
    "gap": "all contacts are closed",
}
# Gaps of what is open, but for rounding closed, to this part of the surface's width.
_TOUCHES = 1e-12
# Nodes of one plane, to this part of its width.
_PLANE = 1e-6
_PIXELS = 500
# An edge longer than so many times the widths of what its two nodes have bridges a hole.
_BRIDGE = 2.5
# The part of the nodes whose values the colours span.
_SPAN = 98
# Arrows, as many across.
_ARROWS = 14


def surface_map(
    result: Any,
    quantity: str = "pressure",
    *,
    step: int = -1,
    arrows: bool | None = None,
    where: ArrayLike | str | None = None,
    contacts: Given | None = None,
    units: Mapping[str, str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Map of a plane surface of contact in space, triangulated by its nodes.

    Tractions grow without bound towards an edge: the colours span what 98 nodes of 100
    have, and an arrow at the colour bar says that others have more. Where there is
    nothing to tell by colours, such as a gap where all is closed, that is said instead.

    Places are those on the plane, along x, y or z where it lies so, else along t1 and t2
    of the contacts, in the mean where these differ.

    Parameters
    ----------
    result, step, where, contacts, units, ax
        As in `tractions`. Of several surfaces, ``where`` chooses one.
    quantity
        ``"pressure"``, ``"shear"`` (its size), ``"slip"`` (the size of the step's, zero
        where contact sticks or is open), ``"gap"`` (what is left of it, zero where bodies
        touch).
    arrows
        Whether arrows show the direction, of shear as it acts on the body that has the
        contacts; default: of shear and slip, where the frames are known.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        A wrong argument, named; contacts that do not lie on one plane.
    """
    if quantity not in QUANTITIES:
        raise ValueError(
            f"quantity is {quantity!r}, expected one of {', '.join(QUANTITIES)}"
        )
    seen = look(result, step, contacts=contacts, where=where, units=units)
    vectors = {"shear": seen.traction[:, 1:], "slip": closed_slip(seen)}
    vector = vectors.get(quantity)
    if arrows is None:
        arrows = vector is not None and seen.frame is not None
    own, ax = ax is None, style.axes_of(ax)
    draw_map(seen, quantity, ax, vector if arrows else None)
    if own:
        style.fit(ax)
    return ax


def draw_map(
    seen: Contacts, quantity: str, ax: Axes, vector: Floats | None = None
) -> Axes:
    """`surface_map` on axes that are there."""
    uv, names = _plane(seen)
    values, name, unit = values_of(seen, quantity)
    if _line(uv):
        raise ValueError("the contacts lie on a line: tractions draws those")
    if not values.any():
        triangles = _triangles(uv, seen.area)
        ax.tripcolor(triangles, values, shading="gouraud", cmap=style.blank())
        style.say(ax, NOTHING[quantity])
    else:
        low, high, extend = span(values, quantity)
        image = ax.tripcolor(
            _triangles(uv, seen.area),
            values,
            shading="gouraud",
            cmap="viridis",
            vmin=low,
            vmax=high,
        )
        if vector is not None:
            _arrows(seen, uv, vector, ax, color="white")
    _finish(seen, uv, names, ax)
    if values.any():
        style.colour_bar(image, ax, name, unit, extend=extend)
    style.note(ax, seen.said)
    return ax


def values_of(seen: Contacts, quantity: str) -> tuple[Floats, str, str | None]:
    """What `QUANTITIES` names, ``(n_c,)``, with its name and unit."""
    name, kind = QUANTITIES[quantity]
    unit = seen.units.get("length")
    if kind == "stress":
        unit = style.stress_unit(seen.units)
        if seen.area is None:
            name = {"pressure": "normal force", "shear": "friction force"}[quantity]
            unit = seen.units.get("force")
    # Of what touches, the gap is rounding.
    width = float(np.ptp(seen.x, axis=0).max())
    apart = (seen.status == Status.OPEN) & (np.abs(seen.gap) > _TOUCHES * width)
    values: dict[str, Floats] = {
        "pressure": seen.traction[:, 0],
        "shear": np.linalg.norm(seen.traction[:, 1:], axis=1),
        "slip": np.linalg.norm(closed_slip(seen), axis=1),
        "gap": np.where(apart, seen.gap, 0.0),
    }
    return values[quantity], name, unit


def span(values: Floats, quantity: str) -> tuple[float, float, str]:
    """Least and largest value that have colours, and whether others have more."""
    low = float(min(values.min(), 0.0)) if quantity == "gap" else 0.0
    high = float(np.percentile(values, _SPAN))
    if high <= low:
        # All the same but a few: those then span the colours.
        high = float(values.max())
    if high <= low:
        return low, low + 1.0, "neither"
    return low, high, "max" if values.max() > high * (1 + 1e-9) else "neither"


def status_map(
    result: Any,
    *,
    step: int | None = None,
    where: ArrayLike | str | None = None,
    contacts: Given | None = None,
    units: Mapping[str, str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Where contact is open, slips and sticks.

    In space the plane surface at one step, each place in the colour of the nearest
    contact; in the plane the contact line over the load path, a row a step.

    Parameters
    ----------
    result, where, contacts, units, ax
        As in `surface_map`; in the plane several surfaces have rows of their own.
    step
        Which step; default the last one, in the plane all.

    Returns
    -------
    matplotlib.axes.Axes
    """
    last = -1 if step is None else step
    seen = look(result, last, contacts=contacts, where=where, units=units)
    own, ax = ax is None, style.axes_of(ax)
    if seen.x.shape[1] == 3:
        draw_status(seen, ax)
        if own:
            style.fit(ax)
        return ax
    if step is None and isinstance(result, Result):
        path = steps_of(result)
        known = contacts_of(path, contacts)
        chosen = selection(where, len(path[0].status), known)
        return draw_zones(seen, path.status[:, chosen], ax)
    draw_zones(seen, seen.status[None], ax)
    ax.set_yticks([])
    ax.set_ylabel("")
    return ax


def draw_status(seen: Contacts, ax: Axes) -> Axes:
    """`status_map` of a surface on axes that are there."""
    from scipy.spatial import cKDTree

    uv, names = _plane(seen)
    low, high = uv.min(axis=0), uv.max(axis=0)
    step = (high - low).max() / _PIXELS or 1.0
    # Pixels of a whole number an axis, to the very rim of the surface.
    count = np.maximum(np.rint((high - low) / step).astype(int), 1)
    width = np.where(high > low, (high - low) / count, step)
    u, v = (low[k] + (np.arange(count[k]) + 0.5) * width[k] for k in (0, 1))
    places = np.stack(np.meshgrid(u, v), axis=-1)
    image = seen.status[cKDTree(uv).query(places)[1]].astype(float)
    if not _line(uv):
        found, bridges = _joined(uv, seen.area)
        # The last one for what is in no triangle.
        hole = np.append(bridges, True)
        image[hole[found.find_simplex(places)]] = np.nan
    ax.imshow(
        image,
        origin="lower",
        extent=(
            low[0],
            low[0] + count[0] * width[0],
            low[1],
            low[1] + count[1] * width[1],
        ),
        interpolation="nearest",
        **style.status_colours(),
    )
    zones = style.status_handles(seen.status)
    style.legend_above(ax, handles=zones, title=seen.said)
    _finish(seen, uv, names, ax)
    return ax


def slip(
    result: Any,
    *,
    step: int = -1,
    along: ArrayLike | str | None = None,
    where: ArrayLike | str | None = None,
    contacts: Given | None = None,
    units: Mapping[str, str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Slip of a step: along a line in the plane, as arrows on a surface in space.

    Arrows are drawn at about one contact of each of 14 × 14 squares, their length as their
    colour the size of the slip, and only where contact slips; the others are dots, those
    that are open circles. Along a line there is none where contact is open.

    Parameters
    ----------
    result, step, along, where, contacts, units, ax
        As in `tractions`; in space ``along`` asks for the line.

    Returns
    -------
    matplotlib.axes.Axes
    """
    seen = look(result, step, contacts=contacts, where=where, units=units)
    own, ax = ax is None, style.axes_of(ax)
    if seen.x.shape[1] == 2 or along is not None:
        return draw_slip(seen, along, ax)
    uv, names = _plane(seen)
    moved = closed_slip(seen)
    size = np.linalg.norm(moved, axis=1)
    closed = seen.status != Status.OPEN
    u, v = uv.T
    ax.scatter(u[closed], v[closed], s=4, color="#c9ced3", lw=0)
    rings: dict[str, Any] = {"facecolors": "none", "edgecolors": "#c9ced3", "lw": 0.6}
    ax.scatter(u[~closed], v[~closed], s=9, **rings)
    arrows = _arrows(seen, uv, moved, ax, cmap="viridis", values=size)
    _finish(seen, uv, names, ax, margin=0.13)
    if arrows is not None:
        unit = seen.units.get("length")
        style.colour_bar(arrows, ax, "slip in the step", unit)
    else:
        style.say(ax, NOTHING["slip"])
    style.note(ax, seen.said)
    if own:
        style.fit(ax)
    return ax


def is_plane(seen: Contacts) -> bool:
    """Whether contacts in space lie on one plane."""
    off = seen.x - seen.x.mean(axis=0)
    widths = np.ptp(off @ np.linalg.svd(off, full_matrices=False)[2].T, axis=0)
    return bool(widths[-1] <= _PLANE * widths[0]) if len(widths) == 3 else True


def _line(uv: Floats) -> bool:
    """Whether places on a plane lie on one line, or are fewer than three."""
    if len(uv) < 3:
        return True
    wide, narrow = np.linalg.svd(uv - uv.mean(axis=0), compute_uv=False)
    return bool(narrow <= _PLANE * wide)


def _plane(seen: Contacts) -> tuple[Floats, list[str]]:
    """Coordinates ``(n_c, 2)`` on the plane of the contacts, and what they are."""
    x = seen.x
    if x.shape[1] != 3:
        raise ValueError("the contacts lie in the plane: tractions draws their line")
    if not is_plane(seen):
        surfaces = [name for name, _ in seen.surfaces if name]
        where = f" (there are {', '.join(surfaces)})" if len(surfaces) > 1 else ""
        raise ValueError(
            "the contacts lie on more than one plane: choose those of one by where="
            f"{where}, or draw them in space by surface3d"
        )
    axes, names = _tangents(seen)
    return x @ axes.T, names


def _tangents(seen: Contacts) -> tuple[Floats, list[str]]:
    """Axes ``(2, 3)`` on the plane of the contacts, and their names.

    Those of the contacts where these are the same: else, as of a roller over a plane,
    they lean out of it, and places along one of them would be those of no ruler.
    """
    off = seen.x - seen.x.mean(axis=0)
    # Three rows more, so that there are three directions of two contacts, too.
    rows = np.concatenate([off, np.zeros((3, 3))])
    normal = np.linalg.svd(rows, full_matrices=False)[2][-1]
    names = ["along t1", "along t2"]
    if seen.frame is None:
        # The two coordinates that the plane is seen best along.
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
    """The mean t1 made to lie in a plane, and what is at right angles to it, as t2 is."""
    first, second = frame[:, 1:].mean(axis=0)
    first = first - (first @ normal) * normal
    if np.linalg.norm(first) < 0.1:
        # Around an axis they cancel: the axis of coordinates that the plane is nearest to.
        axis = np.eye(3)[np.argmin(np.abs(normal))]
        first = axis - (axis @ normal) * normal
    first = first / np.linalg.norm(first)
    across = np.cross(normal, first)
    if np.linalg.norm(second) < 0.1:
        second = np.sign(across[np.argmax(np.abs(across))]) * across
    return np.stack([first, across if across @ second >= 0 else -across])


def _finish(
    seen: Contacts, uv: Floats, names: list[str], ax: Any, margin: float = 0.0
) -> None:
    unit = seen.units.get("length")
    around = margin * np.ptp(uv, axis=0).max()
    low, high = uv.min(axis=0) - around, uv.max(axis=0) + around
    ax.set_aspect("equal")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    style.name_axis(ax.xaxis, names[0], unit)
    style.name_axis(ax.yaxis, names[1], unit)


def _arrows(
    seen: Contacts,
    uv: Floats,
    vector: Floats,
    ax: Any,
    *,
    values: Floats | None = None,
    **look: Any,
) -> Any:
    """Arrows of tangential vectors, on a few contacts, the longest as wide as a square."""
    axes, _ = _tangents(seen)
    size = np.linalg.norm(vector, axis=1)
    largest = float(size.max(initial=0.0))
    # Rounding of what sticks has no direction.
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
        scale = largest / (1.6 * across)
        colours = (values[chosen],)
        look["clim"] = (0.0, largest)
    return ax.quiver(
        *uv[chosen].T,
        *flat.T,
        *colours,
        pivot="mid" if values is None else "tail",
        angles="xy",
        scale_units="xy",
        scale=scale,
        width=5e-3,
        **look,
    )


def _areas(uv: Floats, area: Floats | None) -> Floats:
    """Areas of the nodes, or what one has of the rectangle that holds all."""
    if area is not None:
        return area
    whole = float(np.prod(np.ptp(uv, axis=0)))
    return np.full(len(uv), 4.0 * whole / len(uv))


def _joined(uv: Floats, area: Floats | None) -> tuple[Any, Bools]:
    """Delaunay triangles of nodes not on one line, and which of them bridge a hole."""
    from scipy.spatial import Delaunay

    found = Delaunay(uv)
    corners = found.simplices
    # Cells may be long along one axis: edges are compared with what nodes have when both
    # axes are drawn out so that half the triangles are as wide as high.
    wide, high = np.median(np.ptp(uv[corners], axis=1), axis=0)
    even = uv * np.sqrt([high / wide, wide / high])
    size = np.sqrt(_areas(uv, area))
    longest = np.zeros(len(corners), dtype=bool)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = corners[:, a], corners[:, b]
        length = np.linalg.norm(even[i] - even[j], axis=1)
        longest |= length > _BRIDGE * (size[i] + size[j])
    return found, longest


def _triangles(uv: Floats, area: Floats | None) -> Any:
    """What `_joined` finds, for matplotlib, without what bridges a hole."""
    from matplotlib.tri import Triangulation

    found, bridges = _joined(uv, area)
    return Triangulation(uv[:, 0], uv[:, 1], found.simplices, bridges)


def _thin(uv: Floats, wanted: Bools, values: Floats | None) -> NDArray[np.intp]:
    """One contact of those wanted in each of about 14 × 14 squares.

    The one of the largest value; without values the one nearest the middle, whose arrow
    the frame does not cut.
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
