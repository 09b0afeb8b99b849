"""Gaps from 1e-16 to a thousandth of the size of the body."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from bipot_rs import fem
from studies import blocks, exact
from studies.exact import EPS, Array, Case
from studies.measure import Answer, Row, answer, powers, row, solved

VALUES = powers(-16, -3)


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Rows of a block pressed by twice its gap, given or computed from coordinates.

    The third case has a different gap at each contact, and is moved aside.
    """
    for value in values:
        yield row("given", value, *closing(value))
    for value in values:
        # The height of the plane, slightly below 1, has a rounding error of at most ε/4.
        case, closed = closing(value, measured=True)
        yield row("from coordinates", value, case, closed, data=EPS / (4 * value))
    whole = answer(exact.solve(*known(uneven(1.0))))
    for value in values:
        case = uneven(value)
        closed = Answer(*(value * x for x in whole))
        yield row("uneven", value, case, closed)


def uneven(gap: float) -> Case:
    """Block whose load and solution are proportional to the gap."""
    axes = [np.linspace(0, 2, 9), np.linspace(0, 1, 5)]
    case = blocks.pressed(axes, 0.3, moved=(0.4 * gap, -gap))
    case.gap[:, 0] = gap * (np.arange(9) % 3)
    return case


def known(case: Case) -> tuple[Case, NDArray[np.int8], Array]:
    """Case with computed statuses and slip, which `exact.solve` tests."""
    _, step = solved(case)
    return case, step.status, step.slip


def closing(gap: float, *, measured: bool = False) -> tuple[Case, Answer]:
    """Block in uniaxial strain whose top is lowered by twice the gap.

    With `measured` the gap is the difference of two heights of size 1.
    """
    young, nu, line = 1.0, 0.3, np.linspace(0, 1, 5)
    height = 1.0 - gap if measured else 1.0
    model = fem.assemble(
        [blocks.body([line, 1 + line], nu, young)],
        [blocks.on_plane(2, height=height)],
        [
            fem.Support("block", "left", (0,)),
            fem.Support("block", "right", (0,)),
            fem.Support("block", "top", (1,)),
        ],
    )
    down = model.prescribed([(0.0,), (0.0,), (-2 * gap,)])
    case = blocks.case(model, prescribed=down)
    if not measured:
        case.gap[:, 0] = gap
    stress = gap * young * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    r = np.zeros_like(case.gap)
    r[:, 0] = stress * model.area
    u = np.zeros((len(model.nodes), 2))
    u[:, 1] = -gap * model.nodes[:, 1]
    return case, Answer(r, np.zeros_like(r), u.ravel())
