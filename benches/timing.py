"""Seconds of a function: the minimum of several calls."""

from collections.abc import Callable
from time import perf_counter
from typing import TypeVar

T = TypeVar("T")


def fastest(calls: int, work: Callable[[], T]) -> tuple[float, T]:
    """Minimum seconds of a number of calls, and the last result."""
    best = float("inf")
    for _ in range(calls):
        start = perf_counter()
        result = work()
        best = min(best, perf_counter() - start)
    return best, result


def repeated(work: Callable[[], T]) -> tuple[float, T]:
    """Minimum seconds and the last result; work under 20 ms is called up to three times."""
    seconds: list[float] = []
    while not seconds or (len(seconds) < 3 and sum(seconds) < 0.02):
        spent, result = fastest(1, work)
        seconds.append(spent)
    return min(seconds), result
