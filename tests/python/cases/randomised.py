"""Classes of random problems with fixed seeds, their checks and their counts.

The suite runs the first problems of each class, ``make verify`` many more. The page shows
the counts of the suite.
"""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from support import determinate, slender, verdicts


class Class(NamedTuple):
    """A class of problems.

    `run` checks the problems of some seeds, fails at an error, and counts outcomes by name;
    `told` are the names that the page shows.
    """

    name: str
    drawn: str
    asked: str
    suite: int
    verify: int
    run: Callable[[range], Counter[str]]
    told: tuple[str, ...]

    def row(self) -> list[str]:
        """Cells of this class in the table of the page."""
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
    "what is checked",
    "problems in the suite",
    "in `make verify`",
    "found in the suite",
]

CLASSES = (
    Class(
        "verdicts",
        "1 to 3 plane contacts, W definite or not, up to 3 rigid motions, μ from 0.1 to 1e6",
        "`solve`, `answers`, `existence`, `unique` and `error_bound` never contradict "
        "each other",
        500,
        20_000,
        verdicts.agree,
        ("exists", "absent"),
    ),
    Class(
        "friction alone",
        "1 to 3 sliders with springs along their normals, μ from 10 to 1e12",
        "no method reports convergence if it is proved that no answer exists",
        60,
        1000,
        verdicts.sliders,
        ("exists", "absent"),
    ),
    Class(
        "proofs",
        "3 plane contacts, 1 to 3 rigid motions, μ up to 1",
        "the error has a motion if and only if this motion proves that no answer exists: it "
        "lies in all dual cones and the loads do positive work on it; a linear programme "
        "decides independently whether the loads can be balanced",
        400,
        10_000,
        verdicts.proofs,
        ("motion", "statuses"),
    ),
    Class(
        "local bounds",
        "1 to 3 plane contacts, μ from 0.5 to 4, points near each answer",
        "exactly one of all answers is within `energy`, and no other within `alone_within`",
        120,
        11_880,
        verdicts.locals_of,
        ("bound local", "bound global"),
    ),
    Class(
        "slender bodies",
        "strips, plates and leaves, L/t from 10 to 5000, plane and in space, first and "
        "second order, held in four ways, with and without coordinates",
        "displacements and reactions agree with an elimination in twice the precision; no "
        "body is reported as free; a K with too few digits is refused",
        20,
        400,
        slender.held,
        ("solved", "refused"),
    ),
    Class(
        "statically determinate",
        "randomly rotated blocks on one contact and the fewest supports that hold them, "
        "with and without coordinates",
        "displacements and reactions agree with an elimination in twice the precision",
        60,
        1200,
        determinate.sticking,
        ("solved",),
    ),
    Class(
        "flat and long blocks",
        "randomly rotated coarse blocks, ratio of sides up to 3000, up to 8 supports with "
        "levers down to a few 1e-5, with coordinates",
        "the number of rigid motions is the number that supports leave free; a block that "
        "contact does not hold is refused as floating",
        200,
        4000,
        determinate.counted,
        ("counted", "refused"),
    ),
    Class(
        "two nodes in space",
        "randomly rotated blocks and trusses that touch at two nodes, with and without "
        "coordinates",
        "refused as floating in every orientation",
        200,
        20_000,
        determinate.on_two_nodes,
        ("refused",),
    ),
)


def rows() -> list[list[str]]:
    """The table."""
    return [one.row() for one in CLASSES]
