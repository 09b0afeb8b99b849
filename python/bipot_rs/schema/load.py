"""What moves bodies: supports and loads, each times an amplitude of the path."""

from __future__ import annotations

from bipot_rs.schema.mesh import Within
from bipot_rs.schema.table import Components, Table


class Prescribed(Components):
    """Displacement components prescribed on a surface; others stay free."""

    on: str
    within: Within | None = None


class Traction(Components):
    """Force per area on a surface."""

    on: str


class Pressure(Table):
    """Pressure on a surface, positive inwards."""

    on: str
    value: float
    amplitude: str | None = None


class BodyForce(Components):
    """Force per volume of a body."""

    on: str
