"""Map of the discretisation error by element: it shows where to refine the mesh."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.plots import style
from bipot_rs.plots.body import cells_in_plane, facets_in_space
from bipot_rs.plots.geometry.triangles import skin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure, SubFigure

    from bipot_rs.plots.style import Colours

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
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    draw(figure, nodes, cells, energies, contacts=contacts, unit=unit)
    figure.suptitle(title, fontsize=12, fontweight="bold")
    figure.savefig(path, dpi=130)


def draw(
    figure: Figure | SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    energies: Floats,
    *,
    contacts: Floats | None = None,
    unit: str = "",
) -> None:
    """Draw `error_map` into a figure of matplotlib, or a subfigure."""
    from matplotlib.colors import LogNorm

    count = sum(len(corners) for _, corners in cells)
    energies = floats("energies", energies, shape=(count,))
    mean = energies.mean()
    if not mean > 0:
        raise ValueError("energies are all zero: there is no error to draw")
    share = np.clip(energies / mean, _LOW, _HIGH)
    colours: Colours = {"cmap": "magma_r", "norm": LogNorm(_LOW, _HIGH)}
    label = "error energy of the element / of the mean element"
    if nodes.shape[1] == 2:
        panels = _plane(figure, nodes, cells, share, contacts, colours, unit)
    else:
        panels = _space(figure, nodes, cells, share, colours)
    figure.colorbar(panels[-1][1], ax=[axes for axes, _ in panels], label=label)


def _plane(
    figure: Figure | SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    share: Floats,
    contacts: Floats | None,
    colours: Colours,
    unit: str,
) -> list[tuple[Axes, PolyCollection]]:
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


def _space(
    figure: Figure | SubFigure,
    nodes: Floats,
    cells: Sequence[tuple[str, Ints]],
    share: Floats,
    colours: Colours,
) -> list[tuple[Axes, PolyCollection]]:
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
