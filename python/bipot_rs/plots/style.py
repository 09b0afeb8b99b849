"""Axes, colours, labels and legends of all pictures.

Figures are made without pyplot, which would keep them in memory and choose a backend for
the process. Colours can be distinguished without red and green, and in grey by lightness.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from io import BytesIO
from typing import Any, TypedDict

import numpy as np

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import Floats, Integers
from bipot_rs._lib.validation import floats
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.plots import mpl

# Colours of the statuses open, slip, stick.
COLOURS = ("#d9dee3", "#f28e2b", "#1f4e79")
PRESSURE, SHEAR, LIMIT, QUIET = "#1f4e79", "#c0392b", "#f28e2b", "#7f8c8d"
# Colours of several surfaces, used cyclically.
# The first three differ in lightness, too.
_CYCLE = ("#1f4e79", "#d55e00", "#56b4e9", "#009e73", "#cc79a7", "#7f7f7f")
# Inches: scaled to a column of 85 mm, letters of 10 points become 7 points.
SIZE = (4.8, 3.6)


class LineStyle(TypedDict, total=False):
    """Arguments of matplotlib for lines and their markers."""

    color: mpl.ColorType
    ls: str
    lw: float
    marker: str
    ms: float
    mew: float
    clip_on: bool


class Colours(TypedDict, total=False):
    """Arguments of matplotlib that map values to colours."""

    cmap: str | mpl.Colormap
    norm: mpl.Normalize


class FacetStyle(Colours, total=False):
    """Colours of polygons, and their edges."""

    lw: float
    edgecolor: mpl.ColorType


class RimStyle(TypedDict):
    """Arguments of matplotlib for the rims of arrows."""

    edgecolor: mpl.ColorType
    linewidth: float


class ArrowStyle(RimStyle, total=False):
    """Arguments of matplotlib for the colours of arrows."""

    color: mpl.ColorType
    cmap: str
    clim: tuple[float, float]


# Arrows with a dark rim can be seen on light and on dark colours, and in grey.
RIM: RimStyle = {"edgecolor": "black", "linewidth": 0.4}
Units = Mapping[str, str]
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def axes_of(
    ax: object, *, size: tuple[float, float] = SIZE, space: bool = False
) -> mpl.Axes:
    """``ax``, or the axes of a new figure; ``space`` asks for axes in 3D.

    Raises `ModuleNotFoundError`: matplotlib is not installed; the message says how to install
    it.
    Raises `TypeError`: ``ax`` is not axes of matplotlib, or has the wrong projection.
    """
    load_library("matplotlib", extra="cli", need="pictures")
    if ax is None:
        figure = mpl.Figure(figsize=size, layout="constrained")
        return show_in_notebooks(figure.add_subplot(**(in_space() if space else {})))
    if not isinstance(ax, mpl.Axes):
        raise TypeError(f"ax is a {type(ax).__name__}, expected axes of matplotlib")
    if (ax.name == "3d") is not space:
        wanted = 'projection="3d"' if space else "no projection"
        raise TypeError(f"ax has projection {ax.name!r}, expected axes with {wanted}")
    return ax


def in_space() -> dict[str, Any]:
    """The argument of a new subplot for axes in 3D."""
    from bipot_rs.plots.space_axes import SpaceAxes

    return {"axes_class": SpaceAxes}


def show_in_notebooks(ax: mpl.Axes) -> mpl.Axes:
    """``ax``, as a picture where a notebook shows it: pyplot does not know its figure."""
    vars(ax)["_repr_png_"] = partial(_render, ax)
    return ax


def _render(ax: mpl.Axes) -> bytes:
    """The picture with these axes, as PNG."""
    picture = BytesIO()
    figure_of(ax).savefig(picture, format="png", bbox_inches="tight")
    return picture.getvalue()


def figure_of(ax: mpl.Axes) -> mpl.Figure:
    """The whole figure of axes."""
    return ax.figure.figure


def range_of(limits: object) -> tuple[float, float] | None:
    """The argument ``limits``: two ascending numbers, or None."""
    if limits is None:
        return None
    low, high = floats("limits", limits, shape=(2,)).tolist()
    if not low < high:
        raise ValueError(f"limits are {low:g} and {high:g}, expected ascending numbers")
    return low, high


def label(name: str, unit: str | None) -> str:
    """``name [unit]``, or the name only if the unit is unknown."""
    return f"{name} [{unit}]" if unit else name


def name_axis(axis: mpl.Axis, name: str, unit: str | None) -> float:
    """Label an axis, if necessary with a power of 1000 before the unit; return the power.

    Otherwise ticks would be long, or matplotlib would write the power over a legend. Call
    it after the data are drawn.
    """
    largest = float(np.abs(axis.get_view_interval()).max())
    power = 0
    if np.isfinite(largest) and largest > 0 and not 1e-2 <= largest < 1e4:
        power = 3 * int(np.floor(np.log10(largest) / 3))
    if power:
        axis.set_major_formatter(
            mpl.FuncFormatter(lambda v, _: f"{v / 10.0**power:g}".replace("-", "−"))
        )
        factor = "10" + str(power).translate(_RAISED)
        unit = f"{factor} {unit}" if unit else factor
    axis.set_label_text(label(name, unit))
    return 10.0**power


def name_axes(ax: mpl.Axes, names: str, unit: str | None) -> None:
    """Label the axes of coordinates, such as ``"xy"``."""
    for axis, name in zip("xyz", names, strict=False):
        name_axis(getattr(ax, f"{axis}axis"), name, unit)


def colour_bar(
    image: mpl.ScalarMappable,
    ax: mpl.Axes,
    name: str,
    unit: str | None,
    *,
    extend: str = "neither",
    below: bool = False,
    most: float = np.inf,
) -> mpl.Colorbar:
    """Add a colour bar with a name on the right of the axes, or below axes in 3D.

    ``most``: the largest value, written at the end of a bar that does not reach it.
    """
    if below:
        bar = ax.figure.colorbar(
            image, ax=ax, extend=extend, location="bottom", shrink=0.7, pad=0.02
        )
        power = name_axis(bar.ax.xaxis, name, unit)
    elif ax.name == "3d":
        bar = ax.figure.colorbar(image, ax=ax, extend=extend, shrink=0.75, pad=0.11)
        power = name_axis(bar.ax.yaxis, name, unit)
    else:
        # As high as the axes, also if equal scales make these low, and as wide as usual
        # if equal scales make the axes narrow. Arrows of a map reach over the frame by 0.03.
        wide, high = np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())
        part = 1.0 if ax.get_aspect() == "auto" else max(high / wide, 1.0)
        beside = ax.inset_axes((1.0 + 0.05 * part, 0.0, 0.045 * part, 1.0))
        bar = ax.figure.colorbar(image, cax=beside, extend=extend)
        power = name_axis(bar.ax.yaxis, name, unit)
    if extend in ("max", "both") and np.isfinite(most):
        largest = most / power
        bar.ax.text(
            *((1.06, 0.5) if below else (0.5, 1.07)),
            f"max {largest:.{'0f' if largest >= 1000 else '3g'}}",
            transform=bar.ax.transAxes,
            fontsize="small",
            ha="left" if below else "center",
            va="center" if below else "bottom",
        )
    return bar


def beyond(values: Floats, low: float, high: float) -> str:
    """On which sides values lie beyond the colours, in the words of matplotlib."""
    rounding = 1e-9 * max(abs(low), abs(high))
    sides = bool(values.min() < low - rounding), bool(values.max() > high + rounding)
    names = {(True, True): "both", (True, False): "min", (False, True): "max"}
    return names.get(sides, "neither")


def scale_of(
    colours: str | mpl.Colormap, low: float, high: float
) -> mpl.ScalarMappable:
    """Colours of a bar without a picture in these colours."""
    return mpl.ScalarMappable(**map_colours(colours, low, high))


def map_colours(colours: str | mpl.Colormap, low: float, high: float) -> Colours:
    """Keyword arguments of matplotlib that map values from low to high to colours."""
    return {"cmap": colours, "norm": mpl.Normalize(low, high)}


def shades() -> mpl.ListedColormap:
    """Colours of an order, without their light end, which is hard to see on white."""
    return mpl.ListedColormap(mpl.colormaps["viridis"](np.linspace(0, 0.9, 256)))


def cycle(k: int) -> str:
    """Colour of surface number ``k``."""
    return _CYCLE[k % len(_CYCLE)]


def width(k: int, count: int) -> float:
    """Width of the lines of surface ``k``: an earlier one is visible below a later one."""
    return 1.4 + 1.2 * min(count - 1 - k, 3)


def surface_handles(names: Iterable[str]) -> list[mpl.Line2D]:
    """Lines for a legend, in the colour of each surface."""
    return [
        mpl.Line2D([], [], color=cycle(k), lw=2, label=name)
        for k, name in enumerate(names)
    ]


def fit(ax: mpl.Axes) -> None:
    """Fit the height of a figure of `axes_of` to one picture with equal scales, in 2D or 3D.

    A figure that the user has made keeps its size.
    """
    if "_repr_png_" not in vars(ax):
        return
    wide, high = np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())
    if ax.name == "3d":
        from bipot_rs.plots.space_axes import project_box

        wide, high = np.subtract(*project_box(ax)[::-1])
    figure = figure_of(ax)
    width, _ = figure.get_size_inches()
    # Labels and the colour bar take 2 inches in width, labels 0.9 inches in height.
    inner = width - 2.0
    height = min(max(inner * high / wide, 2.0), 5.4)
    figure.set_size_inches(width, height + 0.9)


def note(ax: mpl.Axes, text: str) -> None:
    """Write a short text above the axes, on the left."""
    if text:
        # Seen from below, the axes in 3D have their labels above.
        below = getattr(ax, "elev", 0.0) < 0
        ax.set_title(text, fontsize="small", loc="left", pad=38 if below else None)


def say(ax: mpl.Axes3D, text: str) -> None:
    """Write a sentence into the middle of axes, in 2D or 3D, that show no values."""
    place = {"ha": "center", "va": "center"}
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    if ax.name == "3d":
        ax.text2D(0.5, 0.97, text, transform=ax.transAxes, **place)
    else:
        ax.text(0.5, 0.5, text, bbox=box, transform=ax.transAxes, **place)


def blank() -> mpl.ListedColormap:
    """Colour map with one colour, for values that are all equal."""
    return mpl.ListedColormap([COLOURS[0]])


def legend_above(ax: mpl.Axes, *, title: str = "", **more: object) -> mpl.Legend:
    """Add a legend above the axes, where it hides nothing, with a title."""
    if title:
        more = {"title": title, "title_fontsize": "small", "alignment": "left"} | more
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False}
    look = {"fontsize": "small", "ncols": 3, "columnspacing": 1.2, "handlelength": 1.4}
    return ax.legend(**{**place, **look, **more})


def status_handles(status: Integers) -> list[mpl.Patch]:
    """Patches for a legend, stick first, with the number of contacts of each status."""
    counts = [int(np.sum(status == k)) for k in range(3)]
    return [
        mpl.Patch(facecolor=COLOURS[k], label=f"{STATUS_NAMES[k]} ({counts[k]})")
        for k in (2, 1, 0)
    ]


def status_colours() -> Colours:
    """Keyword arguments of matplotlib that map statuses to colours."""
    return map_colours(mpl.ListedColormap(COLOURS), 0, 2)


def bare(ax: mpl.Axes) -> None:
    """Remove the top and right lines of the frame."""
    ax.spines[["top", "right"]].set_visible(False)


def whole_numbers(axis: mpl.Axis) -> None:
    """Put ticks at whole numbers."""
    axis.set_major_locator(mpl.MaxNLocator(integer=True, min_n_ticks=1))


def round_number(value: float) -> float:
    """Round ``value`` > 0 down to 1, 2 or 5 times a power of ten.

    >>> [round_number(x) for x in (0.034, 7.0, 1000.0)]
    [0.02, 5.0, 1000.0]
    """
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    fits: Sequence[float] = [m for m in (1.0, 2.0, 5.0) if m <= value / power + 1e-12]
    return float(f"{(fits or [1.0])[-1] * power:.12g}")
