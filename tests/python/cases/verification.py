"""Cases with known solutions as rows of numbers, and the page made from them.

Tests assert `Row.holds`; `make verification` writes
`docs/verification.md` from the same rows.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from support import places

PAGE = places.ROOT / "docs" / "verification.md"


@dataclass(frozen=True)
class Row:
    """One number or word, computed and expected.

    `difference` is relative to the size of the expected value and must be at most `within`.
    Rounding differs between machines, so for rounding the page shows `within`. It shows a
    discretisation error itself.
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
        # In this form NaN fails.
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
    """Errors of one quantity for several mesh sizes, and the smallest order allowed."""

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
        # The position of edges within cells is random, so one pair of meshes proves little.
        first, last = self.error[0], self.error[-1]
        mean = math.log(first / last) / math.log(self.sizes[0] / self.sizes[-1])
        falls = all(f < e for e, f in pairwise(self.error))
        return falls and mean >= self.order and last <= self.within

    def rows(self) -> list[list[str]]:
        # A whole profile has an error but no single number.
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
    # 1e-10 may be slightly below or above that power of ten.
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
    """Row with the largest difference of two arrays; it shows the largest entry."""
    want, got = (np.asarray(x, dtype=float) for x in (expected, computed))
    if want.shape != got.shape:
        raise ValueError(f"{what}: {got.shape} computed, {want.shape} expected")
    at = np.unravel_index(np.argmax(np.abs(want)), want.shape)
    scale = size or float(np.abs(want[at])) or 1.0
    difference = float(np.abs(got - want).max() / scale)
    return Row(
        what, source, float(want[at]), float(got[at]), difference, within, rounding
    )


def exactly(
    source: str, within: float, pairs: dict[str, tuple[ArrayLike, ArrayLike]]
) -> list[Row]:
    """`exact` for several quantities: expected and computed by name."""
    return [exact(what, source, *pair, within) for what, pair in pairs.items()]


def near(
    what: str,
    source: str,
    expected: ArrayLike,
    computed: ArrayLike,
    within: float,
    *,
    size: float | None = None,
) -> Row:
    """`exact` for discretisation errors or errors of printed digits."""
    return exact(what, source, expected, computed, within, size=size, rounding=False)


def same(what: str, source: str, expected: str, computed: str) -> Row:
    """Row that compares two words."""
    return Row(what, source, expected, computed)


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def page(*, fine: bool) -> str:
    """The page. `fine` adds the meshes that take too long for a test."""
    # Imported here: each of them imports Row from this module.
    import cases.exact
    import cases.faults
    import cases.hard
    import cases.manufactured
    import cases.plane
    import cases.published
    import cases.revolution
    import cases.space

    def numbers(cases: dict[str, Callable[[], list[Row]]]) -> list[str]:
        rows = [[i.upper(), *r.cells()] for i, case in cases.items() for r in case()]
        head = ["case", "quantity", "source", "expected", "computed", "difference"]
        return table(head, rows)

    approached = cases.plane.CASES | cases.space.CASES | cases.faults.CASES
    approached |= cases.revolution.CASES
    refined = [
        [i.upper(), *row]
        for i, case in sorted(approached.items(), key=lambda pair: int(pair[0][1:]))
        for section in case(fine)
        for row in section.rows()
    ]
    head = ["case", "quantity", "source", "h/a", "expected", "computed"]
    sections = [
        HEAD,
        "## Answers that the mesh meets exactly\n",
        *numbers(cases.exact.CASES | cases.faults.EXACT),
        "\n## Answers that the mesh approaches\n",
        REFINED,
        *table([*head, "error", "order"], refined),
        "\n## A manufactured solution\n",
        MANUFACTURED,
        *table(MANUFACTURED_HEAD, cases.manufactured.rows(fine)),
        "\n## Published problems\n",
        *numbers(cases.published.CASES),
        "\n## Hard cases\n",
        *numbers(cases.hard.CASES),
    ]
    return "\n".join(sections) + "\n"


HEAD = """\
# Verification

This page compares results of the program with answers from elsewhere. `make verification`
writes it. The tests compute the same numbers and check each against its bound.

The difference is the largest over all numbers of a quantity, relative to the largest of them;
the table shows that largest number. `<` means that only rounding and the residual of the solver
remain; the number after it is a bound that the tests assert. `≤` means that the mesh, or the
digits of the source, make the difference; the number after it is the difference, rounded up to
one digit.

Cases A have answers by analysis: closed forms, statics, enumeration. Cases P are published
problems. Cases H are hard: degenerate geometry, several answers or none, extreme numbers. The
mesh approaches the answers of A7 to A10, A13 and A15 to A19 by refinement, and meets all
other answers A exactly.

Sources: [J85] and the equations of the paper are in [theory.md](theory.md). *Closed form*: the
formula is derived in `bipot_rs.analytic` or in the test. *Enumeration*: every combination of
statuses is tried. *Contract*: the docstring promises it. *5 steps*: this program, with the load
in five steps.

- *SSNV128*, *SSNV503 of code_aster*: tests of its validation manual,
  [code-aster.org](https://www.code-aster.org). SSNV128 is the plate of Raous, Chabrand and
  Lebon, 1988. Its numbers are means of several codes, by Feijóo, Barbosa and Zouain, *Journal of
  Theoretical and Applied Mechanics*; code_aster quotes them with a tolerance of 5 %. At the
  point E the source has 1.50e-5. This program and the independent program have 1.541e-5 on every
  mesh. The number of the source, 3 % less, was probably rounded or read from a curve.
- *SSNP501 of code_aster*: a ring between plates, after A. F. Saleeb, K. Chen and T. Y. P.
  Chang, *Int. J. Numer. Meth. Engng* 37, 1994, 1297–1321. Its displacements are large. An
  independent program with large displacements gives the same numbers (the first two rows of P6);
  the results of this program are the limit of that program for a small approach of the plates.
  *Michell's series* is the exact deformation of the linear ring under the computed reactions.
- P7 has no published number: the sheet is compared with statics and with a bar.
- *SSNP156 of code_aster*: NAFEMS contact benchmark 4, whose results are published as curves. The
  numbers are those that code_aster computes on its mesh (model B).
  [Published problems](published.md) shows P1, P6, P7 and P8, and what is not published.
- *independent program*: finite elements that share no code with this package, with bilinear
  cells and full integration. Its numbers, and the problems of Siconos, are in
  [data_reference](../tests/python/data_reference/README.md).
- *mode II crack*, *Jansen and Meulenbroek 2022*: [Faults](faults.md) derives both.
- *NAFEMS, Konter 2006*: A. W. A. Konter, *Advanced Finite Element Contact Benchmarks*,
  NAFEMS, benchmark 1.
- *ANSYS VM63*: Static Hertz Contact Problem, *ANSYS Verification Manual*; its data in the
  formulas of Hertz.
"""

REFINED = """\
The contact has the half-width a. Either the bodies are hundreds of times larger, or their far
faces move as the closed form prescribes. Cells have the size h at the contact; outwards, each is
larger than the one before by the factor 1 + 2h/a, so that h refines the whole mesh. The errors
of tractions are root mean squares over the contact. Tractions end like a square root, and a mesh
resolves the position of this end only to h: the order is 1, and 2 for the force. In space, the
finite box reduces the force by about 5e-4, so that the last orders look better than they are.

For the faults A15 and A16, a is half the length of the crack and 75 m, and the outer boundary
carries the exact displacements of the infinite body. [Faults](faults.md) derives the orders.

For the bodies of revolution A17 to A19, a is the wall of the shaft or the radius of the contact.
The body of A18 and A19 has the size 800 a, which adds about 1/800 to the force, and normals of
A18 tilt by 0.002: the last orders of forces look worse than they are.
"""

MANUFACTURED = """\
No closed form above has all three statuses and a smooth displacement, and none is for triangles
or tetrahedra. Here a solution is chosen, and the problem is made from it
([manufactured.py](../tests/python/cases/manufactured.py)): a smooth displacement of a square or
a cube over a rigid plane, and reactions that satisfy the law at each point of its bottom, with
a part that sticks, one that slips and one that is open. The loads and initial gaps that belong
to them follow: forces in the body and on its sides from the stress σ, on the bottom the traction
σn - r, and as the gap and tangential offset of a contact v - u. In space, the direction of the
slip turns along the contact, and the ends of the zones are curved.

![Tractions and zones of the manufactured solution, and errors against h](manufactured.png)

The errors are relative: of u and its gradient in L² over the body, of the tractions at the
nodes in root mean square over the contact. The last one is the share of the contact that is
nearest to a node whose status is not the one of this place. For elements of order k the theory
gives k for the gradient; k + 1/2 for u, since the dual problem of Aubin and Nitsche has
singularities at the ends of the zones, where conditions change; 1 for the ends, because a status
belongs to a node. The tractions have kinks at the ends, so that they reach 3/2 at most, also with
k = 2. The tests ask for these orders less 0.2. Faces of six nodes (P2 in space) have mortar
contact, all others contact at the nodes.
"""
MANUFACTURED_HEAD = ["case", "element", "h", "u", "order", "gradient", "order"]
MANUFACTURED_HEAD += ["tractions", "order", "ends of the zones", "order"]


def main() -> None:
    PAGE.write_text(page(fine=True), encoding="utf-8")


if __name__ == "__main__":
    main()
