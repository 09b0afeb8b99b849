"""Stiffness of the upper of two squares over that of the lower one."""

from collections.abc import Iterable, Iterator

import numpy as np

from studies import blocks
from studies.measure import Row, powers, row

VALUES = powers(-12, 12)


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Two squares that touch, and the same in one piece: columns with a closed form."""
    line = np.linspace(0, 1, 5)
    for bonded in (False, True):
        for value in values:
            case, closed = blocks.column([1.0, value], 0.3, (line, line), bonded=bonded)
            statuses = blocks.at_rest(case)
            name = "bonded" if bonded else "touching"
            yield row(name, value, case, closed, statuses=statuses)
