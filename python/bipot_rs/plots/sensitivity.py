"""Pictures of a gradient: which contact decides about a number."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import one_of
from bipot_rs.contact.results.derivatives import Gradient
from bipot_rs.plots import mpl, style
from bipot_rs.plots.data import (
    ContactsArgument,
    DrawnContacts,
    contacts_of,
    look,
    selection,
)
from bipot_rs.plots.line import finish_lines, lines_of, mark_of
from bipot_rs.plots.surface import (
    finish,
    is_line,
    mesh_of,
    paint,
    plane_of,
    span,
)
from bipot_rs.plots.triangles import halve

QUANTITIES = ("mu", "gap")
_SYMBOLS = {"mu": "μ", "gap": "gap"}
# Blue below zero, red above: both differ from white by lightness, too.
_COLOURS = "RdBu_r"
_RISES, _FALLS = "#b2182b", "#2166ac"


def sensitivity(
    gradient: object,
    by: str = "mu",
    *,
    of: str = "number",
    unit: str | None = None,
    step: int | None = None,
    along: ArrayLike | str | None = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Derivative of a number by the friction or the gap of each contact.

    It shows which contacts decide: in 2D along a line, above the status of the contacts; in
    3D on a map of a flat surface, or along a line if ``along`` is given. Red means that the
    number grows with the friction coefficient or the gap of the contact, blue that it falls;
    the colours of a map are symmetric about zero, and its lines at thirds of them are dashed
    if negative. Rings mark contacts on a border between
    two statuses (``one_sided``), where the derivative holds on one side only.

    Values belong to contacts, not to areas: on a finer mesh each contact decides less about
    a force or an energy. Their sum is the derivative if all contacts change alike.

    Parameters
    ----------
    gradient
        The gradient of the number, from `Result.vjp`.
    by
        ``"mu"``, or ``"gap"``, its normal part. If contacts have two friction coefficients,
        ``"mu"`` is the derivative by an equal change of both.
    of, unit
        Name and unit of the number, for the label.
    step
        Load step in which the gap changes. Default: it changes alike in all steps.
    along, on, contacts, units, ax
        As in `tractions`.

    Raises
    ------
    TypeError, ValueError
        A wrong argument, or missing data of the contacts; the message names them.
    """
    if not isinstance(gradient, Gradient):
        raise make_type_error("gradient", gradient, "a gradient of Result.vjp")
    one_of("by", by, QUANTITIES)
    if by == "mu" and step is not None:
        raise ValueError(
            'step is given, but the friction coefficients are those of all steps: use by="gap"'
        )
    result = gradient.result
    at = -1 if step is None else step
    seen = look(result, at, contacts=contacts, on=on, units=units)
    arrays = contacts_of(result, contacts)
    chosen = selection(on, gradient.mu.shape[0], arrays)
    values = _values(gradient, by, step)[chosen]
    # The gap of a step acts on all steps after it, through the slip.
    borders = gradient.one_sided[0 if step is None else step :]
    marked: Bools = np.asarray(borders.any(axis=0))[chosen]
    name = f"d({of}) / d({_SYMBOLS[by]})"
    label = unit if by == "mu" else _ratio(unit, seen.units.get("length"))
    ax = style.axes_of(ax)
    if seen.x.shape[1] == 2 or along is not None:
        _draw_line(seen, along, values, marked, (name, label), ax)
        return ax
    _draw_map(seen, values, marked, (name, label), ax)
    style.fit(ax)
    return ax


def _values(gradient: Gradient, by: str, step: int | None) -> Floats:
    """The derivatives, ``(n_c,)``."""
    if by == "mu":
        mu: Floats = gradient.mu
        return mu if mu.ndim == 1 else np.asarray(mu.sum(axis=1))
    normal = gradient.gap_by_component[:, :, 0]
    return np.asarray(normal.sum(axis=0) if step is None else normal[step])


def _ratio(unit: str | None, length: str | None) -> str | None:
    """Unit of the number by length; None if one is unknown."""
    if not unit or not length:
        return None
    return f"{unit}/{length}" if "/" not in unit else f"({unit})/{length}"


def _draw_line(
    seen: DrawnContacts,
    along: ArrayLike | str | None,
    values: Floats,
    marked: Bools,
    label: tuple[str, str | None],
    ax: mpl.Axes,
) -> None:
    """Draw the derivatives along each surface, filled from zero by their sign."""
    lines, name = lines_of(seen, along)
    for k, (whose, line) in enumerate(lines):
        y = values[line.order]
        colour = "black" if len(lines) == 1 else style.cycle(k)
        ax.plot(line.s, y, color=colour, lw=1.2, label=whose, **mark_of(line))
        if line.once:
            for part, fill in ((y >= 0, _RISES), (y <= 0, _FALLS)):
                ax.fill_between(
                    line.s,
                    y,
                    where=part,
                    color=fill,
                    alpha=0.35,
                    lw=0,
                    interpolate=True,
                )
        _rings(ax, line.s, y, marked[line.order])
    finish_lines(ax, lines, seen.status)
    named = style.surface_handles(name for name, _ in lines) if len(lines) > 1 else []
    handles = [*named, *style.status_handles(seen.status), *_legend(marked)]
    style.legend_above(ax, handles=handles, title=seen.said)
    style.name_axis(ax.xaxis, name, seen.units.get("length"))
    style.name_axis(ax.yaxis, *label)


def _draw_map(
    seen: DrawnContacts,
    values: Floats,
    marked: Bools,
    label: tuple[str, str | None],
    ax: mpl.Axes,
) -> None:
    """Draw the derivatives on a flat surface, by colours symmetric about zero."""
    uv, names = plane_of(seen)
    if is_line(uv):
        raise ValueError('the contacts lie on a line: pass along="arc" or a direction')
    _, largest, _ = span(np.abs(values), "", seen.area)
    colours = style.map_colours(_COLOURS, -largest, largest)
    image = paint(seen, uv, values, ax, **colours)
    # Lines at thirds of the range, dashed if negative: in grey both signs are dark.
    places, spread, parts = mesh_of(seen, uv, values)
    levels = largest * np.array([-2.0, -1.0, 1.0, 2.0]) / 3
    levels = levels[(levels > values.min()) & (levels < values.max())]
    if levels.size:
        triangles = mpl.Triangulation(places[:, 0], places[:, 1], halve(parts))
        look = {"colors": "black", "linewidths": 0.6, "negative_linestyles": "--"}
        ax.tricontour(triangles, spread, levels, **look)
    _rings(ax, uv[:, 0], uv[:, 1], marked)
    if not values.any():
        style.say(ax, "no contact changes the number")
    finish(seen, uv, names, ax)
    style.colour_bar(image, ax, *label, extend=style.beyond(values, -largest, largest))
    if marked.any():
        style.legend_above(ax, handles=_legend(marked), title=seen.said)
    else:
        style.note(ax, seen.said)


def _rings(ax: mpl.Axes, x: Floats, y: Floats, marked: Bools) -> None:
    """Mark the contacts whose derivative is one-sided."""
    if marked.any():
        ax.scatter(
            x[marked],
            y[marked],
            s=30,
            facecolors="none",
            edgecolors="black",
            lw=1.0,
            zorder=3,
            label="one-sided",
        )


def _legend(marked: Bools) -> list[mpl.Line2D]:
    """Entry of the rings, if there are any."""
    if not marked.any():
        return []
    label = f"one-sided ({int(marked.sum())})"
    return [
        mpl.Line2D([], [], ls="none", marker="o", mfc="none", mec="black", label=label)
    ]
