"""A picture of a parameter study: one figure of its rows over another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Floats
from bipot_rs.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.typing import ColorType

# With more series than this, a colour bar shows their numbers. The cycle of colours has
# as many.
_NAMED = 6
_MARKS = ("o", "s", "^", "D", "v", "P")
# Most entries of a legend above the axes, in three columns.
_MOST = 18


@dataclass(frozen=True)
class StudySeries:
    """Rows that differ in nothing but the horizontal axis."""

    name: str  # its entry in the legend
    # x, y (m,): values of its rows.
    x: Floats
    y: Floats
    partial: NDArray[np.bool_]  # (m,) bool: rows that were not solved to the end
    # A number for the colour bar; None if its name is not a number.
    number: float | None = None


def study(
    series: Sequence[StudySeries],
    x: tuple[str, str | None],
    y: tuple[str, str | None],
    *,
    parameter: str = "",
    lines: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Draw the series with one colour each; crosses are rows not solved to the end.

    ``series``: at least one.
    ``x, y``: name and unit of the axes; the unit is None if there is none.
    ``parameter``: what the names of the series are values of.
    ``lines``: connect the solved rows of a series in the order of ``x``.
    ``ax``: axes to draw into; default those of a new figure, ``ax.figure``.
    """
    ax = style.axes_of(ax)
    colours = _colours(series)
    for k, (curve, colour) in enumerate(zip(series, colours, strict=True)):
        solved = ~curve.partial
        order = np.flatnonzero(solved)[np.argsort(curve.x[solved], kind="stable")]
        look: style.LineStyle = {"color": colour, "lw": 1.4, "ms": 4}
        # Marks distinguish the few series that a legend names without colours.
        look["marker"] = _MARKS[k] if len(series) <= _NAMED else "o"
        if not lines:
            look["ls"] = "none"
        ax.plot(curve.x[order], curve.y[order], label=curve.name, **look)
        ax.plot(
            curve.x[curve.partial],
            curve.y[curve.partial],
            ls="none",
            marker="x",
            ms=7,
            mew=1.6,
            color=colour,
        )
    style.bare(ax)
    style.name_axis(ax.xaxis, *x)
    style.name_axis(ax.yaxis, *y)
    _legend(ax, series, parameter)
    return ax


def _colours(series: Sequence[StudySeries]) -> list[ColorType]:
    if len(series) <= _NAMED:
        return [style.cycle(k) for k in range(len(series))]
    places = np.linspace(0, 1, len(series))
    numbers = _numbers(series)
    if numbers is not None and np.ptp(numbers) > 0:
        places = (numbers - numbers.min()) / np.ptp(numbers)
    return list(style.shades()(places))


def _numbers(series: Sequence[StudySeries]) -> Floats | None:
    numbers = [curve.number for curve in series if curve.number is not None]
    return np.array(numbers) if len(numbers) == len(series) else None


def _legend(ax: Axes, series: Sequence[StudySeries], parameter: str) -> None:
    from matplotlib.lines import Line2D

    numbers = _numbers(series)
    handles: list[Line2D] = []
    if len(series) > _NAMED and numbers is not None:
        scale = style.scale_of(style.shades(), numbers.min(), numbers.max())
        style.colour_bar(scale, ax, parameter, None)
        parameter = ""
    elif 1 < len(series) <= _MOST:
        # The crosses have no names.
        named = (str(line.get_label()) for line in ax.get_lines())
        drawn = zip(named, ax.get_lines(), strict=True)
        handles = [line for name, line in drawn if not name.startswith("_")]
    elif len(series) > _MOST:
        parameter = f"{len(series)} combinations of {parameter}"
    if any(curve.partial.any() for curve in series):
        label = "not solved to the end: last solved load step"
        cross = Line2D(
            [], [], color=style.QUIET, label=label, ls="none", marker="x", mew=1.6
        )
        handles.append(cross)
    if handles or len(series) > _MOST:
        title = parameter if len(series) > 1 else ""
        # The entry of the crosses is as wide as three others.
        wide = {"ncols": 2} if handles and handles[-1].get_marker() == "x" else {}
        style.legend_above(ax, title=title, handles=handles, **wide)
