"""Tables of supports, springs and loads; each number may have an amplitude."""

from typing import Annotated

from pydantic import Field

from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    Component,
    Components,
    OneOrList,
    Table,
    Triple,
    Varying,
    Vector,
)

_Stiffness = Annotated[float, Field(ge=0)]
_Stiffnesses = Annotated[list[_Stiffness], Field(min_length=2, max_length=3)]


class Prescribed(Components):
    """Displacement components prescribed on a part of a body; others stay free.

    ``on`` is a surface, a volume or a whole body. ``within`` selects nodes by ranges of
    coordinates, ``at`` only the node nearest to a position.
    """

    on: str
    within: Within | None = None
    at: Vector | None = None


class Mirror(Table):
    """A flat surface on a plane of symmetry: its nodes move only within that plane."""

    on: str


class Foundation(Table):
    """Springs on a surface, per area: a traction opposite to the displacement.

    Either ``stiffness``, one number for all directions or one for each component; or
    ``normal`` and ``tangential``, along the outward normal and across it.
    """

    on: str
    stiffness: OneOrList[_Stiffness, _Stiffnesses] | None = None
    normal: _Stiffness | None = None
    tangential: _Stiffness | None = None


class Traction(Components):
    """Force per area on a surface, or on its part ``within`` ranges of coordinates."""

    on: str
    within: Within | None = None


class Pressure(Varying):
    """Pressure on a surface, or on its part ``within`` ranges, positive inwards."""

    on: str
    within: Within | None = None


class BodyForce(Components):
    """Force per volume of a body."""

    on: str


class InitialStrain(Table):
    """Initial strain of a body or of ``"body.volume"``: the strain at which it is stress-free.

    Thermal: ``expansion`` [1/K], one number or one along each axis of the material, times
    the rise of ``temperature`` [K]. Or any ``tensor``, times ``amplitude``. In two
    dimensions a tensor of two rows has no component out of the plane.
    """

    on: str
    expansion: OneOrList[float, Triple] | None = None
    temperature: Component | None = None
    tensor: Annotated[list[Vector], Field(min_length=2, max_length=3)] | None = None
    amplitude: str | None = None

    @property
    def factor(self) -> Varying:
        """Factor of the strain of one kelvin, or of the tensor."""
        if self.temperature is not None:
            return self.temperature
        return Varying(value=1.0, amplitude=self.amplitude)
