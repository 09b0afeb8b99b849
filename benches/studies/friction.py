"""Friction coefficients from 0 to 1e8."""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy import sparse

from studies import blocks
from studies.exact import Case
from studies.measure import Answer, Row, powers, row

VALUES = [0.0, *powers(-8, -1), 0.3, *powers(0, 8)]


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Rows of a block that sticks at large μ, and of a contact that slides for every μ."""
    axes = [np.linspace(0, 2, 9), np.linspace(0, 1, 5)]
    for value in values:

        def make(young: float, mu: float = value) -> Case:
            return blocks.pressed(axes, 0.3, mu=mu, young=young)

        case, twin = blocks.twins(make)
        yield row("block", value, case, twin=twin)
    for value in values:
        yield row("one contact that slides", value, *slider(value))


def slider(mu: float) -> tuple[Case, Answer]:
    """Contact whose slip draws it into the obstacle.

    With ``K = [[2, 1/2], [1/2, 1]]``, ``f = (0.1, 1)`` no other status fits, for any μ:
    ``u_t = (1 + μ/10)/(1 + μ/2)``, ``r_n = 0.4/(1 + μ/2)``, ``r_t = -μ r_n``.
    """
    r_n, u_t = 0.4 / (1 + mu / 2), (1 + mu / 10) / (1 + mu / 2)
    v = np.array([[0.0, u_t]])
    case = Case(
        sparse.csr_array(np.array([[2.0, 0.5], [0.5, 1.0]])),
        sparse.eye_array(2, format="csr"),
        np.array([0.1, 1.0]),
        np.zeros((1, 2)),
        np.array([mu]),
        np.zeros(0, np.int64),
        np.zeros(0),
    )
    return case, Answer(np.array([[r_n, -mu * r_n]]), v, v[0])
