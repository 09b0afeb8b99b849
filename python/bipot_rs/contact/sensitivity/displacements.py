"""How the contacts respond to reactions, by Krylov solves in the displacements.

The displacements take the place of the rigid motions: ``dv = R dy``, with ``W = 0``, and the
balance of forces ``Rᵀ dr - A dy + df = 0`` in place of ``Rᵀ dr + de = 0``. So the system (33)
has the displacements among its unknowns, and nothing of it is factored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, CsrMatrix, Floats
from bipot_rs.contact.sensitivity.laws import Laws
from bipot_rs.contact.sensitivity.response import PathResponse, make_matrix


class Stalled(Exception):
    """The linear solver does not converge."""


@dataclass(frozen=True)
class KrylovSystem:
    """A system (33) whose right sides take a Krylov solve each."""

    core: _core.PrimalTangent
    laws: Laws
    # Not known; the solver does not converge where it is small.
    reciprocal_condition: float = 1.0

    def solve(self, right: Floats, /) -> Floats:
        """``dr`` of the contacts and ``dy``, a row for each right side."""
        return np.stack([self._solve_row(row, transposed=False) for row in right])

    def solve_transposed(self, right: Floats, /) -> Floats:
        """The same with the transposed matrix."""
        return np.stack([self._solve_row(row, transposed=True) for row in right])

    def _solve_row(self, right: Floats, *, transposed: bool) -> Floats:
        laws = self.laws
        d = laws.by_r.shape[1]
        by_r, by_v = laws.by_r.reshape(-1, d), laws.by_v.reshape(-1, d)
        solution = self.core.solve(laws.contacts, by_r, by_v, right, transposed)
        if solution is None:
            raise Stalled
        return solution


class DisplacementResponse(PathResponse):
    """The response of bodies that the iterative engine solved.

    ``motions``: number of unknown displacements, which are the length of ``da``.
    ``diagonal (n_c, d)``: estimate of the diagonal of W.
    """

    def __init__(self, core: _core.Primal) -> None:
        self._core = _core.PrimalTangent(core)
        self.motions = self._core.order
        self.diagonal = self._core.diagonal

    def stiffness(self) -> CsrMatrix:
        """K, sparse, with the zeros of the blocks of its nodes."""
        return make_matrix(*self._core.stiffness())

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        return self.diagonal > 0

    def factor_laws(self, laws: Laws) -> KrylovSystem:
        """The system (33) of these laws."""
        return KrylovSystem(self._core, laws)

    def find_relative_motion(self, _reaction: Floats, rigid: Floats) -> Floats:
        """``R y``, ``(n_c, d)``."""
        return self._core.moved(np.ascontiguousarray(rigid))

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements."""
        return self._core.work(np.ascontiguousarray(v))

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``B_f u_f (n_c, d)`` of prescribed displacements, and forces on the unknowns."""
        return self._core.free_part(load, prescribed)

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of unknowns and prescribed displacements."""
        by_step = [
            self._core.displacement(np.ascontiguousarray(y), moved)
            for _, moved, _, y in states
        ]
        return np.stack(by_step)
