"""Classes of problems at random, with fixed seeds: what is drawn, asked and met.

The suite runs the first problems of each, ``make verify`` many more. The counts on the page
are those of the suite.
"""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import determinate
import slender
import verdicts


class Class(NamedTuple):
    """A class of problems.

    `run` asks everything of the problems of some seeds, fails where something is wrong,
    and counts by name what it met; `told` are the names that the page shows.
    """

    name: str
    drawn: str
    asked: str
    suite: int
    verify: int
    run: Callable[[range], Counter[str]]
    told: tuple[str, ...]

    def row(self) -> list[str]:
        """Cells of the table of the page."""
        counts = self.run(range(self.suite))
        met = ", ".join(f"{counts[name]} {name}" for name in self.told)
        return [
            self.name,
            self.drawn,
            self.asked,
            str(self.suite),
            f"{self.verify:,}",
            met,
        ]


HEAD = [
    "class",
    "problems",
    "what is asked",
    "in the suite",
    "verify",
    "met in the suite",
]

CLASSES = (
    Class(
        "verdicts",
        "1 to 3 plane contacts, W definite or not, up to 3 rigid motions, μ from 0.1 to 1e6",
        "`solve`, `answers`, `existence`, `unique` and `error_bound` never contradict "
        "what another one proves",
        500,
        20_000,
        verdicts.agree,
        ("exists", "absent"),
    ),
    Class(
        "friction alone",
        "1 to 3 sliders with springs along their normals, μ from 10 to 1e12",
        "no method calls a point converged where there is proved to be no answer",
        60,
        1000,
        verdicts.sliders,
        ("exists", "absent"),
    ),
    Class(
        "proofs",
        "3 plane contacts, 1 to 3 rigid motions, μ up to 1",
        "the verdict carries a motion if and only if that motion proves it: it lies in all "
        "dual cones and the loads do positive work on it; a linear programme says "
        "whether the loads can be balanced",
        400,
        10_000,
        verdicts.proofs,
        ("motion", "statuses"),
    ),
    Class(
        "local bounds",
        "1 to 3 plane contacts, μ from 0.5 to 4, points near each answer",
        "one answer within `energy`, no other within `alone_within`, against all answers",
        120,
        11_880,
        verdicts.locals_of,
        ("bound local", "bound global"),
    ),
    Class(
        "slender bodies",
        "strips, plates and leaves, L/t from 10 to 5000, plane and in space, first and "
        "second order, held in four ways, with and without coordinates",
        "displacements and reactions beside an elimination in twice the precision; none "
        "is called free; what K has no digits for is refused",
        20,
        400,
        slender.held,
        ("solved", "refused"),
    ),
    Class(
        "statically determinate",
        "blocks turned at random on one contact and as few supports as hold them, "
        "with and without coordinates",
        "displacements and reactions beside an elimination in twice the precision",
        60,
        1200,
        determinate.sticking,
        ("solved",),
    ),
    Class(
        "flat and long blocks",
        "coarse blocks turned at random, sides up to 3000 times another, up to 8 supports "
        "with levers down to a few 1e-5, with coordinates",
        "as many rigid motions as supports leave; refused as floating where contact does "
        "not pin them",
        200,
        4000,
        determinate.counted,
        ("counted", "refused"),
    ),
    Class(
        "two nodes in space",
        "blocks and trusses turned at random that touch at two nodes, with and without "
        "coordinates",
        "refused as floating, at every orientation",
        200,
        20_000,
        determinate.on_two_nodes,
        ("refused",),
    ),
)


def rows() -> list[list[str]]:
    """The table."""
    return [one.row() for one in CLASSES]
