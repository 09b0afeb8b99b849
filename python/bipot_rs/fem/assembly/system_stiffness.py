"""Stiffness of all bodies with springs: whole, or rows of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import CsrMatrix, Ints
from bipot_rs.fem.bodies.body import NumberedBodies
from bipot_rs.fem.bodies.boundary import Spring, spring_stiffness
from bipot_rs.fem.bodies.elasticity import dofs_of, stiffness


def system_stiffness(
    bodies: NumberedBodies,
    springs: Sequence[Spring],
    nodes: Ints | None = None,
    rigid: Collection[str] = (),
) -> CsrMatrix:
    """K of (1), CSR ``(n, n)``, block diagonal and bitwise symmetric; or some of its rows.

    ``bodies, springs``: as in `Assembly`.
    ``nodes``: ascending numbers of nodes, counted body after body ``(m,)``: the result has
    their rows, ``(d m, n)``, with the bits of the whole K. The default is all nodes.
    ``rigid``: names of bodies that move as rigid ones, which only springs resist. Their own
    stiffness would leave its rounding in ``Tᵀ K T``.
    Raises `ValueError`: a body or surface of a spring does not exist, or a cell is folded.
    """
    owners = [bodies[spring.body] for spring in springs]
    dim, blocks = bodies.dim, []
    for numbered in bodies.values():
        body, wanted = numbered.body, None
        if nodes is not None:
            start, end = numbered.first // dim, numbered.span.stop // dim
            first, last = np.searchsorted(nodes, (start, end))
            wanted = nodes[first:last] - start
        size = body.points.size
        held = body.name in rigid
        block = sparse.csr_array((size, size)) if held else stiffness(body, wanted)
        for owner, spring in zip(owners, springs, strict=True):
            if owner is numbered:
                added = spring_stiffness(body, spring)
                rows = slice(None) if wanted is None else dofs_of(wanted, dim)
                block = block + added[rows]
        blocks.append(block)
    return _stack_blocks(blocks)


def _stack_blocks(blocks: Sequence[CsrMatrix]) -> CsrMatrix:
    """Block-diagonal CSR of the matrices of the bodies, entries in the same order."""
    if len(blocks) == 1:
        return blocks[0]
    rows, columns = np.cumsum([(0, 0)] + [block.shape for block in blocks], axis=0).T
    entries = np.cumsum([0] + [block.nnz for block in blocks])
    # One index type for all: mixed types are copied at each step.
    wide = np.int64 if max(columns[-1], entries[-1]) >= 2**31 else np.int32
    index = [
        np.add(block.indices, first, dtype=wide)
        for block, first in zip(blocks, columns[:-1], strict=True)
    ]
    start = [
        np.add(block.indptr[:-1], first, dtype=wide)
        for block, first in zip(blocks, entries[:-1], strict=True)
    ]
    made: CsrMatrix = sparse.csr_array(
        (
            np.concatenate([block.data for block in blocks]),
            np.concatenate(index),
            np.concatenate([*start, np.array(entries[-1:], dtype=wide)]),
        ),
        shape=(int(rows[-1]), int(columns[-1])),
    )
    return made
