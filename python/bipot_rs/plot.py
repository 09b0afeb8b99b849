"""The picture that a run leaves: tractions, zones and the load path, in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs.check import floats
from bipot_rs.plots import canvas
from bipot_rs.plots.line import draw_tractions
from bipot_rs.plots.path import draw_resultants, draw_shares, sums
from bipot_rs.plots.source import Contacts
from bipot_rs.plots.surface import draw_map, draw_status, is_plane

Floats = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]


def tractions(
    path: str | os.PathLike[str],
    contacts: Arrays,
    steps: Sequence[Mapping[str, Any]],
    *,
    title: str = "",
    units: Mapping[str, str] | None = None,
) -> None:
    """Draw the last load step, and the path that led to it.

    Parameters
    ----------
    path
        Picture to write; the suffix chooses the format.
    contacts
        ``x (n_c, d)``, ``area (n_c,)``, ``mu``, ``frame (n_c, d, d)``, as
        in a result file.
    steps
        At least one, each with ``load``, ``reaction (n_c, d)``, ``status (n_c,)``.
    title
        Line on top.
    units
        Names of units by ``"length"``, ``"force"``, ``"stress"``.

    Raises
    ------
    TypeError, ValueError
        What is missing or of the wrong shape, by its name.
    """
    from matplotlib.figure import Figure

    if not steps:
        raise ValueError("steps is empty, expected at least one load step")
    contacts, steps = _checked(contacts, steps)
    names = dict(units or {})
    last = steps[-1]
    n, d = contacts["x"].shape
    seen = Contacts(
        **contacts,
        reaction=last["reaction"],
        status=last["status"].astype(np.int8),
        gap=np.zeros(n),
        slip=np.zeros((n, d - 1)),
        units=names,
    )
    planar = d == 2
    # Not pyplot: it would keep the figure and choose a backend for the process.
    heights = [5.2 if planar else 4.1, 2.6][: min(len(steps), 2)]
    figure = Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(
        len(heights), 1, height_ratios=heights, squeeze=False
    ).ravel()
    if planar:
        draw_tractions(seen, None, parts[0].add_subplot())
    elif is_plane(seen):
        _maps(parts[0], seen)
    else:
        _clouds(parts[0], seen)
    if len(steps) > 1:
        left, right = parts[1].subplots(1, 2)
        reaction = np.array([step["reaction"] for step in steps])
        press, drag, limit, _ = sums(reaction, seen.frame, seen.mu)
        draw_resultants(press, drag, limit, names, left)
        draw_shares(np.array([step["status"] for step in steps]), right)
    figure.suptitle(title, fontsize=13, fontweight="bold")
    figure.savefig(path, dpi=150)


def _checked(
    contacts: Arrays, steps: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Floats], list[dict[str, Floats]]]:
    def taken(
        whose: str, given: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]
    ) -> dict[str, Floats]:
        missing = [name for name in shapes if given.get(name) is None]
        if missing:
            raise ValueError(f"{whose} lacks {', '.join(missing)}")
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
    return known | {"x": x}, [
        taken(f"step {k}", step, shapes) for k, step in enumerate(steps)
    ]


def _maps(figure: Any, seen: Contacts) -> None:
    """Contact on a plane: maps of pressure, of shear with its direction, of zones."""
    left, middle, right = figure.subplots(1, 3)
    draw_map(seen, "pressure", left)
    draw_map(seen, "shear", middle, seen.traction[:, 1:])
    draw_status(seen, right)
    for ax in (middle, right):
        ax.set_ylabel("")


def _clouds(figure: Any, seen: Contacts) -> None:
    """Contact on surfaces that are not one plane: nodes in space."""
    panels = figure.subplots(1, 3, subplot_kw={"projection": "3d"})
    x, unit = seen.x, canvas.stress_unit(seen.units)
    shear = np.linalg.norm(seen.traction[:, 1:], axis=1)
    below: dict[str, Any] = {"location": "bottom", "shrink": 0.8, "pad": 0.02}
    for ax, values, name in (
        (panels[0], seen.traction[:, 0], "pressure"),
        (panels[1], shear, "shear traction"),
    ):
        cloud = ax.scatter(*x.T, c=values, s=8, cmap="viridis")
        bar = ax.figure.colorbar(cloud, ax=ax, **below)
        canvas.name_axis(bar.ax.xaxis, name, unit)
    panels[2].scatter(*x.T, c=seen.status, s=8, **canvas.status_colours())
    canvas.legend_above(panels[2], handles=canvas.status_handles(seen.status))
    for ax in panels:
        ax.set_box_aspect(np.maximum(np.ptp(x, axis=0), 0.2 * np.ptp(x)))
