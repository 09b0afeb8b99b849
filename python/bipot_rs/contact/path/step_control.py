"""Adaptive load steps: halved if they fail, doubled if they succeed.

A path goes over a parameter ``s`` from 0 to the last of its stops. Only ``s`` and
``ahead`` determine the next step, and every `Step` holds both: an interrupted path
continues with the same steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.validation import floats, number
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError, with_message
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.path.load_path import PathSolver
from bipot_rs.contact.path.load_steps import Totals
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step, revise

# Lower limit of a step by the rounding of s, over the path.
_LEAST = 1e-12
# A distance to a stop below this part of the smallest step is rounding of s.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Increments:
    """Limits of adaptive steps; all but ``slip`` in units of s."""

    # Ascending values of s at which a step must end. The last is the end of the path.
    stops: tuple[float, ...]
    # first, largest, smallest: length of the first, the longest and the shortest step.
    first: float
    largest: float
    smallest: float
    # Largest slip of a contact in one step [length]; None for no limit.
    slip: float | None = None

    @property
    def steps(self) -> int:
        """Expected number of load steps."""
        return tuning.ADAPTIVE_STEPS * len(self.stops)

    def next(self, s: float, ahead: float) -> float:
        """End of a step from s."""
        stop = next(stop for stop in self.stops if stop > s)
        to = s + ahead
        return stop if to > stop - _ROUNDING * self.smallest else to


def check_increments(
    stops: object, first: object, largest: object, smallest: object, slip: object
) -> Increments:
    """Check the limits, and fill in the defaults.

    Raises `TypeError` or `ValueError`: an argument has the wrong type or order; the message
    names it.
    """
    ends = np.atleast_1d(floats("stops", stops))
    if ends.ndim != 1 or not ends.size or not (np.diff(ends, prepend=0.0) > 0).all():
        raise ValueError(
            f"stops is {ends.tolist()}, expected ascending numbers, the first above zero"
        )
    end = float(ends[-1])
    most = end if largest is None else number("largest", largest)
    least = min(tuning.SMALLEST_STEP * end, most)
    if smallest is not None:
        least = number("smallest", smallest)
    begin = most if first is None else number("first", first)
    if not _LEAST * end <= least <= begin <= most <= end:
        raise ValueError(
            f"smallest, first and largest are {least:g}, {begin:g} and {most:g}, expected "
            f"ascending values from {_LEAST * end:g} to {end:g}, the end of the path"
        )
    most_slip = None if slip is None else number("slip", slip)
    if most_slip is not None and not 0 < most_slip < np.inf:
        raise ValueError(f"slip is {most_slip:g}, expected a positive length")
    return Increments(tuple(ends.tolist()), begin, most, least, most_slip)


def solve_adaptively(
    path: PathSolver,
    loads: Callable[[float], Totals],
    plan: Increments,
    on_step: Callable[[int, Step], object] | None,
) -> Result:
    """Solve a path in adaptive steps.

    ``path``: the path. If its start is no adaptive step, s begins at 0.
    ``loads``: total load, prescribed displacement and gaps at s.
    ``plan``: limits of the steps.
    ``on_step``: called as ``on_step(k, step)`` after each step.
    Raises `NoEquilibriumError` or `NotConvergedError`: a step of length ``smallest`` failed;
    ``.result`` holds the steps before.
    """
    s, ahead = 0.0, plan.first
    start = path.before
    if start is not None and start.s is not None:
        s = start.s
        if s > plan.stops[-1]:
            raise ValueError(
                f"start is at s = {s:g}, beyond the last of stops, {plan.stops[-1]:g}: give "
                "stops that lie behind it"
            )
        ahead = plan.first if start.ahead is None else start.ahead
        ahead = min(max(ahead, plan.smallest), plan.largest)
    while s < plan.stops[-1]:
        s, ahead, step = _solve_next(path, loads, plan, s, ahead)
        path.accept(revise(step, s=s, ahead=ahead))
        if on_step is not None:
            on_step(len(path.steps) - 1, path.steps[-1])
    return path.result()


def _solve_next(
    path: PathSolver,
    loads: Callable[[float], Totals],
    plan: Increments,
    s: float,
    ahead: float,
) -> tuple[float, float, Step]:
    """Solve one step from s; return its end, the next length to try, and the step."""
    halved = False
    while True:
        to = plan.next(s, ahead)
        failed: Step | NoEquilibriumError
        try:
            failed = step = path.attempt(*loads(to))
        except NoEquilibriumError as error:
            failed = error
        else:
            slid = find_largest_slip(step)
            if step.converged and (plan.slip is None or slid <= plan.slip):
                calm = plan.slip is None or slid <= 0.5 * plan.slip
                # A step that a stop has shortened does not justify a longer one.
                whole = to - s >= ahead * (1 - _ROUNDING)
                if calm and whole and not halved:
                    ahead = min(2 * ahead, plan.largest)
                return to, ahead, step
        if to - s <= plan.smallest * (1 + 2 * _ROUNDING):
            raise _make_failure(path, plan, failed, s, to)
        ahead = max((to - s) / 2, plan.smallest)
        halved = True
        # A failed step has changed the state of the core.
        path.rewind()


def find_largest_slip(step: Step) -> float:
    """Largest slip of a closed contact in a step."""
    slips = np.linalg.norm(step.slip, axis=1)[step.status == Status.SLIP]
    return float(slips.max(initial=0.0))


def _make_failure(
    path: PathSolver,
    plan: Increments,
    failed: Step | NoEquilibriumError,
    s: float,
    to: float,
) -> NoEquilibriumError | NotConvergedError:
    """Make the error of a path that ends at s, with the steps before."""
    where = (
        f"the path ends at s = {s:.10g}: the step to s = {to:.10g} failed, and smallest = "
        f"{plan.smallest:g} allows no shorter step: "
    )
    if isinstance(failed, Step) and failed.converged:
        at = np.where(failed.status == Status.SLIP, 1.0, 0.0)
        contact = int(np.argmax(at * np.linalg.norm(failed.slip, axis=1)))
        message = (
            f"{where}contact {contact} slips by {find_largest_slip(failed):g}, more than "
            f"slip = {plan.slip:g}; raise slip, or lower smallest"
        )
        return path.add_steps(NotConvergedError(message))
    error = path.make_failure(failed) if isinstance(failed, Step) else failed
    return path.add_steps(with_message(error, where + error.reason))
