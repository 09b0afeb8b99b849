"""Pictures of contact: tractions, stick, slip and open zones, and the load path."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs.check import floats
from bipot_rs.friction import dissipation

Floats = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]

# By status: open, slip, stick. They differ in lightness too, for print.
_NAMES = ("open", "slip", "stick")
_COLOURS = ("#d9dee3", "#f28e2b", "#1f4e79")
_PIXELS = 500


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
    status = np.asarray(last["status"])
    traction = np.asarray(last["reaction"]) / contacts["area"][:, None]
    planar = contacts["x"].shape[1] == 2
    # Not pyplot: it would keep the figure and choose a backend for the process.
    heights = [5.2 if planar else 4.1, 2.6][: min(len(steps), 2)]
    figure = Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(
        len(heights), 1, height_ratios=heights, squeeze=False
    ).ravel()
    if planar:
        _profile(parts[0], contacts, traction, status, names)
    else:
        _maps(parts[0], contacts, traction, status, names)
    if len(steps) > 1:
        _path(parts[1], contacts, steps, names)
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


def _profile(
    figure: Any,
    contacts: Arrays,
    traction: Floats,
    status: NDArray[Any],
    units: Mapping[str, str],
) -> None:
    """Contact along a line: pressure, shear within ±μ p, a strip of zones."""
    from matplotlib.colors import ListedColormap

    along = contacts["x"] @ contacts["frame"][0, 1]
    order = np.argsort(along)
    s, p, t = along[order], traction[order, 0], traction[order, 1]
    limit = contacts["mu"][order] * p
    axes, strip = figure.subplots(2, 1, sharex=True, height_ratios=[10, 1])
    axes.fill_between(s, -limit, limit, color=_COLOURS[1], alpha=0.15, lw=0)
    axes.plot(s, limit, "--", color=_COLOURS[1], lw=1, label="±μ × pressure")
    axes.plot(s, -limit, "--", color=_COLOURS[1], lw=1)
    mark = {"marker": "o", "ms": 3} if len(s) < 80 else {}
    axes.plot(s, p, color=_COLOURS[2], lw=1.8, label="pressure", **mark)
    axes.plot(s, t, color="#c0392b", lw=1.8, label="shear traction", **mark)
    axes.axhline(0, color="black", lw=0.6)
    axes.set_ylabel(_label("traction", units.get("stress")))
    axes.legend(frameon=False, loc="best")
    axes.spines[["top", "right"]].set_visible(False)
    # Each node takes the stretch up to the middle between it and the next.
    edges = np.concatenate([s[:1], (s[1:] + s[:-1]) / 2, s[-1:]])
    strip.pcolormesh(
        edges,
        [0, 1],
        status[order][None],
        cmap=ListedColormap(_COLOURS),
        vmin=0,
        vmax=2,
    )
    strip.set_yticks([])
    strip.set_xlabel(_label("place", units.get("length")))
    strip.set_xlim(s[0], s[-1])
    _legend(strip, status, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def _maps(
    figure: Any,
    contacts: Arrays,
    traction: Floats,
    status: NDArray[Any],
    units: Mapping[str, str],
) -> None:
    """Contact on a surface: maps of pressure, of shear with its direction, of zones."""
    frame, x = contacts["frame"], contacts["x"]
    shear = np.linalg.norm(traction[:, 1:], axis=1)
    off_plane = (x - x[0]) @ frame[0, 0]
    if np.ptp(off_plane) > 1e-6 * np.ptp(x, axis=0).max():
        _clouds(figure, x, traction[:, 0], shear, status, units)
        return
    uv = x @ frame[0, 1:].T
    panels = figure.subplots(1, 3)
    triangles = _triangles(uv, contacts["area"])
    for axes, values, name in (
        (panels[0], traction[:, 0], "pressure"),
        (panels[1], shear, "shear traction"),
    ):
        # Tractions grow without bound towards an edge: a few nodes there would
        # leave one colour for all others.
        top = float(np.percentile(values, 98)) or 1.0
        image = axes.tripcolor(
            triangles, values, shading="gouraud", cmap="viridis", vmin=0, vmax=top
        )
        figure.colorbar(
            image,
            cax=axes.inset_axes((1.03, 0.0, 0.045, 1.0)),
            extend="max" if values.max() > top else "neither",
        )
        axes.set_title(_label(name, units.get("stress")), fontsize="medium")
    chosen = _thin(uv, shear > 0)
    if chosen.size:
        # Directions of the force on the body; tangents are the same at all nodes.
        arrow = traction[chosen, 1:] / shear[chosen, None]
        panels[1].quiver(
            *uv[chosen].T, *arrow.T, color="white", pivot="mid", width=4e-3
        )
    _zones(panels[2], uv, contacts["area"], status)
    _legend(panels[2], status, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    low, high = uv.min(axis=0), uv.max(axis=0)
    for axes in panels:
        axes.set_aspect("equal")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_xlabel(_label("along t1", units.get("length")))
    panels[0].set_ylabel(_label("along t2", units.get("length")))


def _zones(axes: Any, uv: Floats, area: Floats, status: NDArray[Any]) -> None:
    """Colour each place by the status of the nearest node."""
    from matplotlib.colors import ListedColormap
    from scipy.spatial import cKDTree

    low, high = uv.min(axis=0), uv.max(axis=0)
    step = (high - low).max() / _PIXELS
    u = np.arange(low[0] + step / 2, high[0], step)
    v = np.arange(low[1] + step / 2, high[1], step)
    places = np.stack(np.meshgrid(u, v), axis=-1)
    distance, nearest = cKDTree(uv).query(places)
    image = status[nearest].astype(float)
    # Holes of the surface stay blank: no node is that far from its own area.
    image[distance > 1.5 * np.sqrt(area)[nearest]] = np.nan
    axes.imshow(
        image,
        origin="lower",
        extent=(low[0], high[0], low[1], high[1]),
        cmap=ListedColormap(_COLOURS),
        vmin=0,
        vmax=2,
        interpolation="nearest",
    )


def _clouds(
    figure: Any,
    x: Floats,
    pressure: Floats,
    shear: Floats,
    status: NDArray[Any],
    units: Mapping[str, str],
) -> None:
    """Contact on surfaces that are not one plane: nodes in space."""
    from matplotlib.colors import ListedColormap

    panels = figure.subplots(1, 3, subplot_kw={"projection": "3d"})
    for axes, values, name in (
        (panels[0], pressure, "pressure"),
        (panels[1], shear, "shear traction"),
    ):
        cloud = axes.scatter(*x.T, c=values, s=8, cmap="viridis")
        label = _label(name, units.get("stress"))
        figure.colorbar(cloud, ax=axes, location="bottom", label=label)
    colours = ListedColormap(_COLOURS)
    panels[2].scatter(*x.T, c=status, s=8, cmap=colours, vmin=0, vmax=2)
    _legend(panels[2], status, loc="upper center", bbox_to_anchor=(0.5, -0.05))
    for axes in panels:
        axes.set_box_aspect(np.maximum(np.ptp(x, axis=0), 0.2 * np.ptp(x)))


def _path(
    figure: Any,
    contacts: Arrays,
    steps: Sequence[Mapping[str, Any]],
    units: Mapping[str, str],
) -> None:
    """Resultants and zones of every load step."""
    from matplotlib.ticker import MaxNLocator

    number = np.arange(1, len(steps) + 1)
    reaction = np.array([step["reaction"] for step in steps])
    # In the frame of each node; summed in global components.
    force = np.einsum("sck,ckd->sd", reaction, contacts["frame"])
    normal = contacts["frame"][:, 0].mean(axis=0)
    normal /= np.linalg.norm(normal) or 1.0
    press = force @ normal
    drag = force - press[:, None] * normal
    main = np.linalg.svd(drag, full_matrices=False)[2][0]
    # Of the two directions of the line that the drag follows, the ascending axis.
    main *= np.sign(main[np.argmax(np.abs(main))])
    left, right = figure.subplots(1, 2)
    style = {"marker": "o", "ms": 3, "lw": 1.5}
    left.plot(number, press, color=_COLOURS[2], label="normal force", **style)
    left.plot(number, drag @ main, color="#c0392b", label="tangential force", **style)
    mu = contacts["mu"]
    if mu.ndim == 2:
        # The most that an ellipse's points reach along the line of the drag.
        mu = dissipation(mu, contacts["frame"][:, 1:] @ main)
    limit = reaction[:, :, 0] @ mu
    label = "within ±Σ μ × normal force"
    left.fill_between(
        number, -limit, limit, color=_COLOURS[1], alpha=0.15, lw=0, label=label
    )
    left.axhline(0, color="black", lw=0.6)
    left.set_ylabel(_label("force", units.get("force")))
    left.legend(
        frameon=False,
        fontsize="small",
        ncols=3,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
    )
    counts = np.array(
        [[np.mean(np.asarray(s["status"]) == k) for k in (2, 1, 0)] for s in steps]
    )
    below = np.zeros(len(steps))
    for k, share in zip((2, 1, 0), counts.T, strict=True):
        right.bar(
            number,
            share,
            0.8 if len(steps) > 4 else 0.4,
            bottom=below,
            color=_COLOURS[k],
            label=_NAMES[k],
        )
        below += share
    right.set_ylim(0, 1)
    right.set_xlim(0.2, len(steps) + 0.8)
    right.set_ylabel("share of nodes")
    for axes in (left, right):
        axes.set_xlabel("load step")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        axes.spines[["top", "right"]].set_visible(False)


def _triangles(uv: Floats, area: Floats) -> Any:
    """Delaunay triangles, without those that bridge a hole of the surface."""
    from matplotlib.tri import Triangulation

    triangles = Triangulation(*uv.T)
    corners = triangles.triangles
    size = np.sqrt(area)
    longest = np.zeros(len(corners), dtype=bool)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = corners[:, a], corners[:, b]
        longest |= np.linalg.norm(uv[i] - uv[j], axis=1) > 3 * (size[i] + size[j])
    triangles.set_mask(longest)
    return triangles


def _thin(uv: Floats, wanted: NDArray[np.bool_], across: int = 14) -> NDArray[np.intp]:
    """One node in each of about ``across`` × ``across`` squares, for arrows."""
    size = np.ptp(uv, axis=0).max() / across or 1.0
    squares = np.floor((uv - uv.min(axis=0)) / size).astype(int)
    nodes = np.flatnonzero(wanted)
    _, first = np.unique(squares[nodes], axis=0, return_index=True)
    return nodes[first]


def _legend(axes: Any, status: NDArray[Any], **place: Any) -> None:
    from matplotlib.patches import Patch

    counts = [int(np.sum(status == k)) for k in range(3)]
    handles = [
        Patch(facecolor=_COLOURS[k], label=f"{_NAMES[k]} ({counts[k]})")
        for k in (2, 1, 0)
    ]
    axes.legend(handles=handles, ncols=3, frameon=False, fontsize="small", **place)


def _label(name: str, unit: str | None) -> str:
    return f"{name} [{unit}]" if unit else name
