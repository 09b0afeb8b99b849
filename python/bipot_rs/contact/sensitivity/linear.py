"""The linearised problem of one step, and the linearised steps of a load path.

Contacts on borders are each on one side of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.results.derivatives import LOST
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.sensitivity.laws import (
    Laws,
    Point,
    find_directions,
    linearise_laws,
)
from bipot_rs.contact.sensitivity.model import PathModel, spread_friction
from bipot_rs.contact.sensitivity.response import (
    CondensedResponse,
    ContactResponse,
    DisplacementResponse,
    PathResponse,
    System,
    make_system,
)

if TYPE_CHECKING:
    from bipot_rs.contact.results.contact_fields import ContactArrays

# Distance to a border below which a contact counts as on it, in tolerances of the step times
# the largest terms: the certificate of a converged step allows as large a penetration.
_TOLERANCES = 10.0
# A sticking contact is at the friction limit only if it uses at least this share of it, also
# where the limit is smaller than the tolerance.
_USED = 0.5


@dataclass(frozen=True)
class Borders:
    """Contacts on borders, each ``(n_c,)``."""

    touching: Bools  # just touches: `v_n = 0` and `r_n = 0`
    yielding: Bools  # at the friction limit without slip
    # Touches, and has neither slip nor reaction: all three statuses meet. Part of `touching`.
    resting: Bools

    @property
    def any(self) -> Bools:
        """Contacts on a border."""
        bordering: Bools = self.touching | self.yielding
        return bordering


def find_borders(
    point: Point,
    compliance: Floats,
    tolerance: float,
    moved: Floats,
    work: float = 0.0,
) -> Borders:
    """The contacts that are on a border up to the tolerance of the step.

    ``compliance``: mean of the diagonal of each block of W, ``(n_c,)``; zero if not known.
    ``tolerance``: relative tolerance of η, which the step met.
    ``moved``: sizes of the terms whose sum is ``v``, ``(n_c,)``; they cancel in a touching one.
    ``work``: that of loads and prescribed displacements, without cancellation. A displacement
    ``v`` that it causes has ``v² / w ≤ work``.
    """
    movable = compliance > 0
    root = np.sqrt(np.where(movable, compliance, 1.0))
    # As in the certificate (13): r √w and v / √w have the same unit.
    r = point.reaction * root[:, None]
    opening = np.abs(point.opening) / root
    slip = np.linalg.norm(point.slip, axis=1) / root
    moved = moved / root
    # Contacts far away from each other say nothing about those that meet.
    meets = movable & ((r[:, 0] > 0) | (opening <= _TOLERANCES * tolerance * moved))
    size = max(
        float(np.linalg.norm(r)),
        float(moved[meets].max(initial=0.0)),
        float(np.sqrt(work)),
    )
    near = _TOLERANCES * tolerance * size
    rough = point.friction[:, 0] > 0
    D = np.where(point.friction > 0, point.friction, 1.0)
    left = r[:, 0] - np.linalg.norm(r[:, 1:] / D, axis=1)
    # Distance to the surface of the cone of friction, whose slope is the coefficient.
    slope = D.min(axis=1)
    aside = left * slope / np.hypot(1.0, slope)
    limit = (aside <= near) & (left <= (1.0 - _USED) * r[:, 0])
    cohesion = point.limit[0] * root
    sticky = cohesion > 0
    if sticky.any():
        mu = point.friction[:, 0]
        most = cohesion + mu * r[:, 0]
        left = most - np.linalg.norm(r[:, 1:], axis=1)
        of_cohesion = (left / np.hypot(1.0, mu) <= near) & (
            left <= (1.0 - _USED) * most
        )
        limit, rough = np.where(sticky, of_cohesion, limit), rough | sticky
    touching = movable & (np.maximum(r[:, 0], opening) <= near)
    still = slip <= near
    return Borders(
        touching=touching,
        yielding=movable & rough & ~touching & (r[:, 0] > 0) & still & limit,
        resting=touching & rough & still,
    )


@dataclass(frozen=True)
class StepChange:
    """Changes of the data of a step."""

    # (n_c, d): `dq`, with the change of the gap, less that of the slip before in its tangential
    # components.
    free: Floats
    balance: Floats  # (k,): `de`
    friction: Floats  # (n_c, d - 1): `dD`
    rest: Floats | None = None  # (n_c, 2): `dc` and `dβ`; None for zero


class LinearisedStep:
    """The linearised problem of one step.

    ``point``: its solution.
    ``borders``: contacts on borders.
    """

    def __init__(
        self, response: ContactResponse, point: Point, borders: Borders
    ) -> None:
        self.response, self.point, self.borders = response, point, borders
        self._scale = np.sqrt(response.diagonal.mean(axis=1))
        self.movable: Bools = response.movable()
        self._reported: System | None = None

    @property
    def reported(self) -> System:
        """The system with each border contact on the side of its reported status."""
        if self._reported is None:
            laws = self.laws(self.point.status, self.direction)
            self._reported = self.system(laws)
        return self._reported

    def adjoint(self) -> System:
        """`reported`, for gradients.

        Raises `NotDifferentiableError`: it is singular, also with the contacts that just touch
        closed: reactions are then not determined beside this point.
        """
        self.refuse_borders(self.borders.touching)
        touching = self.borders.touching & (self.point.status == Status.OPEN)
        if touching.any():
            side = self.point.status.copy()
            side[touching] = Status.SLIP
            side[touching & self.borders.resting] = Status.STICK
            self.system(self.laws(side, self.direction))
        return self.reported

    def refuse_borders(self, borders: Bools) -> None:
        """Raise for contacts with cohesion or dilatancy on these borders."""
        at = np.flatnonzero(borders & ~self.point.is_coulomb)
        if at.size:
            raise NotDifferentiableError(
                f"contact {at[0]} with cohesion or dilatancy is on a border between two "
                "statuses, where its one-sided derivatives are not derived; change the load "
                "a little"
            )

    @property
    def direction(self) -> Floats:
        """Direction of slip of each contact."""
        return find_directions(self.point, self._scale)

    def laws(self, side: Ints, direction: Floats) -> Laws:
        """The law of each contact on a side of its borders."""
        return linearise_laws(self.point, side, direction, self.movable)

    def system(self, laws: Laws) -> System:
        """The system (33) of these laws."""
        contacts, d = self.point.reaction.shape
        return make_system(self.response, laws, (contacts, d))


def make_right_side(laws: Laws, of: StepChange) -> Floats:
    """Right side of (33)."""
    at = laws.contacts
    moved = np.einsum("ijk,ik->ij", laws.by_v, of.free[at])
    rubbed = np.einsum("ijk,ik->ij", laws.by_mu, of.friction[at])
    if of.rest is not None:
        rubbed = rubbed + np.einsum("ijk,ik->ij", laws.by_rest, of.rest[at])
    return np.asarray(rubbed - moved, np.float64)


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
