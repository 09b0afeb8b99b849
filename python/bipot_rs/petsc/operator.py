"""Products with ``A = Tᵀ K T``, and with the matrix of a Newton step."""

from __future__ import annotations

from types import ModuleType

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Ints, PetscMat, PetscVec
from bipot_rs.petsc.interface import Interface
from bipot_rs.petsc.own_rows import OwnRows, scatter


class Operator:
    """``K`` in the variables of the contacts.

    Unknowns are a Vec in the numbering of ``K``: the relative displacement of a contact
    stands in the place of the displacement of its node. Prescribed places are zero.

    Attributes
    ----------
    K, variables, interface
        The stiffness, the contacts, and their places.
    fixed
        Own rows that are prescribed.
    products
        Number of products with ``K`` so far.
    """

    def __init__(
        self,
        K: PetscMat,
        variables: _core.ContactVariables,
        interface: Interface,
        fixed: Ints,
        PETSc: ModuleType,
    ) -> None:
        self.K, self.variables, self.interface, self.fixed = (
            K,
            variables,
            interface,
            fixed,
        )
        self.products = 0
        self._PETSc = PETSc
        self._u, self._f = K.createVecs()

    def zeros(self) -> PetscVec:
        """A new Vec of zeros."""
        made = self.K.createVecRight()
        made.set(0.0)
        return made

    def vector(self, own: Floats) -> PetscVec:
        """A Vec with these values in the own rows."""
        made = self.zeros()
        made.array[:] = own
        return made

    def displacements(self, y: PetscVec) -> PetscVec:
        """``u = T y``, with zeros at prescribed degrees of freedom."""
        u = y.copy()
        places = self.interface.gather(y)
        self.variables.to_displacements(places)
        self.interface.write(places, u)
        return u

    def unknowns(self, u: PetscVec) -> PetscVec:
        """``y = T⁻¹ u``."""
        y = u.copy()
        y.array[self.fixed] = 0.0
        places = self.interface.gather(y)
        self.variables.to_local(places)
        self.interface.write(places, y)
        return y

    def forces(self, f: PetscVec) -> None:
        """``Tᵀ f`` without the prescribed rows, in place."""
        f.array[self.fixed] = 0.0
        places = self.interface.gather(f)
        self.variables.forces_to_local(places)
        self.interface.write(places, f)

    def product(self, y: PetscVec) -> PetscVec:
        """``A y``."""
        made = self.K.createVecLeft()
        self.K.mult(self.displacements(y), made)
        self.products += 1
        self.forces(made)
        return made

    def masked(
        self,
        tangent: _core.ContactTangent,
        x: PetscVec,
        y: PetscVec,
        springs: Springs | None = None,
        *,
        transposed: bool = False,
    ) -> None:
        """``y = J x`` without the rows and columns that `tangent` holds.

        With ``springs`` the product is that of the symmetric part of ``J``; ``transposed``,
        that of ``Jᵀ``.
        """
        x.copy(self._u)
        self._u.array[self.fixed] = 0.0
        given = self.interface.gather(x)
        tangent.clear(given)
        moved = given.copy()
        if transposed:
            tangent.pull(moved)
        self.variables.to_displacements(moved)
        self.interface.write(moved, self._u)
        self.K.mult(self._u, y)
        self.products += 1
        y.array[self.fixed] = 0.0
        found = self.interface.gather(y)
        self.variables.forces_to_local(found)
        if springs is not None:
            springs.add(given, found)
        elif transposed:
            tangent.add_transposed(given, found)
        else:
            tangent.add_laws(given, found)
        tangent.clear(found)
        self.interface.write(found, y)

    def add_known(self, tangent: _core.ContactTangent, x: PetscVec) -> None:
        """Set the held places to their known values."""
        x.array[self.fixed] = 0.0
        places = self.interface.gather(x)
        tangent.clear(places)
        self.interface.write(places + tangent.known, x)

    def right_side(self, tangent: _core.ContactTangent, e: PetscVec) -> PetscVec:
        """The right side of a Newton step, from ``e = A y - f``."""
        known = self.zeros()
        self.interface.write(tangent.known, known)
        right = self.product(known)
        moved = self.interface.gather(right)
        right.scale(-1.0)
        right.axpy(-1.0, e)
        right.array[self.fixed] = 0.0
        places = tangent.right_side(self.interface.gather(e), moved)
        self.interface.write(places, right)
        return right

    def terms(self, y: PetscVec) -> tuple[float, Floats]:
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
        everywhere = scatter(self.K, outside, self._PETSc)(u.array_r.copy())
        shape = rows.count, len(everywhere)
        np.abs(rows.values, out=rows.values)
        parts = rows.values, rows.local(outside), rows.pointer
        found = self.zeros()
        found.array[:] = csr_array(parts, shape=shape) @ everywhere
        found.array[self.fixed] = 0.0
        at = self.interface.gather(found)
        self.variables.terms_of_forces(at)
        self.interface.write(at, found)
        return found.norm(), at


class Springs:
    """The symmetric part of the springs of sliding contacts, at the places."""

    def __init__(self, tangent: _core.ContactTangent, d: int) -> None:
        nodes, values = tangent.springs()
        self.places = d * nodes[:, None] + np.arange(d)
        self.blocks = values.reshape(-1, d, d)

    def add(self, x: Floats, out: Floats) -> None:
        """Add the forces of displacements ``x`` to ``out``."""
        out[self.places] += np.einsum("ikl,il->ik", self.blocks, x[self.places])
