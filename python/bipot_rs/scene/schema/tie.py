"""Tables of remote points, cyclic symmetries and periodicities."""

from typing import Annotated

from pydantic import Field

from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    AXES,
    MOST,
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
