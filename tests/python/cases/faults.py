"""A15, A16: faults in infinite bodies, from the examples whose programs the documents show."""

import sys
from functools import cache, partial
from typing import Any

import numpy as np

from cases.verification import Refinement, Row, exact
from support import places
from support.profiles import refine

sys.path.insert(0, str(places.ROOT / "examples"))
import depleting_reservoir as reservoir
import inclined_crack

CRACK, LAYERS = "mode II crack", "Jansen and Meulenbroek 2022"
crack = cache(inclined_crack.solve)
fault = cache(reservoir.solve)


def profile(
    what: str, source: str, sizes: list[float], error: list[float], order: float
) -> Refinement:
    """Errors of values along a whole fault."""
    return Refinement(what, source, sizes, [], [], error, order, within=0.2)


def a15(fine: bool = False) -> list[Refinement]:
    """An inclined crack under compression: orders of the slip.

    The displacement is like the root of the distance from a tip. On equal cells its error is
    of the order 1 in L²; cells graded by the cube of the distance have the order 2 of smooth
    solutions.
    """
    cells = [5, 10, 20, 40] if fine else [5, 10]
    sizes, tables = [1 / n for n in cells], []
    for graded, name, order in ((False, "equal", 0.8), (True, "graded", 1.8)):
        cracks = [crack(n, graded) for n in cells]
        slips = [inclined_crack.errors(c)[0] for c in cracks]
        largest = [
            (float(inclined_crack.exact_slip(0.0)), c.slip.max()) for c in cracks
        ]
        what = f"slip, mean square, {name} cells"
        tables.append(profile(what, CRACK, sizes, slips, order))
        what = f"largest slip, {name} cells [m]"
        tables.append(refine(what, CRACK, sizes, largest, order=order, within=0.1))
    return tables


def crack_tractions() -> list[Row]:
    """The tractions of the crack, uniform on meshes that its line mirrors."""
    rows = []
    for graded, name in ((False, "equal"), (True, "graded")):
        solved = crack(10, graded)
        uniform = np.outer(np.ones_like(solved.x), [1.0, -inclined_crack.MU])
        wanted = inclined_crack.PRESSURE * uniform
        what = f"tractions of the crack, {name} cells [Pa]"
        # Graded cells at the tips are 1e-4 times as long as the others: K has four digits less.
        within = 1e-9 if graded else 1e-11
        rows.append(exact(what, CRACK, wanted, solved.traction, within))
    return rows


def a16(fine: bool = False) -> list[Refinement]:
    """A vertical fault in a depleting reservoir, without friction and held.

    Its stress is like the logarithm of the distance from four points, where the error of the
    displacement is of the order 1. Over the fault that gives 3/2 in L². Piecewise linear
    functions follow a logarithm, and a jump, with the order 1/2.
    """
    cells = [4, 8, 16, 32] if fine else [4, 8]
    sizes = [1 / n for n in cells]
    sliding = [fault(n, 0, 0, reservoir.smooth) for n in cells]
    held = [fault(n, 1, reservoir.COHESION, reservoir.depletion) for n in cells]

    def errors(
        faults: list[Any], field: str, component: int, wanted: Any
    ) -> list[float]:
        values = [getattr(f, field).reshape(len(f.z), -1)[:, component] for f in faults]
        pairs = zip(faults, values, strict=True)
        return [reservoir.error(f.z, value, wanted) for f, value in pairs]

    middle = [float(f.traction[f.z == 0, 1][0]) for f in held]
    slip, shear = reservoir.SLIP, float(reservoir.exact_shear(0.0))
    slips = [(slip, float(np.abs(f.slip).max())) for f in sliding]
    shears = [(shear, value) for value in middle]
    of_slip = errors(sliding, "slip", 0, reservoir.exact_slip)
    of_pressure = errors(sliding, "traction", 0, reservoir.exact_pressure)
    of_shear = errors(held, "traction", 1, reservoir.exact_shear)
    at = partial(refine, source=LAYERS, sizes=sizes, order=1.8, within=1e-4)
    along = partial(profile, source=LAYERS, sizes=sizes)
    return [
        along("slip without friction, mean square", error=of_slip, order=1.4),
        at("largest slip without friction [m]", numbers=slips),
        along("pressure without friction, mean square", error=of_pressure, order=0.45),
        at("shear in the middle, held [Pa]", numbers=shears),
        along("shear, held, mean square", error=of_shear, order=0.45),
    ]


CASES = {"a15": a15, "a16": a16}
EXACT = {"a15": crack_tractions}
