"""Number of contacts, from none to thousands."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from problems import Problem
from reference_solution import refine
from scipy import sparse

from studies import blocks
from studies.exact import Case
from studies.measure import Row, largest, named, row, solved

PLANE = [0, 1, 2, 3, 10, 30, 100, 300, 1000, 2000]
SPACE = [2, 4, 8, 16, 32, 54]
ISLANDS = [1, 10, 100]
# Cells up, and contacts of an island.
UP, EACH = 4, 100
# Nodes per side above which a solution in 3D is not compared with an exact one.
COMPARED = 16


def rows(
    plane: Iterable[int] = PLANE,
    islands: Iterable[int] = ISLANDS,
    space: Iterable[int] = SPACE,
) -> Iterator[Row]:
    """Rows of one block and of many blocks in 2D, of a sticking and a slipping one in 3D."""
    plane, space = list(plane), list(space)
    for count in plane:
        case, twin = blocks.twins(partial(strip, count))
        yield row("plane, one block", count, case, twin=twin)
    whole = None
    for count in islands:
        case, twin = blocks.twins(partial(many, count))
        first_row = row("plane, blocks of 100", EACH * count, case, twin=twin)
        # The blocks are equal, and so are their bounds relative to their own size.
        whole = whole or first_row
        limits = (whole.bound_r, whole.bound_v, whole.bound_u)
        yield replace(first_row, **named("bound", limits))
    for side in space:
        grid = np.linspace(0, side - 1, side)
        axes = [grid, grid, np.linspace(0, UP, UP + 1)]
        case, closed = blocks.sheared(axes, 1.0, 0.2)
        exactly = side <= COMPARED
        yield row("space, sticking", side**2, case, closed, exactly=exactly)
    for side in space:
        grid = np.linspace(0, side - 1, side)
        axes = [grid, grid, np.linspace(0, UP, UP + 1)]
        case = blocks.pressed(axes, 0.3, moved=(0.02, 0.01, -0.04))
        first_row = row("space, slipping", side**2, case, exactly=False)
        yield against_reduced(first_row, case) if side <= COMPARED else first_row


def strip(contacts: int, young: float) -> Case:
    """Block with contacts at a distance of 1 that slips at its ends."""
    across = np.arange(max(contacts, 2), dtype=float)
    axes = [across, np.linspace(0, UP, UP + 1)]
    case = blocks.pressed(axes, 0.3, moved=(0.02, -0.04), young=young)
    if contacts >= 2:
        return case
    # Fewer contacts than nodes of a cell: the other nodes are free.
    kept = 2 * contacts
    return Case(
        case.K,
        case.B[:kept],
        case.load,
        case.gap[:contacts],
        case.mu[:contacts],
        case.fixed,
        case.prescribed,
    )


def many(count: int, young: float) -> Case:
    """Independent blocks, each with its own prescribed motion."""
    block = strip(EACH, young)
    moved = 1 + np.arange(count) / max(count, 1)
    n = block.K.shape[0]
    return Case(
        sparse.block_diag([block.K] * count, format="csr"),
        sparse.block_diag([block.B] * count, format="csr"),
        np.tile(block.load, count),
        np.tile(block.gap, (count, 1)),
        np.tile(block.mu, count),
        np.concatenate([block.fixed + n * k for k in range(count)]),
        np.concatenate([block.prescribed * m for m in moved]),
    )


def against_reduced(found: Row, case: Case) -> Row:
    """Row with errors against the exact solution of ``v = W r + q`` with the computed W."""
    problem, step = solved(case)
    reduced = problem.reduced(case.load, case.prescribed)
    reduced_data = Problem(found.case, reduced.W, reduced.q, case.mu)
    right = refine(reduced_data, step.reaction, None, step.status)
    v = float(np.abs(step.relative_displacement - right.v).max())
    return replace(
        found,
        error_r=float(np.abs(step.reaction - right.r).max() / np.abs(right.r).max()),
        error_v=v / largest(step.displacement),
        statuses_right=right.trusted,
    )
