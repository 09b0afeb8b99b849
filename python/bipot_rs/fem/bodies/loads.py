"""Loads by description, whose derivatives with respect to parameters are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, number
from bipot_rs.fem.bodies.body import Body, Box, Field
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.fem.bodies.stress_recovery import Initial, initial_forces

_KINDS = ("traction", "pressure", "force", "strain")


@dataclass(frozen=True)
class Load:
    """One load of a body, in proportion to a factor of each load step.

    Give exactly one of ``traction``, ``pressure``, ``force`` and ``strain``.

    Parameters
    ----------
    body
        Name of the body.
    surface
        Name of the surface of a traction or a pressure.
    traction, pressure, force, strain
        As ``value`` of `Assembly.traction`, `Assembly.pressure` and
        `Assembly.body_force`, and ``strain`` of `Assembly.initial_strain`.
    factors
        Multiplies the load in each step, ``(steps,)``; a number for all steps.
    within
        Ranges of coordinates by axis, such as ``{0: (0.0, 1.0)}``: the part of the surface
        that a traction or a pressure loads, also a part of a facet.
    """

    body: str
    surface: str | None = None
    traction: Field | None = None
    pressure: float | None = None
    force: Field | None = None
    strain: Initial | None = None
    factors: ArrayLike = 1.0
    within: Box | None = None

    def __post_init__(self) -> None:
        kinds_given = [name for name in _KINDS if getattr(self, name) is not None]
        if len(kinds_given) != 1:
            raise ValueError(
                f"load of body {self.body!r} has {' and '.join(kinds_given) or 'no value'}, "
                "expected exactly one of traction, pressure, force and strain"
            )
        (kind,) = kinds_given
        if (self.surface is None) == (kind in ("traction", "pressure")):
            raise ValueError(
                f"load of body {self.body!r} is a {kind}, and surface is "
                f"{self.surface!r}: a traction or a pressure needs a surface, others none"
            )
        if self.within is not None and self.surface is None:
            raise ValueError(
                f"load of body {self.body!r} is a {kind} and has within: only a traction or a "
                "pressure has"
            )
        if self.pressure is not None:
            number("pressure", self.pressure)
        floats(f"factors of the load of body {self.body!r}", self.factors)

    @property
    def kind(self) -> str:
        """``"traction"``, ``"pressure"``, ``"force"`` or ``"strain"``."""
        return next(name for name in _KINDS if getattr(self, name) is not None)

    def of_steps(self, steps: int) -> Floats:
        """The factor of each step, ``(steps,)``; `ValueError` for another number."""
        factors = floats(f"factors of the load of body {self.body!r}", self.factors)
        if factors.shape not in ((), (steps,)):
            raise ValueError(
                f"factors of the load of body {self.body!r} has shape {factors.shape}, "
                f"expected a number or ({steps},)"
            )
        return np.broadcast_to(factors, (steps,))

    def forces(self, body: Body) -> Floats:
        """Nodal forces ``(dim * nodes,)`` of the body for a factor of 1 [N]."""
        if self.strain is not None:
            return initial_forces(body, self.strain)
        if self.force is not None:
            return nodal_forces(body, body.volume(), self.force)
        forces = np.zeros(body.points.size)
        for points in body.surface_parts(str(self.surface), self.within):
            value = self.traction
            if value is None:
                value = -float(self.pressure or 0.0) * np.asarray(points.normals)
            forces += nodal_forces(body, points, value)
        return forces

    def area(self, body: Body) -> float:
        """Area that a traction or a pressure loads [m²]; in 2D times the thickness."""
        parts = body.surface_parts(str(self.surface), self.within)
        return body.depth * float(sum(points.weights.sum() for points in parts))


@dataclass(frozen=True)
class PointLoad:
    """A force and a moment at the reference point of an obstacle or a remote.

    ``name``: a floating obstacle, which takes no moment, or a remote.
    ``force, moment``: ``(d,)`` [N], and about the point ``(3,)``, in the plane a number [N m].
    """

    name: str
    force: ArrayLike | None = None
    moment: ArrayLike | None = None
