"""Tables of contacts and rigid obstacles, remote points, bolts and repetitions."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    AXES,
    MOST,
    Component,
    Components,
    OneOrList,
    Table,
    Varying,
    Vector,
    wrap,
)

_Coefficient = Annotated[float, Field(ge=0)]
_Pair = Annotated[list[_Coefficient], Field(min_length=2, max_length=2)]


class PlaneTable(Table):
    """A rigid plane; its normal points towards the body."""

    point: Vector
    normal: Vector


class Clearance(Table):
    """Addition to the gap: a height, and r²/(2 radius) around a centre."""

    # Quadratic along an edge, so that three values determine it.
    QUADRATIC: ClassVar[bool] = True

    height: float = 0.0
    radius: float | None = None
    centre: Vector | None = None

    def at(self, points: Floats) -> Floats:
        """Clearance at points ``(n_c, d)``."""
        clearance = np.full(len(points), self.height)
        if self.radius is not None:
            centre = np.zeros(points.shape[1]) if self.centre is None else self.centre
            clearance += np.sum((points - centre) ** 2, axis=1) / (2 * self.radius)
        return clearance


class Ball(Table):
    """A rigid sphere, in two dimensions a disc."""

    centre: Vector
    radius: Annotated[float, Field(gt=0)]


class Bar(Table):
    """An infinite rigid cylinder along ``axis``, in two dimensions a disc."""

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
    """A rotation by ``angle`` degrees about a point, in three dimensions about ``axis``.

    Counter-clockwise; about an axis by the right-hand rule. ``move`` also moves the
    point. Its default is the point of the plane or the cylinder, the centre of the
    sphere or the torus, and for a surface the origin.
    """

    angle: Component
    about: Vector | None = None
    axis: Vector | None = None


class Driven(Table):
    """Base of what is moved, or loaded, by components along the axes."""

    def given(self) -> dict[str, dict[int, Varying]]:
        """Components by axis, of each key that is given."""
        keys = ("move", "turn", "force", "moment")
        tables = {key: getattr(self, key, None) for key in keys}
        return {
            key: table.components()
            for key, table in tables.items()
            if isinstance(table, Components)
        }

    def varying(self) -> dict[str, Varying]:
        """Numbers that may have an amplitude, by the end of their key path."""
        return {
            f"{key}.{AXES[k]}": number
            for key, numbers in self.given().items()
            for k, number in numbers.items()
        }


class Rigid(Driven):
    """A rigid obstacle: a plane, a sphere, a cylinder, a torus, or a surface from a file.

    With ``inside`` the bodies lie inside a sphere, a bore or the tube of a torus, or on
    the other side of a surface; by default the normals of a surface point to the bodies.
    Files are those that meshio reads, such as STL; their names are relative to the scene
    file. ``move`` and ``turn`` are the total displacement and rotation, times amplitudes.
    ``force`` is the total force on the obstacle: its displacement in these directions is an
    unknown.
    """

    # The keys that define its shape.
    SHAPES: ClassVar = ("plane", "sphere", "cylinder", "torus", "surface")

    plane: PlaneTable | None = None
    sphere: Ball | None = None
    cylinder: Bar | None = None
    torus: Ring | None = None
    surface: str | None = None
    inside: bool = False
    move: Components | None = None
    turn: Turn | None = None
    force: Components | None = None

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
        """As of its base, with the angle of its turn."""
        turn = {} if self.turn is None else {"turn.angle": self.turn.angle}
        return super().varying() | turn


class Touch(Table):
    """Contact of the nodes of a surface with a rigid plane, an obstacle or another body.

    ``against`` is ``"body.surface"``, or the name of an obstacle. With ``pairing =
    "match"`` each node of one body lies opposite a node of the other. Otherwise meshes
    need not match: with ``"mortar"`` a constant pressure is transmitted exactly, with
    ``"nodes"`` nodes meet facets. Two numbers ``mu`` are friction along the tangential
    part of ``axis``, and across it. ``cohesion`` is the shear stress that a contact carries
    without pressure until it opens, ``dilatancy`` its opening per slip, at most ``mu``.
    Tables, files and ``--set`` name the contact by ``name``.
    """

    on: str
    name: str | None = None
    mu: OneOrList[_Coefficient, _Pair]
    axis: Vector | None = None
    cohesion: _Coefficient = 0.0
    dilatancy: _Coefficient = 0.0
    plane: PlaneTable | None = None
    against: str | None = None
    pairing: Literal["match", "nodes", "mortar"] = "match"
    clearance: Annotated[Clearance, wrap("height")] = Field(default_factory=Clearance)
    within: Within | None = None

    @property
    def obstacle(self) -> str | None:
        """Name of the obstacle, which has no dot; None for a plane or a body."""
        return self.against if self.against and "." not in self.against else None

    @property
    def other(self) -> str | None:
        """Surface of the other body; None for a plane or an obstacle."""
        return self.against if self.against and "." in self.against else None


class RemoteTable(Driven):
    """A part of a body that follows a point, or that a force at this point acts on.

    ``on`` is a surface, a volume or a whole body, of which ``within`` selects nodes. The
    nodes move with the point as a rigid body. Each component of its displacement and
    rotation is prescribed by ``move`` and ``turn`` (degrees about x, y, z; in two dimensions
    z), or free and loaded by ``force`` and ``moment``. With ``distributed`` the part may
    deform, and ``force`` and ``moment`` are spread over it. The default of ``point`` is the
    mean position of the nodes.
    """

    on: str
    within: Within | None = None
    point: Vector | None = None
    move: Components | None = None
    turn: Components | None = None
    force: Components | None = None
    moment: Components | None = None
    distributed: bool = False


class Tightening(Varying):
    """The force of a bolt; without an amplitude it grows from step ``first`` to ``last``."""

    first: int
    last: int

    def constant(self, ends: Floats) -> Floats:
        """Factors at the ends of steps: one at the end of ``last`` and after it."""
        return np.clip((ends - self.first + 1) / (self.last - self.first + 1), 0.0, 1.0)


class BoltTable(Table):
    """A bolt: its shank is cut at ``section``, and tightened by ``force``.

    ``section`` is a surface across the shank, ``"body.surface"``; or a body, which ``plane``
    cuts. In the load steps from ``step[0]`` to ``step[1]``, counted from 1, the force
    determines how much the shank is shortened; other steps keep the shortening. The force is
    that of the whole bolt, positive for tension; with ``half`` a plane of symmetry divides it.
    Tables name the bolt by ``name``, by default its section.
    """

    section: str
    force: Component
    step: Annotated[
        list[Annotated[int, Field(ge=1, le=MOST)]], Field(min_length=2, max_length=2)
    ]
    plane: PlaneTable | None = None
    half: bool = False
    name: str | None = None

    @property
    def title(self) -> str:
        """Name in tables."""
        return self.section if self.name is None else self.name

    @property
    def share(self) -> float:
        """Part of the bolt that is modelled."""
        return 0.5 if self.half else 1.0

    @property
    def tightening(self) -> Tightening:
        """The force along the path."""
        first, last = self.step
        return Tightening(
            value=self.force.value,
            amplitude=self.force.amplitude,
            first=first,
            last=last,
        )

    def is_tightened(self, ends: Floats) -> Bools:
        """Whether the force determines the shortening in steps with these ends."""
        return (ends > self.step[0] - 1) & (ends <= self.step[1])


class CyclicTable(Table):
    """Two cuts ``on`` and ``onto`` of one of ``sectors`` equal sectors about an axis.

    The axis goes through ``about``, by default the origin; in three dimensions its direction
    is ``axis``. Loads, contacts and obstacles repeat from sector to sector.
    """

    on: str
    onto: str
    sectors: Annotated[int, Field(ge=2, le=MOST)]
    about: Vector | None = None
    axis: Vector | None = None


class PeriodicTable(Table):
    """Two cuts ``on`` and ``onto`` of a structure that repeats itself by a translation."""

    on: str
    onto: str
