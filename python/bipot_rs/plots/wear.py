"""Pictures of wear: depth and pressure along a line, by cycle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.validation import integers, one_of
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.wear.record import Wear
from bipot_rs.plots import mpl, style
from bipot_rs.plots.data import ContactsArgument, look, steps_of
from bipot_rs.plots.line import lines_of

QUANTITIES = ("depth", "pressure")
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
    one_of("quantity", quantity, QUANTITIES)
    path = _ends(result)
    chosen = _choose(path, cycles)
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
            colour = _colour(number, len(chosen))
            ax.plot(line.s, values[line.order], color=colour, label=label, **joined)
    style.name_axis(ax.xaxis, axis, seen.units.get("length"))
    if quantity == "depth":
        ax.set_ylim(1.05 * largest or 1.0, 0.0)
        style.name_axis(ax.yaxis, "wear depth", seen.units.get("length"))
    elif seen.area is None:
        style.name_axis(ax.yaxis, "normal force", seen.units.get("force"))
    else:
        style.name_axis(ax.yaxis, "pressure", style.stress_unit(seen.units))
    style.bare(ax)
    style.legend_above(ax)
    return ax


def both(
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


def _ends(result: object) -> Result:
    """The ends of cycles; an error if there are none."""
    source = result.ends if isinstance(result, Wear) else result
    path = steps_of(source)
    if any(step.wear is None for step in path):
        raise ValueError("result has no wear: it is not from ContactProblem.wear")
    return path


def _choose(path: Result, cycles: ArrayLike | None) -> list[int]:
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


def _colour(number: int, count: int) -> tuple[float, float, float, float]:
    """Colours from light to dark, for the order of cycles."""
    return mpl.colormaps["viridis_r"](0.15 + 0.85 * number / max(count - 1, 1))
