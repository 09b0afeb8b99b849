"""Gaps from nothing to a thousandth of the size."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from bipot_rs import fem
from studies import blocks, exact
from studies.exact import EPS, Array, Case
from studies.measure import Answer, Row, answer, powers, row, solved

VALUES = powers(-16, -3)


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """A block pressed by twice its gap: the gap given, and made of coordinates.

    The third has gaps that differ from contact to contact, and is pushed aside.
    """
    for value in values:
        yield row("given", value, *closing(value))
    for value in values:
        # The height of the plane, a little below 1, is rounded by ε/4 at the most.
        case, closed = closing(value, measured=True)
        yield row("from coordinates", value, case, closed, data=EPS / (4 * value))
    whole = answer(exact.solve(*known(uneven(1.0))))
    for value in values:
        case = uneven(value)
        closed = Answer(*(value * x for x in whole))
        yield row("uneven", value, case, closed)


def uneven(gap: float) -> Case:
    """Everything in proportion to the gap, so is the answer."""
    axes = [np.linspace(0, 2, 9), np.linspace(0, 1, 5)]
    case = blocks.pressed(axes, 0.3, moved=(0.4 * gap, -gap))
    case.gap[:, 0] = gap * (np.arange(9) % 3)
    return case


def known(case: Case) -> tuple[Case, NDArray[np.int8], Array]:
    """With statuses and slip, which `exact.solve` then tests."""
    _, step = solved(case)
    return case, step.status, step.slip


def closing(gap: float, *, measured: bool = False) -> tuple[Case, Answer]:
    """Uniaxial strain of a block whose top is lowered by twice the gap.

    `measured`: the gap is the difference of two heights of size 1.
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
