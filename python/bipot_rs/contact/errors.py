"""Errors of solves. Wrong arguments raise ``ValueError`` or ``TypeError`` instead.

Errors of the core, of any class, have a ``kind`` (the name of a variant of `src/error.rs`,
``"floating_body"``) and the fields of that variant as attributes.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from bipot_rs._lib.types import Floats
    from bipot_rs.contact.results.result import Result

E = TypeVar("E", bound=Exception)


class BipotError(Exception):
    """Base class of the errors of this package.

    Attributes
    ----------
    result
        The steps of the load path that converged; ``None`` if there is no path.
    direction
        Displacement of each contact in a rigid motion, ``(n_c, d)``, normal first, scaled
        so that the largest has length 1, or ``None``. For a `NoEquilibriumError` it is a
        proof. For a `NotConvergedError` it is the direction in which the iteration
        diverged, which proves nothing.
    kind
        What is wrong, in a word of the core (``"floating_body"``), or ``""``.
    dof
        A degree of freedom of the body that can move freely, or ``None``.
    step
        Number of the load step that failed, from 1, or ``None``.
    reason
        The message without the load step.
    wear
        A `Wear` with the cycles before, if `ContactProblem.wear` failed; else ``None``.
    """

    kind: str = ""
    dof: int | None = None
    step: int | None = None
    wear: Any = None

    def __init__(
        self,
        message: str,
        result: Result | None = None,
        direction: Floats | None = None,
    ) -> None:
        super().__init__(message)
        self.reason = message
        self.result = result
        self.direction = direction

    def at_step(self, step: int, count: int | None = None) -> str:
        """Set the number of the load step, of ``count``, and make the message anew.

        Returns
        -------
        The message, ``"load step 2 of 9: not converged ..."``.
        """
        of = "" if count is None else f" of {count}"
        self.step = step
        self.args = (f"load step {step}{of}: {self.reason}",)
        return str(self)


class NoEquilibriumError(BipotError):
    """No solution exists. This is proved, and the message gives the proof.

    If contact cannot carry the loads, ``direction`` is the proof: it lies in the dual cone
    of every contact, so that no reaction does work against it, and the loads do work on
    it. It is ``None`` for other proofs: all combinations of statuses were tried and none
    satisfies the contact law, or contacts contradict each other.
    """


class FloatingBodyError(BipotError):
    """A rigid motion of a body is free, and the contacts cannot hold it."""


class NotConvergedError(BipotError):
    """The solver did not reach the tolerance. A solution may exist."""


class NotDifferentiableError(BipotError):
    """The derivative of a solution does not exist or is not unique there.

    Reactions are not determined, or contacts on a border between two statuses allow no
    change, or several, in the direction of the data.
    """


class NotIterativeError(ValueError):
    """``engine="iterative"`` was asked for a problem that it cannot solve."""

    reason: str = ""  # why, as part of a sentence
    # The first contact without a node of its own, and all of them; `None` for another reason.
    contact: int | None = None
    contacts: Sequence[int] = ()
    dof: int | None = None  # of the body that the reason is about
    # Whether a support holds it along a direction that is neither its normal nor a tangent.
    oblique: bool = False


def describe_contact(
    error: NotIterativeError, where: str, support: str = "a support"
) -> str:
    """Reason of an error at a contact; ``where`` is ``" at (0, 0, 5)"``, or empty."""
    if error.oblique:
        return (
            f"{support} holds contact {error.contact}{where} along a direction that is "
            "neither its normal nor a tangent"
        )
    return (
        f"contact {error.contact}{where} shares each of its nodes with other contacts"
    )


def with_reason(
    error: NotIterativeError, reason: str, engine: str = "iterative"
) -> NotIterativeError:
    """A copy of an error of an engine, with its fields and another reason."""
    text = f"engine {engine!r} cannot solve this problem: {reason}. Use engine='direct'"
    made = with_message(error, text)
    made.reason = reason
    return made


def with_message(error: E, message: str) -> E:
    """A copy of an error, with its fields and another message."""
    made = copy(error)
    made.args = (message,)
    if isinstance(made, BipotError):
        made.reason = message
    return made
