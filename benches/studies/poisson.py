"""Poisson's ratio near 1/2."""

from collections.abc import Iterable, Iterator

import numpy as np

from studies import blocks
from studies.exact import Case
from studies.measure import Row, powers, row

VALUES = [0.2, 0.1, *powers(-12, -2)[::-1]]


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Rows at ``1/2 - value``: a column in closed form, a block that slips and sticks."""
    line = np.linspace(0, 1, 5)
    for value in values:
        case, closed = blocks.column([1.0], 0.5 - value, (line, line))
        statuses = blocks.at_rest(case)
        yield row("column", value, case, closed, statuses=statuses)
    axes = [np.linspace(0, 2, 9), np.linspace(0, 1, 5)]
    for value in values:
        if value >= 1e-8:

            def make(young: float, nu: float = 0.5 - value) -> Case:
                return blocks.pressed(axes, nu, young=young)

            case, twin = blocks.twins(make)
            yield row("block", value, case, twin=twin)
