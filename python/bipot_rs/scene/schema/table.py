"""Base class and types of all tables of a scene."""

import re
from collections.abc import Sequence
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag

from bipot_rs._lib.types import Floats

AXES = ("x", "y", "z")
# Cells along an axis, and load steps: a larger number is a typing error.
MOST = 1_000_000
# Products of a few lengths, moduli and forces beyond this, or below its inverse, would
# overflow or underflow. No system of units needs such numbers.
LARGEST = 1e60
# Names that stand in keys of ``--set`` and in formulas.
NAME = re.compile(r"[^\W\d][\w-]*")


class Table(BaseModel):
    """A table without unknown keys."""

    # Strict: a number in quotes, or `true` for 1, is a typing error.
    # Built at the first use, as one: each table by itself would build its parts again.
    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        populate_by_name=True,
        defer_build=True,
    )


def wrap(key: str) -> BeforeValidator:
    """Accept a plain value in place of a table with the one key ``key``."""
    return BeforeValidator(lambda v: v if isinstance(v, dict | BaseModel) else {key: v})


Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]

# Names of the members of a union begin with this. Key paths of messages leave them out.
KIND = "|"
One = TypeVar("One")
Several = TypeVar("Several")
OneOrList: TypeAlias = Annotated[
    Annotated[One, Tag(f"{KIND}one")] | Annotated[Several, Tag(f"{KIND}list")],
    Discriminator(lambda v: KIND + ("list" if isinstance(v, list) else "one")),
]


class Varying(Table):
    """A number times an amplitude; constant from the first load step on without one."""

    value: float
    amplitude: str | None = None

    def constant(self, ends: Floats) -> Floats:
        """Factors at the ends of steps without an amplitude."""
        return np.minimum(ends, 1.0)


Component = Annotated[Varying, wrap("value")]


class Components(Table):
    """A vector; some of its components may be missing."""

    x: Component | None = None
    y: Component | None = None
    z: Component | None = None

    def components(self) -> dict[int, Varying]:
        """Given components by axis."""
        components = (self.x, self.y, self.z)
        return {k: v for k, v in enumerate(components) if v is not None}


def no_entries() -> list[One]:
    """The default of a list. Pydantic reads this signature ten times faster than `list`'s."""
    return []


def no_tables() -> dict[str, One]:
    """The default of tables by name; see `no_entries`."""
    return {}


def key_path(loc: Sequence[str | int], table: object) -> list[str]:
    """Key path of an error of pydantic, as written in ``table``.

    `wrap` puts some plain values into a table with one key; that key is left out.
    """
    path, at = [], table
    for part in loc:
        if isinstance(at, dict) and part in at:
            at = at[part]
        elif isinstance(part, str) and part.startswith(KIND):
            continue
        elif isinstance(at, dict):
            at = None
        elif isinstance(at, list) and isinstance(part, int):
            at = at[part] if part < len(at) else None
        elif at is not None:
            continue
        path.append(str(part))
    return path
