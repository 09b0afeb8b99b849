"""What is raised where there is no answer; wrong arguments are ``ValueError``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bipot_rs._lib.types import Floats

if TYPE_CHECKING:
    from bipot_rs.contact.result import Result


class BipotError(Exception):
    """Base of the errors below.

    Attributes
    ----------
    result
        Everything up to the last good step of a load path; ``None`` where
        there was none to take.
    direction
        How each contact moves along a rigid motion, ``(n_c, d)``, normal first, the
        largest of length 1; ``None`` where there is none to tell. Of a
        `NoEquilibriumError` it is a proof. Of a `NotConvergedError` it is what the
        iteration moved along when it ended: an observation, no proof.
    dof
        A degree of freedom of the body that is free to move, where one is; else ``None``.
    """

    dof: int | None = None

    def __init__(
        self,
        message: str,
        result: Result | None = None,
        direction: Floats | None = None,
    ) -> None:
        super().__init__(message)
        self.result = result
        self.direction = direction

    def __reduce__(self) -> tuple[Any, ...]:
        known = (*self.args, self.result, self.direction)
        return type(self), known, {"dof": self.dof}


class NoEquilibriumError(BipotError):
    """No answer exists, which is proved; the message says how.

    Where the loads lie outside what contact can carry, ``direction`` is the proof: it
    lies in the dual cone of every contact, so that no reaction works against it, and the
    loads work on it. It is ``None`` where something else is the proof: all statuses of
    the contacts were tried and none holds, or contacts contradict each other.
    """


class FloatingBodyError(BipotError):
    """A motion is free that the contact set cannot hold."""


class NotConvergedError(BipotError):
    """The solver stopped short of the tolerance; an answer may exist."""
