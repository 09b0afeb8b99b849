"""What all tables of a scene share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

AXES = ("x", "y", "z")
# Cells along an axis, and load steps: more are a slip of the pen.
MOST = 1_000_000
# Lengths, moduli and forces beyond this, or below its inverse, overflow when a few of
# them are multiplied; in no system of units are there such.
LARGEST = 1e60


class Table(BaseModel):
    """A table that knows all of its keys."""

    # Strict: a number in quotes, or `true` for 1, is a slip of the pen.
    model_config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True
    )


def wrap(key: str) -> BeforeValidator:
    """Let a plain value stand for a table with one key."""
    return BeforeValidator(lambda v: v if isinstance(v, dict | BaseModel) else {key: v})


Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]


# What a union calls its kinds is no part of a place in the file: it begins with this.
KIND = "|"


class Varying(Table):
    """A number times an amplitude; without one, the same in every load step."""

    value: float
    amplitude: str | None = None


Component = Annotated[Varying, wrap("value")]


class Components(Table):
    """A vector, of which some components are given."""

    x: Component | None = None
    y: Component | None = None
    z: Component | None = None

    def components(self) -> dict[int, Varying]:
        """Those given, by axis."""
        given = (self.x, self.y, self.z)
        return {k: v for k, v in enumerate(given) if v is not None}
