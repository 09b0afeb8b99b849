"""The preconditioner of small problems: a factor of the core, on the first rank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Integers, PetscVec
from bipot_rs._lib.validation import csr, indices
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.petsc.linear.preconditioner import Preconditioner
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart
from bipot_rs.petsc.own_rows import OwnRows


class NotFactoredError(Exception):
    """The core cannot factor the symmetric part; all ranks raise it."""


class OneRankFactor(Preconditioner):
    """``P⁻¹`` for the symmetric part ``P`` of a Newton step, as a shell of PETSc.

    The first rank holds all of ``P`` and its factor. A product takes one message from each
    other rank and one to it, where multigrid takes some for each of its levels.
    """

    name = "factor on the first rank"

    def __init__(self, part: SymmetricPart) -> None:
        super().__init__(part)
        self._comm = part.P.comm.tompi4py()
        self._sizes = np.diff(part.P.getOwnershipRanges()).tolist()
        # Of the first rank.
        self._factor: _core.Condensed | None = None

    def update(self) -> None:
        """Factor the symmetric part.

        Raises `NotFactoredError`: it cannot be factored.
        """
        rows = OwnRows.of(self._part.P)
        arrays = rows.pointer, rows.column, rows.values
        every = self._comm.gather(arrays, root=0)
        reason = None if every is None else self._factor_rows(every)
        reason = self._comm.bcast(reason, root=0)
        if reason is not None:
            raise NotFactoredError(reason)

    def _factor_rows(
        self, parts: Sequence[tuple[Integers, Integers, Floats]]
    ) -> str | None:
        """Factor the rows of all ranks; the reason if that is not possible."""
        from scipy.sparse import csr_array, vstack

        n, d = sum(self._sizes), self._part.d
        rows = [
            csr_array((values, column, pointer), shape=(len(pointer) - 1, n))
            for pointer, column, values in parts
        ]
        stiffness = csr("P", vstack(rows).tocsr())
        # No contacts: those of the problem are springs and held places in P.
        none = csr("B", csr_array((0, n)))
        gap, law = np.zeros((0, d)), ContactLaw(np.zeros(0))
        fixed = indices("fixed", None, n)
        try:
            self._factor = _core.Condensed(
                stiffness.parts, none.parts, gap, law, fixed, None
            )
        except (FloatingBodyError, ValueError) as error:
            return str(error)
        return None

    def apply(self, _pc: object, b: PetscVec, x: PetscVec, /) -> None:
        """``x = P⁻¹ b``; PETSc calls it."""
        factor = self._factor
        first = self._comm.rank == 0
        whole = np.empty(sum(self._sizes) if first else 0)
        pieces = [whole, self._sizes] if first else None
        self._comm.Gatherv(np.ascontiguousarray(b.array_r), pieces, root=0)
        if factor is not None:
            none = np.zeros(0)
            state = whole, none, np.zeros((0, self._part.d)), none
            pieces = [
                np.ascontiguousarray(factor.displacements([state])[0]),
                self._sizes,
            ]
        part = np.empty(b.getLocalSize())
        self._comm.Scatterv(pieces, part, root=0)
        x.array[:] = part
