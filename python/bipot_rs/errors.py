"""What is raised where there is no answer; wrong arguments are ``ValueError``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bipot_rs.result import Result


class BipotError(Exception):
    """Base of the errors below.

    Attributes
    ----------
    result
        Everything up to the last good step of a load path; ``None`` where
        there was none to take.
    """

    def __init__(self, message: str, result: Result | None = None) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (*self.args, self.result)


class NoEquilibriumError(BipotError):
    """The loads lie outside what contact can carry."""


class FloatingBodyError(BipotError):
    """A motion is free that the contact set cannot hold."""


class NotConvergedError(BipotError):
    """The solver stopped short of the tolerance; an answer may exist."""
