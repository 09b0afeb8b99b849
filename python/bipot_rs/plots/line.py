"""Contact along a line: tractions within friction's limit, slip, zones over the path."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Floats
from bipot_rs.contact.elliptic_friction import dissipation
from bipot_rs.contact.status import Status
from bipot_rs.plots import style
from bipot_rs.plots.arc_length import Places, common
from bipot_rs.plots.data import Contacts, Given, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Beyond so many contacts markers would run into each other.
_MARKERS = 60


def tractions(
    result: Any,
    *,
    step: int = -1,
    along: ArrayLike | str | None = None,
    where: ArrayLike | str | None = None,
    contacts: Given | None = None,
    units: Mapping[str, str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Pressure and shear along a line, within ±μ times the pressure, and the zones.

    Shear is positive where it pulls the body that has the contacts the way that places
    grow. Several surfaces have a line each, by name, over the same axis.

    Parameters
    ----------
    result
        A `Result`, or a `Step` or `Solution` with ``contacts``.
    step
        Which step of a result.
    along
        What places are: a direction ``(d,)`` or ``"x"``, ``"y"``, ``"z"``, on which
        contacts are projected, in space the one of shear, too; or ``"arc"``, the length
        of the chain of contacts. An open one begins at the end of least x (y, z where
        x is the same), a closed one at its largest x and goes counter-clockwise. Default
        in the plane: x, y or the direction of a straight line, of others the arc. The
        label says what it is. Contacts that are no one line are drawn as marks.
    where
        Contacts to draw, a mask ``(n_c,)``, numbers, or the name of their surface,
        ``"body.surface"``: in space those of one line.
    contacts
        ``x (n_c, d)``, ``frame``, ``area``, ``mu``, and to tell surfaces ``surface
        (n_c,)`` and ``surface_names``, in a mapping, or the model, where the result does
        not know them. Without areas, forces are drawn.
    units
        Names by ``"length"``, ``"force"``, ``"stress"``; default those of the result.
    ax
        Axes to draw into; default those of a new figure, ``ax.figure``.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        A wrong argument, named; what is not known of the contacts, and how to give it.
    """
    seen = look(result, step, contacts=contacts, where=where, units=units)
    return draw_tractions(seen, along, style.axes_of(ax))


def draw_tractions(seen: Contacts, along: ArrayLike | str | None, ax: Axes) -> Axes:
    """`tractions` on axes that are there."""
    lines, name = _lines(seen, along)
    pressure, shear = seen.traction[:, 0], seen.traction[:, 1:]
    what = ("pressure", "shear") if seen.area is not None else ("normal", "tangential")
    edge = None
    for k, (_, one) in enumerate(lines):
        mark = _mark(one)
        colours = (style.PRESSURE, style.SHEAR)
        if len(lines) > 1:
            colours = (style.cycle(k), style.cycle(k))
        p, t = pressure[one.order], _component(seen, shear, one)
        if seen.mu is not None and one.once:
            limit = _limit(seen, one) * p
            band = style.LIMIT if len(lines) == 1 else colours[0]
            ax.fill_between(one.s, -limit, limit, color=band, alpha=0.15, lw=0)
            line = "--" if len(lines) == 1 else ":"
            dashed: dict[str, Any] = {"ls": line, "color": band, "lw": 1}
            (edge,) = ax.plot(one.s, limit, label="±μ × pressure", **dashed)
            ax.plot(one.s, -limit, **dashed)
        ax.plot(one.s, p, color=colours[0], lw=1.6, label=what[0], **mark)
        if len(lines) > 1:
            mark = {"ls": "--"} | mark
        ax.plot(one.s, t, color=colours[1], lw=1.6, label=what[1], **mark)
    ax.axhline(0, color="black", lw=0.6)
    _strips(ax, lines, seen.status)
    style.bare(ax)
    kinds = [h for h in ax.get_lines() if h.get_label() in what]
    kinds += [] if edge is None else [edge]
    if len(lines) > 1:
        kinds = _styles(what, edge is not None)
    _legend(ax, lines, kinds, seen)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    if seen.area is not None:
        style.name_axis(ax.yaxis, "traction", style.stress_unit(seen.units))
    else:
        style.name_axis(ax.yaxis, "contact force", seen.units.get("force"))
    return ax


def _lines(
    seen: Contacts, along: ArrayLike | str | None
) -> tuple[list[tuple[str, Places]], str]:
    """Surfaces by name with the places of their contacts, and what these are."""
    names, parts = zip(*seen.surfaces, strict=True)
    found = common(seen.x, parts, along)
    told = {one.name for one in found}
    name = told.pop() if len(told) == 1 else "arc length along each surface"
    return list(zip(names, found, strict=True)), name


def _mark(one: Places) -> dict[str, Any]:
    if not one.once:
        # A line through them would go to and fro.
        return {"marker": "o", "ms": 2, "ls": "none"}
    return {"marker": "o", "ms": 3} if len(one.s) <= _MARKERS else {}


def _component(seen: Contacts, tangential: Floats, one: Places) -> Floats:
    """The part of tangential vectors ``(n_c, d - 1)`` along a line, ``(m,)``.

    In the plane the whole of it, positive the way that places grow; t1 points either way.
    """
    own = tangential[one.order]
    if seen.frame is None and seen.x.shape[1] == 2:
        return np.asarray(own[:, 0], np.float64)
    tangents = seen.has_frame[one.order, 1:]
    along = np.einsum("mkd,md->mk", tangents, one.towards)
    if seen.x.shape[1] == 2:
        return np.asarray(own[:, 0] * np.where(along[:, 0] < 0, -1.0, 1.0))
    return np.asarray(np.einsum("mk,mk->m", own, along), np.float64)


def _limit(seen: Contacts, one: Places) -> Floats:
    """Friction by unit pressure along a line, ``(m,)``."""
    mu: Floats = np.asarray(seen.mu, np.float64)[one.order]
    if mu.ndim == 1:
        return mu
    # The most that an ellipse's points reach along the line.
    tangents = seen.has_frame[one.order, 1:]
    return dissipation(mu, np.einsum("mkd,md->mk", tangents, one.towards))


def _styles(what: tuple[str, str], limited: bool) -> list[Any]:
    """Of lines that have the colours of surfaces."""
    from matplotlib.lines import Line2D

    looks = [("-", what[0]), ("--", what[1]), *([(":", "±μ × pressure")] * limited)]
    return [Line2D([], [], color="black", lw=1.2, ls=ls, label=s) for ls, s in looks]


def _legend(
    ax: Any, lines: list[tuple[str, Places]], kinds: list[Any], seen: Contacts
) -> None:
    """What lines and zones are, above the axes; filled column by column."""
    zones = style.status_handles(seen.status)
    if len(lines) == 1:
        # Lines above zones.
        handles = [h for both in zip(_padded(kinds), zones, strict=True) for h in both]
        style.legend_above(ax, handles=handles, title=seen.said)
        return
    from matplotlib.lines import Line2D

    whose = [
        Line2D([], [], color=style.cycle(k), lw=2, label=name)
        for k, (name, _) in enumerate(lines)
    ]
    rows = max(3, len(whose))
    columns = [*_padded(whose, rows), *_padded(kinds, rows), *_padded(zones, rows)]
    style.legend_above(ax, handles=columns, title=seen.said)


def _padded(handles: list[Any], rows: int = 3) -> list[Any]:
    from matplotlib.lines import Line2D

    nothing = [Line2D([], [], ls="none", label=" ") for _ in range(rows - len(handles))]
    return handles + nothing


def draw_slip(seen: Contacts, along: ArrayLike | str | None, ax: Axes) -> Axes:
    """Slip of the step along a line; none where contact is open."""
    lines, name = _lines(seen, along)
    for k, (_, one) in enumerate(lines):
        v = _component(seen, closed_slip(seen), one)
        v[seen.status[one.order] == Status.OPEN] = np.nan
        colour = style.SHEAR if len(lines) == 1 else style.cycle(k)
        mark = _mark(one)
        if np.isnan(v).any():
            # Between open contacts one alone has no line.
            mark = {"marker": "o", "ms": 2} | mark
        ax.plot(one.s, v, color=colour, lw=1.6, **mark)
    ax.axhline(0, color="black", lw=0.6)
    _strips(ax, lines, seen.status)
    style.bare(ax)
    if len(lines) == 1:
        zones = style.status_handles(seen.status)
        style.legend_above(ax, handles=zones, title=seen.said)
    else:
        _legend(ax, lines, [], seen)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    style.name_axis(ax.yaxis, "slip in the step", seen.units.get("length"))
    return ax


def closed_slip(seen: Contacts) -> Floats:
    """Slip of the step where contact slips, ``(n_c, d - 1)``; zero elsewhere.

    What sticks has that of the residual, and what is open moves, but on nothing.
    """
    return np.where(seen.status[:, None] == Status.SLIP, seen.slip, 0.0)


def draw_zones(seen: Contacts, status: NDArray[np.integer[Any]], ax: Axes) -> Axes:
    """Zones along a line, a row a load step, the first at the bottom.

    Several surfaces lie above each other, each with rows of its own.

    Parameters
    ----------
    seen
        The last step, by which contacts are placed.
    status
        ``(steps, n_c)`` of the contacts that are drawn.
    """
    lines, name = _lines(seen, None)
    steps = len(status)
    # Between surfaces as much as a row, and of long paths more.
    apart = steps + max(1.0, 0.12 * steps)
    for k, (whose, one) in enumerate(lines):
        rows = k * apart + np.arange(steps + 1) + 0.5
        ax.pcolormesh(
            _edges(one.s), rows, status[:, one.order], **style.status_colours()
        )
        if len(lines) > 1:
            ax.text(
                1.01,
                rows.mean(),
                whose,
                transform=ax.get_yaxis_transform(),
                fontsize="small",
                ha="left",
                va="center",
                rotation=90,
            )
    if len(lines) == 1:
        style.whole_numbers(ax.yaxis)
    else:
        ends = sorted({1, steps})
        rows_of = [k * apart + end for k in range(len(lines)) for end in ends]
        ax.set_yticks(rows_of, [str(end) for end in ends] * len(lines))
    counted = f"numbers in {seen.said}" if steps > 1 and seen.said else seen.said
    style.legend_above(ax, handles=style.status_handles(status[-1]), title=counted)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    ax.set_ylabel("load step")
    return ax


def _edges(s: Floats) -> Floats:
    """Ends of the stretches of nodes: the middles between a node and the next."""
    if len(s) == 1:
        return np.array([s[0] - 0.5, s[0] + 0.5])
    return np.concatenate([s[:1], (s[1:] + s[:-1]) / 2, s[-1:]])


def _strips(
    ax: Any, lines: list[tuple[str, Places]], status: NDArray[np.integer[Any]]
) -> None:
    """Strips of zones at the bottom of the axes, below what is drawn, one a surface."""
    lines = [(name, one) for name, one in lines if one.once]
    if not lines:
        return
    high = 0.04 if len(lines) == 1 else 0.03
    low, top = ax.get_ylim()
    ax.set_ylim(low - (0.03 + high * len(lines)) * (top - low), top)
    for k, (_, one) in enumerate(lines):
        _strip(ax, one.s, status[one.order], (k * high, (k + 1) * high))
        if len(lines) > 1:
            edge = {"transform": ax.get_xaxis_transform(), "scaley": False}
            ends = [one.s[0], one.s[-1]]
            ax.plot(ends, [k * high] * 2, color=style.cycle(k), lw=2, **edge)
    first = min(one.s[0] for _, one in lines)
    last = max(one.s[-1] for _, one in lines)
    if last > first:
        ax.set_xlim(first, last)


def _strip(
    ax: Any, s: Floats, status: NDArray[np.integer[Any]], rows: tuple[float, float]
) -> None:
    from matplotlib.collections import PolyCollection

    low, high = rows
    corners = [
        [(a, low), (b, low), (b, high), (a, high)] for a, b in pairwise(_edges(s))
    ]
    colours = style.status_colours()
    strip = PolyCollection(
        corners,
        array=status.astype(float),
        cmap=colours["cmap"],
        clim=(colours["vmin"], colours["vmax"]),
        transform=ax.get_xaxis_transform(),
        lw=0,
        antialiased=False,
    )
    ax.add_collection(strip, autolim=False)
