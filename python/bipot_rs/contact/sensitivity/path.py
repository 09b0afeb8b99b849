"""The linearised steps of a load path, shared by its tangents and gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.sensitivity.borders import borders
from bipot_rs.contact.sensitivity.laws import Point
from bipot_rs.contact.sensitivity.linear import Linear
from bipot_rs.contact.sensitivity.model import PathModel, along_tangents
from bipot_rs.contact.sensitivity.response import Condensed
from bipot_rs.contact.solution import Step
from bipot_rs.contact.status import Status

if TYPE_CHECKING:
    from bipot_rs.contact.result import Result

# Contacts with a smaller opening, as a share of the largest one, may be on a border.
_CLOSE = 1e-6
# Bytes of the compliance and of the factored systems that a result may keep.
KEPT = 2**28


class LinearPath:
    """The steps of a path, linearised one after the other.

    Attributes
    ----------
    model
        Contact operator and shapes.
    response
        How the contacts respond to reactions.
    steps
        The steps.
    mu
        Friction coefficients, ``(n_c,)`` or ``(n_c, 2)``.
    bytes
        Memory of the compliance of the contacts that close, and of a system for each step.
    """

    def __init__(
        self,
        model: PathModel,
        steps: Sequence[Step],
        contacts: Mapping[str, Any],
    ) -> None:
        self.model, self.steps = model, steps
        self.mu: Floats = np.asarray(contacts["mu"])
        self.shape = steps[0].reaction.shape
        friction = along_tangents(self.mu, self.shape[1])
        self.points = [
            Point(
                step.reaction,
                step.relative_displacement[:, 0],
                step.slip,
                step.status.astype(np.int64),
                friction,
            )
            for step in steps
        ]
        recovery = steps[-1]._recover
        if recovery is None:
            raise ValueError(_LOST)
        self.has_factor = recovery.has_factor()
        self.response = Condensed(recovery.condensed(), self._closed(), self.shape[0])
        order = len(self.response.members) * self.shape[1] + self.response.motions
        self.bytes = 8 * order**2 * (1 + len(steps))
        self._linear: dict[int, Linear] = {}
        compliance = self.response.diagonal.mean(axis=1)
        self.borders = [
            borders(point, compliance, step.tolerance)
            for point, step in zip(self.points, steps, strict=True)
        ]

    def _closed(self) -> Any:
        """Contacts that close, or nearly do, in some step."""
        closed = np.zeros(self.shape[0], bool)
        for point in self.points:
            near = _CLOSE * np.abs(point.opening).max(initial=0.0)
            closed |= (point.status != Status.OPEN) | (point.opening <= near)
        return np.flatnonzero(closed)

    @property
    def one_sided(self) -> Bools:
        """Contacts on a border between two statuses, ``(steps, n_c)``."""
        return np.stack([known.any for known in self.borders])

    def linear(self, k: int) -> Linear:
        """The linearised problem of a step, kept for further derivatives if all fit."""
        found = self._linear.get(k)
        if found is None:
            found = Linear(self.response, self.points[k], self.borders[k])
            if self.bytes <= KEPT:
                self._linear[k] = found
        return found


_LOST = (
    "the problem of this result is not available: it was read from a file or came from "
    "another process; solve again to differentiate"
)


def linearised(result: Result) -> LinearPath:
    """The linearised steps of a result, which keeps them if they are no larger than `KEPT`.

    Raises
    ------
    ValueError
        The problem of the result is not available, or the result has no steps.
    """
    if not len(result):
        raise ValueError(f"the result has no steps to differentiate: {result.message}")
    if result._model is None:
        raise ValueError(_LOST)
    kept: LinearPath | None = result._linearised
    if kept is not None:
        return kept
    path = LinearPath(result._model, result.steps, result.contacts)
    if path.bytes <= KEPT:
        result._linearised = path
    return path
