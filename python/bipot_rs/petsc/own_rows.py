"""The rows of K that this rank owns, read once, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from bipot_rs._lib.types import Communicator, Floats, Integers, Ints, PetscMat

# As `_core`: pairs of K that differ by less are equal up to rounding.
ASYMMETRY = 1e-10


@dataclass(frozen=True)
class OwnRows:
    """A copy of the rows of this rank: row pointers, columns of all of K, and values.

    It takes as much memory as these rows and is dropped after it was read.
    """

    first: int
    pointer: Integers
    column: Integers
    values: Floats

    @classmethod
    def of(cls, K: PetscMat) -> OwnRows:
        """Copy the rows of this rank out of a matrix of PETSc."""
        first, _ = K.getOwnershipRange()
        return cls(first, *K.getValuesCSR())

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.pointer) - 1

    def check_finite(self) -> None:
        """Raise ``ValueError`` for an entry that is not finite."""
        wrong = ~np.isfinite(self.values)
        if wrong.any():
            at = int(np.argmax(wrong))
            row = self.first + int(np.searchsorted(self.pointer, at, side="right")) - 1
            entry = "NaN" if np.isnan(self.values[at]) else self.values[at]
            raise ValueError(
                f"K is not finite at row {row}, column {self.column[at]}: {entry}"
            )

    def outside(self) -> Ints:
        """Columns of these rows that other ranks own, ascending."""
        last = self.first + self.count
        away = (self.column < self.first) | (self.column >= last)
        return np.unique(self.column[away])

    def local(self, outside: Ints) -> Ints:
        """Columns in the numbering of own rows, then of those `outside`."""
        local_column = self.column - self.column.dtype.type(self.first)
        away = (local_column < 0) | (local_column >= self.count)
        local_column[away] = self.count + np.searchsorted(outside, self.column[away])
        return local_column


def scatter(
    K: PetscMat, outside: Ints, PETSc: ModuleType
) -> Callable[[Floats], Floats]:
    """Function that brings values of all rows to this rank: own ones, then those `outside`.

    Every rank must call it.
    """
    source = K.createVecRight()
    target = PETSc.Vec().createSeq(len(outside))
    where = PETSc.IS().createGeneral(
        outside.astype(PETSc.IntType), comm=PETSc.COMM_SELF
    )
    way = PETSc.Scatter().create(source, where, target, None)

    def bring(values: Floats) -> Floats:
        source.array[:] = values
        way.scatter(source, target)
        return np.concatenate([values, target.array_r])

    return bring


def check_symmetry(K: PetscMat, comm: Communicator) -> None:
    """Raise ``ValueError`` on all ranks if K is not symmetric.

    ``K x - Kᵀ x`` with numbers x from 1 to 2 in units of ``1/sqrt(K_ii)``, so that neither
    units nor a chance of signs decide.
    """
    diagonal = np.sqrt(np.abs(K.getDiagonal().array_r))
    scale = np.where(diagonal > 0, diagonal, 1.0)
    x, ours, theirs = K.createVecRight(), K.createVecRight(), K.createVecRight()
    first, last = K.getOwnershipRange()
    # A quasi-random sequence: the same numbers for any number of ranks.
    x.array[:] = (1 + np.modf(np.arange(first, last) * 0.6180339887498949)[0]) / scale
    K.mult(x, ours)
    K.multTranspose(x, theirs)
    off = np.abs(ours.array_r - theirs.array_r) / scale
    worst = (
        float(off.max(initial=0.0)),
        first + int(np.argmax(off)) if len(off) else 0,
    )
    most, row = max(comm.allgather(worst))
    # A sum of some hundred entries whose pairs each differ by rounding.
    if most > 100 * ASYMMETRY:
        raise ValueError(
            f"stiffness K is not symmetric at row {row}: entries of the row and of the "
            f"column differ by {most:.1e} of the diagonal"
        )
