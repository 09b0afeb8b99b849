"""Tables of the load path: steps and amplitudes."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from bipot_rs.scene.schema.table import KIND, MOST, Table, no_tables, wrap


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
