"""The linearised steps of a load path, shared by its tangents and gradients."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact import tuning
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.results.derivatives import LOST
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.sensitivity.laws import Point
from bipot_rs.contact.sensitivity.linear import LinearisedStep, find_borders
from bipot_rs.contact.sensitivity.model import PathModel, spread_friction
from bipot_rs.contact.sensitivity.response import (
    CondensedResponse,
    DisplacementResponse,
    PathResponse,
)

if TYPE_CHECKING:
    from bipot_rs.contact.results.contact_data import ContactArrays


class LinearPath:
    """The steps of a path, linearised one after the other.

    ``model``: contact operator and shapes.
    ``response``: how the contacts respond; by default the response of the engine, of the last
    step for each set of bolts that are free.
    ``iterative``: whether results of the iterative engine are differentiated by it.
    ``mu``: friction coefficients, ``(n_c,)`` or ``(n_c, 2)``.
    ``kept``: whether the linearised steps are kept for further derivatives.
    """

    def __init__(
        self,
        model: PathModel,
        steps: Sequence[Step],
        contacts: ContactArrays,
        response: PathResponse | None = None,
        *,
        iterative: bool = True,
    ) -> None:
        self.model, self.steps = model, steps
        self.mu: Floats = np.asarray(contacts["mu"])
        self.shape = steps[0].reaction.shape
        friction = spread_friction(self.mu, self.shape[1])
        cohesion, dilatancy = contacts.get("cohesion"), contacts.get("dilatancy")
        # Derivative of β ‖s‖ by the slip, and ‖s‖, of contacts that dilate in each step.
        self.dilation: list[tuple[Floats, Floats]] = []
        # 1 for the changes of cohesion and dilatancy that a step feels: broken contacts have
        # no cohesion, whatever it was.
        self.felt: list[Floats] = []
        self.points: list[Point] = []
        for step in steps:
            length = np.linalg.norm(step.slip, axis=1)
            length = np.where(step.status == Status.OPEN, 0.0, length)
            slope = np.zeros_like(step.slip)
            opening, left = step.relative_displacement[:, 0], cohesion
            if step.dilation is not None:
                # The surfaces met here, had this step not lifted them.
                opening = opening - step.dilation
            if dilatancy is not None:
                size = np.where(length > 0, length, 1.0)
                slope = (dilatancy * (length > 0) / size)[:, None] * step.slip
            if cohesion is not None and step.broken is not None:
                left = np.where(step.broken, 0.0, cohesion)
            self.dilation.append((slope, length))
            felt = np.ones((self.shape[0], 2))
            felt[:, 0] = 1.0 if step.broken is None else ~step.broken
            self.felt.append(felt)
            self.points.append(
                Point(
                    step.reaction,
                    opening,
                    step.slip,
                    step.status.astype(np.int64),
                    friction,
                    left,
                    dilatancy,
                )
            )
        # v, B u and the gap: two of them may cancel.
        gap = np.asarray(contacts["gap"])
        self._moved = [
            _measure_terms(
                step.relative_displacement, gap if step.gap is None else step.gap
            )
            for step in steps
        ]
        self.has_factor = True
        # Bytes of the free latches of each step; the response for each of these sets.
        keys = [
            b"" if step.tightened is None else step.tightened.tobytes()
            for step in steps
        ]
        last = dict(zip(keys, steps, strict=True))
        by_key = {
            key: response or self._make_response(step, iterative)
            for key, step in last.items()
        }
        self.responses = [by_key[key] for key in keys]
        order = max(
            len(made.members) * self.shape[1] + made.motions
            if isinstance(made, CondensedResponse)
            else 0
            for made in by_key.values()
        )
        self.kept = 8 * order**2 * (1 + len(steps)) <= tuning.KEPT_BYTES
        self._linear: dict[int, LinearisedStep] = {}
        # Without a factor the displacements are not known.
        work = [0.0] * len(steps)
        for first, end in self.spans if self.has_factor else ():
            work[first:end] = self.responses[first].measure_work(
                steps[first:end], self.list_fixed(first)
            )
        self.borders = [
            find_borders(point, laws.diagonal.mean(axis=1), step.tolerance, moved, done)
            for point, laws, step, moved, done in zip(
                self.points, self.responses, steps, self._moved, work, strict=True
            )
        ]

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First steps and ends of the parts of the path with one response."""
        parts = groupby(range(len(self.steps)), lambda k: id(self.responses[k]))
        members = [list(part) for _, part in parts]
        return [(part[0], part[-1] + 1) for part in members]

    def list_fixed(self, k: int) -> Ints:
        """Degrees of freedom that are prescribed in a step."""
        fixed, free = self.model.fixed, self.steps[k].tightened
        if self.model.latches is None or free is None:
            return fixed
        return np.delete(fixed, self.model.latches.at[free])

    def drop_free(self, k: int, prescribed: Floats) -> Floats:
        """Prescribed displacements of the path, without those of free latches."""
        free = self.steps[k].tightened
        if self.model.latches is None or free is None:
            return prescribed
        return self.model.latches.drop_free(prescribed, free)

    def _make_response(self, last: Step, iterative: bool) -> PathResponse:
        """The response of the engine that solved a step."""
        recovery = last.recovery
        if recovery is None:
            raise ValueError(LOST)
        self.has_factor = recovery.has_factor()
        primal = recovery.primal() if iterative else None
        if primal is not None:
            return DisplacementResponse(primal)
        # Contacts that close, or nearly do, in some step.
        closed = np.zeros(self.shape[0], bool)
        for point, moved in zip(self.points, self._moved, strict=True):
            near = tuning.NEARLY_CLOSED * moved.max(initial=0.0)
            closed |= (point.status != Status.OPEN) | (point.opening <= near)
        return CondensedResponse(
            recovery.condensed(), np.flatnonzero(closed), self.shape[0]
        )

    @property
    def one_sided(self) -> Bools:
        """Contacts on a border between two statuses, ``(steps, n_c)``."""
        return np.stack([border.any for border in self.borders])

    def linear(self, k: int) -> LinearisedStep:
        """The linearised problem of a step."""
        if k in self._linear:
            return self._linear[k]
        step = LinearisedStep(self.responses[k], self.points[k], self.borders[k])
        if self.kept:
            self._linear[k] = step
        return step


def _measure_terms(v: Floats, gap: Floats) -> Floats:
    """Size of ``B u`` and of the gap at each contact, ``(n_c,)``."""
    offset = np.zeros_like(v)
    offset[:, : 1 if gap.ndim == 1 else None] = gap if gap.ndim == 2 else gap[:, None]
    moved: Floats = np.linalg.norm(np.abs(v - offset) + np.abs(offset), axis=1)
    return moved
