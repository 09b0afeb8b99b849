"""What is asked of each load step: totals that are given, and those a problem has itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, together
from bipot_rs._lib.validation import gap as gap_of_step
from bipot_rs._lib.validation import gaps as gaps_of_steps
from bipot_rs._lib.validation import loads as steps_of
from bipot_rs.contact.result import Result
from bipot_rs.contact.solution import Step

T = TypeVar("T")
Loads = tuple[Floats, Floats]
# Total load, prescribed displacements, and gaps where they are not the problem's.
Totals = tuple[Floats, Floats, Floats | None]


class Held(Protocol):
    """What K and B cannot say of nodes that are held across the axes."""

    def stiffness(self, K: Any) -> Any:
        """K of which they are held."""

    def load(self, force: Floats) -> Floats:
        """Forces without what holds them."""

    def prescribed(self, values: Floats) -> None:
        """Refuse displacements that they cannot have."""


@dataclass(frozen=True)
class Loading:
    """Sizes of the totals of a step, and what a problem has of its own for each step.

    Attributes
    ----------
    n, fixed
        Degrees of freedom, and how many of them are prescribed.
    contacts, d
        Contacts and their components.
    loads
        Loads and prescribed displacements of each step; ``None`` without own ones.
    gaps : (steps, n_c, d) or None
        Gaps of each step; ``None`` where they do not change.
    held
        Of nodes that planes hold, which every load must know.
    """

    n: int
    fixed: int
    contacts: int
    d: int
    loads: list[Loads] | None = None
    gaps: Floats | None = None
    held: Held | None = None

    @classmethod
    def of(
        cls,
        n: int,
        fixed: int,
        contacts: int,
        d: int,
        loads: Any,
        gaps: ArrayLike | None,
        held: Held | None = None,
    ) -> Loading:
        """With loads and gaps as `ContactProblem` takes them, checked."""
        known = None
        if loads is not None:
            given = loads if isinstance(loads, tuple) else (loads, None)
            if len(given) != 2:
                raise ValueError(
                    f"loads is a tuple of {len(given)}, expected an array or "
                    "(load, prescribed)"
                )
            known = [_kept(held, one) for one in steps_of(*given, n, fixed)]
        moving = None if gaps is None else gaps_of_steps(gaps, contacts, d)
        if known is not None and moving is not None:
            # As many of the one as of the other, or one.
            together("gaps", list(moving), "loads", known, lambda *both: both)
        return cls(n, fixed, contacts, d, known, moving, held)

    def one(self, load: ArrayLike | None, prescribed: ArrayLike | None) -> Loads:
        """Loads and prescribed displacements of one step."""
        if self.loads is not None and load is None and prescribed is None:
            if len(self.loads) == 1:
                return self.loads[0]
            raise ValueError(
                f"load is missing: this problem has loads of {len(self.loads)} steps of its "
                "own, and one is asked for"
            )
        steps = steps_of(load, prescribed, self.n, self.fixed)
        if len(steps) != 1:
            raise ValueError(
                f"load and prescribed have {counted(len(steps), 'step')}, expected one"
            )
        return _kept(self.held, steps[0])

    def gap(self, value: ArrayLike) -> Floats:
        """Gaps of one step by component, ``(n_c, d)``."""
        return gap_of_step(value, self.contacts, self.d)

    def totals(
        self,
        load: ArrayLike | None,
        prescribed: ArrayLike | None,
        gap: ArrayLike | None,
        start: Result | Step | None,
    ) -> list[Totals]:
        """Of each step to come; what is not given is the problem's own behind ``start``.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named, or a start that does not tell what is next.
        """
        own = load is None and prescribed is None
        loads = self.loads if own else None
        gaps = self.gaps if gap is None else None
        count = max(len(loads or ()), 0 if gaps is None else len(gaps))
        given = not own or gap is not None
        first = 0
        # One step of its own stands for as many as are given.
        if start is not None and count > (1 if given else 0):
            first = _done(start, count, given)
            _same_path(start, first, loads, gaps)
        forces = steps_of(load, prescribed, self.n, self.fixed)
        forces = (
            loads if loads is not None else [_kept(self.held, one) for one in forces]
        )
        offsets: list[Floats] | None = None
        if gap is not None:
            offsets = list(gaps_of_steps(gap, self.contacts, self.d))
        elif gaps is not None:
            offsets = list(gaps)
        if first:
            # Of what is given there are the steps to come, of what is ours all.
            forces = _behind(first, count, forces, "load", loads is None)
            if offsets is not None:
                offsets = _behind(first, count, offsets, "gap", gaps is None)
        if offsets is None:
            return [(f, u, None) for f, u in forces]
        return together(
            "gap", offsets, "the load path", forces, lambda g, loads: (*loads, g)
        )

    def along(
        self,
        load: ArrayLike | Callable[[float], ArrayLike] | None,
        prescribed: ArrayLike | Callable[[float], ArrayLike] | None,
        gap: Callable[[float], ArrayLike] | None,
        end: float,
    ) -> Callable[[float], Totals]:
        """Totals at ``s``, of functions or of arrays that grow in proportion to it."""
        if self.loads is not None and load is None and prescribed is None:
            raise ValueError(
                "load is missing: this problem has loads of "
                f"{counted(len(self.loads), 'load step')} of its own, and steps in between "
                "need them as a function of s"
            )
        force = _proportional("load", load, self.n, end)
        moved = _proportional("prescribed", prescribed, self.fixed, end)
        if gap is None and self.gaps is not None:
            raise ValueError(
                "gap is missing: this problem has gaps of "
                f"{counted(len(self.gaps), 'load step')}, and steps in between need them "
                "as a function of s"
            )
        at = _gaps_at(gap, self.contacts, self.d)
        return lambda s: (*_kept(self.held, (force(s), moved(s))), at(s))


def _kept(held: Held | None, loads: Loads) -> Loads:
    """Loads of a step, of nodes that planes hold without what the planes carry."""
    if held is None:
        return loads
    force, moved = loads
    held.prescribed(moved)
    return held.load(force), moved


def check_case(k: int, case: Any) -> None:
    """Refuse what is no mapping of a path of several, case ``k``."""
    keys = ("load", "prescribed", "gap", "mu", "start")
    expected = f"{', '.join(keys[:-1])} or {keys[-1]}"
    if not isinstance(case, Mapping):
        raise TypeError(
            f"case {k} is a {type(case).__name__}, expected a mapping with {expected}"
        )
    unknown = sorted(set(map(str, case)) - set(keys))
    if unknown:
        raise TypeError(f"case {k} has {unknown[0]!r}, expected {expected}")


def done(start: Result | Step | None) -> int:
    """Steps of a path behind it, as far as ``start`` tells them."""
    return start._first + len(start) if isinstance(start, Result) else 0


def reached(start: Result | Step | None) -> Step | None:
    """The step that a path goes on from.

    Raises
    ------
    TypeError
        What is no path and no step of one.
    """
    if isinstance(start, Result):
        # Where nothing was added, what that path itself started from.
        return start[-1] if len(start) else start.start
    if start is None or isinstance(start, Step):
        return start
    raise TypeError(
        f"start is a {type(start).__name__}, expected a Result or one of its steps"
    )


def _done(start: Result | Step, count: int, given: bool) -> int:
    """The same, of a path of which a problem has ``count`` steps itself."""
    if not isinstance(start, Result):
        raise TypeError(
            f"start is a {type(start).__name__}, expected a Result: how many steps it has "
            f"tells which of the {count} that this problem has of its own come next; or "
            "give gap, and load where the problem has loads"
        )
    first = done(start)
    if first > count or (given and first == count):
        raise ValueError(
            f"start has {counted(first, 'step')}, and this problem has loads or gaps of "
            f"its own for {count}: give those of the steps to come"
        )
    return first


def _behind(first: int, count: int, rows: list[T], what: str, given: bool) -> list[T]:
    """What is to come of a path of ``count`` steps; one row stands for all of them."""
    rest = count - first
    if len(rows) == 1:
        return rows * rest
    if given and len(rows) != rest:
        raise ValueError(
            f"{what} has {counted(len(rows), 'step')}, expected {rest}: so many of the "
            f"{count} that this problem has of its own are to come behind start"
        )
    return rows if given else rows[first:]


def _same_path(
    start: Result | Step,
    first: int,
    loads: list[Loads] | None,
    gaps: Floats | None,
) -> None:
    """Refuse a start that another path has led to."""
    last = reached(start)
    if not first or last is None:
        return
    behind = first - 1
    own: dict[str, Floats | None] = {}
    if loads is not None:
        own["load"], own["prescribed"] = loads[min(behind, len(loads) - 1)]
    if gaps is not None:
        own["gap"] = gaps[min(behind, len(gaps) - 1)]
    other = differing(last, own)
    if other is not None:
        raise ValueError(
            f"start ends with another {other} than load step {behind + 1} of the path that "
            f"this problem has of its own: give {other}, of the steps to come"
        )


def differing(step: Step, totals: Mapping[str, Floats | None]) -> str | None:
    """Which of these totals is another than that of a step, as far as the step knows.

    Files keep no loads; gaps they do, of paths that have any.
    """
    for name, own in totals.items():
        theirs = getattr(step, name)
        if theirs is None or own is None:
            same = theirs is own or (theirs is None and name != "gap")
        else:
            same = np.array_equal(theirs, own)
        if not same:
            return name
    return None


def _proportional(
    what: str, value: Any, length: int, end: float
) -> Callable[[float], Any]:
    """``value(s)``, or an array that grows in proportion to s up to ``end``; checked."""
    if value is None:
        zero = np.zeros(length)
        return lambda _: zero
    if not callable(value):
        whole = floats(what, value, shape=(length,))
        return lambda s: whole if s == end else whole * (s / end)

    def at(s: float) -> Any:
        return floats(f"{what} at s = {s:.10g}", value(s), shape=(length,))

    return at


def _gaps_at(
    gap: Callable[[float], Any] | None, contacts: int, d: int
) -> Callable[[float], Any]:
    """``gap(s)`` by component ``(n_c, d)``, checked; None, those of the problem, without it."""
    if gap is None:
        return lambda _: None

    def at(s: float) -> Any:
        return gap_of_step(gap(s), contacts, d, f"gap at s = {s:.10g}")

    return at
