"""The load path: its steps and amplitudes."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from bipot_rs._lib.types import Floats
from bipot_rs.scene.schema.table import KIND, MOST, Table, wrap


class Amplitude(Table):
    """Factor of each load step k = 0, 1, …: a table, sin(2π k/period), (k + 1)/steps."""

    table: Annotated[list[float], Field(min_length=1)] | None = None
    wave: Literal["sine", "ramp"] | None = None
    period: Annotated[float, Field(gt=0)] | None = None

    def values(self, steps: int) -> Floats:
        """Factors ``(steps,)``."""
        if self.table is not None:
            return np.array(self.table)
        if self.wave == "ramp":
            return np.arange(1.0, steps + 1) / steps
        turns = np.arange(steps) / (self.period or 1.0)
        factors: Floats = np.sin(2 * np.pi * turns)
        return factors

    def at(self, t: Floats, steps: int) -> Floats:
        """Factors at places ``t`` from 0 to ``steps``, load step k ending at k + 1.

        In between tables are linear and waves what they are; the first load step goes
        linearly from zero, for the bodies are unloaded before it.
        """
        known = np.concatenate([[0.0], self.values(steps)])
        whole = np.floor(t).astype(np.int64)
        share = t - whole
        before, after = known[whole], known[np.minimum(whole + 1, steps)]
        between = (1 - share) * before + share * after
        if self.wave == "ramp":
            between = t / steps
        elif self.wave == "sine":
            turns = (t - 1) / (self.period or 1.0)
            between = np.where(whole > 0, np.sin(2 * np.pi * turns), between)
        # At the ends of load steps the very bits of `values`.
        found: Floats = np.where(share == 0, before, between)
        return found


class Automatic(Table):
    """How a load step is divided, in fractions of it.

    Steps start with ``first`` (``largest`` if not given), are halved where they fail or
    slip by more than ``slip`` [length], grow up to ``largest`` again, and are given up
    below ``smallest``. Each load step is met at its end. Steps are told by ``s``, where
    load step k, from 0, ends at k + 1.
    """

    first: Annotated[float | None, Field(gt=0, le=1)] = None
    largest: Annotated[float, Field(gt=0, le=1)] = 1.0
    smallest: Annotated[float, Field(gt=0, le=1)] = 1e-3
    slip: Annotated[float | None, Field(gt=0)] = None


class LoadPath(Table):
    """Load steps, from the unloaded state; each is one implicit increment."""

    steps: Annotated[int, Field(gt=0, le=MOST)] | None = None
    parameter: str | None = None
    automatic: Annotated[
        Annotated[bool, Tag(f"{KIND}switch")]
        | Annotated[Automatic, Tag(f"{KIND}table")],
        Discriminator(lambda v: KIND + ("switch" if isinstance(v, bool) else "table")),
    ] = False
    amplitude: dict[str, Annotated[Amplitude, wrap("table")]] = Field(
        default_factory=dict
    )

    @property
    def increments(self) -> Automatic | None:
        """How load steps are divided; None where they are taken as they are."""
        if self.automatic is True:
            return Automatic()
        return self.automatic or None

    def count(self) -> int:
        """Load steps: as given, or the length of the tables, or one."""
        lengths = [len(a.table) for a in self.amplitude.values() if a.table]
        return self.steps or max(lengths, default=1)
