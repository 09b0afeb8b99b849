"""The picture of `bipot run --plot`: tractions, statuses and the load path in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats
from bipot_rs.plots.body import box_in_space
from bipot_rs.plots.data import Contacts, facets_of, names_of, surface_of
from bipot_rs.plots.line import draw_tractions
from bipot_rs.plots.path import draw_resultants, draw_shares
from bipot_rs.plots.space import draw_space
from bipot_rs.plots.surface import draw_map, draw_status
from bipot_rs.plots.surface_plane import is_plane

Arrays = Mapping[str, NDArray[Any]]

# Up to this many surfaces have separate maps; more are drawn together.
_ROWS = 4


def tractions(
    path: str | os.PathLike[str],
    contacts: Arrays,
    steps: Sequence[Mapping[str, Any]],
    *,
    title: str = "",
    units: Mapping[str, str] | None = None,
    step: int = -1,
) -> None:
    """Draw one load step, and the load path.

    Parameters
    ----------
    path
        Picture to write; the suffix chooses the format.
    contacts
        ``x (n_c, d)``, ``area (n_c,)``, ``mu``, ``frame (n_c, d, d)``, and for several
        surfaces ``surface (n_c,)`` and ``surface_names``, as in a result file; in 3D also
        ``facets``, without which curved surfaces are dots. Each surface has separate
        lines, in 3D maps.
    steps
        At least one, each with ``load``, ``reaction (n_c, d)``, ``status (n_c,)``.
    title
        Title; the number of the load step is added.
    units
        Names of units by ``"length"``, ``"force"``, ``"stress"``.
    step
        Index of the step to draw, default the last.

    Raises
    ------
    TypeError, ValueError
        Data are missing or have a wrong shape; the message names them.
    """
    from matplotlib.figure import Figure

    if not steps:
        raise ValueError("steps is empty, expected at least one load step")
    known, steps = _checked(contacts, steps)
    names = dict(units or {})
    at = range(len(steps))[step]
    drawn = steps[at]
    n, d = known["x"].shape
    frames = np.array([one.get("frame", known["frame"]) for one in steps])
    seen = Contacts(
        **(known | {"frame": frames[at]}),
        reaction=drawn["reaction"],
        status=drawn["status"].astype(np.int8),
        gap=np.zeros(n),
        slip=np.zeros((n, d - 1)),
        units=names,
        surface=surface_of(contacts, n),
        names=names_of(contacts),
        facets=facets_of(contacts, n) if d == 3 else None,
    )
    # Not pyplot: it would keep the figure and choose a backend for the process.
    rows = [5.2] if d == 2 else [4.1] * len(_rows(seen))
    heights = [*rows, *([2.6] if len(steps) > 1 else [])]
    figure = Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(
        len(heights), 1, height_ratios=heights, squeeze=False
    ).ravel()
    if d == 2:
        draw_tractions(seen, None, parts[0].add_subplot())
    else:
        _in_space(parts, seen)
    if len(steps) > 1:
        left, right = parts[-1].subplots(1, 2)
        reaction = np.array([step["reaction"] for step in steps])
        draw_resultants(reaction, frames, seen.mu, seen.surfaces, names, left)
        draw_shares(np.array([step["status"] for step in steps]), right)
        said = f"load step {at + 1} of {len(steps)}"
        title = f"{title}, {said}" if title else said
    figure.suptitle(title, fontsize=13, fontweight="bold")
    figure.savefig(path, dpi=150)


def _rows(seen: Contacts) -> list[tuple[str, Contacts]]:
    """Rows of pictures: one for each surface if all are flat, else one for all."""
    if is_plane(seen):
        return [("", seen)]
    each = [(name, seen.part(own)) for name, own in seen.surfaces]
    if len(each) > _ROWS or not all(is_plane(one) for _, one in each):
        return [("", seen)]
    return each


def _in_space(figures: Sequence[Any], seen: Contacts) -> None:
    for figure, (name, one) in zip(figures, _rows(seen), strict=False):
        (_maps if is_plane(one) else _facets)(figure, one)
        if name:
            figure.suptitle(name, x=0.01, ha="left", fontsize="medium")


def _checked(
    contacts: Arrays, steps: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Floats], list[dict[str, Floats]]]:
    def taken(
        whose: str, given: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]
    ) -> dict[str, Floats]:
        missing = [name for name in shapes if given.get(name) is None]
        if missing:
            raise ValueError(f"{whose}: {', '.join(missing)} missing")
        return {
            name: floats(f"{name} of {whose}", given[name], shape=shape)
            for name, shape in shapes.items()
        }

    x = taken("contacts", contacts, {"x": np.asarray(contacts.get("x")).shape})["x"]
    if x.ndim != 2 or x.shape[1] not in (2, 3) or not len(x):
        raise ValueError(f"x of contacts has shape {x.shape}, expected (n_c, 2 or 3)")
    n, d = x.shape
    two = d == 3 and np.asarray(contacts.get("mu")).ndim == 2
    coefficients = (n, 2) if two else (n,)
    shapes_known = {"area": (n,), "mu": coefficients, "frame": (n, d, d)}
    known = taken("contacts", contacts, shapes_known)
    shapes: dict[str, tuple[int, ...]] = {"reaction": (n, d), "status": (n,)}
    found = []
    for k, step in enumerate(steps):
        # A step has frames of its own if an obstacle turns or curves.
        own = {} if step.get("frame") is None else {"frame": (n, d, d)}
        found.append(taken(f"step {k}", step, shapes | own))
    return known | {"x": x}, found


def _maps(figure: Any, seen: Contacts) -> None:
    """Draw contact on a flat surface: maps of pressure, shear with direction, status."""
    left, middle, right = figure.subplots(1, 3)
    draw_map(seen, "pressure", left)
    draw_map(seen, "shear", middle, seen.traction[:, 1:])
    draw_status(seen, right)
    for ax in (middle, right):
        ax.set_ylabel("")


def _facets(figure: Any, seen: Contacts) -> None:
    """Draw contact on other surfaces: their facets in 3D, or dots if they are unknown."""
    panels = figure.subplots(1, 3, subplot_kw={"projection": "3d"})
    for ax, quantity in zip(panels, ("pressure", "shear", "status"), strict=True):
        draw_space(seen, quantity, ax, below=True)
        box_in_space(seen.x, ax, zoom=0.72)
        ax.tick_params(labelsize="small")
