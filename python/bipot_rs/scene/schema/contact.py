"""What bodies meet, and the friction there."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from bipot_rs._lib.types import Floats
from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    KIND,
    Component,
    Components,
    Table,
    Varying,
    Vector,
    wrap,
)

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


class Ball(Table):
    """A rigid ball, in the plane a disc."""

    centre: Vector
    radius: Annotated[float, Field(gt=0)]


class Bar(Table):
    """An endless rigid round bar, in the plane a disc; ``axis`` is its direction."""

    point: Vector
    radius: Annotated[float, Field(gt=0)]
    axis: Vector | None = None


class Ring(Table):
    """A rigid torus about ``axis``, in three dimensions."""

    centre: Vector
    axis: Vector
    major_radius: Annotated[float, Field(gt=0)]
    minor_radius: Annotated[float, Field(gt=0)]


class Turn(Table):
    """A rotation by ``angle`` degrees about a point, in space about ``axis`` there.

    Counter-clockwise, by the right hand about the axis. The point is carried along by
    ``move``; if not given, it is that of the plane or the cylinder, the centre of the
    sphere or the torus, and of a surface the origin.
    """

    angle: Component
    about: Vector | None = None
    axis: Vector | None = None


class Rigid(Table):
    """A rigid obstacle: a plane, a sphere, a cylinder, a torus, or a surface from a file.

    With ``inside`` bodies are within a sphere, a bore or the tube of a torus, or on the
    other side of a surface, whose normals point to the bodies. Files are those that
    meshio reads, such as STL, relative to the scene file. ``move`` displaces it along
    the load path, totals times amplitudes, and ``turn`` turns it.
    """

    plane: Plane | None = None
    sphere: Ball | None = None
    cylinder: Bar | None = None
    torus: Ring | None = None
    surface: str | None = None
    inside: bool = False
    move: Components | None = None
    turn: Turn | None = None

    @property
    def centre(self) -> list[float] | None:
        """The point that it turns about by default; None for the surface of a file."""
        if self.plane is not None:
            return self.plane.point
        if self.cylinder is not None:
            return self.cylinder.point
        round_one = self.sphere or self.torus
        return None if round_one is None else round_one.centre

    def varying(self) -> dict[str, Varying]:
        """Its numbers that may have an amplitude, by the ends of their places."""
        found = {}
        if self.move is not None:
            letters = "xyz"
            found = {f"move.{letters[k]}": v for k, v in self.move.components().items()}
        if self.turn is not None:
            found["turn.angle"] = self.turn.angle
        return found


class Touch(Table):
    """Nodes of a surface that may meet a rigid plane, an obstacle or another body.

    ``against`` is ``"body.surface"``, or the name of an obstacle. Of two bodies nodes lie
    opposite one to one with ``pairing = "match"``; with ``"mortar"`` meshes need not
    match, and each facet passes its pressure exactly, with ``"nodes"`` nodes meet facets.
    Two numbers ``mu`` are friction along ``axis``, made tangential, and across it.
    """

    on: str
    mu: Friction
    axis: Vector | None = None
    plane: Plane | None = None
    against: str | None = None
    pairing: Literal["match", "nodes", "mortar"] = "match"
    clearance: Annotated[Clearance, wrap("height")] = Field(default_factory=Clearance)
    within: Within | None = None

    @property
    def obstacle(self) -> str | None:
        """Name of the obstacle it may meet: one without a dot."""
        return self.against if self.against and "." not in self.against else None

    @property
    def other(self) -> str | None:
        """The surface of another body that it may meet."""
        return self.against if self.against and "." in self.against else None
