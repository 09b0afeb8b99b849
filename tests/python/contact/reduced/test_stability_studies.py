"""The stability studies at a few values each: errors are within their bounds."""

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stability
from studies import blocks, contrast, exact, friction, gaps, poisson, size, slender
from studies import steps as load_steps
from studies.measure import (
    COLUMNS,
    CORRECTED,
    LAWFUL,
    Row,
    bounds,
    solved,
)

import bipot_rs as bp

pytestmark = pytest.mark.needs_extra

EPS = float(np.finfo(float).eps)
SLIP, STICK = bp.Status.SLIP, bp.Status.STICK


def held(rows: Iterable[Row]) -> Iterator[Row]:
    """Rows with errors within the bounds, which are the rounding errors of worst sign.

    The constant is that of the studies: entries of K are sums of four or eight terms.
    """
    for measured in rows:
        assert measured.outcome == "converged", measured
        assert measured.statuses_right, measured
        for symbol in "rvu":
            error = getattr(measured, f"error_{symbol}")
            if np.isfinite(error):
                bound = getattr(measured, f"bound_{symbol}")
                assert error <= stability.CONSTANT * bound, (symbol, measured)
        yield measured


# Rows of a study, the errors that are looked at, and what they may be.
ALLOWED: dict[str, tuple[Callable[[], Iterable[Row]], str, Callable[[Row], float]]] = {
    # K adds (1 - 2ν)⁻¹ to terms of order one and rounds them away. The error of u grows
    # like that, times the constant of all these bounds.
    "poisson": (lambda: poisson.rows([0.2, 1e-2, 1e-4, 1e-7]), "u",
                lambda x: 1e-14 + stability.CONSTANT * EPS / (2 * x.parameter)),
    # Normal reactions of the column follow from statics, for any ν.
    "column": (lambda: poisson.rows([0.2, 1e-7]), "r",
               lambda x: 1e-14 if x.case == "column" else np.inf),
    # Each body is factored separately: its rigid motion is split off for any stiffness of
    # the other. Entries of the stiff half of one body are rounded by ε E₂, as if springs of that
    # size tied its 16 cells to the ground, compared with the modulus 1 that really holds it.
    "contrast": (lambda: contrast.rows([1e-12, 1e-6, 1e6, 1e9, 1e11]), "ru",
                 lambda x: 1e-14 + (x.case == "bonded") * 16 * EPS * max(x.parameter, 1.0)),
    # The matrix of a sticking contact does not contain μ, and a sliding contact has r of
    # size one: no power of μ multiplies any error.
    "friction": (lambda: friction.rows([0.0, 1e-8, 0.3, 10.0, 1e4, 1e8]), "rvu", lambda _: 1e-14),
    # Everything is in proportion to the gap. Only a gap computed as a difference of two
    # coordinates has lost digits before the solve.
    "gaps": (lambda: gaps.rows([1e-16, 1e-12, 1e-8, 1e-3]), "ru",
             lambda x: 1e-14 + (x.case == "from coordinates") * EPS / x.parameter),
    # One of the 32 cells has a stiffness of 32 EA/L along the beam; the tip has 3EI/L³
    # across it, 128 (L/h)² times less. Entries of K are rounded relative to the first.
    "slender": (lambda: slender.slender([1.0, 30.0, 1000.0]), "u",
                lambda x: 1e-13 + 128 * EPS * x.parameter**2 if x.case == "beam" else np.inf),
    # A flat cell is much stiffer upwards than the block: S is what remains after cancellation.
    "needles": (lambda: slender.needles([1.0, 100.0, 1e4, 1e6]), "ru",
                lambda x: 1e-14 + 2 * EPS * x.parameter),
    # The history adds one rounding per step, not one per product; the slip of a step is the
    # difference of two totals.
    "steps": (lambda: load_steps.rows([1e-13, 1e-12, 1e-6, 1e-1]), "v",
              lambda x: 1e-13 if x.case == "totals" else 1e-14 / x.parameter),
}  # fmt: skip


@pytest.mark.parametrize("study", ALLOWED)
def test_errors_have_a_reason(study: str) -> None:
    rows, symbols, allowed = ALLOWED[study]
    for measured in held(rows()):
        worst = max(getattr(measured, f"error_{symbol}") for symbol in symbols)
        assert worst <= allowed(measured), measured


def test_a_rigid_motion_is_seen_through_the_rounding_of_a_stiff_part() -> None:
    line = np.linspace(0, 1, 5)
    for value in (1e6, 1e8, 1e10):
        case, _ = blocks.column([1.0, value], 0.3, (line, line), bonded=True)
        problem, _ = solved(case)
        assert problem.stats["rigid_motions"] == 1
        assert problem.stats["cond_S"] < 100


def test_flat_cells_of_a_free_body() -> None:
    lines = np.linspace(0, 1, 5), slender.layers(1e6)
    case, closed = blocks.column([1.0], 0.3, lines)
    problem, step = solved(case)
    right = exact.solve(case, step.status, step.slip)
    limit = stability.CONSTANT * bounds(right, problem, step.residual)[0]
    # S is a small difference of large entries. The rounding in S along the free motion is
    # removed, so statics is exact, with W and with K.
    by_w = problem.reduced(case.load).solve(tol=1e-14)
    assert problem.stats["cond_S"] < 100 < CORRECTED
    for outcome in (by_w, step):
        assert np.abs(outcome.reaction - closed.r).max() <= limit * closed.r.max()


@pytest.mark.slow
def test_contacts_from_none_to_many() -> None:
    plane, islands, space = [0, 1, 2, 3, 30, 200], [3], [2, 6]
    rows_held = []
    for x in size.rows(plane, islands, space):
        if np.isfinite(x.bound_r):
            rows_held += held([x])
        else:
            # In space, with slip: compared with the exact solution for W r + q. η is 1e-14.
            assert x.statuses_right
            assert x.error_r <= 1e-14 * x.cond_S
            rows_held.append(x)
        assert x.law <= 1e-13
    # A hundred times as many contacts need a few times as many products.
    work = {x.contacts: x.products for x in rows_held if x.case == "plane, one block"}
    assert work[200] <= 10 * work[3]
    # Separate blocks need memory in proportion to n, one block in proportion to n².
    bytes_of_one, ten = (x.bytes for x in size.rows([], [1, 10], []))
    assert ten <= 12 * bytes_of_one


def test_the_bound_of_data_is_reached() -> None:
    """The last bits of K, chosen against u, move u by a large part of the bound."""
    case = blocks.pressed([np.linspace(0, 2, 9), np.linspace(0, 1, 5)], 0.4999)
    _, step = solved(case)
    right = exact.solve(case, step.status, step.slip)
    n = case.K.shape[0]
    free = np.setdiff1d(np.arange(n), case.fixed)
    u = exact.to_floats(right.u)
    inverse = np.linalg.inv(right.A.toarray())[: len(free), : len(free)]
    worst = int(np.argmax(np.abs(inverse) @ (abs(case.K[free]) @ np.abs(u))))
    K = case.K.tocoo()
    signs = np.zeros(n)
    signs[free] = np.sign(inverse[worst])
    against_u = np.sign(signs[K.row] * np.sign(u[K.col]))
    # A program that computes each entry separately rounds (i, j) and (j, i) independently.
    # The exact solution does not need a symmetric K.
    bent = K.copy()
    bent.data = K.data * (1 + EPS * against_u * np.sign(K.data))
    other = replace(case, K=bent.tocsr())
    moved = exact.solve(other, step.status, step.slip)
    change = np.abs(exact.to_floats(moved.u - right.u)).max() / np.abs(u).max()
    data = EPS * right.condition()[2]
    assert 0.2 * data <= change <= 2 * data


def test_the_page_shows_what_was_measured(repository: Path) -> None:
    page = (repository / "docs" / "stability.md").read_text(encoding="utf-8")
    assert stability.summary() in page
    for name in stability.STUDIES:
        picture = repository / "benches" / "results" / f"stability_{name}.png"
        assert f"../benches/results/{picture.name}" in page
        assert 5_000 < picture.stat().st_size < 80_000


@pytest.mark.parametrize("name", stability.STUDIES)
def test_the_tables_keep_the_bounds(name: str) -> None:
    with stability.table(name).open() as file:
        assert next(csv.reader(file)) == list(COLUMNS)
    for rows in stability.read(name).values():
        solved_rows = [x for x in rows if x.outcome == "converged"]
        assert all(x.statuses_right for x in solved_rows)
        assert all(not stability.share(x) > 1 for x in solved_rows)
        # Where no exact solution is known: the law and equilibrium in extended precision.
        assert all(
            x.law <= LAWFUL for x in solved_rows if np.isnan(x.bound_r + x.bound_v)
        )
