"""Loads, prescribed displacements and gaps of each load step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun, make_type_error
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats, rows_of_steps, together
from bipot_rs._lib.validation import gap as gap_of_step
from bipot_rs._lib.validation import gaps as gaps_of_steps
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.results.latches import Latches
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.results.state import State
from bipot_rs.contact.sensitivity.model import Held

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start

T = TypeVar("T")
Loads = tuple[Floats, Floats]
# Total load, prescribed displacements, and gaps or None for those of the problem.
Gap = Floats | MovingGaps
Totals = tuple[Floats, Floats, Gap | None]


@dataclass(frozen=True, eq=False)
class Loading:
    """Checks the totals of each step, and holds the loads and gaps of the problem."""

    # n, fixed: number of degrees of freedom, and of the prescribed ones.
    n: int
    fixed: int
    contacts: ContactSet  # the contacts
    # `loads` of the problem: load and prescribed displacements of each step.
    loads: list[Loads] | None = None
    # (steps, n_c, d), MovingGaps or None: `gaps` of the problem.
    gaps: Gap | None = None
    # Whether these were given by component; None without them.
    gaps_by_component: bool | None = None
    held: Held | None = None  # inclined supports, rigid sets and cyclic symmetries
    latches: Latches | None = None  # bolts
    # Checks the load of a path, and lists that of each step. Loads of PETSc are no arrays.
    read_forces: Callable[[object], Sequence[Floats]] | None = None

    @classmethod
    def check(
        cls,
        n: int,
        fixed: int,
        contacts: ContactSet,
        loads: ArrayLike | tuple[ArrayLike | None, ArrayLike | None] | None = None,
        gaps: ArrayLike | MovingGaps | None = None,
        held: Held | None = None,
        latches: Latches | None = None,
    ) -> Loading:
        """Check the loads and gaps of a `ContactProblem`."""
        bare = cls(n, fixed, contacts, held=held, latches=latches)
        of_steps = None
        if loads is not None:
            pair = loads if isinstance(loads, tuple) else (loads, None)
            if len(pair) != 2:
                raise ValueError(
                    f"loads is a tuple of {len(pair)}, expected an array or "
                    "(load, prescribed)"
                )
            of_steps = bare._read_loads(*pair)
        moving = None if gaps is None else bare._read_gaps(gaps, "gaps")
        if of_steps is not None and moving is not None:
            # Raises unless both have the same number of steps, or one of them has one.
            together("gaps", list(moving), "loads", of_steps, lambda *both: both)
        by_component = bare.are_by_component(gaps)
        return replace(
            bare, loads=of_steps, gaps=moving, gaps_by_component=by_component
        )

    def are_by_component(
        self, gap: ArrayLike | MovingGaps | Callable[[float], object] | None
    ) -> bool | None:
        """Whether the gaps of a path are by component; None without gaps of steps.

        ``gap`` are those of `ContactProblem.solve`; None for those of the problem.
        """
        if gap is None:
            return self.gaps_by_component
        if isinstance(gap, MovingGaps):
            return False
        return callable(gap) or np.ndim(gap) == 3

    def read_step(self, load: ArrayLike | None, prescribed: ArrayLike | None) -> Loads:
        """Loads and prescribed displacements of one step."""
        if self.loads is not None and load is None and prescribed is None:
            if len(self.loads) == 1:
                return self.loads[0]
            raise ValueError(
                f"load is missing: the loads of this problem have {len(self.loads)} steps, "
                "so give the load of this step"
            )
        steps = self._read_loads(load, prescribed)
        if len(steps) != 1:
            raise ValueError(
                f"load and prescribed have {count_noun(len(steps), 'step')}, expected one"
            )
        return steps[0]

    def read_gap(self, value: ArrayLike | MovingGaps, what: str = "gap") -> Gap:
        """Gaps of one step by component, ``(n_c, d)``, or with frames."""
        if not isinstance(value, MovingGaps):
            return gap_of_step(value, *self.contacts.shape, what)
        self._check_frames(value)
        if value.gap.ndim != 1:
            raise ValueError(
                f"{what} has the moving gaps of {count_noun(len(value), 'step')}, expected "
                "those of one, moving[k]"
            )
        return value

    def _read_gaps(self, value: ArrayLike | MovingGaps, what: str = "gap") -> Gap:
        """Gaps of each step."""
        if not isinstance(value, MovingGaps):
            return gaps_of_steps(value, *self.contacts.shape, what)
        self._check_frames(value)
        if value.gap.ndim == 1:
            return MovingGaps(value.gap[None], value.frame[None], value.drag[None])
        return value

    def _check_frames(self, moving: MovingGaps) -> None:
        if self.contacts.frame is None:
            raise ValueError(
                "gap has frames of each step, but the frames of B are not known: pass "
                "frame= to ContactProblem"
            )
        moving.check_shape(*self.contacts.shape)

    @property
    def _may_be_free(self) -> Ints:
        """Places of the prescribed displacements that may be NaN."""
        return np.zeros(0, np.int64) if self.latches is None else self.latches.at

    def _read_loads(
        self, load: ArrayLike | None, prescribed: ArrayLike | None
    ) -> list[Loads]:
        """Load and prescribed displacements of each step."""
        if self.read_forces is None:
            forces: Sequence[Floats] = list(rows_of_steps("load", load, self.n))
        else:
            forces = self.read_forces(load)
        rows = rows_of_steps("prescribed", prescribed, self.fixed, self._may_be_free)
        motions = list(rows)
        pairs = together("prescribed", motions, "load", forces, lambda u, f: (f, u))
        return [self._without_reactions(*pair) for pair in pairs]

    def _without_reactions(self, force: Floats, moved: Floats) -> Loads:
        """Loads of one step, without the reactions of inclined supports."""
        if self.held is None:
            return force, moved
        self.held.prescribed(moved)
        return self.held.load(force), moved

    def list_totals(
        self,
        load: ArrayLike | None,
        prescribed: ArrayLike | None,
        gap: ArrayLike | MovingGaps | None,
        start: Start | None = None,
    ) -> list[Totals]:
        """Totals of each step: those given, else those of the problem after ``start``.

        Raises `TypeError` or `ValueError`: an argument is wrong, or ``start`` does not
        determine the next step.
        """
        own_loads = load is None and prescribed is None
        loads = self.loads if own_loads else None
        gaps = self.gaps if gap is None else None
        count = max(len(loads or ()), 0 if gaps is None else len(gaps))
        is_given = not own_loads or gap is not None
        first = 0
        # A single row of the problem is used in all steps.
        if start is not None and count > (1 if is_given else 0):
            first = _count_finished(start, count, is_given)
            _check_same_path(start, first, loads, gaps)
        forces = self._read_loads(load, prescribed) if loads is None else loads
        offsets: list[Gap] | None = None
        if gap is not None:
            offsets = list(self._read_gaps(gap))
        elif gaps is not None:
            offsets = list(gaps)
        if first:
            # Arguments hold the following steps only, the problem holds all steps.
            forces = _drop_finished(first, count, forces, "load", loads is None)
            if offsets is not None:
                offsets = _drop_finished(first, count, offsets, "gap", gaps is None)
        if offsets is None:
            return [(f, u, None) for f, u in forces]
        return together(
            "gap", offsets, "the load path", forces, lambda g, loads: (*loads, g)
        )

    def _make_force(self, load: object, end: float) -> Callable[[float], Floats]:
        """Loads as a function of ``s``."""
        read = self.read_forces
        if read is None or not callable(load):
            return _scale_or_call("load", load, self.n, end)
        return lambda s: read(load(s))[0]

    def make_totals(
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
                f"{count_noun(len(self.loads), 'load step')}, and adaptive steps need the load "
                "as a function of s"
            )
        force = self._make_force(load, end)
        free = self._may_be_free
        moved = _scale_or_call("prescribed", prescribed, self.fixed, end, free)
        if gap is None and self.gaps is not None:
            raise ValueError(
                "gap is missing: the gaps of this problem have "
                f"{count_noun(len(self.gaps), 'load step')}, and adaptive steps need the gap "
                "as a function of s"
            )

        def totals(s: float) -> Totals:
            loads = self._without_reactions(force(s), moved(s))
            if gap is None:
                return (*loads, None)
            return (*loads, self.read_gap(gap(s), f"gap at s = {s:.10g}"))

        return totals


def count_steps(start: Start | None) -> int:
    """Number of steps before the end of ``start``, 0 if it is a single step."""
    return start.first_step + len(start) if isinstance(start, Result) else 0


def last_step(start: Start | None) -> Step | None:
    """The step that a path continues from.

    Raises `TypeError`: ``start`` is not a `Result`, a `Step` or a `State`.
    """
    if isinstance(start, Result):
        # A path without steps continues from its own start.
        return start[-1] if len(start) else start.start
    if isinstance(start, State):
        return start.step()
    if start is None or isinstance(start, Step):
        return start
    raise make_type_error("start", start, "a Result, one of its steps, or a State")


def _count_finished(start: Start, count: int, given: bool) -> int:
    """`count_steps`, checked against the ``count`` steps of the loads or gaps of the problem."""
    if not isinstance(start, Result):
        raise TypeError(
            f"start is a {type(start).__name__}, expected a Result: its number of steps "
            f"determines the next of the {count} steps of this problem; or give the load "
            "and gap of the following steps"
        )
    first = count_steps(start)
    if first > count or (given and first == count):
        raise ValueError(
            f"start has {count_noun(first, 'step')}, and the loads or gaps of this problem "
            f"have {count}: give the load and gap of the following steps"
        )
    return first


def _drop_finished(
    first: int, count: int, rows: list[T], what: str, given: bool
) -> list[T]:
    """Rows of the steps after ``first`` of ``count`` steps; a single row is repeated."""
    rest = count - first
    if len(rows) == 1:
        return rows * rest
    if given and len(rows) != rest:
        raise ValueError(
            f"{what} has {count_noun(len(rows), 'step')}, expected {rest}: the remaining ones "
            f"of the {count} steps of this problem after start"
        )
    return rows if given else rows[first:]


def _check_same_path(
    start: Start, first: int, loads: list[Loads] | None, gaps: Gap | None
) -> None:
    """Raise if ``start`` is not the end of step ``first`` of the path of the problem."""
    last = last_step(start)
    if not first or last is None:
        return
    behind = first - 1
    ends_of_path: dict[str, Gap | None] = {}
    if loads is not None:
        ends_of_path["load"], ends_of_path["prescribed"] = loads[
            min(behind, len(loads) - 1)
        ]
    if gaps is not None:
        ends_of_path["gap"] = gaps[min(behind, len(gaps) - 1)]
    other = find_difference(last, ends_of_path)
    if other is not None:
        raise ValueError(
            f"start ends with another {other} than load step {behind + 1} of this "
            f"problem: give the {other} of the following steps"
        )


def find_difference(step: Step, totals: Mapping[str, Gap | None]) -> str | None:
    """Name of the first total that differs from that of a step, or None.

    A step that was read from a file has no loads, which then count as equal.
    """
    named: dict[str, Floats | None] = {}
    for name, total in totals.items():
        if isinstance(total, MovingGaps):
            named |= {
                "gap": total.by_component,
                "frame": total.frame,
                "drag": total.drag,
            }
        else:
            named[name] = total
    for name, total in named.items():
        theirs = getattr(step, name)
        if theirs is None or total is None:
            lost = name in ("load", "prescribed")
            same = theirs is total or (theirs is None and lost)
        else:
            # Free latches are NaN.
            same = np.array_equal(theirs, total, equal_nan=True)
        if not same:
            return name
    return None


def _scale_or_call(
    what: str, value: object, length: int, end: float, free: Ints | None = None
) -> Callable[[float], Floats]:
    """``value(s)``, or an array scaled by ``s / end``, with its shape checked."""
    if value is None:
        zero = np.zeros(length)
        return lambda _: zero
    if not callable(value):
        whole = floats(what, value, shape=(length,), but=free)
        return lambda s: whole if s == end else whole * (s / end)

    def at(s: float) -> Floats:
        return floats(f"{what} at s = {s:.10g}", value(s), shape=(length,), but=free)

    return at
