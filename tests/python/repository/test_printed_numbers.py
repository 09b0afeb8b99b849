"""Tables and pictures of the chapters are those of the current build.

Work is counted, not timed, and repeats bit for bit on one machine. Another machine rounds
differently, which changes the last iterations: a count may differ by a tenth plus two,
an error left by an iteration by a factor of two.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from types import ModuleType

import numpy as np
import pytest

from support.places import ROOT

PAPER = ROOT / "docs" / "paper"
NUMBER = re.compile(r"\d+\.?\d*(?:e[-+]?\d+)?")
PICTURES = {
    "9-error-bound.svg": "figures_bound",
    "10-stop-rule.png": "figures_stop_rule",
}


@pytest.fixture(autouse=True)
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(PAPER), str(ROOT / "benches"), *sys.path])
    monkeypatch.setenv("MPLBACKEND", "agg")


def script(name: str) -> ModuleType:
    import importlib

    return importlib.import_module(name)


def rows(page: str, name: str) -> list[list[str]]:
    """Cells of the table between two markers of a page."""
    text = (PAPER / page).read_text(encoding="utf-8")
    _, _, after = text.partition(f"<!-- {name}, written by")
    table = after.partition("<!-- end")[0].splitlines()[3:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table]


def row(table: Sequence[Sequence[str]], *head: str) -> list[str]:
    (found,) = (list(r) for r in table if tuple(r[: len(head)]) == head)
    return found


def same(shown: str, fresh: str, share: float, least: float = 0.0) -> bool:
    """Whether words are equal, and numbers agree to a relative tolerance or to ``least``."""
    if NUMBER.sub("#", shown) != NUMBER.sub("#", fresh):
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(fresh), strict=True)
    numbers = [(float(a), float(b)) for a, b in pairs]
    return all(abs(a - b) <= max(share * max(a, b), least) for a, b in numbers)


STOPS = (
    ("cattaneo_mindlin", 10),
    ("sheared_cube", 6),
    ("two_blocks", 6),
    ("pressed_block", 32),
)


@pytest.mark.parametrize(
    ("name", "n"),
    [
        pytest.param(*s, marks=[pytest.mark.slow] * (s[0] != "pressed_block"))
        for s in STOPS
    ],
)
def test_the_table_of_the_stop_rule(name: str, n: int) -> None:
    bench = script("discretisation_error")
    assert (name, n) in bench.STOPS
    assert len(bench.STOPS) == len(STOPS)
    printed = rows("10-discretisation-error.md", "stop rule")
    for fresh in bench.stops(name, n):
        shown = row(printed, *fresh[:3])
        mesh, tol, *work, left = zip(shown[3:], fresh[3:], strict=True)
        assert same(*mesh, share=0.02), (shown, fresh)
        assert same(*tol, share=0.5), (shown, fresh)
        for pair in work:
            assert same(*pair, share=0.1, least=2.0), (shown, fresh)
        # Below the requested tolerance, the last step determines the error.
        assert same(*left, share=0.5, least=1e-8), (shown, fresh)


def effectivities() -> Iterator[tuple[str, tuple[str, ...], int, int]]:
    for name, settings, sizes in script("discretisation_error").ROWS:
        for n, factor in sizes:
            yield name, settings, n, factor


def effectivity_is_printed(
    name: str, settings: tuple[str, ...], n: int, f: int
) -> None:
    fresh = script("discretisation_error").compare(name, settings, n, f).cells()
    shown = row(rows("10-discretisation-error.md", "effectivity"), *fresh[:3])
    for a, b in zip(shown, fresh, strict=True):
        # One unit in the last of the four digits.
        assert same(a, b, share=0.01, least=1.01e-4), (shown, fresh)


def test_the_first_rows_of_the_effectivities() -> None:
    for case in effectivities():
        if case[0] == "pressed_block" and case[2] == 4:
            effectivity_is_printed(*case)


@pytest.mark.slow
def test_all_rows_of_the_effectivities(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    cases = list(effectivities())
    assert len(cases) == len(rows("10-discretisation-error.md", "effectivity"))
    for case in cases:
        effectivity_is_printed(*case)


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_match_their_tables(picture: str) -> None:
    path = PAPER / picture
    stamp = script("curves").digest(path.with_suffix(".csv"))
    assert stamp.encode() in path.read_bytes()


def agree(
    shown: Sequence[tuple[str, str, float, float]],
    fresh: Sequence[tuple[str, str, float, float]],
) -> None:
    """Whether curves have the same points, as far as another machine repeats them."""
    for a, b in zip(shown, fresh, strict=True):
        assert a[:2] == b[:2]
        assert abs(a[2] - b[2]) <= max(0.1 * a[2], 2.0), (a, b)
        # Once a method has found the statuses, only rounding is left.
        assert max(a[3], b[3]) < 1e-8 or abs(np.log2(a[3] / b[3])) <= 1.0, (a, b)


def test_the_curves_of_the_bound() -> None:
    figure = script("figures_bound")
    agree(script("curves").read(figure.NUMBERS), figure.points())


@pytest.mark.parametrize(
    ("name", "n", "methods"),
    [
        ("sheared_cube", 6, ("auto",)),
        pytest.param("sheared_cube", 6, None, marks=pytest.mark.slow),
        pytest.param("cattaneo_mindlin", 10, None, marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_the_curves_of_the_stop_rule(
    name: str, n: int, methods: tuple[str, ...] | None
) -> None:
    figure = script("figures_stop_rule")
    chosen = methods or figure.METHODS
    shown = script("curves").read(figure.NUMBERS)
    panel = f"{name}, n = {n}, P1"
    shown = [
        p for p in shown if p.panel == panel and p.curve.partition(",")[0] in chosen
    ]
    agree(shown, figure.curves(name, n, chosen))
