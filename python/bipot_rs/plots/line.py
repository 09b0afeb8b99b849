"""Pictures along a line: tractions with the friction limit, slip, status, wear, ranges."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats, Integers
from bipot_rs._lib.validation import floats, integers, one_of
from bipot_rs.contact.law.contact_law import dissipation
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.proof.reaction_range import ReactionRange
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.wear.record import Wear
from bipot_rs.plots import mpl, style
from bipot_rs.plots.arc_length import Places, common, places
from bipot_rs.plots.data import (
    ContactsArgument,
    DrawnContacts,
    contacts_of,
    look,
    selection,
    steps_of,
    units_of,
)

# With more contacts, markers would overlap.
_MARKERS = 60


def tractions(
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
    """Pressure and shear along a line, with the friction limit ±μ pressure and the status.

    Cohesion of contacts that are not broken adds to the limit.
    Shear is positive if it pulls the body that has the contacts in the direction of
    growing position. Several surfaces are drawn over the same axis, each with its name.

    Parameters
    ----------
    result
        A `Result`, or a `Step` or `Solution` with ``contacts``.
    step
        Step of a result.
    along
        Position on the horizontal axis: the projection on a direction ``(d,)`` or ``"x"``,
        ``"y"``, ``"z"``, in 3D also the direction of shear; or ``"arc"``, the arc length
        of the chain of contacts. An open chain begins at its end with the least x (y or z
        if x is equal), a closed one at its largest x, counter-clockwise. Default in 2D:
        the direction of a straight line, else the arc length. Contacts that do not form
        one line are drawn as separate marks.
    on
        Contacts to draw: a mask ``(n_c,)``, numbers, or the name of their surface,
        ``"body.surface"``. In 3D select those of one line.
    contacts
        Needed if the result does not contain these data: the model, or a mapping with
        ``x (n_c, d)``, ``frame``, ``area``, ``mu``, and for several surfaces
        ``surface (n_c,)`` and ``surface_names``. Without areas, forces are drawn.
    limits
        Least and largest value shown, to compare load steps; default those of the step.
    units
        Names by ``"length"``, ``"force"``, ``"stress"``; default those of the result.
    ax
        Axes to draw into; default those of a new figure, ``ax.figure``.

    Raises
    ------
    TypeError, ValueError
        A wrong argument, or missing data of the contacts; the message names them.
    """
    seen = look(result, step, contacts=contacts, on=on, units=units)
    return draw_tractions(seen, along, style.axes_of(ax), style.range_of(limits))


def draw_tractions(
    seen: DrawnContacts,
    along: ArrayLike | str | None,
    ax: mpl.Axes,
    limits: tuple[float, float] | None = None,
) -> mpl.Axes:
    """Draw `tractions` into existing axes."""
    lines, name = lines_of(seen, along)
    pressure, shear = seen.traction[:, 0], seen.traction[:, 1:]
    what = ("pressure", "shear") if seen.area is not None else ("normal", "tangential")
    edge = None
    for k, (_, line) in enumerate(lines):
        # The marks of the first and last contact are on the frame.
        mark = mark_of(line) | {"clip_on": limits is not None}
        colours = (style.PRESSURE, style.SHEAR)
        if len(lines) > 1:
            colours = (style.cycle(k), style.cycle(k))
        p, t = pressure[line.order], _component(seen, shear, line)
        if seen.mu is not None and line.once:
            limit = _limit(seen, line, p)
            band = style.LIMIT if len(lines) == 1 else colours[0]
            ax.fill_between(line.s, -limit, limit, color=band, alpha=0.15, lw=0)
            dashed: style.LineStyle = {"ls": ":", "color": band, "lw": 1.2}
            (edge,) = ax.plot(line.s, limit, label=_name_limit(seen), **dashed)
            ax.plot(line.s, -limit, **dashed)
        lw = style.width(k, len(lines))
        ax.plot(line.s, p, color=colours[0], lw=lw, label=what[0], **mark)
        # In grey the colours are alike.
        mark = {"ls": "--"} | mark
        ax.plot(line.s, t, color=colours[1], lw=lw, label=what[1], **mark)
    finish_lines(ax, lines, seen.status, limits)
    kinds = [h for h in ax.get_lines() if h.get_label() in what]
    kinds += [] if edge is None else [edge]
    if len(lines) > 1:
        kinds = _styles(what, "" if edge is None else _name_limit(seen))
    _legend(ax, lines, kinds, seen)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    label = "contact force" if seen.area is None else "traction"
    style.name_axis(ax.yaxis, label, seen.traction_unit)
    return ax


def lines_of(
    seen: DrawnContacts, along: ArrayLike | str | None
) -> tuple[list[tuple[str, Places]], str]:
    """Names of the surfaces with the positions of their contacts, and the axis label."""
    names, parts = zip(*seen.surfaces, strict=True)
    lines = common(seen.x, parts, along)
    told = {line.name for line in lines}
    name = told.pop() if len(told) == 1 else "arc length along each surface"
    if seen.revolved:
        name = re.sub(r"\b[xy]\b", lambda axis: {"x": "r", "y": "z"}[axis[0]], name)
    return list(zip(names, lines, strict=True)), name


def mark_of(line: Places) -> style.LineStyle:
    """Style of the markers of a line: none if they would overlap."""
    if not line.once:
        # A line through them would go back and forth.
        return {"marker": "o", "ms": 2, "ls": "none"}
    return {"marker": "o", "ms": 3} if len(line.s) <= _MARKERS else {}


def _component(seen: DrawnContacts, tangential: Floats, line: Places) -> Floats:
    """Component of tangential vectors ``(n_c, d - 1)`` along a line, ``(m,)``.

    In 2D the whole vector, positive in the direction of growing position.
    """
    tangential_in_order = tangential[line.order]
    if seen.frame is None and seen.x.shape[1] == 2:
        return np.asarray(tangential_in_order[:, 0], np.float64)
    tangents = seen.has_frame[line.order, 1:]
    along = np.einsum("mkd,md->mk", tangents, line.towards)
    if seen.x.shape[1] == 2:
        return np.asarray(
            tangential_in_order[:, 0] * np.where(along[:, 0] < 0, -1.0, 1.0)
        )
    return np.asarray(np.einsum("mk,mk->m", tangential_in_order, along), np.float64)


def _limit(seen: DrawnContacts, line: Places, pressure: Floats) -> Floats:
    """Largest shear along a line, ``(m,)``."""
    mu: Floats = np.asarray(seen.mu, np.float64)[line.order]
    if seen.cohesion is not None:
        area = 1.0 if seen.area is None else seen.area[line.order]
        return np.asarray(seen.cohesion[line.order] / area + mu * pressure)
    if mu.ndim == 1:
        return mu * pressure
    # The most that an ellipse's points reach along the line.
    tangents = seen.has_frame[line.order, 1:]
    along = dissipation(mu, np.einsum("mkd,md->mk", tangents, line.towards))
    return along * pressure


def _name_limit(seen: DrawnContacts) -> str:
    return "±μ × pressure" if seen.cohesion is None else "±(c + μ × pressure)"


def _styles(what: tuple[str, str], limit: str) -> list[mpl.Line2D]:
    """Legend entries for line styles, if colours distinguish surfaces."""
    looks = [("-", what[0]), ("--", what[1])] + [(":", limit)] * bool(limit)
    return [
        mpl.Line2D([], [], color="black", lw=1.2, ls=ls, label=s) for ls, s in looks
    ]


def _legend(
    ax: mpl.Axes,
    lines: list[tuple[str, Places]],
    kinds: Sequence[mpl.Artist],
    seen: DrawnContacts,
) -> None:
    """Legend of lines and statuses above the axes, filled column by column."""
    zones = style.status_handles(seen.status)
    if len(lines) == 1:
        # Lines above zones.
        handles = [h for both in zip(_pad(kinds), zones, strict=True) for h in both]
        style.legend_above(ax, handles=handles, title=seen.said)
        return
    whose = style.surface_handles(name for name, _ in lines)
    rows = max(3, len(whose))
    columns = [*_pad(whose, rows), *_pad(kinds, rows), *_pad(zones, rows)]
    style.legend_above(ax, handles=columns, title=seen.said)


def _pad(handles: Sequence[mpl.Artist], rows: int = 3) -> list[mpl.Artist]:
    nothing = [
        mpl.Line2D([], [], ls="none", label=" ") for _ in range(rows - len(handles))
    ]
    return [*handles, *nothing]


def draw_slip(
    seen: DrawnContacts,
    along: ArrayLike | str | None,
    ax: mpl.Axes,
    limits: tuple[float, float] | None = None,
) -> mpl.Axes:
    """Draw the slip of the step along a line, except where contact is open."""
    lines, name = lines_of(seen, along)
    for k, (_, line) in enumerate(lines):
        v = _component(seen, find_closed_slip(seen), line)
        v[seen.status[line.order] == Status.OPEN] = np.nan
        colour = style.SHEAR if len(lines) == 1 else style.cycle(k)
        mark = mark_of(line)
        if np.isnan(v).any():
            # A single contact between open ones needs a marker: it has no line.
            mark = {"marker": "o", "ms": 2} | mark
        mark |= {"clip_on": limits is not None}
        ax.plot(line.s, v, color=colour, lw=style.width(k, len(lines)), **mark)
    finish_lines(ax, lines, seen.status, limits)
    if len(lines) == 1:
        zones = style.status_handles(seen.status)
        style.legend_above(ax, handles=zones, title=seen.said)
    else:
        _legend(ax, lines, [], seen)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    style.name_axis(ax.yaxis, "slip in the step", seen.units.get("length"))
    return ax


def find_closed_slip(seen: DrawnContacts) -> Floats:
    """Slip of the step where the status is slip, ``(n_c, d - 1)``; zero elsewhere.

    At sticking contacts it is rounding; at open ones it is not slip.
    """
    return np.where(seen.status[:, None] == Status.SLIP, seen.slip, 0.0)


def draw_zones(seen: DrawnContacts, status: Integers, ax: mpl.Axes) -> mpl.Axes:
    """Draw the status along a line, one row for each load step, the first at the bottom.

    Several surfaces are drawn above each other.

    ``seen``: the last step, from which the positions are taken.
    ``status``: ``(steps, n_c)`` of the contacts to draw.
    """
    lines, name = lines_of(seen, None)
    steps = len(status)
    # One empty row between surfaces, more for long paths.
    apart = steps + max(1.0, 0.12 * steps)
    for k, (whose, line) in enumerate(lines):
        rows = k * apart + np.arange(steps + 1) + 0.5
        ax.pcolormesh(
            _edges(line.s), rows, status[:, line.order], **style.status_colours()
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
    """Limits of the intervals of nodes: the midpoints between neighbours."""
    if len(s) == 1:
        return np.array([s[0] - 0.5, s[0] + 0.5])
    return np.concatenate([s[:1], (s[1:] + s[:-1]) / 2, s[-1:]])


def finish_lines(
    ax: mpl.Axes,
    lines: list[tuple[str, Places]],
    status: Integers,
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw the zero line, and a strip of statuses for each surface at the bottom."""
    ax.axhline(0, color="black", lw=0.6)
    style.bare(ax)
    if limits is not None:
        ax.set_ylim(*limits)
    lines = [(name, line) for name, line in lines if line.once]
    if not lines:
        return
    high = 0.04 if len(lines) == 1 else 0.03
    low, top = ax.get_ylim()
    ax.set_ylim(low - (0.03 + high * len(lines)) * (top - low), top)
    for k, (_, line) in enumerate(lines):
        ax.pcolormesh(
            _edges(line.s),
            [k * high, (k + 1) * high],
            status[None, line.order],
            transform=ax.get_xaxis_transform(),
            **style.status_colours(),
        )
        if len(lines) > 1:
            ax.plot(
                [line.s[0], line.s[-1]],
                [k * high] * 2,
                color=style.cycle(k),
                lw=2,
                transform=ax.get_xaxis_transform(),
                scaley=False,
            )
    first = min(line.s[0] for _, line in lines)
    last = max(line.s[-1] for _, line in lines)
    if last > first:
        ax.set_xlim(first, last)


_OF_WEAR = ("depth", "pressure")
# Cycles that are drawn if none are chosen.
_CYCLES = 5


def wear(
    result: object,
    quantity: str = "depth",
    *,
    cycles: ArrayLike | None = None,
    along: ArrayLike | str | None = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Depth of wear or pressure along a line, at the end of some cycles.

    Parameters
    ----------
    result
        A `Wear`, its ``ends``, or the result of `bipot run` for a scene with ``[wear]``.
    quantity
        ``"depth"``, drawn downwards, or ``"pressure"``.
    cycles
        Numbers of cycles that were solved. Default: the first, the last, and those between
        at which about 1/4, 1/2 and 3/4 of the largest depth were worn off.
    along, on, contacts, units, ax
        As in `tractions`. Without areas, ``"pressure"`` is the normal force.

    Raises
    ------
    TypeError, ValueError
        A wrong argument, a result without wear, or missing data of the contacts.
    """
    one_of("quantity", quantity, _OF_WEAR)
    path = _find_ends(result)
    chosen = _choose_cycles(path, cycles)
    ax = style.axes_of(ax)
    largest = 0.0
    for number, k in enumerate(chosen):
        seen = look(path, k, contacts=contacts, on=on, units=units)
        values = seen.traction[:, 0] if quantity == "pressure" else seen.wear
        values = np.asarray(values, np.float64)
        largest = max(largest, float(values.max(initial=0.0)))
        lines, axis = lines_of(seen, along)
        for name, line in lines:
            label = f"cycle {path[k].cycle}" + (f", {name}" if len(lines) > 1 else "")
            joined: style.LineStyle = {"lw": 1.6}
            if not line.once or len(line.s) == 1:
                joined = {"ls": "none", "marker": "o", "ms": 2}
            colour = _colour_of_cycle(number, len(chosen))
            ax.plot(line.s, values[line.order], color=colour, label=label, **joined)
    style.name_axis(ax.xaxis, axis, seen.units.get("length"))
    if quantity == "depth":
        ax.set_ylim(1.05 * largest or 1.0, 0.0)
        style.name_axis(ax.yaxis, "wear depth", seen.units.get("length"))
    else:
        label = "normal force" if seen.area is None else "pressure"
        style.name_axis(ax.yaxis, label, seen.traction_unit)
    style.bare(ax)
    style.legend_above(ax)
    return ax


def pressure_and_wear(
    result: object,
    *,
    along: ArrayLike | str | None = None,
    on: ArrayLike | str | None = None,
) -> mpl.Axes:
    """Draw pressure above depth in a new figure; arguments as of `wear`."""
    width, height = style.SIZE
    figure = mpl.Figure(figsize=(width, 1.7 * height), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    wear(result, "pressure", along=along, on=on, ax=above)
    wear(result, "depth", along=along, on=on, ax=below)
    legend = below.get_legend()
    if legend is not None:
        legend.remove()
    above.set_xlabel("")
    axes: mpl.Axes = below
    return style.show_in_notebooks(axes)


def _find_ends(result: object) -> Result:
    """The ends of cycles; an error if there are none."""
    source = result.ends if isinstance(result, Wear) else result
    path = steps_of(source)
    if any(step.wear is None for step in path):
        raise ValueError("result has no wear: it is not from ContactProblem.wear")
    return path


def _choose_cycles(path: Result, cycles: ArrayLike | None) -> list[int]:
    """Indices of the steps to draw."""
    cycles_recorded = [step.cycle for step in path]
    if cycles is None:
        deepest = np.array([step.wear.max(initial=0.0) for step in path])  # type: ignore[union-attr]
        parts = np.linspace(0.0, 1.0, _CYCLES) * deepest[-1]
        indices = {0, len(path) - 1, *np.searchsorted(deepest, parts[1:-1]).tolist()}
        return sorted(indices)
    wanted = np.atleast_1d(integers("cycles", cycles))
    for cycle in wanted.tolist():
        if cycle not in cycles_recorded:
            near = min(
                cycles_recorded, key=lambda recorded: abs((recorded or 0) - cycle)
            )
            raise ValueError(
                f"cycles has {cycle}, which was jumped over or not reached; the next that "
                f"was solved is {near}"
            )
    return [cycles_recorded.index(cycle) for cycle in wanted.tolist()]


def _colour_of_cycle(number: int, count: int) -> tuple[float, float, float, float]:
    """Colours from light to dark, for the order of cycles."""
    return mpl.colormaps["viridis_r"](0.15 + 0.85 * number / max(count - 1, 1))


# A bound that is infinite is drawn this much beyond the largest finite number.
_BEYOND = 0.25
_COMPONENTS = ("normal force", "tangential force", "second tangential force")


def reaction_band(
    ranges: Sequence[ReactionRange],
    *,
    contacts: ContactsArgument,
    along: ArrayLike | str | None = None,
    on: ArrayLike | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Least, found and largest reactions along a line.

    Each contact attains every value of the band, not all of them at once. Triangles mark
    bounds that are infinite; the band ends there beyond the largest finite number.

    Parameters
    ----------
    ranges
        What `ReducedProblem.reaction_ranges` returns.
    contacts
        A mapping with ``x (n_c, d)``, or the model.
    along, on, units, ax
        As in `tractions`; ``on`` is a mask or numbers of contacts.
    """
    every = list(ranges)
    for interval in every:
        if not isinstance(interval, ReactionRange):
            raise make_type_error("ranges", interval, "a list of ReactionRange")
    if not every or any(interval.component != every[0].component for interval in every):
        raise ValueError("ranges are empty, or of several components")
    arrays = contacts_of(None, contacts)
    x = floats("x of contacts", arrays.get("x"), ndim=2)
    if max(interval.contact for interval in every) >= len(x):
        raise ValueError(
            f"x of contacts has {len(x)} rows, expected one for each contact"
        )
    chosen = np.arange(len(x))[selection(on, len(x), arrays)]
    every = [interval for interval in every if interval.contact in chosen]
    line = places(x[[interval.contact for interval in every]], along)
    least, answers, largest = (
        np.array([getattr(interval, name) for interval in every])[line.order]
        for name in ("least", "found", "largest")
    )
    ax = style.axes_of(ax)
    _draw_band(ax, line.s, least, answers, largest)
    ax.axhline(0, color="black", lw=0.6)
    style.bare(ax)
    style.legend_above(ax)
    named = units_of(None, units)
    style.name_axis(ax.xaxis, line.name, named.get("length"))
    style.name_axis(ax.yaxis, _COMPONENTS[every[0].component], named.get("force"))
    return ax


def _draw_band(
    ax: mpl.Axes, s: Floats, least: Floats, solved: Floats, largest: Floats
) -> None:
    values = np.concatenate([least, solved, largest])
    values = np.append(values[np.isfinite(values)], 0.0)
    beyond = _BEYOND * (float(np.ptp(values)) or 1.0)
    low = np.where(np.isfinite(least), least, values.min() - beyond)
    high = np.where(np.isfinite(largest), largest, values.max() + beyond)
    ax.fill_between(s, low, high, color=style.LIMIT, alpha=0.25, lw=0)
    line: style.LineStyle = {"marker": "o", "ms": 3}
    ax.plot(s, high, color=style.LIMIT, lw=1, label="largest", **line)
    ax.plot(s, solved, color=style.PRESSURE, lw=1.6, label="found", **line)
    ax.plot(s, low, color=style.LIMIT, lw=1, ls="--", label="least", **line)
    for bound, drawn, mark in ((largest, high, "^"), (least, low, "v")):
        ends = np.isinf(bound)
        if ends.any():
            ax.plot(s[ends], drawn[ends], mark, color=style.LIMIT, ms=7, clip_on=False)
