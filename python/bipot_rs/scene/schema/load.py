"""Tables of supports, springs, loads and their path; each number may have an amplitude."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from bipot_rs.scene.schema.mesh import Within
from bipot_rs.scene.schema.table import (
    KIND,
    MOST,
    Component,
    Components,
    OneOrList,
    Table,
    Triple,
    Varying,
    Vector,
    no_tables,
    wrap,
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


class Amplitude(Table):
    """Factor of load step k = 0, 1, …: a table, sin(2π k/period) or (k + 1)/steps."""

    table: Annotated[list[float], Field(min_length=1)] | None = None
    wave: Literal["sine", "ramp"] | None = None
    period: Annotated[float, Field(gt=0)] | None = None


class Automatic(Table):
    """Automatic division of load steps; lengths are fractions of a load step.

    The first step has the length ``first`` (default ``largest``). A step is halved if it
    fails or a contact slips by more than ``slip`` [length]; later steps grow again up to
    ``largest``. The path fails if a step would be shorter than ``smallest``. A step ends
    at the end of each load step. The path parameter ``s`` is k + 1 at the end of load
    step k = 0, 1, ….
    """

    first: Annotated[float | None, Field(gt=0, le=1)] = None
    largest: Annotated[float, Field(gt=0, le=1)] = 1.0
    smallest: Annotated[float, Field(gt=0, le=1)] = 1e-3
    slip: Annotated[float | None, Field(gt=0)] = None


class LoadPath(Table):
    """Load steps from the unloaded state; each is one implicit increment."""

    steps: Annotated[int, Field(gt=0, le=MOST)] | None = None
    parameter: str | None = None
    automatic: Annotated[
        Annotated[bool, Tag(f"{KIND}switch")]
        | Annotated[Automatic, Tag(f"{KIND}table")],
        Discriminator(lambda v: KIND + ("switch" if isinstance(v, bool) else "table")),
    ] = False
    amplitude: dict[str, Annotated[Amplitude, wrap("table")]] = Field(
        default_factory=no_tables
    )

    @property
    def increments(self) -> Automatic | None:
        """Automatic division of load steps; None without it."""
        if self.automatic is True:
            return Automatic()
        return self.automatic or None

    def count(self) -> int:
        """Number of load steps: ``steps``, else the length of the tables, else one."""
        lengths = [len(a.table) for a in self.amplitude.values() if a.table]
        return self.steps or max(lengths, default=1)


# Cycles: a larger number is a typing error.
_MOST_CYCLES = 1_000_000_000


class WearTable(Table):
    """Archard wear: the last ``steps`` load steps are a cycle, repeated ``cycles`` times.

    In each load step the depth ``coefficient`` × pressure × slip is worn off; the unit of
    ``coefficient`` is 1/stress. Load steps before the cycle are solved once, without wear.
    By default all load steps are the cycle. With ``jump`` cycles are jumped over, so that
    the depth has an error of about ``rtol``, relative to the largest depth.
    """

    coefficient: Annotated[float, Field(ge=0)]
    cycles: Annotated[int, Field(gt=0, le=_MOST_CYCLES)]
    steps: Annotated[int | None, Field(gt=0)] = None
    jump: bool = True
    rtol: Annotated[float, Field(gt=0, lt=1)] = 0.01
