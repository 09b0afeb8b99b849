"""Derivatives of a load path, forward (33) and backward (34) through its steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import CsrMatrix, Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.results.derivatives import (
    Adjoint,
    Cotangents,
    DataChange,
    Gradient,
    Tangent,
)
from bipot_rs.contact.sensitivity.directional import differentiate_step
from bipot_rs.contact.sensitivity.linear import LinearPath, StepChange
from bipot_rs.contact.sensitivity.model import (
    PathChange,
    check_changes,
    check_cotangent,
    reshape_gap_gradient,
)

if TYPE_CHECKING:
    from bipot_rs.contact.results.result import Result


def _solve_together(path: LinearPath, solve: Callable[[int, int], Floats]) -> Floats:
    """What ``solve(first, end)`` gives for all steps, of which some share each pass of a factor."""
    size = tuning.DISPLACEMENTS_TOGETHER
    blocks = [
        solve(k, min(k + size, end))
        for first, end in path.spans
        for k in range(first, end, size)
    ]
    return np.concatenate(blocks)


class Forward:
    """Derivatives of all steps in one direction."""

    def __init__(
        self, path: LinearPath, given: PathChange, displacement: Floats | None
    ) -> None:
        self._path, self._given = path, given
        steps, shape = len(path.steps), path.shape
        self.reaction = np.zeros((steps, *shape))
        self.relative_displacement = np.zeros((steps, *shape))
        self.slip = np.zeros((steps, shape[0], shape[1] - 1))
        self._amounts = [np.zeros(one.motions) for one in path.responses]
        latches = path.model.latches
        # Change of what the latches reached when they were last free.
        kept = np.zeros(0 if latches is None else len(latches.dofs))
        self._moved = given.prescribed
        if latches is not None:
            moved = np.zeros((steps, len(path.model.fixed)))
            self._moved = moved if self._moved is None else self._moved + moved
        self._load = given.load
        if given.stiffness is not None and displacement is not None:
            # K du + dK u = df.
            pulled = path.model.forces(-(given.stiffness @ displacement.T).T)
            self._load = pulled if given.load is None else given.load + pulled
        before = np.zeros((shape[0], shape[1] - 1))
        lifted = np.zeros(shape[0])
        for k in range(steps):
            if latches is not None and self._moved is not None:
                self._moved[k, latches.at] += kept
            free, balance = self._find_free_part(k)
            moved = free.copy()
            moved[:, 1:] -= before
            moved[:, 0] -= lifted
            rest = None if given.rest is None else given.rest * path.felt[k]
            change = StepChange(moved, balance, given.friction, rest)
            self.reaction[k], self._amounts[k] = differentiate_step(
                path.linear(k), change
            )
            self.relative_displacement[k] = self._find_displacement(k, free)
            tightened = path.steps[k].tightened
            if latches is not None and tightened is not None:
                reached = self._recover_displacements(k, k + 1)[0, latches.dofs]
                kept = np.where(tightened, reached, kept)
            self.slip[k] = self.relative_displacement[k, :, 1:] - before
            before = self.relative_displacement[k, :, 1:]
            # The change of β ‖s‖, by which dilatancy lifts the contacts in a step.
            slope, length = path.dilation[k]
            lift = np.einsum("ik,ik->i", slope, self.slip[k])
            if given.rest is not None:
                lift = lift + length * given.rest[:, 1]
            lifted = lifted + lift

    def _find_free_part(self, k: int) -> tuple[Floats, Floats]:
        """``dq (n_c, d)`` with the change of the gap, and ``de``."""
        path, changes = self._path, self._given
        response = path.responses[k]
        free, balance = np.zeros(path.shape), np.zeros(response.motions)
        if self._load is not None or self._moved is not None:
            free, balance = response.free(*self._find_loads(k))
        return (free if changes.gap is None else free + changes.gap[k]), balance

    def _find_loads(self, k: int) -> tuple[Floats, Floats]:
        model = self._path.model
        load, moved = self._load, self._moved
        prescribed = np.zeros(len(model.fixed)) if moved is None else moved[k]
        return (
            np.zeros(model.n) if load is None else np.ascontiguousarray(load[k]),
            self._path.drop_free(k, prescribed),
        )

    def _find_displacement(self, k: int, free: Floats) -> Floats:
        path, gap = self._path, self._given.gap
        response = path.responses[k]
        if response.whole:
            return free + response.find_relative_motion(
                self.reaction[k], self._amounts[k]
            )
        (u,) = self._recover_displacements(k, k + 1)
        moved: Floats = (path.model.contact @ u).reshape(path.shape)
        return moved if gap is None else moved + gap[k]

    def _recover_displacements(self, first: int, end: int) -> Floats:
        """Derivatives of the displacements of steps with one response."""
        states = [
            (*self._find_loads(k), self.reaction[k], self._amounts[k])
            for k in range(first, end)
        ]
        held = self._path.model.held
        moved = self._path.responses[first].displacements(states)
        if held is None:
            return moved
        return np.stack([held.displacement(y) for y in moved])

    def displacement(self) -> Floats:
        """Derivatives of the displacements, ``(steps, n)``."""
        return _solve_together(self._path, self._recover_displacements)

    def tangent(self, displacement: Callable[[], Floats] | None = None) -> Tangent:
        """The derivatives; ``displacement`` replaces the method of this name."""
        return Tangent(
            self.reaction,
            self.relative_displacement,
            self.slip,
            self._path.one_sided,
            displacement or self.displacement,
        )


def find_tangent(path: LinearPath, result: Result, change: DataChange) -> Tangent:
    """`Result.jvp`."""
    shape = path.shape[0], path.shape[1]
    changes = check_changes(path.model, len(path.steps), path.mu, shape, change)
    return Forward(
        path, changes, None if change.K is None else result.displacement
    ).tangent()


class Backward:
    """Derivatives of one number by the data of all steps."""

    def __init__(
        self,
        result: Result,
        path: LinearPath,
        reaction: Floats | None,
        displacement: Floats | None,
        relative_displacement: Floats | None,
        slip: Floats | None,
    ) -> None:
        self._result, self._path = result, path
        self._matrices: dict[int, CsrMatrix] = {}
        steps, shape = len(path.steps), path.shape
        self._displacement = displacement
        self.gap_by_component = np.zeros((steps, *shape))
        # Forces that were condensed; adjoint reactions are given beside them.
        self._forces: dict[int, Floats] = {}
        self._reactions = np.zeros((steps, *shape))
        self._amounts = [np.zeros(one.motions) for one in path.responses]
        latches = path.model.latches
        if latches is not None:
            shape_of_u = steps, path.model.n
            given = np.zeros(shape_of_u) if displacement is None else displacement
            self._displacement = given.copy()
        self.mu = np.zeros_like(path.mu)
        # By cohesion and dilatancy.
        self.rest = np.zeros((shape[0], 2))
        r = np.zeros((steps, *shape)) if reaction is None else reaction
        moved = relative_displacement
        # Cotangent of the tangential displacement that the step after this one starts from.
        carried = np.zeros((shape[0], shape[1] - 1))
        # Cotangent of the opening to which this step has lifted the contacts.
        lifted = np.zeros(shape[0])
        # Cotangent of what the latches reached when they were last free.
        kept = np.zeros(0 if latches is None else len(latches.dofs))
        # With two coefficients there is neither cohesion nor dilatancy.
        one = path.mu.ndim == 1
        for k in reversed(range(steps)):
            v = np.zeros(shape) if moved is None else moved[k].copy()
            v[:, 1:] += carried
            slope, length = path.dilation[k]
            of_slip = slope * lifted[:, None]
            self.rest[:, 1] += length * lifted * one
            if slip is not None:
                of_slip = of_slip + slip[k]
            v[:, 1:] += of_slip
            tightened = path.steps[k].tightened
            if (
                latches is not None
                and tightened is not None
                and self._displacement is not None
            ):
                self._displacement[k, latches.dofs] += np.where(tightened, kept, 0.0)
            system = path.linear(k).adjoint()
            q, e = self._find_free_part(k, v)
            w, b = system.solve_transposed(r[k] + q, e)
            # Cᵀ w, the adjoint force of the laws.
            pulled, rubbed = system.laws.adjoint(w, self.mu)
            self.gap_by_component[k] = v - pulled
            # The core removes the rigid part of forces, and not that of reactions: λ must
            # have the same division as the right side.
            self._reactions[k] = -pulled if k in self._forces else v - pulled
            self._amounts[k] = -b
            self.mu += rubbed
            self.rest += system.laws.adjoint_rest(w) * path.felt[k] * one
            carried = pulled[:, 1:] - of_slip
            lifted = lifted + pulled[:, 0]
            if latches is not None and tightened is not None:
                by_support = self._find_prescribed(k, self._solve_adjoint(k, k + 1))
                kept = np.where(tightened, 0.0, by_support[0, latches.dofs] + kept)

    def _find_free_part(self, k: int, v: Floats) -> tuple[Floats, Floats]:
        """``W v + B K⁻¹ u`` of the cotangents, and their work on rigid motions."""
        path, response = self._path, self._path.responses[k]
        still = np.zeros(response.motions)
        if self._displacement is None:
            if not v.any():
                return np.zeros(path.shape), still
            if response.whole:
                return response.find_relative_motion(v, still), response.work(v)
        force = np.asarray(path.model.contact.T @ v.ravel())
        if self._displacement is not None:
            force = force + self._displacement[k]
        self._forces[k] = force
        return response.free(force, np.zeros(len(path.list_fixed(k))))

    def load(self) -> Floats:
        """Adjoint displacements, ``(steps, n)``."""
        adjoint = _solve_together(self._path, self._solve_adjoint)
        held = self._path.model.held
        if held is None:
            return adjoint
        return np.stack([held.displacement(row) for row in adjoint])

    def _solve_adjoint(self, first: int, end: int) -> Floats:
        """Adjoint displacements of steps with one response."""
        path = self._path
        fixed, none = np.zeros(len(path.list_fixed(first))), np.zeros(path.model.n)
        states = [
            (self._forces.get(k, none), fixed, self._reactions[k], self._amounts[k])
            for k in range(first, end)
        ]
        return path.responses[first].displacements(states)

    def prescribed(self, load: Floats) -> Floats:
        """Derivatives by prescribed displacements, from the adjoint displacements."""
        blocks = [self._find_prescribed(k, load[k:end]) for k, end in self._path.spans]
        return np.ascontiguousarray(np.concatenate(blocks)[:, self._path.model.fixed])

    def _find_prescribed(self, first: int, load: Floats) -> Floats:
        """Derivatives by prescribed displacements, at all degrees of freedom."""
        path, part = self._path, slice(first, first + len(load))
        pushed = self.gap_by_component[part].reshape(len(load), -1)
        force = (path.model.contact.T @ pushed.T).T
        if self._displacement is not None:
            force = force + self._displacement[part]
        derivatives = np.zeros(force.shape)
        at = path.list_fixed(first)
        derivatives[:, at] = (
            force[:, at] - (self._find_stiffness(first) @ load.T).T[:, at]
        )
        return derivatives

    def stiffness(self, load: Floats) -> CsrMatrix:
        """Derivatives by the entries of K, from the adjoint displacements."""
        from scipy.sparse import csr_array

        if self._path.model.latches is not None:
            raise ValueError(
                "derivatives by the entries of K are not available for a model with bolts: use "
                "differences of results"
            )
        K = self._find_stiffness(0)
        rows = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
        # The steps of one degree of freedom side by side.
        adjoint = np.ascontiguousarray(load.T)
        moved = np.ascontiguousarray(self._result.displacement.T)
        values = np.empty(K.nnz)
        for first in range(0, K.nnz, tuning.ENTRIES_TOGETHER):
            block = slice(first, first + tuning.ENTRIES_TOGETHER)
            pairs = adjoint[rows[block]], moved[K.indices[block]]
            np.einsum("ek,ek->e", *pairs, out=values[block])
        half = csr_array((values / -2, K.indices, K.indptr), shape=K.shape)
        # With the zeros of the pattern: a sum of two matrices would keep them out.
        mirrored = half.T.tocsr()
        mirrored.sort_indices()
        values = half.data + mirrored.data
        gradient: CsrMatrix = csr_array((values, K.indices, K.indptr), shape=K.shape)
        return gradient

    def _find_stiffness(self, k: int) -> CsrMatrix:
        """K, without the entries between the degrees of freedom that a step prescribes."""
        response = self._path.responses[k]
        if id(response) not in self._matrices:
            self._matrices[id(response)] = response.stiffness()
        return self._matrices[id(response)]

    def gradient(self, adjoint: Adjoint | None = None) -> Gradient:
        """The derivatives; ``adjoint`` computes those on first use in place of this."""
        return Gradient(
            self._result,
            reshape_gap_gradient(self._path.model, self.gap_by_component),
            self.gap_by_component,
            self.mu,
            self._path.one_sided,
            adjoint or self,
            self.rest,
        )


def find_gradient(path: LinearPath, result: Result, given: Cotangents) -> Gradient:
    """`Result.vjp`."""
    steps, (contacts, d) = len(path.steps), path.shape
    stacked = steps, contacts, d
    u = check_cotangent("displacement", given.displacement, (steps, path.model.n))
    if u is not None and not path.has_factor:
        raise ValueError(
            "displacement has a cotangent, but the problem was made with loads= and has no "
            "factor of K: make it without loads="
        )
    return Backward(
        result,
        path,
        check_cotangent("reaction", given.reaction, stacked),
        None if u is None else path.model.forces(u),
        check_cotangent("relative_displacement", given.relative_displacement, stacked),
        check_cotangent("slip", given.slip, (steps, contacts, d - 1)),
    ).gradient()
