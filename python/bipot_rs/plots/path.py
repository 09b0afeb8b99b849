"""Pictures over the load path: resultants, force over displacement, work of friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats
from bipot_rs.contact.law.contact_law import dissipation as by_pressure
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.law.resultants import is_curved, list_resultants
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.results.result import Result
from bipot_rs.files.fields import unit
from bipot_rs.plots import mpl
from bipot_rs.plots import style as canvas
from bipot_rs.plots.data import (
    Chosen,
    ContactData,
    ContactsArgument,
    contacts_of,
    names_of,
    require_model,
    selection,
    steps_of,
    surface_of,
    units_of,
)

_STYLE: canvas.LineStyle = {"marker": "o", "ms": 3, "lw": 1.5}
# A mean of normals shorter than this is rounding: the normals cancel.
_AROUND = 1e-6
# A friction limit above this multiple of the force is not drawn.
_IN_SIGHT = 4.0
# With more steps, markers would overlap.
_MARKERS = 80


def resultants(
    result: object,
    *,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Normal and tangential force over the load steps, and the limit of friction.

    The numbers are those of `Result.table`. On a flat surface the size of the tangential
    force is drawn; its limit is ``Σ μ r_n``, reached if all nodes slip in one direction. On
    a curved surface sums of components are not forces: ``Σ r_n`` and ``Σ ‖r_t‖`` are drawn,
    the latter with the limit ``Σ μ r_n``, and the force in global components on the body
    that has the contacts. Several surfaces have separate lines, each with its name.

    Parameters
    ----------
    result
        A `Result`.
    on, contacts, units, ax
        As in `tractions`. Without frames, components are added.
    """
    units = units_of(result, units)
    path, arrays = steps_of(result), contacts_of(result, contacts)
    chosen, frame, mu = _choose(path, on, arrays)
    surface = surface_of(arrays, len(path[0].status))
    reaction = path.reaction[:, chosen]
    whole = arrays.get("cohesion")
    left = np.where(path.broken, 0.0, 0.0 if whole is None else whole)[:, chosen]
    if surface is None:
        parts = [("", np.arange(reaction.shape[1]))]
    else:
        names, surface = names_of(arrays), surface[chosen]
        parts = [(names[k], np.flatnonzero(surface == k)) for k in np.unique(surface)]
    ax = canvas.axes_of(ax)
    for k, (_, members) in enumerate(parts):
        frames = None if frame is None else frame[..., members, :, :]
        coefficients = None if mu is None else mu[members]
        _of_surface(
            reaction[:, members],
            frames,
            coefficients,
            left[:, members],
            ax,
            None if len(parts) == 1 else canvas.cycle(k),
            canvas.width(k, len(parts)),
        )
    ax.axhline(0, color="black", lw=0.6)
    canvas.name_axis(ax.yaxis, "force", units.get("force"))
    if len(parts) > 1:
        curved = frame is not None and any(
            is_curved(_normals(frame[..., o, :, :])) for _, o in parts
        )
        _name_surfaces([name for name, _ in parts], ax, curved, mu is not None)
    else:
        canvas.legend_above(ax)
    return _finish(ax)


def _finish(ax: mpl.Axes) -> mpl.Axes:
    """Label an axis of load steps."""
    ax.set_xlabel("load step")
    canvas.whole_numbers(ax.xaxis)
    canvas.bare(ax)
    return ax


def _of_surface(
    reaction: Floats,
    frame: Floats | None,
    mu: Floats | None,
    cohesion: Floats,
    ax: mpl.Axes,
    colour: str | None,
    width: float,
) -> None:
    """Draw the lines of one surface; ``colour`` replaces the default colours."""
    number = np.arange(1, len(reaction) + 1)
    style = _style(len(reaction)) | {"lw": width}
    steps, n, d = reaction.shape
    frames = np.broadcast_to(np.eye(d) if frame is None else frame, (steps, n, d, d))
    group, friction = np.zeros(n, np.int64), np.zeros(n) if mu is None else mu
    totals = [
        list_resultants(r, axes, friction, group, 1, left)[0]
        for r, axes, left in zip(reaction, frames, cohesion, strict=True)
    ]
    names = ("normal", "tangential")
    if any(total.curved for total in totals):
        names = ("Σ normal", "Σ |tangential|")
        # Wide lines below the others: equal values stay visible.
        looks = (("-", 5.0, "#c9ced3"), ("-", 3.0, "#9aa5a8"), (":", 2.0, "black"))
        force = np.transpose([total.force for total in totals])
        for name, values, (ls, lw, grey) in zip("xyz", force, looks, strict=False):
            if colour is None:
                ax.plot(number, values, ls=ls, lw=lw, color=grey, label=f"force {name}")
    press = [total.normal for total in totals]
    drag = [total.tangential for total in totals]
    ax.plot(number, press, color=colour or canvas.PRESSURE, label=names[0], **style)
    # In grey the colours are alike.
    dashed = style | {"color": colour or canvas.SHEAR, "ls": "--"}
    ax.plot(number, drag, label=names[1], **dashed)
    if mu is not None:
        limit = [total.limit for total in totals]
        band = ax.fill_between(number, 0.0, limit, label="within Σ μ × normal", lw=0)
        band.set(color=colour or canvas.LIMIT, alpha=0.15)


def _name_surfaces(
    names: Sequence[str], ax: mpl.Axes, curved: bool, limited: bool
) -> None:
    whose = canvas.surface_handles(names)
    looks = (("-", "normal"), ("--", "tangential"))
    if curved:
        looks = (("-", "Σ normal"), ("--", "tangential, curved: Σ of sizes"))
    kinds: list[mpl.Artist] = [
        mpl.Line2D([], [], color="black", ls=ls, label=name) for ls, name in looks
    ]
    if limited:
        label = "within Σ μ × normal"
        kinds.append(mpl.Patch(label=label, facecolor=canvas.QUIET, alpha=0.3))
    canvas.legend_above(ax, handles=[*whose, *kinds])


def status_shares(
    result: object,
    *,
    on: ArrayLike | str | None = None,
    ax: mpl.Axes | None = None,
    contacts: ContactsArgument | None = None,
) -> mpl.Axes:
    """Fractions of the contacts that stick, slip and are open, over the load steps.

    Parameters
    ----------
    result
        A `Result`.
    on, contacts, ax
        As in `tractions`.
    """
    path = steps_of(result)
    arrays = contacts_of(path, contacts)
    status = path.status[:, selection(on, len(path[0].status), arrays)]
    ax = canvas.axes_of(ax)
    steps = len(status)
    number = np.arange(1, steps + 1)
    below = np.zeros(steps)
    for k in (2, 1, 0):
        share = np.mean(status == k, axis=1)
        ax.bar(
            number,
            share,
            0.8 if steps > 4 else 0.4,
            bottom=below,
            color=canvas.COLOURS[k],
            label=STATUS_NAMES[k],
        )
        below += share
    ax.set_ylim(0, 1)
    ax.set_xlim(0.2, steps + 0.8)
    ax.set_ylabel("share of contacts")
    canvas.legend_above(ax)
    return _finish(ax)


def force_displacement(
    result: object,
    displacement: ArrayLike | str | None = None,
    *,
    name: str | None = None,
    model: object = None,
    on: ArrayLike | str | None = None,
    contacts: ContactsArgument | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Tangential force over displacement: the hysteresis loop of friction.

    The force is the one that drives: its work along the displacement is positive. If
    ``displacement`` is that of the driven point, the area of a closed loop is the work of
    friction. If the normals are parallel, dashed lines show the limit of friction; a limit
    above four times the force is written above the axes instead. On a curved surface the
    force is the part at right angles to the mean normal, or all of it if normals cancel.

    Parameters
    ----------
    result
        A `Result`.
    displacement
        ``(steps,)``, for example the prescribed one; or the name of a surface,
        ``"body.surface"``, whose mean displacement along the force is taken; default the
        mean relative displacement of the contacts along the force, positive at first.
    name
        Label of the displacement.
    model
        As in `plot`, for the name of a surface.
    on, contacts, units, ax
        As in `resultants`.

    Raises
    ------
    TypeError, ValueError
        A wrong argument, or unknown frames; the message names them.
    """
    path, units = steps_of(result), units_of(result, units)
    arrays = contacts_of(path, contacts)
    chosen, frame, mu = _choose(path, on, arrays)
    names = names_of(arrays) if on is None else []
    said = f"sum of {len(names)} surfaces, 'on' chooses one" if len(names) > 1 else ""
    drag, limit, main = _sum_tangential(path.reaction[:, chosen], frame, mu)
    drive = -(drag @ main)
    if displacement is None:
        v = path.relative_displacement[:, chosen, 1:]
        if frame is not None:
            every = _repeat_frames(frame, path.reaction[:, chosen])
            v = np.einsum("sck,sckd->scd", v, every[:, :, 1:])
        delta = v.mean(axis=1) @ main
        name = name or "mean relative displacement"
        if drive[np.argmax(np.abs(drive) > 0.1 * np.abs(drive).max())] < 0:
            drive, delta = -drive, -delta
    else:
        if isinstance(displacement, str):
            name = name or f"displacement of {displacement}"
            displacement = _mean_displacement(path, displacement, model) @ main
        delta = floats("displacement", displacement, shape=(len(path),))
        name = name or "displacement"
        # The work of the force that drives is positive along its own displacement.
        steps = np.diff(delta, prepend=0.0)
        if np.sum((drive + np.append(0.0, drive[:-1])) * steps) < 0:
            drive = -drive
    ax = canvas.axes_of(ax)
    ax.plot(delta, drive, color=canvas.SHEAR, label="force", **_style(len(path)))
    ax.axhline(0, color="black", lw=0.6)
    if limit is not None and limit.max() <= _IN_SIGHT * np.abs(drive).max():
        dashed: canvas.LineStyle = {"ls": "--", "lw": 1, "color": canvas.LIMIT}
        # Only the limits on the sides where there is a force.
        rounding = 1e-9 * np.abs(drive).max()
        sides = [s for s in (1, -1) if (s * drive).max() > rounding]
        for side in sides:
            label = "Σ μ × normal" if side == sides[0] else ""
            ax.plot(delta, side * limit, label=label, **dashed)
        canvas.legend_above(ax, title=said)
    elif limit is not None:
        # Drawing so large a limit would make the loop too small to see.
        most = f"friction could hold up to {limit.max():.3g} {units.get('force', '')}"
        canvas.note(ax, "\n".join(filter(None, [most.strip(), said])))
    else:
        canvas.note(ax, said)
    canvas.name_axis(ax.xaxis, name, units.get("length"))
    canvas.name_axis(ax.yaxis, "tangential force", units.get("force"))
    canvas.bare(ax)
    return ax


def _mean_displacement(path: Result, surface: str, model: object) -> Floats:
    """Mean displacement of the nodes of ``"body.surface"``, ``(steps, d)``."""
    bodies = require_model(path if model is None else model)[0].numbered
    body, _, name = surface.partition(".")
    nodes = bodies[body].body.nodes(name)
    return np.asarray(path.displacement[:, bodies[body].dofs[nodes]].mean(axis=1))


def dissipation(
    result: object,
    *,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
) -> mpl.Axes:
    """Work of friction in each step, and accumulated from the beginning of the path.

    Parameters
    ----------
    result
        A `Result`.
    units, ax
        As in `tractions`.
    """
    path, units = steps_of(result), units_of(result, units)
    lost = path.dissipation
    ax = canvas.axes_of(ax)
    number = np.arange(1, len(path) + 1)
    ax.bar(number, lost, 0.8, color=canvas.LIMIT, label="in the step")
    ax.plot(
        number,
        np.cumsum(lost),
        color=canvas.PRESSURE,
        label="in all",
        **_style(len(path)),
    )
    canvas.name_axis(ax.yaxis, "work of friction", unit("energy", units))
    ax.set_xlim(0.2, len(path) + 0.8)
    canvas.legend_above(ax)
    return _finish(ax)


def _style(steps: int) -> canvas.LineStyle:
    return _STYLE if steps <= _MARKERS else _STYLE | {"marker": ""}


def _choose(
    path: Result, on: ArrayLike | str | None, data: ContactData
) -> tuple[Chosen, Floats | None, Floats | None]:
    """Contacts to draw, their frames and their friction coefficients."""
    n, d = path[0].reaction.shape
    chosen = selection(on, n, data)
    frame, mu = data.get("frame"), data.get("mu")
    if frame is not None:
        frame = floats("frame of contacts", frame, shape=(n, d, d))
        if any(step.frame is not None for step in path):
            frame = np.stack([find_step_frames(step, frame) for step in path])
        frame = frame[..., chosen, :, :]
    if mu is not None:
        mu = np.asarray(mu)[chosen]
    return chosen, frame, mu


def _normals(frame: Floats) -> Floats:
    """Normals of frames ``(n_c, d, d)`` or ``(steps, n_c, d, d)``, as rows."""
    return np.asarray(frame[..., 0, :].reshape(-1, frame.shape[-1]))


def _repeat_frames(frame: Floats, reaction: Floats) -> Floats:
    """Frames of each step, ``(steps, n_c, d, d)``."""
    d = reaction.shape[-1]
    return np.broadcast_to(frame, (*reaction.shape[:-1], d, d))


def _sum_tangential(
    reaction: Floats, frame: Floats | None, mu: Floats | None
) -> tuple[Floats, Floats | None, Floats]:
    """Tangential force, the friction limit ``(steps,)``, and the direction.

    From reactions ``(steps, n_c, d)``; no limit if normals differ. Tangential forces are
    vectors ``(steps, k)`` and their direction is a unit vector, in global components if
    frames are known, else along t1, t2.
    """
    parallel = True
    if frame is None:
        drag = reaction[..., 1:].sum(axis=1)
    else:
        force = np.einsum("sck,sckd->sd", reaction, _repeat_frames(frame, reaction))
        normals = _normals(frame)
        # Opposite normals, as of a clamp, count as parallel.
        side = np.where(normals @ normals[0] < 0, -1.0, 1.0)
        parallel = not is_curved(normals * side[:, None])
        normal = normals[0] if parallel else normals.mean(axis=0)
        length = np.linalg.norm(normal)
        # Around a hole the normals cancel: the whole force is then tangential.
        normal = normal / length if length > _AROUND else np.zeros_like(normal)
        drag = force - (force @ normal)[:, None] * normal
    main = np.linalg.svd(drag, full_matrices=False)[2][0]
    # Of the two opposite directions, take the one along the ascending axis.
    main = main * np.sign(main[np.argmax(np.abs(main))])
    limit = None
    if mu is not None and parallel:
        if mu.ndim == 2:
            # Extent of the friction ellipse along the direction of the force.
            # Of the last step, if frames change about one normal.
            tangents = np.eye(2)
            if frame is not None:
                tangents = _repeat_frames(frame, reaction)[-1, :, 1:]
            mu = by_pressure(mu, np.broadcast_to(tangents @ main, mu.shape))
        limit = reaction[..., 0] @ mu
    return drag, limit, main
