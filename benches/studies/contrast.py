"""Contrast of stiffness: the upper of two squares and the lower one."""

from collections.abc import Iterable, Iterator

import numpy as np

from studies import blocks
from studies.measure import Row, powers, row

VALUES = powers(-12, 12)


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Rows of two squares, touching and bonded: columns with a closed form."""
    line = np.linspace(0, 1, 5)
    for bonded in (False, True):
        for value in values:
            case, closed = blocks.column([1.0, value], 0.3, (line, line), bonded=bonded)
            statuses = blocks.at_rest(case)
            name = "bonded" if bonded else "touching"
            yield row(name, value, case, closed, statuses=statuses)
