"""Pictures by name, as on the command line, of one load step or as a GIF of several."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import meant
from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import Floats, Record
from bipot_rs._lib.validation import integers, number
from bipot_rs.contact.results.result import Result
from bipot_rs.files.drafts import aside
from bipot_rs.plots import mpl
from bipot_rs.plots.body import deformed, usual_scale
from bipot_rs.plots.data import look, model_of, steps_of
from bipot_rs.plots.line import pressure_and_wear, tractions
from bipot_rs.plots.path import (
    dissipation,
    force_displacement,
    resultants,
    status_shares,
)
from bipot_rs.plots.space import surface3d
from bipot_rs.plots.style import figure_of
from bipot_rs.plots.surface import QUANTITIES, is_plane, slip, status_map, surface_map

# Quantities of flat maps that have no function of their own.
_MAPS = ("pressure", "shear", "gap")


@dataclass(frozen=True)
class Picture:
    """A picture with a name."""

    draw: Callable[..., mpl.Axes]  # the function
    bodies: bool = False  # whether it takes the model before the result
    quantity: str | None = None  # the quantity that it draws, if it can draw several

    def takes(self, name: str) -> bool:
        """Whether the function has an argument of that name."""
        return name in signature(self.draw).parameters

    def __call__(
        self, result: object, model: object = None, **options: object
    ) -> mpl.Axes:
        """Draw the result, on its model if that is known."""
        drawn = [model, result] if self.bodies and model is not None else [result]
        if not self.bodies and model is not None and self.takes("model"):
            options = {"model": model} | options
        if self.quantity is not None:
            options = {"quantity": self.quantity} | options
        return self.draw(*drawn, **options)


KINDS: Mapping[str, Picture] = (
    {
        function.__name__: Picture(function)
        for function in (
            tractions,
            slip,
            status_map,
            resultants,
            status_shares,
            force_displacement,
            dissipation,
        )
    }
    | {"deformed": Picture(deformed, bodies=True)}
    | {f"{name}_map": Picture(surface_map, quantity=name) for name in _MAPS}
    | {
        f"{name}_3d": Picture(surface3d, bodies=True, quantity=name)
        for name in (*QUANTITIES, "status")
    }
    | {"wear": Picture(pressure_and_wear)}
)


def plot(
    result: object, kind: str | None = None, *, model: object = None, **options: object
) -> mpl.Axes:
    """Draw a picture by its name.

    Parameters
    ----------
    result
        As in `tractions`.
    kind
        ``"tractions"``, ``"slip"``, ``"status_map"``, ``"resultants"``,
        ``"status_shares"``, ``"force_displacement"``, ``"dissipation"``, ``"deformed"``,
        ``"wear"``; in 3D also ``"pressure_map"``, ``"shear_map"``, ``"gap_map"``, and
        ``"pressure_3d"``, ``"shear_3d"``, ``"gap_3d"``, ``"slip_3d"``, ``"status_3d"``.
        Default: ``"tractions"`` in 2D, in 3D ``"pressure_map"``, or ``"pressure_3d"`` if
        the surface is not flat.
    model
        The bodies, for ``"deformed"`` and outlines in 3D; not needed for a `ModelResult`.
    options
        Arguments of the function of the picture.
    """
    picture, bodies = chosen(result, kind, model, options)
    return picture(result, bodies, **options)


def chosen(
    result: object, kind: str | None, model: object, options: Mapping[str, object]
) -> tuple[Picture, object]:
    """The picture of a name, and the model of the result; errors name what is wrong."""
    name = _choose_picture(result, options) if kind is None else kind
    if name not in KINDS:
        raise ValueError(
            f"kind is {name!r}, expected one of {', '.join(KINDS)}{meant(name, KINDS)}"
        )
    picture = KINDS[name]
    for option in options:
        if not picture.takes(option):
            expected = list(signature(picture.draw).parameters)[1:]
            raise TypeError(
                f"{option} is no argument of the picture {name!r}, expected some of "
                f"{', '.join(expected)}{meant(option, expected)}"
            )
    if model is None:
        model, _ = model_of(result)
    if model is None and picture.draw is deformed:
        raise ValueError(
            "the mesh of the result is not known: pass model=, the Model or the "
            "fem.Assembly that was solved"
        )
    return picture, model


def _choose_picture(result: object, options: Record) -> str:
    """The picture of a result if none is named."""
    choices = {k: options[k] for k in ("step", "contacts", "on") if k in options}
    path = result if isinstance(result, Result) else None
    if path is not None and len(path) and path[-1].reaction.shape[1] == 2:
        return "tractions"
    seen = look(result, **choices)
    if seen.x.shape[1] == 2:
        return "tractions"
    return "pressure_map" if is_plane(seen) and np.ptp(seen.x) > 0 else "pressure_3d"


# Margin of values along a line above and below, as matplotlib has it.
_MARGIN = 0.05


def animate(
    result: object,
    path: str | os.PathLike[str],
    kind: str | None = None,
    *,
    steps: ArrayLike | None = None,
    frames_per_second: float = 4.0,
    dpi: float = 100.0,
    model: object = None,
    **options: object,
) -> Path:
    """Write a GIF that shows a picture of each load step.

    All frames have the same axes, colours, arrow lengths and factor of the displacements:
    those that show the values of all steps. The options ``limits``, ``scale``, ``box`` and
    ``largest_force`` of a picture replace them.

    Parameters
    ----------
    result
        A `Result`.
    path
        File to write or to replace, ``NAME.gif``.
    kind, model, options
        As in `plot`, of a picture that shows one step.
    steps
        Numbers of the load steps to show, from 0; default all.
    frames_per_second, dpi
        Speed, and pixels by inch: a picture is about 5 inches wide.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ModuleNotFoundError
        matplotlib is not installed.
    OSError
        The file cannot be written. An earlier file of that name is intact.
    """
    target = Path(path)
    if target.suffix.lower() != ".gif":
        raise ValueError(f"path is {os.fspath(path)!r}, expected a name NAME.gif")
    for name, value in (("frames_per_second", frames_per_second), ("dpi", dpi)):
        if not number(name, value) > 0:
            raise ValueError(f"{name} is {value}, expected a positive number")
    load_library("matplotlib", extra="cli", need="pictures")
    path_of_steps = steps_of(result)
    numbers = _numbers(path_of_steps, steps)
    for name in ("step", "ax"):
        if name in options:
            raise TypeError(f"{name} cannot be given for an animation")
    picture, bodies = chosen(result, kind, model, options)
    if not picture.takes("step"):
        able = ", ".join(
            name for name, picture in KINDS.items() if picture.takes("step")
        )
        raise ValueError(
            f"kind is {kind!r}, a picture of all load steps, expected one of {able}"
        )
    options = _common(picture, path_of_steps, bodies, numbers, options) | options
    _write(
        target, picture, path_of_steps, bodies, numbers, options, frames_per_second, dpi
    )
    return target


def _numbers(path: Result, steps: ArrayLike | None) -> list[int]:
    if steps is None:
        return list(range(len(path)))
    chosen = np.atleast_1d(integers("steps", steps))
    if not chosen.size:
        raise ValueError("steps is empty, expected numbers of load steps")
    wrong = (chosen < 0) | (chosen >= len(path))
    if wrong.any():
        raise ValueError(f"steps has {chosen[wrong][0]}, expected 0 to {len(path) - 1}")
    return [int(k) for k in chosen.ravel()]


def _common(
    picture: Picture,
    result: Result,
    model: object,
    numbers: list[int],
    options: dict[str, object],
) -> dict[str, object]:
    """The options that give all frames the same scales."""
    of_body = picture.draw is deformed
    common: dict[str, object] = {}
    if of_body:
        largest = max(
            float(np.linalg.norm(result[k].reaction, axis=1).max(initial=0.0))
            for k in numbers
        )
        common["scale"] = usual_scale(model, [result[k] for k in numbers])
        if largest > 0:
            common["largest_force"] = largest
    if picture.takes("limits") and options.get("limits") is None:
        ranges, boxes = [], []
        for k in numbers:
            ax = picture(result, model, step=k, **(common | options))
            ranges += _find_ranges(ax)
            boxes.append(_corners(ax))
        low, high = np.array(ranges).T if ranges else (np.zeros(1), np.zeros(1))
        if low.min() < high.max():
            common["limits"] = float(low.min()), float(high.max())
        if of_body and not options.keys() & {"near", "box"}:
            corners = np.array(boxes)
            common["box"] = [corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)]
    return common


def _find_ranges(ax: mpl.Axes) -> list[tuple[float, float]]:
    """Ranges of the values in a picture: of its colours, else of its lines."""
    bars = [it for it in ax.collections if it.colorbar is not None]
    if bars:
        return [it.get_clim() for it in bars]
    low, high = ax.dataLim.intervaly
    if ax.get_aspect() != "auto" or not low < high:
        # A map without a bar, of a quantity that is zero in this step.
        return []
    margin = _MARGIN * (high - low)
    return [(low - margin, high + margin)]


def _corners(ax: mpl.Axes) -> tuple[Floats, Floats]:
    """Lower and upper corner of what axes show."""
    names = "xyz" if ax.name == "3d" else "xy"
    low, high = np.array([getattr(ax, f"get_{name}lim")() for name in names]).T
    return low, high


def _write(
    target: Path,
    picture: Picture,
    result: Result,
    model: object,
    numbers: list[int],
    options: dict[str, object],
    rate: float,
    dpi: float,
) -> None:
    writer = mpl.PillowWriter(fps=rate)  # type: ignore[arg-type]
    with aside(target) as draft:
        for first, k in enumerate(numbers):
            figure = figure_of(picture(result, model, step=k, **options))
            if first == 0:
                writer.setup(figure, draft, dpi=dpi)
            writer.fig = figure
            writer.grab_frame()
        writer.finish()
