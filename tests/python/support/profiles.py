"""Tractions over a contact compared with a closed form, and tables of refinement."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases.verification import Refinement

Array = NDArray[np.float64]


class Profile(NamedTuple):
    """Tractions (n_c, d) at distances x from the axis, computed and expected."""

    x: Array
    area: Array
    traction: Array
    expected: Array

    def error(self, component: int) -> float:
        """Root mean square over the area, relative to the expected values."""
        off = self.traction[:, component] - self.expected[:, component]
        size = np.sum(self.area * self.expected[:, component] ** 2)
        return float(np.sqrt(np.sum(self.area * off**2) / size))

    def on_axis(self, component: int) -> tuple[float, float]:
        """Expected and computed value on the axis."""
        i = np.argmin(np.abs(self.x))
        return float(self.expected[i, component]), float(self.traction[i, component])


def refine(
    what: str,
    source: str,
    sizes: list[float],
    numbers: list[tuple[float, float]],
    *,
    order: float,
    within: float,
) -> Refinement:
    """Pairs of expected and computed numbers for the mesh sizes h/a."""
    expected, computed = [e for e, _ in numbers], [c for _, c in numbers]
    error = [abs(c / e - 1) for e, c in numbers]
    return Refinement(what, source, sizes, expected, computed, error, order, within)


def mean_square(
    source: str,
    sizes: list[float],
    profiles: list[Profile],
    component: int,
    *,
    order: float,
    within: float,
) -> Refinement:
    """Errors of whole profiles of pressure (0) or shear (1)."""
    what = ("pressure", "shear")[component] + ", mean square"
    error = [p.error(component) for p in profiles]
    return Refinement(what, source, sizes, [], [], error, order, within)
