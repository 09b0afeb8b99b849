"""Loads, prescribed displacements and gaps of each load step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import counted, mistyped
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats, together
from bipot_rs._lib.validation import gap as gap_of_step
from bipot_rs._lib.validation import gaps as gaps_of_steps
from bipot_rs._lib.validation import loads as steps_of
from bipot_rs.contact.path.moving_gaps import MovingGaps, checked
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.results.state import State

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start

T = TypeVar("T")
Loads = tuple[Floats, Floats]
# Total load, prescribed displacements, and gaps or None for those of the problem.
Gap = Floats | MovingGaps
Totals = tuple[Floats, Floats, Gap | None]


class Held(Protocol):
    """Inclined supports, rigid sets and cyclic symmetries, which K and B do not contain."""

    @property
    def dependent(self) -> Ints:
        """Degrees of freedom that follow others, prescribed as zero."""

    def stiffness(self, K: Any) -> Any:
        """K with these supports."""

    def load(self, force: Floats) -> Floats:
        """Forces without the reactions of these supports."""

    def prescribed(self, values: Floats) -> None:
        """Raise for displacements that these supports do not allow."""

    def displacement(self, y: Floats) -> Floats:
        """Displacements of all degrees of freedom, from the solution of (1)."""

    def unknowns(self, u: Floats) -> Floats:
        """The solution of (1), from the displacements of all degrees of freedom."""


@dataclass(frozen=True)
class Loading:
    """Checks the totals of each step, and holds the loads and gaps of the problem.

    Attributes
    ----------
    n, fixed
        Number of degrees of freedom, and of the prescribed ones.
    contacts, d
        Number of contacts and of their components.
    loads
        ``loads`` of the problem: load and prescribed displacements of each step.
    gaps : (steps, n_c, d), MovingGaps or None
        ``gaps`` of the problem.
    held
        Nodes on inclined supports.
    framed
        Whether the frames of the contacts are known, which `MovingGaps` need.
    """

    n: int
    fixed: int
    contacts: int
    d: int
    loads: list[Loads] | None = None
    gaps: Gap | None = None
    held: Held | None = None
    framed: bool = False

    @classmethod
    def of(
        cls,
        n: int,
        fixed: int,
        contacts: int,
        d: int,
        loads: Any,
        gaps: ArrayLike | MovingGaps | None,
        held: Held | None = None,
        framed: bool = False,
    ) -> Loading:
        """Check the loads and gaps of a `ContactProblem`."""
        known = None
        if loads is not None:
            given = loads if isinstance(loads, tuple) else (loads, None)
            if len(given) != 2:
                raise ValueError(
                    f"loads is a tuple of {len(given)}, expected an array or "
                    "(load, prescribed)"
                )
            known = [_kept(held, one) for one in steps_of(*given, n, fixed)]
        moving = None
        if gaps is not None:
            moving = _gaps(gaps, contacts, d, framed)
        if known is not None and moving is not None:
            # Raises unless both have the same number of steps, or one of them has one.
            together("gaps", list(moving), "loads", known, lambda *both: both)
        return cls(n, fixed, contacts, d, known, moving, held, framed)

    def one(self, load: ArrayLike | None, prescribed: ArrayLike | None) -> Loads:
        """Loads and prescribed displacements of one step."""
        if self.loads is not None and load is None and prescribed is None:
            if len(self.loads) == 1:
                return self.loads[0]
            raise ValueError(
                f"load is missing: the loads of this problem have {len(self.loads)} steps, "
                "so give the load of this step"
            )
        steps = steps_of(load, prescribed, self.n, self.fixed)
        if len(steps) != 1:
            raise ValueError(
                f"load and prescribed have {counted(len(steps), 'step')}, expected one"
            )
        return _kept(self.held, steps[0])

    def gap(self, value: ArrayLike | MovingGaps) -> Gap:
        """Gaps of one step by component, ``(n_c, d)``, or with frames."""
        return _gap(value, self.contacts, self.d, self.framed)

    def totals(
        self,
        load: ArrayLike | None,
        prescribed: ArrayLike | None,
        gap: ArrayLike | MovingGaps | None,
        start: Start | None,
    ) -> list[Totals]:
        """Totals of each step: those given, else those of the problem after ``start``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or ``start`` does not determine the next step.
        """
        own = load is None and prescribed is None
        loads = self.loads if own else None
        gaps = self.gaps if gap is None else None
        count = max(len(loads or ()), 0 if gaps is None else len(gaps))
        given = not own or gap is not None
        first = 0
        # A single row of the problem is used in all steps.
        if start is not None and count > (1 if given else 0):
            first = _done(start, count, given)
            _same_path(start, first, loads, gaps)
        forces = steps_of(load, prescribed, self.n, self.fixed)
        forces = (
            loads if loads is not None else [_kept(self.held, one) for one in forces]
        )
        offsets: list[Gap] | None = None
        if gap is not None:
            offsets = list(_gaps(gap, self.contacts, self.d, self.framed))
        elif gaps is not None:
            offsets = list(gaps)
        if first:
            # Arguments hold the following steps only, the problem holds all steps.
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
        gap: Callable[[float], ArrayLike | MovingGaps] | None,
        end: float,
    ) -> Callable[[float], Totals]:
        """Totals as a function of ``s``; arrays are scaled in proportion to ``s``."""
        if self.loads is not None and load is None and prescribed is None:
            raise ValueError(
                "load is missing: the loads of this problem have "
                f"{counted(len(self.loads), 'load step')}, and adaptive steps need the load "
                "as a function of s"
            )
        force = _proportional("load", load, self.n, end)
        moved = _proportional("prescribed", prescribed, self.fixed, end)
        if gap is None and self.gaps is not None:
            raise ValueError(
                "gap is missing: the gaps of this problem have "
                f"{counted(len(self.gaps), 'load step')}, and adaptive steps need the gap "
                "as a function of s"
            )
        at = _gaps_at(gap, self.contacts, self.d, self.framed)
        return lambda s: (*_kept(self.held, (force(s), moved(s))), at(s))


def _kept(held: Held | None, loads: Loads) -> Loads:
    """Loads of one step, with the reactions of inclined supports removed."""
    if held is None:
        return loads
    force, moved = loads
    held.prescribed(moved)
    return held.load(force), moved


def _framed(framed: bool) -> None:
    if not framed:
        raise ValueError(
            "gap has frames of each step, but the frames of B are not known: pass frame= to "
            "ContactProblem"
        )


def _gap(value: Any, contacts: int, d: int, framed: bool, what: str = "gap") -> Gap:
    """Gaps of one step."""
    if not isinstance(value, MovingGaps):
        return gap_of_step(value, contacts, d, what)
    _framed(framed)
    if value.gap.ndim != 1:
        raise ValueError(
            f"{what} has the moving gaps of {counted(len(value), 'step')}, expected those "
            "of one, moving[k]"
        )
    return checked(value, contacts, d)


def _gaps(value: Any, contacts: int, d: int, framed: bool) -> Gap:
    """Gaps of each step."""
    if not isinstance(value, MovingGaps):
        return gaps_of_steps(value, contacts, d)
    _framed(framed)
    found = checked(value, contacts, d)
    if found.gap.ndim == 1:
        return MovingGaps(found.gap[None], found.frame[None], found.drag[None])
    return found


def check_case(k: int, case: Any) -> None:
    """Check the type and the keys of case ``k`` of `ContactProblem.solve_many`."""
    keys = ("load", "prescribed", "gap", "mu", "start")
    expected = f"{', '.join(keys[:-1])} or {keys[-1]}"
    if not isinstance(case, Mapping):
        raise mistyped(f"case {k}", case, f"a mapping with {expected}")
    unknown = sorted(set(map(str, case)) - set(keys))
    if unknown:
        raise TypeError(f"case {k} has {unknown[0]!r}, expected {expected}")


def done(start: Start | None) -> int:
    """Number of steps before the end of ``start``, 0 if it is a single step."""
    return start.first_step + len(start) if isinstance(start, Result) else 0


def reached(start: Start | None) -> Step | None:
    """The step that a path continues from.

    Raises
    ------
    TypeError
        ``start`` is not a `Result`, a `Step` or a `State`.
    """
    if isinstance(start, Result):
        # A path without steps continues from its own start.
        return start[-1] if len(start) else start.start
    if isinstance(start, State):
        return start.step()
    if start is None or isinstance(start, Step):
        return start
    raise mistyped("start", start, "a Result, one of its steps, or a State")


def _done(start: Start, count: int, given: bool) -> int:
    """`done`, checked against the ``count`` steps of the loads or gaps of the problem."""
    if not isinstance(start, Result):
        raise TypeError(
            f"start is a {type(start).__name__}, expected a Result: its number of steps "
            f"determines the next of the {count} steps of this problem; or give the load "
            "and gap of the following steps"
        )
    first = done(start)
    if first > count or (given and first == count):
        raise ValueError(
            f"start has {counted(first, 'step')}, and the loads or gaps of this problem "
            f"have {count}: give the load and gap of the following steps"
        )
    return first


def _behind(first: int, count: int, rows: list[T], what: str, given: bool) -> list[T]:
    """Rows of the steps after ``first`` of ``count`` steps; a single row is repeated."""
    rest = count - first
    if len(rows) == 1:
        return rows * rest
    if given and len(rows) != rest:
        raise ValueError(
            f"{what} has {counted(len(rows), 'step')}, expected {rest}: the remaining ones "
            f"of the {count} steps of this problem after start"
        )
    return rows if given else rows[first:]


def _same_path(
    start: Start, first: int, loads: list[Loads] | None, gaps: Gap | None
) -> None:
    """Raise if ``start`` is not the end of step ``first`` of the path of the problem."""
    last = reached(start)
    if not first or last is None:
        return
    behind = first - 1
    own: dict[str, Gap | None] = {}
    if loads is not None:
        own["load"], own["prescribed"] = loads[min(behind, len(loads) - 1)]
    if gaps is not None:
        own["gap"] = gaps[min(behind, len(gaps) - 1)]
    other = differing(last, own)
    if other is not None:
        raise ValueError(
            f"start ends with another {other} than load step {behind + 1} of this "
            f"problem: give the {other} of the following steps"
        )


def differing(step: Step, totals: Mapping[str, Gap | None]) -> str | None:
    """Name of the first total that differs from that of a step, or None.

    A step that was read from a file has no loads, which then count as equal.
    """
    named: dict[str, Floats | None] = {}
    for name, own in totals.items():
        if isinstance(own, MovingGaps):
            named |= {"gap": own.by_component, "frame": own.frame, "drag": own.drag}
        else:
            named[name] = own
    for name, own in named.items():
        theirs = getattr(step, name)
        if theirs is None or own is None:
            lost = name in ("load", "prescribed")
            same = theirs is own or (theirs is None and lost)
        else:
            same = np.array_equal(theirs, own)
        if not same:
            return name
    return None


def _proportional(
    what: str, value: Any, length: int, end: float
) -> Callable[[float], Any]:
    """``value(s)``, or an array scaled by ``s / end``, with its shape checked."""
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
    gap: Callable[[float], Any] | None, contacts: int, d: int, framed: bool
) -> Callable[[float], Any]:
    """``gap(s)`` by component ``(n_c, d)``, checked; None for the gaps of the problem."""
    if gap is None:
        return lambda _: None

    def at(s: float) -> Any:
        return _gap(gap(s), contacts, d, framed, f"gap at s = {s:.10g}")

    return at
