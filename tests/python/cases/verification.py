"""Cases with answers known from elsewhere, as rows of numbers, and the page they make.

Tests assert what `Row.holds` says; `python tests/python/cases/verification.py` writes
`docs/verification.md` from the same rows.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import places

PAGE = places.ROOT / "docs" / "verification.md"


@dataclass(frozen=True)
class Row:
    """One number, or one word, beside what it should be.

    `difference` is relative to the size of what is expected and must be at most
    `within`. Rounding differs from machine to machine, so that the page gives `within`
    for it; a difference that the discretisation makes is printed itself.
    """

    what: str
    source: str
    expected: float | str
    computed: float | str
    difference: float = 0.0
    within: float = 0.0
    rounding: bool = True

    def holds(self) -> bool:
        if isinstance(self.expected, str):
            return self.computed == self.expected
        # Written so that NaN fails.
        return self.difference <= self.within

    def cells(self) -> list[str]:
        if isinstance(self.expected, str):
            return [self.what, self.source, self.expected, str(self.computed), ""]
        # Digits of rounding are not shown.
        digits = min(10, int(-math.log10(self.within)) - 1) if self.rounding else 6
        computed = float(self.computed)
        if self.expected == 0 and abs(computed) <= self.within:
            computed = 0.0  # digits of rounding
        difference = power(self.within) if self.rounding else power(self.difference)
        return [
            self.what,
            self.source,
            f"{self.expected:.{digits}g}",
            f"{computed:.{digits}g}",
            ("< " if self.rounding else "≤ ") + difference,
        ]


class Refinement(NamedTuple):
    """Errors of one quantity over mesh sizes, and the least order they may fall with."""

    what: str
    source: str
    sizes: list[float]
    expected: list[float]
    computed: list[float]
    error: list[float]
    order: float
    within: float

    @property
    def orders(self) -> list[float]:
        steps = zip(pairwise(self.sizes), pairwise(self.error), strict=True)
        return [math.log(e / f) / math.log(h / k) for (h, k), (e, f) in steps]

    def holds(self) -> bool:
        # One pair of meshes says little where edges fall into cells by chance.
        first, last = self.error[0], self.error[-1]
        mean = math.log(first / last) / math.log(self.sizes[0] / self.sizes[-1])
        falls = all(f < e for e, f in pairwise(self.error))
        return falls and mean >= self.order and last <= self.within

    def rows(self) -> list[list[str]]:
        # A whole profile has an error, and no number to show.
        numbers = [
            (f"{e:.5g}", f"{c:.5g}")
            for e, c in zip(self.expected, self.computed, strict=True)
        ]
        orders = ["", *(f"{o:.1f}" for o in self.orders)]
        columns = zip(
            self.sizes,
            numbers or [("", "")] * len(orders),
            self.error,
            orders,
            strict=True,
        )
        return [
            [self.what, self.source, f"{h:.3g}", *pair, "≤ " + power(error), order]
            for h, pair, error, order in columns
        ]


def power(x: float) -> str:
    """A bound of x with one digit: 0.0123 gives 2e-02."""
    if x == 0:
        return "0"
    exponent = math.floor(math.log10(x))
    # 1e-10 is a little less or more than ten to that power.
    digit = math.ceil(x / 10.0**exponent * (1 - 1e-9))
    return f"{digit * 10.0**exponent:.0e}"


def exact(
    what: str,
    source: str,
    expected: ArrayLike,
    computed: ArrayLike,
    within: float,
    *,
    size: float | None = None,
    rounding: bool = True,
) -> Row:
    """Largest difference of arrays beside the largest entry; prints that entry."""
    want, got = (np.asarray(x, dtype=float) for x in (expected, computed))
    if want.shape != got.shape:
        raise ValueError(f"{what}: {got.shape} computed, {want.shape} expected")
    at = np.unravel_index(np.argmax(np.abs(want)), want.shape)
    scale = size or float(np.abs(want[at])) or 1.0
    difference = float(np.abs(got - want).max() / scale)
    return Row(
        what, source, float(want[at]), float(got[at]), difference, within, rounding
    )


def near(
    what: str,
    source: str,
    expected: ArrayLike,
    computed: ArrayLike,
    within: float,
    *,
    size: float | None = None,
) -> Row:
    """The same where it is the discretisation, or the printed digits, that differ."""
    return exact(what, source, expected, computed, within, size=size, rounding=False)


def same(what: str, source: str, expected: str, computed: str) -> Row:
    """Two words."""
    return Row(what, source, expected, computed)


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def page(*, fine: bool) -> str:
    """The page; `fine` adds the meshes that take longer than a test may."""
    # Here, since each of them needs Row.
    import cases_exact
    import cases_hard
    import cases_plane
    import cases_published
    import cases_random
    import cases_space

    def numbers(cases: dict[str, Callable[[], list[Row]]]) -> list[str]:
        rows = [[i.upper(), *r.cells()] for i, case in cases.items() for r in case()]
        head = ["case", "quantity", "source", "expected", "computed", "difference"]
        return table(head, rows)

    approached = cases_plane.CASES | cases_space.CASES
    refined = [
        [i.upper(), *row]
        for i, case in sorted(approached.items(), key=lambda pair: int(pair[0][1:]))
        for one in case(fine)
        for row in one.rows()
    ]
    head = ["case", "quantity", "source", "h/a", "expected", "computed"]
    sections = [
        HEAD,
        "## Answers that meshes meet exactly\n",
        *numbers(cases_exact.CASES),
        "\n## Answers that meshes approach\n",
        REFINED,
        *table([*head, "error", "order"], refined),
        "\n## Published problems\n",
        *numbers(cases_published.CASES),
        "\n## Hard cases\n",
        *numbers(cases_hard.CASES),
        "\n## Randomised classes\n",
        RANDOMISED,
        *table(cases_random.HEAD, cases_random.rows()),
    ]
    return "\n".join(sections) + "\n"


HEAD = """\
# Verification

Answers that do not come from this program, beside its own. `make verification` writes
this page; the tests compute the same numbers and hold each to its bound.

The difference is the largest over all numbers of a quantity, relative to the largest
of them, which is the one printed. `<` stands before a bound that the tests assert where
only rounding and the residual that the solver is held to are left; `≤` before the
difference itself, rounded up to one digit, where it comes from a mesh or from the
digits of a source.

Cases A have answers by analysis: closed forms, statics, enumerations. Cases P are
published problems. Cases H are hard ones: degenerate geometry, several answers or none,
extreme numbers. A7, A8, A9, A10 and A13 are approached by refinement, all other A are met
exactly.

Sources: [J85] and the paper's equations are in [theory.md](theory.md); *closed form*
means that it is derived in `bipot_rs.analytic` or in the test of that number;
*enumeration* tries every status of every contact; *contract* is what the docstring
promises; *5 steps* is the same program with the load in five steps.

- *SSNV128*, *SSNV503 of code_aster*: tests of its validation manual,
  [code-aster.org](https://www.code-aster.org). SSNV128 is the plate of Raous, Chabrand
  and Lebon, 1988; the numbers are a mean of several codes by Feijóo, Barbosa and Zouain,
  *Journal of Theoretical and Applied Mechanics*, which code_aster quotes with a tolerance
  of 5 %. At the point E the source has 1.50e-5, where this program and the independent
  one have 1.541e-5 on every mesh: it looks rounded, or read off a curve, and is 3 % off.
- *independent program*: finite elements that share no code with these, bilinear cells,
  full integration; its numbers are in
  [data_reference](../tests/python/data_reference/README.md), as are the problems of
  Siconos.
- *NAFEMS, Konter 2006*: A. W. A. Konter, *Advanced Finite Element Contact Benchmarks*,
  NAFEMS, benchmark 1.
- *ANSYS VM63*: Static Hertz Contact Problem, *ANSYS Verification Manual*; its data, put
  into Hertz's formulas.
"""

REFINED = """\
Elastic bodies hundreds of times larger than the contact, whose half-width is a, or
smaller ones whose far faces move as the closed form says. Cells of the size h at the
contact grow outwards by the factor 1 + 2h/a each, so that h refines the whole mesh.
Tractions are compared in the mean square over the contact. They have square-root
ends, where a mesh of cells resolves them to h: order 1, and 2 for the force. In space
the box takes away about 5e-4 of the force, so that the last orders look better than
they are.
"""


RANDOMISED = """\
Problems drawn at random from fixed seeds. Each is asked what only a right program answers
rightly, without an answer known beforehand; one that fails fails the suite. The suite runs
the first seeds of a class, `make verify` those that follow. What was met shows that a class
is not empty of what it is drawn for.
"""


def main() -> None:
    PAGE.write_text(page(fine=True), encoding="utf-8")


if __name__ == "__main__":
    main()
