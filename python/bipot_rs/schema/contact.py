"""What bodies meet, and the friction there."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Discriminator, Field, Tag

from bipot_rs.schema.mesh import Within
from bipot_rs.schema.table import KIND, Floats, Table, Vector, wrap

_Coefficient = Annotated[float, Field(ge=0)]
_Pair = Annotated[list[_Coefficient], Field(min_length=2, max_length=2)]


Friction = Annotated[
    Annotated[_Coefficient, Tag(f"{KIND}number")]
    | Annotated[_Pair, Tag(f"{KIND}pair")],
    Discriminator(lambda v: KIND + ("pair" if isinstance(v, list) else "number")),
]


class Plane(Table):
    """A rigid plane; the normal points to the body."""

    point: Vector
    normal: Vector


class Clearance(Table):
    """What is added to the gap: a height, and r²/(2 radius) around a centre."""

    # Along an edge three values tell it.
    QUADRATIC: ClassVar[bool] = True

    height: float = 0.0
    radius: float | None = None
    centre: Vector | None = None

    def at(self, points: Floats) -> Floats:
        """Clearance at places ``(n_c, d)``."""
        clearance = np.full(len(points), self.height)
        if self.radius is not None:
            centre = np.zeros(points.shape[1]) if self.centre is None else self.centre
            clearance += np.sum((points - centre) ** 2, axis=1) / (2 * self.radius)
        return clearance


class Touch(Table):
    """Nodes of a surface that may meet a rigid plane or another body.

    Two numbers ``mu`` are friction along ``axis``, made tangential, and across it.
    """

    on: str
    mu: Friction
    axis: Vector | None = None
    plane: Plane | None = None
    against: str | None = None
    clearance: Annotated[Clearance, wrap("height")] = Field(default_factory=Clearance)
    within: Within | None = None
