"""How the contacts respond to reactions: the linear part of the derivatives of a step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Integers, Ints
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.results.solution import Computed, Step, recover_displacements
from bipot_rs.contact.sensitivity.laws import Laws

# Below this multiple of the rounding error of a sum of as many terms as unknowns, the
# reciprocal condition of a system is rounding.
_ROUNDING = 8 * np.finfo(float).eps


class FactoredSystem(Protocol):
    """A system that is ready for right sides."""

    @property
    def reciprocal_condition(self) -> float:
        """Estimate of the reciprocal condition; 1 if it is not known."""

    def solve(self, right: Floats, /) -> Floats:
        """Solve for right sides, a row each."""

    def solve_transposed(self, right: Floats, /) -> Floats:
        """Solve with the transposed matrix for right sides, a row each."""


class ContactResponse(Protocol):
    """``dv = W dr + R da``, of some contacts or of all."""

    motions: int  # number of rigid motions, the length of `da`
    diagonal: Floats  # (n_c, d): diagonal of W; zero at contacts that W is not known of

    def factor_laws(self, laws: Laws) -> FactoredSystem | None:
        """The system (33) of these laws; None if it is singular."""

    def find_relative_motion(self, reaction: Floats, rigid: Floats) -> Floats:
        """``W r + R a``, ``(n_c, d)``; zero at contacts that W is not known of."""

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""


class PathResponse(ContactResponse, Protocol):
    """The response of the bodies of a load path."""

    @property
    def whole(self) -> bool:
        """Whether `find_relative_motion` is known of all contacts."""
        return True

    def stiffness(self) -> Any:
        """K, sparse, without the entries between prescribed degrees of freedom."""

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements that vanish where W is not known."""

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``dq (n_c, d)`` without gaps, zero where W is not known, and ``e``."""

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of loads, prescribed displacements, reactions and rigid motions."""

    def measure_work(self, steps: Sequence[Step], fixed: Ints, /) -> Iterator[float]:
        """Work of loads and prescribed displacements of each step, without cancellation."""
        stiffness = self.stiffness()
        for first in range(0, len(steps), tuning.DISPLACEMENTS_TOGETHER):
            # The displacements are not kept.
            block = [
                replace(step, computed=Computed(step.computed.displacement))
                for step in steps[first : first + tuning.DISPLACEMENTS_TOGETHER]
            ]
            recover_displacements(block)
            for step in block:
                u = step.displacement
                yield sum_work(np.asarray(step.load), u, fixed, lambda y: stiffness @ y)


@dataclass(frozen=True)
class System:
    """The factored system (33) of one step, and its transpose (34)."""

    laws: Laws
    core: FactoredSystem
    shape: tuple[int, int]

    def solve(self, right: Floats, balance: Floats) -> tuple[Floats, Floats]:
        """``dr (n_c, d)`` and ``da`` of right sides ``(m, d)`` and ``(k,)``."""
        return self._split_solution(self.core.solve(_join(right, balance)))

    def solve_transposed(self, moved: Floats, motion: Floats) -> tuple[Floats, Floats]:
        """Multipliers ``w (n_c, d)`` of the laws and ``b`` of the rigid motions.

        The right side is given for all contacts, ``(n_c, d)``; that of open ones has no
        effect.
        """
        at_contacts = moved[self.laws.contacts]
        return self._split_solution(
            self.core.solve_transposed(_join(at_contacts, motion))
        )

    def _split_solution(self, solved: Floats) -> tuple[Floats, Floats]:
        m, d = len(self.laws.contacts), self.shape[1]
        whole = np.zeros(self.shape)
        whole[self.laws.contacts] = solved[0, : m * d].reshape(m, d)
        return whole, solved[0, m * d :]


def make_system(
    response: ContactResponse, laws: Laws, shape: tuple[int, int]
) -> System:
    """The system of these laws.

    Raises `NotDifferentiableError`: it is singular.
    """
    core = response.factor_laws(laws)
    order = laws.contacts.size * shape[1] + response.motions
    if core is None or core.reciprocal_condition <= _ROUNDING * max(order, 1):
        raise NotDifferentiableError(
            "the linearised contact problem is singular: the reactions are not determined "
            "by the loads (redundant supports), or a small change of the data ends the "
            "equilibrium; make the supports statically determinate, or add friction or "
            "stiffness"
        )
    return System(laws, core, shape)


def make_matrix(start: Integers, column: Integers, values: Floats) -> CsrMatrix:
    """A square sparse matrix."""
    from scipy.sparse import csr_array

    n = len(start) - 1
    matrix: CsrMatrix = csr_array((values, column, start), shape=(n, n))
    return matrix


def sum_work(
    load: Floats, u: Floats, fixed: Ints, multiply: Callable[[Floats], Floats]
) -> float:
    """``Σ |f u|`` over free, ``Σ |u (K u_free)|`` over prescribed degrees of freedom."""
    free = u.copy()
    free[fixed] = 0.0
    held = u[fixed] * multiply(free)[fixed]
    return float(np.abs(load * free).sum() + np.abs(held).sum())


def _join(rows: Floats, rest: Floats) -> Floats:
    return np.concatenate([rows.ravel(), rest])[None]


class CondensedResponse(PathResponse):
    """The response of bodies that the direct engine condensed.

    ``core``: the bodies and the contacts that close in the path.
    ``members (m,)``: contacts that W is known of.
    """

    def __init__(self, core: _core.Condensed, closed: Ints, contacts: int) -> None:
        self.core = _core.TangentView(core, np.asarray(closed, np.int64))
        self.members = self.core.members
        self._stiffness = core.stiffness
        diagonal_of_core, modes = self.core.diagonal, self.core.modes
        self.motions, self._modes = len(modes), modes
        self.diagonal = np.zeros((contacts, diagonal_of_core.shape[1]))
        self.diagonal[self.members] = diagonal_of_core
        self._place = np.full(contacts, -1)
        self._place[self.members] = np.arange(len(self.members))
        self._felt = (
            np.abs(modes).max(axis=0, initial=0.0).reshape(diagonal_of_core.shape) > 0
        )

    @property
    def whole(self) -> bool:
        """Whether W is known of all contacts."""
        return len(self.members) == len(self._place)

    def stiffness(self) -> Any:
        """K, sparse, without the entries between prescribed degrees of freedom."""
        return make_matrix(*self._stiffness())

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        can_move: Bools = self.diagonal > 0
        can_move[self.members] |= self._felt
        return can_move

    def factor_laws(self, laws: Laws) -> _core.TangentSystem | None:
        """The system (33) of these laws; None if it is singular."""
        contacts, by_r, by_v = laws.parts
        return self.core.system(self._place[contacts], by_r, by_v)

    def find_relative_motion(self, reaction: Floats, rigid: Floats) -> Floats:
        """``W r + R a``, ``(n_c, d)``; zero at contacts that W is not known of."""
        return self._spread_members(
            self.core.product(self._take_members(reaction), rigid)
        )

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements that vanish where W is not known."""
        return self._modes @ v[self.members].ravel()

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``B K⁻¹ f (n_c, d)``, zero at other contacts, and ``e``."""
        q, e = self.core.free_part(load, prescribed)
        return self._spread_members(q), e

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of loads, prescribed displacements, reactions and rigid motions."""
        by_step = [
            (f, u, self._take_members(r), np.ascontiguousarray(a))
            for f, u, r, a in states
        ]
        return self.core.displacements(by_step)

    def _take_members(self, reaction: Floats) -> Floats:
        return np.ascontiguousarray(reaction[self.members])

    def _spread_members(self, values: Floats) -> Floats:
        whole = np.zeros_like(self.diagonal)
        whole[self.members] = values
        return whole


class ReducedResponse:
    """The response of a reduced problem, whose ``W`` may be asymmetric."""

    def __init__(
        self,
        core: _core.Reduced,
        W: Floats | CsrMatrix,
        shape: tuple[int, int],
        modes: Floats | CsrMatrix,
    ) -> None:
        self._core, self._W, self._shape, self._modes = core, W, shape, modes
        self.motions = modes.shape[1]
        self.diagonal = np.asarray(W.diagonal(), float).reshape(shape)

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        sizes: Any = abs(self._modes)
        felt = np.asarray(sizes.sum(axis=1)).reshape(self._shape) > 0
        can_move: Bools = (self.diagonal > 0) | felt
        return can_move

    def factor_laws(self, laws: Laws) -> _core.TangentSystem | None:
        """The system (33) of these laws; None if it is singular."""
        return self._core.tangent(*laws.parts)

    def find_relative_motion(self, reaction: Floats, rigid: Floats) -> Floats:
        """``W r + R a``, ``(n_c, d)``."""
        v = self._W @ reaction.ravel() + self._modes @ rigid
        return np.asarray(v, np.float64).reshape(self._shape)


class Stalled(Exception):
    """The linear solver does not converge."""


@dataclass(frozen=True)
class KrylovSystem:
    """A system (33) whose right sides take a Krylov solve each."""

    # Solves for a right side, with the matrix or its transpose: `dr` of the contacts and `dy`.
    solve_row: Callable[[Floats, bool], Floats]
    # Not known; the solver does not converge where it is small.
    reciprocal_condition: float = 1.0

    def solve(self, right: Floats, /) -> Floats:
        """Solve for right sides, a row each."""
        return np.stack([self.solve_row(row, False) for row in right])

    def solve_transposed(self, right: Floats, /) -> Floats:
        """Solve with the transposed matrix for right sides, a row each."""
        return np.stack([self.solve_row(row, True) for row in right])


class DisplacementResponse(PathResponse):
    """The response of bodies that the iterative engine solved.

    The displacements take the place of the rigid motions: ``dv = R dy``, with ``W = 0``, and the
    balance of forces ``Rᵀ dr - A dy + df = 0`` in place of ``Rᵀ dr + de = 0``. So the system (33)
    has the displacements among its unknowns, and nothing of it is factored.

    ``motions``: number of unknown displacements, which are the length of ``da``.
    ``diagonal (n_c, d)``: estimate of the diagonal of W.
    """

    def __init__(self, core: _core.Primal) -> None:
        self._core, self._variables = _core.PrimalTangent(core), core.variables()
        self.motions = self._core.order
        self.diagonal = self._variables.diagonal

    def stiffness(self) -> Any:
        """K, sparse, with the zeros of the blocks of its nodes."""
        return make_matrix(*self._core.stiffness())

    def movable(self) -> Bools:
        """Components that a reaction moves, ``(n_c, d)``."""
        return self.diagonal > 0

    def factor_laws(self, laws: Laws) -> KrylovSystem:
        """The system (33) of these laws.

        Raises `Stalled`: one of them determines nothing.
        """
        linearised = _core.LinearisedLaws.of(self._variables, *laws.parts)
        if linearised is None:
            raise Stalled

        def solve_row(right: Floats, transposed: bool) -> Floats:
            solution = self._core.solve(linearised, right, transposed)
            if solution is None:
                raise Stalled
            return solution

        return KrylovSystem(solve_row)

    def find_relative_motion(self, _reaction: Floats, rigid: Floats) -> Floats:
        """``R y``, ``(n_c, d)``."""
        return self._variables.moved(np.ascontiguousarray(rigid))

    def work(self, v: Floats) -> Floats:
        """``Rᵀ v`` of relative displacements."""
        return self._variables.work(np.ascontiguousarray(v))

    def free(self, load: Floats, prescribed: Floats) -> tuple[Floats, Floats]:
        """``B_f u_f (n_c, d)`` of prescribed displacements, and forces on the unknowns."""
        return self._variables.offsets(prescribed), self._core.force(load, prescribed)

    def displacements(
        self, states: list[tuple[Floats, Floats, Floats, Floats]]
    ) -> Floats:
        """``u`` of unknowns and prescribed displacements."""
        by_step = [
            self._core.displacement(np.ascontiguousarray(y), moved)
            for _, moved, _, y in states
        ]
        return np.stack(by_step)
