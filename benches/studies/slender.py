"""Slender bodies, and flat cells at the contact."""

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np

from bipot_rs import fem
from studies import blocks
from studies.exact import Array, Case
from studies.measure import Row, powers, row

SLENDER = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]
NEEDLES = powers(0, 6)


def slender(values: Iterable[float] = SLENDER) -> Iterator[Row]:
    """Rows of a beam, clamped at one end and pressed on a plane near the other."""
    for value in values:
        case, twin = blocks.twins(partial(beam, value))
        yield row("beam", value, case, twin=twin)
    for value in values:
        lines = np.linspace(0, 1 / value, 3), np.linspace(0, 1, 33)
        yield row("column", value, *blocks.column([1.0], 0.3, lines))


def beam(length: float, young: float) -> Case:
    """Beam of 32 by 2 cells. The clamped end is lowered, so that friction holds the other."""
    lines = [np.linspace(0, length, 33), np.linspace(0, 1, 3)]
    end = {0: (0.8 * length, length)}
    model = fem.assemble(
        [blocks.body(lines, 0.3, young)],
        [blocks.on_plane(2, within=end)],
        [fem.Support("block", "left", (0, 1))],
    )
    down = model.prescribed([(0.001 * length, -0.01 * length)])
    return blocks.case(model, prescribed=down)


def needles(values: Iterable[float] = NEEDLES) -> Iterator[Row]:
    """Rows of bodies with layers of flat cells at the contact."""
    for value in values:
        lines = np.linspace(0, 1, 5), layers(value)
        yield row("column", value, *blocks.column([1.0], 0.3, lines))
    for value in values:
        case, twin = blocks.twins(partial(needle_block, value))
        yield row("block", value, case, twin=twin)


def layers(aspect: float) -> Array:
    """Grid lines: three layers of cells 1/4 wide and of the given aspect, two thick layers."""
    return np.append(np.linspace(0, 0.75, 4) / aspect, [0.9, 1.0])


def needle_block(aspect: float, young: float) -> Case:
    """Block that sticks and slips on flat cells."""
    axes = [np.linspace(0, 2, 9), layers(aspect)]
    return blocks.pressed(axes, 0.3, young=young)
