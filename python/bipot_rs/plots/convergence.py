"""Convergence of the solver: residual over work."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Solution
from bipot_rs.plots import mpl, style
from bipot_rs.plots.data import one_step, steps_of

# With more steps than this, a colour bar shows their numbers.
_NAMED = 6


def convergence(
    result: object, *, step: int | None = None, ax: mpl.Axes | None = None
) -> mpl.Axes:
    """Residual η over work in products with W, one point for each iteration.

    Parameters
    ----------
    result
        A `Solution`, a `Step` or a `Result`.
    step
        Step of a result; default all.
    ax
        As in `tractions`.

    Raises
    ------
    ValueError
        The result has no history, for example because it was read from a file.
    """
    path: Sequence[Solution]
    if isinstance(result, Result) and step is None:
        path = steps_of(result)
    else:
        path = [one_step(result, -1 if step is None else step)]
    kept = [k for k, iterate in enumerate(path) if len(iterate.history)]
    if not kept:
        raise ValueError(
            "history is empty: result files do not contain it, pass a result of solve"
        )
    ax = style.axes_of(ax)
    shade = mpl.Normalize(1, max(len(path), 2))
    colours = style.shades()
    for k in kept:
        work, eta = path[k].history.T
        # A logarithmic axis cannot show a residual of zero.
        ax.semilogy(
            work,
            np.where(eta > 0, eta, np.nan),
            marker="o",
            ms=3,
            lw=1.2,
            color=style.PRESSURE if len(path) == 1 else colours(shade(k + 1)),
            label=f"step {k + 1}" if len(path) > 1 else "residual",
        )
    tolerance = max(path[k].tolerance for k in kept)
    ax.axhline(tolerance, ls="--", lw=1, color=style.LIMIT, label="held to")
    ax.set_xlabel("work [products with W]")
    ax.set_ylabel("residual η")
    style.bare(ax)
    if len(path) <= _NAMED:
        style.legend_above(ax)
    else:
        scale = style.scale_of(colours, 1, len(path))
        style.colour_bar(scale, ax, "load step", None)
        handles = [h for h in ax.get_lines() if h.get_label() == "held to"]
        style.legend_above(ax, handles=handles)
    return ax
