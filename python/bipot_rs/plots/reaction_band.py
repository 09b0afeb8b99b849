"""Picture of reactions that are not determined: a band along a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats
from bipot_rs.contact.proof.reaction_range import ReactionRange
from bipot_rs.plots import mpl, style
from bipot_rs.plots.arc_length import places
from bipot_rs.plots.data import ContactsArgument, contacts_of, selection, units_of

# A bound that is infinite is drawn this much beyond the largest finite number.
_BEYOND = 0.25
_NAMES = ("normal force", "tangential force", "second tangential force")


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
    _draw(ax, line.s, least, answers, largest)
    ax.axhline(0, color="black", lw=0.6)
    style.bare(ax)
    style.legend_above(ax)
    named = units_of(None, units)
    style.name_axis(ax.xaxis, line.name, named.get("length"))
    style.name_axis(ax.yaxis, _NAMES[every[0].component], named.get("force"))
    return ax


def _draw(
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
