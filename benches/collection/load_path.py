"""`LoadPath`: the arrays of a load path of the collection, and histories of loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.path.moving_gaps import MovingGaps


@dataclass(frozen=True)
class Proof:
    """Why the last step of a path has no solution.

    Attributes
    ----------
    motion
        Rigid motion ``(n,)`` of all degrees of freedom. It lies inside the dual cone of
        every contact, and the loads do positive work on it.
    forces
        Normal reactions ``(n_c,)`` that move nothing. They do negative work on ``q``, but
        without penetration no such work is negative.
    """

    motion: Floats | None = None
    forces: Floats | None = None


@dataclass(frozen=True)
class LoadPath:
    """A problem in all degrees of freedom and the loads of its steps.

    Attributes
    ----------
    K, B, gap, mu, fixed
        As in `ContactProblem`.
    load, prescribed, gaps
        Totals of each step: ``(steps, n)``, ``(steps, len(fixed))``, and
        ``(steps, n_c[, d])``, `MovingGaps` or None, as in `ContactProblem.solve`.
    frame
        Frames of B ``(n_c, d, d)``, which moving gaps refer to.
    form
        Form of the files: ``"local"``, or ``"global"`` where a dense W would be too large.
    redundant
        Whether reactions are not unique, so that the reference determines u alone.
    several
        Whether all answers of each step are searched.
    proof
        Why the last step has no solution, or None if it has one.
    """

    K: Any
    B: Any
    gap: Floats
    mu: Floats
    load: Floats
    prescribed: Floats
    fixed: Ints
    gaps: Floats | MovingGaps | None = None
    frame: Floats | None = None
    form: Literal["local", "global"] = "local"
    redundant: bool = False
    several: bool = False
    proof: Proof | None = None

    @property
    def steps(self) -> int:
        """Number of load steps."""
        return len(self.load)

    def gap_of(self, step: int) -> Floats:
        """Gaps by component ``(n_c, d)`` in a step, in its frames."""
        gap = self.gap if self.gaps is None else self.gaps[step]
        if isinstance(gap, MovingGaps):
            return gap.by_component
        if gap.ndim == 2:
            return gap
        whole = np.zeros((len(gap), self.B.shape[0] // len(gap)))
        whole[:, 0] = gap
        return whole


def legs(corners: Sequence[ArrayLike], per: int = 1) -> Floats:
    """Straight legs from zero through corners, ``per`` steps each: ``(steps, k)``."""
    ends = np.asarray(corners, np.float64)
    starts = np.vstack([np.zeros_like(ends[:1]), ends[:-1]])
    part = np.arange(1, per + 1)[:, None] / per
    way = starts[:, None] + part * (ends - starts)[:, None]
    return way.reshape(-1, ends.shape[1])


def press_and_shear(d: int, depth: float, shear: float, per: int = 1) -> Floats:
    """Motion ``(steps, d)`` down by ``depth``, then along x by ``shear``."""
    down, along = np.zeros((2, d))
    down[-1] = along[-1] = -depth
    along[0] = shear
    return legs([down, along], per)


def cycles(d: int, depth: float, shear: float, count: int, per: int = 1) -> Floats:
    """Press, then shear to and fro ``count`` times; a cycle has ``4 per`` steps.

    Each cycle is a twentieth larger: after equal cycles, contacts would be exactly at the
    friction limit, and their status arbitrary.
    """
    down = np.zeros(d)
    down[-1] = -depth
    turn = []
    for k in range(count):
        along = shear * (1 + 0.05 * k) * np.eye(d)[0]
        turn += [down + along, down, down - along, down]
    return np.vstack([down[None], _after(down, turn, per)])


def release(d: int, depth: float, shear: float, per: int = 1) -> Floats:
    """Press, shear, unload by half, lift off, and press again at another place."""
    up, along = np.eye(d)[-1], shear * np.eye(d)[0]
    down = -depth * up
    corners = [
        down,
        down + along,
        down / 2 + along,
        # Not by half the depth: halfway there, a flat contact would exactly touch.
        0.7 * depth * up + along,
        0.7 * depth * up - along,
        down - along,
    ]
    return legs(corners, per)


def turning(depth: float, shear: float, steps: int) -> Floats:
    """Press, then shear in a direction that turns once: ``(steps + 1, 3)``."""
    angle = 2 * np.pi * np.arange(steps) / steps
    way = np.c_[shear * np.cos(angle), shear * np.sin(angle), np.full(steps, -depth)]
    return np.vstack([[0.0, 0.0, -depth], way])


def _after(start: Floats, corners: Sequence[Floats], per: int) -> Floats:
    return legs([corner - start for corner in corners], per) + start
