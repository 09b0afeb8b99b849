"""Load steps as long as they may be: halved where they fail, grown where they do not.

A path is followed over a parameter ``s`` from 0 to the last of its stops. What decides
the next step is ``s`` and ``ahead``, and both stand in every `Step`: a path that is left
off and taken up again takes the steps of one that went through.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bipot_rs._lib.validation import floats, number
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.contact.load_path import Following
from bipot_rs.contact.load_steps import Totals
from bipot_rs.contact.result import Result
from bipot_rs.contact.solution import Step
from bipot_rs.contact.status import Status

# The least step, of the whole path where none is given, and where rounding of s begins.
_SMALLEST, _LEAST = 1e-3, 1e-12
# What is left to a stop, in smallest steps, when it is rounding of s alone.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Increments:
    """How a path is divided; all but ``slip`` in units of s.

    Attributes
    ----------
    stops
        Ascending values of s where a step must end; the last is the end.
    first, largest, smallest
        The first step tried, the longest, and the one below which a path is given up.
    slip
        The most that a contact may slip over a step [length]; None for any amount.
    """

    stops: tuple[float, ...]
    first: float
    largest: float
    smallest: float
    slip: float | None = None

    def next(self, s: float, ahead: float) -> float:
        """Where a step from s would end."""
        stop = next(stop for stop in self.stops if stop > s)
        to = s + ahead
        return stop if to > stop - _ROUNDING * self.smallest else to


def increments(
    stops: Any, first: Any, largest: Any, smallest: Any, slip: Any
) -> Increments:
    """The same, checked, with what is left to us filled in.

    Raises
    ------
    TypeError, ValueError
        An argument of the wrong kind or out of order, named.
    """
    ends = np.atleast_1d(floats("stops", stops))
    if ends.ndim != 1 or not ends.size or not (np.diff(ends, prepend=0.0) > 0).all():
        raise ValueError(
            f"stops is {ends.tolist()}, expected ascending numbers, the first above zero"
        )
    end = float(ends[-1])
    most = end if largest is None else number("largest", largest)
    least = min(_SMALLEST * end, most)
    if smallest is not None:
        least = number("smallest", smallest)
    begin = most if first is None else number("first", first)
    if not _LEAST * end <= least <= begin <= most <= end:
        raise ValueError(
            f"smallest, first and largest are {least:g}, {begin:g} and {most:g}, expected "
            f"them ascending, from {_LEAST:g} to 1 of the path's end, {end:g}"
        )
    most_slip = None if slip is None else number("slip", slip)
    if most_slip is not None and not 0 < most_slip < np.inf:
        raise ValueError(f"slip is {most_slip:g}, expected a positive length")
    return Increments(tuple(ends.tolist()), begin, most, least, most_slip)


def follow(
    following: Following,
    loads: Callable[[float], Totals],
    plan: Increments,
    on_step: Callable[[int, Step], object] | None,
) -> Result:
    """Follow a path from where it stands.

    Parameters
    ----------
    following
        The path, which stands at a step of such a path, or at any state, which is then
        at s = 0.
    loads
        Total load, prescribed displacement and gaps at s.
    plan
        How it is divided.
    on_step
        Called as ``on_step(k, step)`` after each step.

    Raises
    ------
    NoEquilibriumError, NotConvergedError
        No step of ``smallest`` leads on; ``.result`` holds what was reached.
    """
    s, ahead = 0.0, plan.first
    start = following.before
    if start is not None and start.s is not None:
        s = start.s
        if s > plan.stops[-1]:
            raise ValueError(
                f"start is at s = {s:g}, beyond the last of stops, {plan.stops[-1]:g}"
            )
        ahead = plan.first if start.ahead is None else start.ahead
        ahead = min(max(ahead, plan.smallest), plan.largest)
    while s < plan.stops[-1]:
        s, ahead, step = _advance(following, loads, plan, s, ahead)
        following.accept(replace(step, s=s, ahead=ahead))
        if on_step is not None:
            on_step(len(following.steps) - 1, following.steps[-1])
    return following.result()


def _advance(
    following: Following,
    loads: Callable[[float], Totals],
    plan: Increments,
    s: float,
    ahead: float,
) -> tuple[float, float, Step]:
    """One step from s, with where it ends and the length to try next."""
    halved = False
    while True:
        to = plan.next(s, ahead)
        failed: Step | NoEquilibriumError
        try:
            failed = step = following.attempt(*loads(to))
        except NoEquilibriumError as error:
            failed = error
        else:
            slid = largest_slip(step)
            if step.converged and (plan.slip is None or slid <= plan.slip):
                calm = plan.slip is None or slid <= 0.5 * plan.slip
                # One that a stop has cut short says nothing of a longer one.
                whole = to - s >= ahead * (1 - _ROUNDING)
                if calm and whole and not halved:
                    ahead = min(2 * ahead, plan.largest)
                return to, ahead, step
        if to - s <= plan.smallest * (1 + 2 * _ROUNDING):
            raise _refusal(following, plan, failed, s, to)
        ahead = max((to - s) / 2, plan.smallest)
        halved = True
        # A failed step leaves its traces in what the core holds.
        following.rewind()


def largest_slip(step: Step) -> float:
    """The most that a pressed contact slips over a step."""
    slips = np.linalg.norm(step.slip, axis=1)[step.status == Status.SLIP]
    return float(slips.max(initial=0.0))


def _refusal(
    following: Following,
    plan: Increments,
    failed: Step | NoEquilibriumError,
    s: float,
    to: float,
) -> NoEquilibriumError | NotConvergedError:
    """Why the path ends at s, with all that was reached."""
    where = (
        f"load step {len(following.steps) + 1}: the path ends at s = {s:.10g}: from there no step "
        f"to s = {to:.10g}, and smallest = {plan.smallest:g} allows no shorter one: "
    )
    if isinstance(failed, Step) and failed.converged:
        at = np.where(failed.status == Status.SLIP, 1.0, 0.0)
        contact = int(np.argmax(at * np.linalg.norm(failed.slip, axis=1)))
        message = (
            f"{where}contact {contact} slips by {largest_slip(failed):g}, more than "
            f"slip = {plan.slip:g}; raise slip, or lower smallest"
        )
        return NotConvergedError(message, following.result(False, message))
    error = (
        following.failure(failed)
        if isinstance(failed, Step)
        else following.ended(failed)
    )
    message = where + str(error).partition(": ")[2]
    return type(error)(message, following.result(False, message), error.direction)
