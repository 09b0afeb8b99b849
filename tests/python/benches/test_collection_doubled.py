"""Sums and products in twice the precision, against exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from collection.doubled import Pair, add, exactly, minus, product, times
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
# Two roundings of the lower part for each operation.
UNIT = Fraction(2) ** -104


def exact(a: Pair) -> list[Fraction]:
    return [Fraction(h) + Fraction(low) for h, low in zip(*a, strict=True)]


def drawn(seed: int, n: int = 40) -> Pair:
    rng = np.random.default_rng(seed)
    high = rng.standard_normal(n) * 10.0 ** rng.integers(-8, 8, n)
    return high, high * 2.0**-54 * rng.uniform(-1, 1, n)


@pytest.mark.parametrize("seed", range(4))
def test_products_and_sums_have_twice_the_digits(seed: int) -> None:
    a, b = drawn(seed), drawn(100 + seed)
    for computed, x, y in zip(exact(times(a, b)), exact(a), exact(b), strict=True):
        assert abs(computed - x * y) <= 8 * UNIT * abs(x * y)
    for computed, x, y in zip(exact(add(a, b)), exact(a), exact(b), strict=True):
        # A sum that cancels keeps the digits of its terms.
        assert abs(computed - x - y) <= 4 * UNIT * (abs(x) + abs(y))
    assert exact(minus(a)) == [-x for x in exact(a)]


@pytest.mark.parametrize("seed", range(3))
def test_a_product_with_a_matrix_that_cancels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = np.where(rng.random((30, 40)) < 0.2, rng.standard_normal((30, 40)), 0.0)
    whole[7] = 0.0  # a row without entries
    A, x = sparse.csr_array(whole), drawn(seed)
    numbers = exact(x)
    for i, computed in enumerate(exact(product(A, x))):
        terms = [Fraction(whole[i, j]) * numbers[j] for j in range(40)]
        assert abs(computed - sum(terms)) <= 100 * UNIT * sum(map(abs, terms))
    empty = product(sparse.csr_array((3, 0)), exactly(np.zeros(0)))
    assert exact(empty) == [0, 0, 0]
