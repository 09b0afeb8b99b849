"""The matrix of the preconditioner: the symmetric part of that of a Newton step."""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Integers, Ints, PetscMat
from bipot_rs.petsc.operator import Operator, SlidingSprings


class SymmetricPart:
    """``P``: ``A = Tᵀ K T`` with the held rows and columns on the diagonal only, and springs.

    Its pattern never changes. For new statuses only the rows of contact nodes, and the
    columns of these nodes in other rows, are written again.

    ``P``: the matrix. It is the only other one of the size of ``K``.
    ``d``: number of degrees of freedom of a node.
    ``around``: values of ``A`` between places of the interface: rows, columns and values of
    those that this rank owns.
    """

    def __init__(
        self, A: PetscMat, operator: Operator, contact: Ints, shift: float
    ) -> None:
        """Take ``A`` over, with structural zeros on the diagonal where it has no entry.

        ``contact``: places of contact nodes, which may be held.
        ``shift``: relative to the diagonal, which is increased by it.
        """
        self.P, self.d = A, operator.d
        interface, comm = operator.interface, operator.comm
        first, _ = A.getOwnershipRange()
        diagonal = A.getDiagonal()
        size = np.abs(diagonal.array_r)
        # A number of the size of the others, whatever the units.
        sums = comm.allreduce(float(size.sum()))
        counts = comm.allreduce(int((size > 0).sum()))
        filled = np.where(size > 0, size, sums / counts if counts else 1.0)
        kept = diagonal.array_r.copy()
        kept[operator.fixed] = filled[operator.fixed]
        diagonal.array[:] = (1 + shift) * kept
        A.setDiagonal(diagonal)
        A.assemble()
        may_hold = np.zeros(len(interface.dofs) + 1, bool)
        may_hold[contact] = True
        around = _read_around(A, operator)
        inside = (around.of_row >= 0) & (around.of_column >= 0)
        self.around = (
            around.of_row[inside],
            around.of_column[inside],
            around.values[inside],
        )
        taken = may_hold[around.of_row] | may_hold[around.of_column]
        near = around.select(taken)
        self._entries = near
        self._rows, counts_of_rows = np.unique(near.row, return_counts=True)
        self._pointer = np.concatenate([[0], np.cumsum(counts_of_rows)])
        self._on_diagonal = np.flatnonzero(near.row == near.column)
        self._filled = filled[near.row[self._on_diagonal] - first]
        self._keys = near.of_row * (len(interface.dofs) + 1) + near.of_column
        self._order = np.argsort(self._keys)
        self._places = len(interface.dofs)

    def set_values(self, held: Bools, springs: SlidingSprings | None) -> None:
        """Write the values for held places and springs of sliding contacts."""
        dead = np.append(held, False)
        near = self._entries
        values = near.values.copy()
        values[dead[near.of_row] | dead[near.of_column]] = 0.0
        at = self._on_diagonal
        on_held = dead[near.of_row[at]]
        values[at[on_held]] = self._filled[on_held]
        if springs is not None:
            self._add_springs(values, springs)
        kind = near.column.dtype
        self.P.setValuesIJV(
            self._pointer.astype(kind),
            near.column,
            values,
            rowmap=self._rows.astype(kind),
        )
        self.P.assemble()

    def _add_springs(self, values: Floats, springs: SlidingSprings) -> None:
        """Add the springs of own contact nodes to the values."""
        i, j, added = springs.list_entries()
        keys = i * (self._places + 1) + j
        if not len(keys) or not len(self._keys):
            return
        at = np.searchsorted(self._keys, keys, sorter=self._order)
        at[at == len(self._keys)] = 0
        at = self._order[at]
        ours = self._keys[at] == keys
        values[at[ours]] += added[ours]


class _Entries(NamedTuple):
    """Entries of a matrix: rows, columns and values, and their places or -1."""

    row: Ints
    column: Ints
    values: Floats
    of_row: Ints
    of_column: Ints

    def select(self, wanted: Bools) -> _Entries:
        """Some of the entries."""
        return _Entries(*(part[wanted] for part in self))  # type: ignore[arg-type]


def _read_around(A: PetscMat, operator: Operator) -> _Entries:
    """Entries of the own rows with a place of the interface as row or column.

    A copy of all own rows would take as much memory as the matrix.
    """
    interface, PETSc = operator.interface, operator.PETSc
    first, last = A.getOwnershipRange()
    ours = interface.dofs[interface.own]
    others = np.setdiff1d(np.arange(first, last), ours, assume_unique=True)
    row, column, values = _read_entries(A, ours, None, PETSc)
    of_column = interface.find_places(column)
    # Columns of this part are in the order of the places.
    row_beside, place, values_beside = _read_entries(A, others, ours, PETSc)
    row = np.concatenate([row, row_beside])
    order = np.argsort(row, kind="stable")
    beside = interface.dofs[place].astype(column.dtype)
    of_column = np.concatenate([of_column, place])
    return _Entries(
        row[order],
        np.concatenate([column, beside])[order],
        np.concatenate([values, values_beside])[order],
        interface.find_places(row[order]),
        of_column[order],
    )


def _read_entries(
    A: PetscMat, rows: Ints, columns: Ints | None, PETSc: ModuleType
) -> tuple[Ints, Integers, Floats]:
    """Rows, columns and values of a part of a matrix; each rank names its own ones."""

    def numbers(of: Ints) -> object:
        return PETSc.IS().createGeneral(of.astype(PETSc.IntType), comm=A.comm)

    chosen = None if columns is None else numbers(columns)
    part = A.createSubMatrix(numbers(rows), chosen)
    pointer, column, values = part.getValuesCSR()
    part.destroy()
    return np.repeat(rows, np.diff(pointer)), column, values


def make_transformation(operator: Operator) -> PetscMat:
    """``T`` as a matrix of PETSc, with zeros in the rows of prescribed degrees of freedom.

    The diagonal is part of its pattern, and so of that of ``Tᵀ K T``.
    """
    from scipy.sparse import coo_array

    K, interface, PETSc = operator.K, operator.interface, operator.PETSc
    first, last = K.getOwnershipRange()
    count = last - first
    pointer, place, entries = operator.variables.transformation()
    whole = slice(pointer[interface.own.start], pointer[interface.own.stop])
    lengths = np.diff(pointer)[interface.own]
    others = np.ones(count)
    others[interface.rows] = 0.0
    row = np.concatenate([np.arange(count), np.repeat(interface.rows, lengths)])
    column = np.concatenate([np.arange(first, last), interface.dofs[place[whole]]])
    value = np.concatenate([others, entries[whole]])
    prescribed = np.zeros(count, bool)
    prescribed[operator.fixed] = True
    value[prescribed[row]] = 0.0
    # Zeros are kept; duplicates on the diagonal are added.
    T = coo_array((value, (row, column)), shape=(count, K.getSize()[1])).tocsr()
    T.sort_indices()
    kind = PETSc.IntType
    matrix: PetscMat = PETSc.Mat().createAIJ(
        K.getSizes(),
        bsize=operator.d,
        csr=(T.indptr.astype(kind), T.indices.astype(kind), T.data),
        comm=K.comm,
    )
    return matrix
