"""Derivatives of random load paths against finite differences, and jvp against vjp."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.random_paths import (
    FIELDS,
    KINDS,
    apart,
    cotangents,
    differences,
    jvp,
    products,
    random_direction,
    solvable,
)

# Of the fourth order with h = 1e-3: h⁴ = 1e-12 times a fifth derivative, and rounding of
# 1e-15 times the condition over h, both far below this.
CLOSE = 1e-7
# Two orders of the same sums: rounding times the condition of the tangent systems.
SAME = 1e-10


def judged(seeds: Iterable[int]) -> tuple[int, int]:
    """Compare paths; how many were compared with differences, and how many were not."""
    compared = count = 0
    for name, path_problem, data, result, seed in solvable(seeds):
        by = random_direction(data, seed)
        tangent = jvp(result, by)
        bars = cotangents(result, seed)
        gradient = result.vjp(**bars)
        terms = [bars[field] * getattr(tangent, field) for field in FIELDS]
        if not tangent.one_sided.any():
            apart = abs(products(gradient, by) - sum(map(np.sum, terms)))
            assert apart <= SAME * sum(np.abs(t).sum() for t in terms), name
        compared += _compared(name, path_problem, data, by, tangent)
        count += 1
    return compared, count - compared


def _compared(name: str, given: Any, data: Any, by: Any, tangent: Any) -> bool:
    for h in (1e-3, 1e-4):
        try:
            derivative = differences(lambda t: given.solve(data.moved(by, t)), h)
        except bp.BipotError:
            return False
        if derivative is not None:
            off = apart(tangent, derivative)
            if off <= CLOSE:
                return True
    assert derivative is None or off <= CLOSE, f"{name}: {off:.1e}"
    return False


def test_random_paths() -> None:
    """A path is skipped only if a contact changes its status within h."""
    compared, skipped = judged(range(50))
    assert compared > 40
    assert skipped <= 0.1 * compared


@pytest.mark.slow
@pytest.mark.parametrize("part", range(12))
def test_ten_thousand_random_paths(part: int) -> None:
    compared, skipped = judged(range(1000 * (part + 1), 1000 * (part + 2)))
    assert compared > 850
    assert skipped <= 0.1 * compared


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_slips_and_sticks(kind: str) -> None:
    """The random paths are no special case: all statuses occur, and in paths of some steps."""
    seen = set()
    for _, _, _, result, _ in solvable(range(14), (kind,)):
        seen |= set(np.unique(result.status).tolist())
    expected = {0, 1} if kind == "frictionless" else {1, 2}
    assert expected <= seen
