"""Pictures by name, as on the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.messages import meant
from bipot_rs._lib.types import Record
from bipot_rs.contact.results.result import Result
from bipot_rs.plots.body import deformed
from bipot_rs.plots.data import look, model_of
from bipot_rs.plots.line import tractions
from bipot_rs.plots.path import (
    dissipation,
    force_displacement,
    resultants,
    status_shares,
)
from bipot_rs.plots.space import surface3d
from bipot_rs.plots.surface import QUANTITIES, is_plane, slip, status_map, surface_map
from bipot_rs.plots.wear import both

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Quantities of flat maps that have no function of their own.
_MAPS = ("pressure", "shear", "gap")


@dataclass(frozen=True)
class Picture:
    """A picture with a name."""

    draw: Callable[..., Axes]  # the function
    bodies: bool = False  # whether it takes the model before the result
    quantity: str | None = None  # the quantity that it draws, if it can draw several

    def takes(self, name: str) -> bool:
        """Whether the function has an argument of that name."""
        return name in signature(self.draw).parameters

    def __call__(self, result: object, model: object = None, **options: object) -> Axes:
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
    | {"wear": Picture(both)}
)


def plot(
    result: object, kind: str | None = None, *, model: object = None, **options: object
) -> Axes:
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
    name = _usual(result, options) if kind is None else kind
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


def _usual(result: object, options: Record) -> str:
    """The picture of a result if none is named."""
    choices = {k: options[k] for k in ("step", "contacts", "on") if k in options}
    path = result if isinstance(result, Result) else None
    if path is not None and len(path) and path[-1].reaction.shape[1] == 2:
        return "tractions"
    seen = look(result, **choices)
    if seen.x.shape[1] == 2:
        return "tractions"
    return "pressure_map" if is_plane(seen) and np.ptp(seen.x) > 0 else "pressure_3d"
