"""Values at the nodes of the contacts, the same on every rank."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np

from bipot_rs._lib.types import Communicator, Floats, Integers, Ints, PetscVec


class SharedPlaces:
    """The degrees of freedom of all nodes that a contact touches.

    ``dofs``: number of each place of the interface in K, ascending: ``d`` places for a node.
    ``own``: the places that this rank owns.
    ``rows``: their rows in the part of this rank.
    ``gathers``: number of gathers so far. Each is one message of ``8 len(dofs)`` bytes to every
    rank.
    """

    def __init__(
        self, comm: Communicator, MPI: ModuleType, dofs: Ints, ranges: Ints
    ) -> None:
        # Rows of ranks follow each other, and so do the places.
        ends = np.searchsorted(dofs, ranges)
        self.dofs = dofs
        self.own = slice(int(ends[comm.rank]), int(ends[comm.rank + 1]))
        self.rows = dofs[self.own] - ranges[comm.rank]
        self.gathers = 0
        self._comm = comm
        self._layout = [np.diff(ends), ends[:-1], MPI.DOUBLE]

    def gather_own(self, own: Floats) -> Floats:
        """Values at all places, from those at the own ones: one column or several."""
        if own.ndim > 1:
            return np.column_stack([self.gather_own(column) for column in own.T])
        values = np.empty(len(self.dofs))
        self._comm.Allgatherv(np.ascontiguousarray(own), [values, *self._layout])
        self.gathers += 1
        return values

    def gather(self, vector: PetscVec) -> Floats:
        """Values of a Vec at all places."""
        return self.gather_own(vector.array_r[self.rows])

    def write(self, values: Floats, vector: PetscVec) -> None:
        """Set the own places of a Vec."""
        vector.array[self.rows] = values[self.own]

    def change(self, vector: PetscVec, operation: Callable[[Floats], None]) -> None:
        """Let an operation change the values of a Vec at all places, in place."""
        values = self.gather(vector)
        operation(values)
        self.write(values, vector)

    def find_places(self, dofs: Integers) -> Ints:
        """Place of each degree of freedom; -1 for one that is no place."""
        if not len(self.dofs):
            return np.full(len(dofs), -1)
        at: Ints = np.searchsorted(self.dofs, dofs)
        at[at == len(self.dofs)] = 0
        return np.where(self.dofs[at] == dofs, at, -1)
