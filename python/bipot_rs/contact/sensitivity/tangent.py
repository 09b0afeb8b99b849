"""Directional derivatives of a load path, forward through its steps (33)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.results.derivatives import DataChange, Tangent
from bipot_rs.contact.sensitivity.directional import differentiate_step
from bipot_rs.contact.sensitivity.linear import StepChange
from bipot_rs.contact.sensitivity.linear_path import LinearPath
from bipot_rs.contact.sensitivity.model import PathChange, check_changes

if TYPE_CHECKING:
    from bipot_rs.contact.results.result import Result


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
        if held is None or not held.dependent.size:
            return moved
        return np.stack([held.displacement(y) for y in moved])

    def displacement(self) -> Floats:
        """Derivatives of the displacements, ``(steps, n)``."""
        size = tuning.DISPLACEMENTS_TOGETHER
        blocks = [
            self._recover_displacements(k, min(k + size, end))
            for first, end in self._path.spans
            for k in range(first, end, size)
        ]
        return np.concatenate(blocks)

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
