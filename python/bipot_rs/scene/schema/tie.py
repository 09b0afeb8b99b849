"""Tables of remote points, bolts, cyclic symmetries and periodicities."""

from typing import Annotated

import numpy as np
from pydantic import Field

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.scene.schema.contact import PlaneTable
from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    AXES,
    MOST,
    Component,
    Components,
    Table,
    Varying,
    Vector,
)


class RemoteTable(Table):
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

    def given(self) -> dict[str, dict[int, Varying]]:
        """Components by axis, of each key that is given."""
        keys = ("move", "turn", "force", "moment")
        tables = {key: getattr(self, key) for key in keys}
        return {k: t.components() for k, t in tables.items() if t is not None}

    def varying(self) -> dict[str, Varying]:
        """Numbers that may have an amplitude, by the end of their key path."""
        return {
            f"{key}.{AXES[k]}": number
            for key, numbers in self.given().items()
            for k, number in numbers.items()
        }


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
