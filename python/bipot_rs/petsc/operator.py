"""Products with ``A = Tᵀ K T``, and with the matrix of a Newton step.

Values at the nodes of the contacts are the same on every rank.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import (
    Communicator,
    CsrMatrix,
    Floats,
    Integers,
    Ints,
    PetscMat,
    PetscVec,
)
from bipot_rs.petsc.own_rows import OwnRows, scatter


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


class Operator:
    """``K`` in the variables of the contacts.

    Unknowns are a Vec in the numbering of ``K``: the relative displacement of a contact
    stands in the place of the displacement of its node. Prescribed places are zero.

    ``K, variables, interface``: the stiffness, the contacts, and their places.
    ``fixed``: own rows that are prescribed.
    ``d``: number of degrees of freedom of a node.
    ``PETSc``: the module.
    ``comm``: the communicator of ``K``, of mpi4py.
    ``products``: number of products with ``K`` so far.
    """

    def __init__(
        self,
        K: PetscMat,
        variables: _core.ContactVariables,
        interface: SharedPlaces,
        fixed: Ints,
        d: int,
        PETSc: ModuleType,
    ) -> None:
        self.K, self.variables, self.interface = K, variables, interface
        self.fixed, self.d, self.PETSc = fixed, d, PETSc
        self.comm = K.comm.tompi4py()
        self.products = 0
        self._u, self._f = K.createVecs()

    def make_zeros(self) -> PetscVec:
        """A new Vec of zeros."""
        vector = self.K.createVecRight()
        vector.set(0.0)
        return vector

    def make_vector(self, own: Floats) -> PetscVec:
        """A new Vec with these values in the own rows."""
        vector = self.make_zeros()
        vector.array[:] = own
        return vector

    def to_displacements(self, y: PetscVec) -> PetscVec:
        """``u = T y``, with zeros at prescribed degrees of freedom."""
        u = y.copy()
        self.interface.change(u, self.variables.to_displacements)
        return u

    def to_unknowns(self, u: PetscVec) -> PetscVec:
        """``y = T⁻¹ u``."""
        y = u.copy()
        y.array[self.fixed] = 0.0
        self.interface.change(y, self.variables.to_local)
        return y

    def to_local_forces(self, f: PetscVec) -> None:
        """``Tᵀ f`` without the prescribed rows, in place."""
        f.array[self.fixed] = 0.0
        self.interface.change(f, self.variables.forces_to_local)

    def multiply(self, y: PetscVec) -> PetscVec:
        """``A y``."""
        product = self.K.createVecLeft()
        self.K.mult(self.to_displacements(y), product)
        self.products += 1
        self.to_local_forces(product)
        return product

    def multiply_newton(
        self,
        tangent: _core.ContactTangent,
        x: PetscVec,
        y: PetscVec,
        springs: SlidingSprings | None = None,
        *,
        transposed: bool = False,
    ) -> None:
        """``y = J x`` without the rows and columns that `tangent` holds.

        With ``springs`` the product is that of the symmetric part of ``J``; ``transposed``,
        that of ``Jᵀ``.
        """
        x.copy(self._u)
        self._u.array[self.fixed] = 0.0
        at_places = self.interface.gather(x)
        tangent.clear(at_places)
        moved = at_places.copy()
        if transposed:
            tangent.pull(moved)
        self.variables.to_displacements(moved)
        self.interface.write(moved, self._u)
        self.K.mult(self._u, y)
        self.products += 1
        y.array[self.fixed] = 0.0
        forces = self.interface.gather(y)
        self.variables.forces_to_local(forces)
        if springs is not None:
            springs.add_forces(at_places, forces)
        elif transposed:
            tangent.add_transposed(at_places, forces)
        else:
            tangent.add_laws(at_places, forces)
        tangent.clear(forces)
        self.interface.write(forces, y)

    def set_known(self, tangent: _core.ContactTangent, x: PetscVec) -> None:
        """Set the held places to their known values, and prescribed rows to zero."""
        # The places have the variables of the contacts, among which others are prescribed.
        places = self.interface.gather(x)
        tangent.clear(places)
        x.array[self.fixed] = 0.0
        self.interface.write(places + tangent.known, x)

    def make_right_side(self, tangent: _core.ContactTangent, e: PetscVec) -> PetscVec:
        """The right side of a Newton step, from ``e = A y - f``."""
        shift = self.make_zeros()
        self.interface.write(tangent.known, shift)
        right = self.multiply(shift)
        moved = self.interface.gather(right)
        right.scale(-1.0)
        right.axpy(-1.0, e)
        right.array[self.fixed] = 0.0
        places = tangent.right_side(self.interface.gather(e), moved)
        self.interface.write(places, right)
        return right

    def measure_terms(self, y: PetscVec) -> tuple[float, Floats]:
        """Norm of ``|Tᵀ| |K| |T y|``, and its values at the places.

        It reads a copy of the own rows of ``K``.
        """
        from scipy.sparse import csr_array

        u = y.copy()
        places = self.interface.gather(y)
        self.variables.terms_of_displacements(places)
        u.abs()
        self.interface.write(places, u)
        rows = OwnRows.of(self.K)
        outside = rows.outside()
        everywhere = scatter(self.K, outside, self.PETSc)(u.array_r.copy())
        shape = rows.count, len(everywhere)
        np.abs(rows.values, out=rows.values)
        parts = rows.values, rows.local(outside), rows.pointer
        sizes: CsrMatrix = csr_array(parts, shape=shape)
        terms = self.make_vector(sizes @ everywhere)
        terms.array[self.fixed] = 0.0
        at_places = self.interface.gather(terms)
        self.variables.terms_of_forces(at_places)
        self.interface.write(at_places, terms)
        return terms.norm(), at_places


class SlidingSprings:
    """The symmetric part of the springs of sliding contacts, at the places."""

    def __init__(self, tangent: _core.ContactTangent, d: int) -> None:
        nodes, values = tangent.springs()
        self.places = d * nodes[:, None] + np.arange(d)
        self.blocks = values.reshape(-1, d, d)

    def list_entries(self) -> tuple[Ints, Ints, Floats]:
        """Rows, columns and values of the springs as a matrix on the places."""
        d = self.places.shape[1]
        row = np.repeat(self.places, d, axis=1).ravel()
        return row, np.tile(self.places, (1, d)).ravel(), self.blocks.ravel()

    def add_forces(self, x: Floats, forces: Floats) -> None:
        """Add the forces of displacements ``x`` to ``forces``."""
        forces[self.places] += np.einsum("ikl,il->ik", self.blocks, x[self.places])
