"""Tables and pictures of the chapters are those of the current build.

Work is counted, not timed, and repeats bit for bit on one machine. Another machine rounds
differently, which changes the last iterations: a count may differ by a tenth plus two,
an error left by an iteration by a factor of two.
"""

import math
import re
import sys
from collections import Counter
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.places import ROOT
from support.random_problems import random_problem

Array = NDArray[np.float64]

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
    """Cells of a table of a page: after a marker, or one whose head begins like ``name``."""
    text = (PAPER / page).read_text(encoding="utf-8")
    if name.startswith("|"):
        table = text[text.index(name) :].partition("\n\n")[0].splitlines()[2:]
    else:
        _, _, after = text.partition(f"<!-- {name}, written by")
        table = after.partition("<!-- end")[0].splitlines()[3:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table]


def row(table: Sequence[Sequence[str]], *head: str) -> list[str]:
    (matching_row,) = (list(r) for r in table if tuple(r[: len(head)]) == head)
    return matching_row


def same(shown: str, fresh: str, share: float, least: float = 0.0) -> bool:
    """Whether words are equal, and numbers agree to a relative tolerance or to ``least``."""
    if NUMBER.sub("#", shown) != NUMBER.sub("#", fresh):
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(fresh), strict=True)
    numbers = [(float(a), float(b)) for a, b in pairs]
    return all(abs(a - b) <= max(share * max(a, b), least) for a, b in numbers)


STOPS = [
    pytest.param(name, n, marks=[pytest.mark.slow] * (name != "pressed_block"))
    for name, n in (
        *(("cattaneo_mindlin", 10), ("sheared_cube", 6), ("two_blocks", 6)),
        ("pressed_block", 32),
    )
]


@pytest.mark.parametrize(("name", "n"), STOPS)
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


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_table_of_effectivities(
    every: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All rows, or the first of one scene."""
    monkeypatch.chdir(ROOT)
    bench, printed = (
        script("discretisation_error"),
        rows("10-discretisation-error.md", "effectivity"),
    )
    cases = [
        (name, settings, *size)
        for name, settings, sizes in bench.ROWS
        for size in sizes
        if every or (name == "pressed_block" and size[0] == 4)
    ]
    assert len(cases) == len(printed) or (cases and not every)
    for case in cases:
        fresh = bench.compare(*case).cells()
        shown = row(printed, *fresh[:3])
        for a, b in zip(shown, fresh, strict=True):
            # One unit in the last of the four digits.
            assert same(a, b, share=0.01, least=1.01e-4), (shown, fresh)


BOUNDED = {
    "tests: held": "held",
    "tests: graded": "graded",
    "tests: frictionless": "frictionless",
    "random": None,
    "held": None,
    "two bodies": None,
}
CLASSES = ((3e-2, np.inf), (1e-5, 3e-2), (1e-8, 1e-5), (1e-11, 1e-8))
SEEDS = 24


def make_bounded_problem(name: str, seed: int) -> Any:
    """A problem of a row of the first table of chapter 9: a set of the tests or of benches."""
    kind = BOUNDED[name]
    if kind is not None:
        return random_problem(kind, 2 + seed % 2, seed)
    return getattr(script("problems"), name.replace(" ", "_"))(seed)


def list_points(problem: Any, answer: Array, seed: int) -> Array:
    """Iterates of two methods, and random points near the solution."""
    iterates = [
        problem.solve(method, 1e-13, max_iterations=2**k).reaction
        for method in ("gauss_seidel", "nesterov")
        for k in range(8)
    ]
    rng = np.random.default_rng(seed)
    sizes = (10.0**-k * rng.normal(size=answer.shape) for k in (1, 3, 6, 9))
    return np.array(iterates + [answer * (1 + size) for size in sizes])


def compare_bounds(name: str) -> list[str]:
    """The row of a set: kinds of bounds; median and 90 % of bound over error, by its size."""
    kinds = Counter()
    ratios: list[list[float]] = [[] for _ in CLASSES]
    for seed in range(SEEDS):
        data = make_bounded_problem(name, seed)
        # The table is about many small problems that supports hold.
        if data.q.size > 450 or data.rigid is not None:
            continue
        problem = bp.ReducedProblem(data.W, data.q, data.mu)
        answer = problem.solve(tol=1e-14)
        if not answer.converged:
            continue
        kinds[answer.error.kind] += 1
        if answer.error.kind != "global":
            continue

        def norm(d: Array, W: Any = data.W) -> float:
            return math.sqrt(max(d.ravel() @ W @ d.ravel(), 0.0))

        points = list_points(problem, answer.reaction, seed)
        for point, bound in zip(points, problem.error_bounds(points), strict=True):
            error = norm(point - answer.reaction)
            assert error <= bound.energy + answer.error.energy
            if error <= 100 * answer.error.energy:
                continue  # the solution is not known well enough
            share = error / norm(answer.reaction)
            for (least, most), of_class in zip(CLASSES, ratios, strict=True):
                if least <= share < most:
                    of_class.append(bound.energy / error)
    counts = ", ".join(str(kinds[k]) for k in ("global", "local", "not available"))
    cells = [
        f"{np.median(x):.1f} / {np.quantile(x, 0.9):.1f} ({len(x)})" for x in ratios
    ]
    return [name, counts, *cells]


@pytest.mark.parametrize(
    "name",
    [pytest.param(s, marks=[pytest.mark.slow] * (s != "random")) for s in BOUNDED],
)
def test_the_table_of_bounds_over_errors(name: str) -> None:
    fresh = compare_bounds(name)
    shown = row(rows("9-error-bound.md", "| set | global"), name)
    assert shown[1] == fresh[1]
    for a, b in zip(shown[2:], fresh[2:], strict=True):
        # Iterates of another machine differ: some points change their class.
        assert same(a, b, share=0.1, least=2.0), (shown, fresh)


def find_largest_friction(W: Array, d: int) -> tuple[float, float]:
    """Largest μ with a bound for every load: by L = 2 in scaled variables, and as proved."""
    n = np.arange(0, len(W), d)
    t = np.setdiff1d(np.arange(len(W)), n)
    scale = np.repeat(1 / np.sqrt(np.diag(W).reshape(-1, d).mean(axis=1)), d)
    scaled = W * np.outer(scale, scale)
    alpha = np.linalg.eigvalsh(scaled[np.ix_(t, t)])[-1]
    beta = np.linalg.eigvalsh(np.linalg.inv(scaled)[np.ix_(n, n)])[-1]
    q, low, high = np.tile([-1.0, *[0.1] * (d - 1)], (len(n), 1)), 0.0, 10.0
    while high - low > 0.02 * high:
        middle = (low + high) / 2
        unique = bp.ReducedProblem(W, q, middle).error_bound(np.zeros_like(q)).unique
        low, high = (middle, high) if unique else (low, middle)
    return 2 / math.sqrt(alpha * beta), low


@pytest.mark.slow
def test_the_table_of_the_largest_friction() -> None:
    block = script("problems").block
    bodies = ((2, 20, 0.3), (2, 60, 0.3), (3, 6, 0.3), (3, 6, 0.4999))
    fresh = [find_largest_friction(block(d, n, nu)["W"], d) for d, n, nu in bodies]
    for d in (2, 3):
        drawn = [random_problem("held", d, seed).W for seed in range(SEEDS)]
        limits = [find_largest_friction(W, d) for W in drawn]
        fresh.append(tuple(np.median(limits, axis=0)))
    printed = rows("9-error-bound.md", "| W | L = 2 at")
    for shown, limits in zip(printed, fresh, strict=True):
        # Bisection stops at 2 %, and the table has two digits.
        assert [float(x) for x in shown[1:]] == pytest.approx(
            limits, rel=0.03, abs=0.006
        )


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_match_their_tables(picture: str) -> None:
    path = PAPER / picture
    stamp = script("curves").digest(path.with_suffix(".csv"))
    assert stamp.encode() in path.read_bytes()
