"""Contact along a line: tractions within friction's limit, slip, zones over the path."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs.check import Array, floats
from bipot_rs.friction import dissipation
from bipot_rs.plots import canvas
from bipot_rs.plots.source import Contacts, Given, look

# Points on one line, to this part of its length.
_STRAIGHT = 1e-6
# Beyond so many contacts markers would run into each other.
_MARKERS = 60


def tractions(
    result: Any,
    *,
    step: int = -1,
    along: ArrayLike | None = None,
    where: ArrayLike | None = None,
    contacts: Given | None = None,
    units: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Pressure and shear along a line, within ±μ times the pressure, and the zones.

    Parameters
    ----------
    result
        A `Result`, or a `Step` or `Solution` with ``contacts``.
    step
        Which step of a result.
    along
        Direction ``(d,)`` to measure places along, and in space the one of shear. In the
        plane it may be left out: places are then those along t1, on a curve its length.
    where
        Contacts to draw, a mask ``(n_c,)`` or numbers: in space those of one line.
    contacts
        ``x (n_c, d)``, ``frame``, ``area``, ``mu`` in a mapping, or the model, where the
        result does not know them. Without areas, forces are drawn.
    units
        Names by ``"length"``, ``"force"``, ``"stress"``; default those of the result.
    ax
        Axes to draw into; default those of a new figure, ``ax.figure``.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        A wrong argument, named; what is not known of the contacts, and how to give it.
    """
    seen = look(result, step, contacts=contacts, where=where, units=units)
    return draw_tractions(seen, along, canvas.axes_of(ax))


def draw_tractions(seen: Contacts, along: ArrayLike | None, ax: Any) -> Any:
    """`tractions` on axes that are there."""
    order, s, name = _line(seen, along)
    p, t = seen.traction[order, 0], _shear(seen, along)[order]
    edge = None
    if seen.mu is not None:
        mu = seen.mu
        if mu.ndim == 2:
            # The most that an ellipse's points reach along the line.
            across = seen.has_frame[:, 1:] @ _direction(along, 3)
            mu = dissipation(mu, across)
        limit = mu[order] * p
        ax.fill_between(s, -limit, limit, color=canvas.LIMIT, alpha=0.15, lw=0)
        dashed = {"ls": "--", "color": canvas.LIMIT, "lw": 1}
        (edge,) = ax.plot(s, limit, label="±μ × pressure", **dashed)
        ax.plot(s, -limit, **dashed)
    mark = {"marker": "o", "ms": 3} if len(s) <= _MARKERS else {}
    what = ("pressure", "shear") if seen.area is not None else ("normal", "tangential")
    lines = ax.plot(s, p, color=canvas.PRESSURE, lw=1.6, label=what[0], **mark)
    lines += ax.plot(s, t, color=canvas.SHEAR, lw=1.6, label=what[1], **mark)
    lines += [] if edge is None else [edge]
    ax.axhline(0, color="black", lw=0.6)
    _strip(ax, s, seen.status[order])
    canvas.bare(ax)
    zones = canvas.status_handles(seen.status)
    # Filled column by column: lines above zones.
    pairs = [h for both in zip(_padded(lines), zones, strict=True) for h in both]
    canvas.legend_above(ax, handles=pairs)
    canvas.name_axis(ax.xaxis, name, seen.units.get("length"))
    if seen.area is not None:
        canvas.name_axis(ax.yaxis, "traction", canvas.stress_unit(seen.units))
    else:
        canvas.name_axis(ax.yaxis, "contact force", seen.units.get("force"))
    return ax


def _padded(handles: list[Any]) -> list[Any]:
    from matplotlib.lines import Line2D

    nothing = [Line2D([], [], ls="none", label=" ") for _ in range(3 - len(handles))]
    return handles + nothing


def draw_slip(seen: Contacts, along: ArrayLike | None, ax: Any) -> Any:
    """Slip of the step along a line."""
    order, s, name = _line(seen, along)
    v = seen.slip[:, 0]
    if seen.x.shape[1] == 3:
        v = seen.vectors(seen.slip) @ _direction(along, 3)
    mark = {"marker": "o", "ms": 3} if len(s) <= _MARKERS else {}
    ax.plot(s, v[order], color=canvas.SHEAR, lw=1.6, **mark)
    ax.axhline(0, color="black", lw=0.6)
    _strip(ax, s, seen.status[order])
    canvas.bare(ax)
    canvas.legend_above(ax, handles=canvas.status_handles(seen.status))
    canvas.name_axis(ax.xaxis, name, seen.units.get("length"))
    canvas.name_axis(ax.yaxis, "slip in the step", seen.units.get("length"))
    return ax


def draw_zones(seen: Contacts, status: NDArray[np.integer[Any]], ax: Any) -> Any:
    """Zones along a line, a row a load step, the first at the bottom.

    Parameters
    ----------
    seen
        The last step, by which contacts are placed.
    status
        ``(steps, n_c)`` of the contacts that are drawn.
    """
    order, s, name = _line(seen, None)
    rows = np.arange(len(status) + 1) + 0.5
    ax.pcolormesh(_edges(s), rows, status[:, order], **canvas.status_colours())
    ax.yaxis.get_major_locator().set_params(integer=True)
    handles = canvas.status_handles(status[-1])
    canvas.legend_above(ax, handles=handles)
    canvas.name_axis(ax.xaxis, name, seen.units.get("length"))
    ax.set_ylabel("load step")
    return ax


def _direction(along: ArrayLike | None, d: int) -> Array:
    if along is None:
        raise ValueError(
            "along is missing: of contacts in space, a line is drawn along a direction, "
            "with where= those on it; a whole surface is drawn by surface_map"
        )
    direction = floats("along", along, shape=(d,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ValueError("along is zero, expected a direction")
    return direction / length


def _shear(seen: Contacts, along: ArrayLike | None) -> Array:
    if seen.x.shape[1] == 2:
        return seen.traction[:, 1]
    return seen.vectors(seen.traction[:, 1:]) @ _direction(along, 3)


def _line(
    seen: Contacts, along: ArrayLike | None
) -> tuple[NDArray[np.intp], Array, str]:
    """Order of the contacts along the line, their places on it, and its name."""
    x = seen.x
    if along is not None or x.shape[1] == 3:
        s = x @ _direction(along, x.shape[1])
    else:
        off = x - x.mean(axis=0)
        main = np.linalg.svd(off, full_matrices=False)[2]
        if np.ptp(off @ main[-1]) > _STRAIGHT * np.ptp(off @ main[0]):
            order, s = _chain(x)
            return order, s, "length along the contact"
        tangent = main[0] * np.sign(main[0][np.argmax(np.abs(main[0]))])
        s = x @ (tangent if seen.frame is None else seen.frame[0, 1])
    order = np.argsort(s, kind="stable")
    return order, s[order], "place"


def _chain(x: Array) -> tuple[NDArray[np.intp], Array]:
    """Points of a curve from one end to the other, each the nearest of the rest."""
    far = x - x.mean(axis=0)
    at = int(np.argmax(np.einsum("ij,ij->i", far, far)))
    left = np.ones(len(x), dtype=np.bool_)
    order, s = [at], [0.0]
    left[at] = False
    while left.any():
        apart = np.linalg.norm(x - x[at], axis=1)
        apart[~left] = np.inf
        at = int(np.argmin(apart))
        order.append(at)
        s.append(s[-1] + float(apart[at]))
        left[at] = False
    return np.array(order), np.array(s)


def _edges(s: Array) -> Array:
    """Ends of the stretches of nodes: the middles between a node and the next."""
    if len(s) == 1:
        return np.array([s[0] - 0.5, s[0] + 0.5])
    return np.concatenate([s[:1], (s[1:] + s[:-1]) / 2, s[-1:]])


def _strip(ax: Any, s: Array, status: NDArray[np.integer[Any]]) -> None:
    """A strip of zones at the bottom of the axes, below what is drawn."""
    from matplotlib.collections import PolyCollection

    low, high = ax.get_ylim()
    ax.set_ylim(low - 0.07 * (high - low), high)
    ends = _edges(s)
    corners = [[(a, 0.0), (b, 0.0), (b, 0.04), (a, 0.04)] for a, b in pairwise(ends)]
    colours = canvas.status_colours()
    strip = PolyCollection(
        corners,
        array=status.astype(float),
        cmap=colours["cmap"],
        clim=(colours["vmin"], colours["vmax"]),
        transform=ax.get_xaxis_transform(),
        lw=0,
        antialiased=False,
    )
    ax.add_collection(strip, autolim=False)
    if s[-1] > s[0]:
        ax.set_xlim(s[0], s[-1])
