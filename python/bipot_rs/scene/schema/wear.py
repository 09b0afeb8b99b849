"""Table of wear: a load path that is repeated."""

from typing import Annotated

from pydantic import Field

from bipot_rs.scene.schema.table import Table

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
