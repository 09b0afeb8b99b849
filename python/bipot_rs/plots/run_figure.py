"""The pictures of `bipot run --plot`: contact and the load path, and the discretisation error."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.results.result import Result
from bipot_rs.plots import mpl, style
from bipot_rs.plots.body import cells_in_plane, facets_in_space
from bipot_rs.plots.data import DrawnContacts, look, number_of
from bipot_rs.plots.line import draw_tractions
from bipot_rs.plots.path import resultants, status_shares
from bipot_rs.plots.space import draw_space
from bipot_rs.plots.surface import draw_map, draw_status, is_plane, plane_of
from bipot_rs.plots.triangles import skin

if TYPE_CHECKING:
    from bipot_rs.plots.style import Colours

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
    # The title of the figure has the number of the step.
    seen = replace(look(result, step, on=on, units=units), said="")
    flat = seen.x.shape[1] == 2
    several = len(result) > 1
    # Not pyplot: it would keep the figure and choose a backend for the process.
    heights = [5.2] if flat else [_height(surface) for _, surface in _rows(seen)]
    heights += [2.6] if several else []
    figure = mpl.Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts: list[mpl.SubFigure] = (
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


def _in_space(figures: Sequence[mpl.SubFigure], seen: DrawnContacts) -> None:
    for figure, (name, surface) in zip(figures, _rows(seen), strict=False):
        (_maps if is_plane(surface) else _facets)(figure, surface)
        if name:
            figure.suptitle(name, x=0.01, ha="left", fontsize="medium")


def _maps(figure: mpl.Figure | mpl.SubFigure, seen: DrawnContacts) -> None:
    """Draw contact on a flat surface: maps of pressure, shear with direction, status."""
    left, middle, right = figure.subplots(1, 3)
    draw_map(seen, "pressure", left)
    draw_map(seen, "shear", middle, seen.traction[:, 1:])
    draw_status(seen, right)
    for ax in (middle, right):
        ax.set_ylabel("")


def _facets(figure: mpl.Figure | mpl.SubFigure, seen: DrawnContacts) -> None:
    """Draw contact on other surfaces: their facets in 3D, or dots if they are unknown."""
    panels = figure.subplots(1, 3, subplot_kw=style.in_space())
    for ax, quantity in zip(panels, ("pressure", "shear", "status"), strict=True):
        draw_space(seen, quantity, ax, below=True)
        ax.tick_params(labelsize="small")


# Range of the colours, relative to the mean element. A mesh is best for its size when all
# elements have about the same error.
_LOW, _HIGH = 1e-3, 1e2


def error_map(
    path: str | os.PathLike[str],
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    energies: Floats,
    *,
    contacts: Floats | None = None,
    title: str = "",
    unit: str = "",
) -> None:
    """Draw the error energy of each element, relative to the mean.

    ``path``: picture to write; the suffix chooses the format.
    ``nodes, cells``: ``(nodes, d)`` and the cells of each body, as `Model.nodes` and
    `Model.cells`.
    ``energies``: ``(cells,)``, as `DiscretisationError.cells`, not all zero.
    ``contacts``: points ``(n_c, d)``; in 2D a second panel shows their surroundings.
    ``title, unit``: title; name of the unit of length.
    """
    figure = mpl.Figure(figsize=(9.5, 4.4), layout="constrained")
    draw_error(figure, nodes, cells, energies, contacts=contacts, unit=unit)
    figure.suptitle(title, fontsize=12, fontweight="bold")
    figure.savefig(path, dpi=130)


def draw_error(
    figure: mpl.Figure | mpl.SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    energies: Floats,
    *,
    contacts: Floats | None = None,
    unit: str = "",
) -> None:
    """Draw `error_map` into a figure of matplotlib, or a subfigure."""
    count = sum(len(corners) for _, corners in cells)
    energies = floats("energies", energies, shape=(count,))
    mean = energies.mean()
    if not mean > 0:
        raise ValueError("energies are all zero: there is no error to draw")
    share = np.clip(energies / mean, _LOW, _HIGH)
    colours: Colours = {"cmap": "magma_r", "norm": mpl.LogNorm(_LOW, _HIGH)}
    label = "error energy of the element / of the mean element"
    if nodes.shape[1] == 2:
        panels = _error_in_plane(figure, nodes, cells, share, contacts, colours, unit)
    else:
        panels = _draw_error_in_space(figure, nodes, cells, share, colours)
    figure.colorbar(panels[-1][1], ax=[axes for axes, _ in panels], label=label)


def _error_in_plane(
    figure: mpl.Figure | mpl.SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    share: Floats,
    contacts: Floats | None,
    colours: Colours,
    unit: str,
) -> list[tuple[mpl.Axes, mpl.PolyCollection]]:
    views = [(nodes.min(axis=0), nodes.max(axis=0))]
    if contacts is not None and len(contacts):
        low, high = contacts.min(axis=0), contacts.max(axis=0)
        around = 0.35 * (high - low).max()
        near = (
            np.maximum(low - around, views[0][0]),
            np.minimum(high + around, views[0][1]),
        )
        if (near[1] - near[0]).prod() < 0.25 * (views[0][1] - views[0][0]).prod():
            views.append(near)
    panels = []
    for k, (low, high) in enumerate(views):
        axes = figure.add_subplot(1, len(views), k + 1)
        image = cells_in_plane(cells, nodes, share, axes, **colours)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        if unit:
            axes.set_xlabel(f"[{unit}]")
        panels.append((axes, image))
    return panels


def _draw_error_in_space(
    figure: mpl.Figure | mpl.SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    share: Floats,
    colours: Colours,
) -> list[tuple[mpl.Axes, mpl.PolyCollection]]:
    """Draw the boundary from above and from below, each facet in the colour of its cell."""
    parts = skin(cells)
    outside = [polygon for facets, _ in parts for polygon in nodes[facets]]
    of_cell = np.concatenate([cell for _, cell in parts])
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    panels = []
    for k, height in enumerate((25, -25)):
        axes = figure.add_subplot(1, 2, k + 1, **style.in_space())
        image = facets_in_space(
            outside, share[of_cell], axes, lw=0.1, edgecolor="grey", **colours
        )
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low)
        axes.view_init(height, -55)
        axes.set_title("from above" if height > 0 else "from below", fontsize="medium")
        axes.set_axis_off()
        panels.append((axes, image))
    return panels
