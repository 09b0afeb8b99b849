"""The picture of `bipot run --plot`: tractions, statuses and the load path in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs.contact.results.result import Result
from bipot_rs.plots import style
from bipot_rs.plots.data import DrawnContacts, look, number_of
from bipot_rs.plots.line import draw_tractions
from bipot_rs.plots.path import resultants, status_shares
from bipot_rs.plots.space import draw_space
from bipot_rs.plots.surface import draw_map, draw_status, is_plane, plane_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

# Up to this many surfaces have separate maps; more are drawn together.
_ROWS = 4


def write_figure(
    path: str | os.PathLike[str],
    result: Result,
    *,
    step: int = -1,
    on: ArrayLike | str | None = None,
    title: str = "",
    units: Mapping[str, str] | None = None,
) -> None:
    """Draw one load step, and the load path.

    ``path``: picture to write; the suffix chooses the format.
    ``result, step, on, units``: as in `plots.tractions`. Each surface has separate lines, in
    3D maps; a curved one without ``facets`` is drawn as dots.
    ``title``: title; the number of the load step is added.
    Raises `TypeError` or `ValueError`: data are missing or have a wrong shape; the message
    names them.
    """
    from matplotlib.figure import Figure

    # The title of the figure has the number of the step.
    seen = replace(look(result, step, on=on, units=units), said="")
    flat = seen.x.shape[1] == 2
    several = len(result) > 1
    # Not pyplot: it would keep the figure and choose a backend for the process.
    heights = [5.2] if flat else [_height(surface) for _, surface in _rows(seen)]
    heights += [2.6] if several else []
    figure = Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts: list[SubFigure] = (
        figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
        .ravel()
        .tolist()
    )
    if flat:
        draw_tractions(seen, None, parts[0].add_subplot())
    else:
        _in_space(parts, seen)
    number = number_of(result, step)
    if several and number is not None:
        left, right = parts[-1].subplots(1, 2)
        resultants(result, on=on, units=units, ax=left)
        status_shares(result, on=on, ax=right)
        place = f"load step {number[0] + 1} of {number[1]}"
        title = f"{title}, {place}" if title else place
    figure.suptitle(title, fontsize=13, fontweight="bold")
    figure.savefig(path, dpi=150, bbox_inches="tight")


def _height(seen: DrawnContacts) -> float:
    """Height of a row of three pictures [inch]: maps have equal scales."""
    if not is_plane(seen):
        return 3.7
    wide, high = np.ptp(plane_of(seen)[0], axis=0)
    return float(np.clip(2.4 * high / (wide or 1.0), 1.2, 3.2) + 1.1)


def _rows(seen: DrawnContacts) -> list[tuple[str, DrawnContacts]]:
    """Rows of pictures: one for each surface if all are flat, else one for all."""
    if is_plane(seen):
        return [("", seen)]
    each = [(name, seen.part(members)) for name, members in seen.surfaces]
    if len(each) > _ROWS or not all(is_plane(surface) for _, surface in each):
        return [("", seen)]
    return each


def _in_space(figures: Sequence[SubFigure], seen: DrawnContacts) -> None:
    for figure, (name, surface) in zip(figures, _rows(seen), strict=False):
        (_maps if is_plane(surface) else _facets)(figure, surface)
        if name:
            figure.suptitle(name, x=0.01, ha="left", fontsize="medium")


def _maps(figure: Figure | SubFigure, seen: DrawnContacts) -> None:
    """Draw contact on a flat surface: maps of pressure, shear with direction, status."""
    left, middle, right = figure.subplots(1, 3)
    draw_map(seen, "pressure", left)
    draw_map(seen, "shear", middle, seen.traction[:, 1:])
    draw_status(seen, right)
    for ax in (middle, right):
        ax.set_ylabel("")


def _facets(figure: Figure | SubFigure, seen: DrawnContacts) -> None:
    """Draw contact on other surfaces: their facets in 3D, or dots if they are unknown."""
    panels = figure.subplots(1, 3, subplot_kw=style.in_space())
    for ax, quantity in zip(panels, ("pressure", "shear", "status"), strict=True):
        draw_space(seen, quantity, ax, below=True)
        ax.tick_params(labelsize="small")
