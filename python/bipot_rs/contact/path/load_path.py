"""A load path: solves its steps one by one, or reduces one of them to its reactions."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.messages import body_of, count_noun
from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import Bools, CsrMatrix, Floats
from bipot_rs._lib.validation import logical
from bipot_rs.contact.errors import BipotError, NoEquilibriumError, NotConvergedError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.frames import find_rotation
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.messages import rigid_motion_names as motion
from bipot_rs.contact.messages.remarks import ProblemRemarks
from bipot_rs.contact.path.bond import Bond
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.direct import Direct
from bipot_rs.contact.path.engine import (
    REPLACED,
    Engine,
    RestoredDigits,
    StepData,
    StepFrames,
)
from bipot_rs.contact.path.load_steps import (
    Gap,
    Loading,
    Loads,
    Totals,
    count_steps,
    last_step,
)
from bipot_rs.contact.path.moving_gaps import (
    MovingGaps,
    carry_step,
    list_components,
    rotate,
)
from bipot_rs.contact.proof.equilibrium import describe_friction, name_friction
from bipot_rs.contact.results.derivatives import PathDerivatives
from bipot_rs.contact.results.latches import Latches
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import (
    Computed,
    Recovery,
    Step,
    find_opening,
    make_step,
    revise,
)
from bipot_rs.contact.sensitivity.model import Held

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


OnStep = Callable[[int, Step], object] | None


@contextmanager
def show_progress(wanted: bool, total: float, on_step: OnStep) -> Iterator[OnStep]:
    """``on_step`` with a bar, of tqdm if it is installed, up to ``total`` steps or ``s``."""
    logical("progress", wanted)
    if not wanted:
        yield on_step
        return
    try:
        bar = import_module("tqdm.auto").tqdm(total=total, unit="step")
        advance = bar.update
    except ModuleNotFoundError:
        load_library("rich", extra="cli", need="progress bars")
        bar = import_module("rich.progress").Progress()
        task = bar.add_task("load steps", total=total)

        def advance(more: float) -> None:
            bar.advance(task, more)

    done = 0.0

    def count(k: int, step: Step) -> None:
        nonlocal done
        before, done = done, k + 1 if step.s is None else step.s
        advance(done - before)
        if on_step is not None:
            on_step(k, step)

    with bar:
        yield count


E = TypeVar("E", bound=BipotError)

# Why a path that continues from a step with the entry `REPLACED` is direct.
CONTINUED = "in the part of the path before"

# A path that continues from a step with frames of its own needs those of B.
NO_FRAME = (
    "start has frames of its own, but the frames of B are not known: pass frame= to "
    "ContactProblem"
)


@dataclass(frozen=True, eq=False)
class PathProblem:
    """What the load paths of a problem share."""

    contacts: ContactSet  # the contacts, with the friction of the path
    # Warnings about the problem, to which those about a path are added.
    remarks: ProblemRemarks
    seconds: float  # time of the condensation
    # Names of the bodies, each with its first degree of freedom.
    bodies: Mapping[str, int] | None = None
    restored: RestoredDigits | None = None  # relative error of K, if it is not rounding
    held: Held | None = None  # inclined supports, rigid sets and cyclic symmetries
    # `Result`, or another class with the same arguments.
    make_result: Callable[..., Result] = Result
    # latches, engine_of: bolts, if there are any, and the engine for a set of free ones.
    latches: Latches | None = None
    engine_of: Callable[[Bools], Engine] | None = None


class PathSolver:
    """A load path whose steps are being solved.

    ``engine`` solves the steps; the path continues from ``start``, and ``derivatives`` are
    for those of the result.
    ``path``: state of the core.
    ``before``: the step that the path started from; ``None`` for the unloaded bodies.
    ``steps``: the steps that converged.
    """

    def __init__(
        self,
        engine: Engine,
        problem: PathProblem,
        settings: _core.Settings,
        start: Start | None,
        derivatives: PathDerivatives[Any] | None = None,
    ) -> None:
        self._problem = problem
        self._contacts = problem.contacts
        self._settings = settings
        self._derivatives = derivatives
        self.before = find_start(start, self._contacts.shape)
        framed = self.before is not None and self.before.frame is not None
        if framed and self._contacts.frame is None:
            raise ValueError(NO_FRAME)
        # Whether the direct engine took over from the one that was chosen.
        self._replaced = self.before is not None and REPLACED in self.before.stats
        # With the law of the path; `_engine` has what is left of the cohesion.
        self._whole = engine.replacement(CONTINUED) if self._replaced else engine
        self._first = count_steps(start)
        self.steps: list[Step] = []
        # Which latches the engine has free; None before the first step.
        self._free: Bools | None = None
        if problem.latches is not None:
            problem.latches.check_start(self.before)
        self.rewind()
        self._seconds = {"condense": problem.seconds, "solve": 0.0, "recover": 0.0}

    def rewind(self) -> None:
        """Set the core to the state after the last step."""
        at = self._last_step()
        self._last = None if at is None else at.relative_displacement
        self._bond = Bond.begin(self._contacts, at)
        self._engine = self._weaken(self._whole)
        held, latches = self._problem.held, self._problem.latches
        if latches is not None:
            if self._free is None:
                at = None
            elif at is not None and (
                at.tightened is None or not np.array_equal(at.tightened, self._free)
            ):
                # Its rigid motions and working set are those of another K.
                at = replace(at, from_state=True, working_set=None, working_motion=None)
        if held is not None and at is not None:
            u = at.computed.displacement
            if u is not None:
                at = replace(at, computed=Computed(held.unknowns(u)))
        self.path = self._engine.path(at)
        # Whether `path` is in other frames than those of B.
        self._turned: Floats | None = None

    @property
    def has_memory(self) -> bool:
        """Whether contacts may break or dilate, or bolts latch: steps then change the problem."""
        bond, latches = self._bond, self._problem.latches
        return not (bond.broken is None and bond.dilation is None and latches is None)

    def _weaken(self, engine: Engine) -> Engine:
        """The engine with the cohesion that is left."""
        weakened = self._bond.weakened
        return engine if weakened is self._contacts.law else engine.with_law(weakened)

    def _last_step(self) -> Step | None:
        """The last step."""
        return self.steps[-1] if self.steps else self.before

    def _turn_to_frames(self, gap: Gap | None) -> Floats | None:
        """Set the core to the frames of a step.

        Returns ``(n_c, d, d) or None``: gaps by component of the step, if it has frames.
        """
        at, base = self._last_step(), self._contacts.frame
        offsets = None if gap is None else list_components(gap)
        if base is None:
            return offsets
        frame = gap.frame if isinstance(gap, MovingGaps) else base
        frame_of_step = base if at is None or at.frame is None else at.frame
        turned = not np.array_equal(frame, base)
        if (
            turned
            or not np.array_equal(frame_of_step, base)
            or self._turned is not None
        ):
            engine, self._turned = self._engine, None
            if turned:
                self._turned = find_rotation(frame, base)
                engine = engine.with_rotation(self._turned)
            if at is not None:
                start = self._contacts.gap_by_component[:, 0]
                at = carry_step(at, frame, base, start)
            self.path = engine.path(at)
            self._last = None if at is None else at.relative_displacement
        return offsets

    def advance(self, load: Floats, prescribed: Floats, gap: Gap | None = None) -> Step:
        """Solve one step and add it to the path; raise if that fails.

        ``gap`` are the gaps of the step, ``(n_c, d)`` or `MovingGaps` of one step; the
        default is those of the problem.
        """
        try:
            step = self.attempt(load, prescribed, gap)
        except NoEquilibriumError as error:
            raise self.add_steps(error) from None
        return self._accept_converged(step)

    def attempt(self, load: Floats, prescribed: Floats, gap: Gap | None = None) -> Step:
        """Solve a trial step. It joins the path only if it is accepted.

        Raises `NoEquilibriumError`: contacts contradict each other.
        """
        began = time.perf_counter()
        given, latches = prescribed, self._problem.latches
        if latches is not None:
            free = latches.find_free(given)
            self._set_free(free)
            filled = latches.fill(given, self._last_step())
            prescribed = latches.drop_free(filled, free)
        try:
            offsets = self._turn_to_frames(gap)
            step = self._solve_and_break(load, prescribed, offsets)
        finally:
            self._seconds["solve"] += time.perf_counter() - began
        if self.path.engine.name != self._engine.name:
            # The direct engine replaced the iterative one, for the rest of the path.
            self._whole, self._replaced = self._whole.replacement(), True
            self._engine = self._weaken(self._whole)
        step = self._complete(step, load, prescribed, gap)
        if latches is None or self._free is None:
            return step
        step = revise(step, prescribed=given)
        if not step.converged:
            return step
        r, contacts = step.reaction, self._contacts
        if step.frame is not None and contacts.frame is not None:
            r = rotate(find_rotation(contacts.frame, step.frame), r)
        pushed = contacts.operator.matrix.T @ r.ravel()
        return latches.complete(step, pushed, self._free)

    def _set_free(self, free: Bools) -> None:
        """Take the engine of a set of free latches."""
        make = self._problem.engine_of
        before = self._free
        if make is None or (before is not None and np.array_equal(free, before)):
            return
        engine, self._free = make(free), free
        self._whole = engine.replacement(CONTINUED) if self._replaced else engine
        self.rewind()

    def _solve_and_break(
        self, load: Floats, prescribed: Floats, gap: Floats | None
    ) -> Step:
        """Solve a step; contacts that open lose their cohesion, until no other opens.

        Each time all of them break together, and the step is solved again from the solution
        before. Its relative displacements are replaced by those at the start of the step,
        from which slip counts.
        """
        before, left = self._bond, self._settings
        gap = before.shift(gap, self._contacts.gap_by_component)
        step = self.path.step(load, prescribed, gap, left)
        spent = step
        while step.converged:
            bond = self._bond.break_opened(before.unshift(step))
            if bond is self._bond:
                break
            self._bond = bond
            history = self._last
            if history is None:
                history = np.zeros_like(step.relative_displacement)
            at = revise(step, relative_displacement=history)
            self.path = self.path.engine.with_law(bond.weakened).path(at)
            self._engine = self._weaken(self._whole)
            left = _subtract_spent(self._settings, spent)
            step = self.path.step(load, prescribed, gap, left)
            spent = revise(
                step,
                iterations=spent.iterations + step.iterations,
                work=spent.work + step.work,
                seconds=spent.seconds + step.seconds,
            )
        return self._bond.complete(before.unshift(spent), before)

    def _complete(
        self,
        step: Step,
        load: Floats,
        prescribed: Floats,
        gap: Gap | None = None,
    ) -> Step:
        """Add loads, tractions and the problem to a step of the engine."""
        offsets = None if gap is None else list_components(gap)
        solved_gap = self._bond.shift(offsets, self._contacts.gap_by_component)
        engine, turned = self.path.engine, self._turned
        if turned is not None:
            # A step keeps no rotated W: it is made again for questions about the step.
            engine = self._engine
        elif solved_gap is not None and isinstance(engine, Direct):
            engine = engine.with_gap(solved_gap)
        moving = gap if isinstance(gap, MovingGaps) else None
        recovery = engine.recovery(self._seconds, self._contacts)
        problem, computed = self._problem, step.computed
        if problem.held is not None:
            u = computed.displacement
            if u is not None:
                computed = replace(computed, displacement=problem.held.displacement(u))
            if recovery is not None:
                recovery = HeldRecovery(recovery, problem.held, prescribed)
        data = StepData(
            load,
            prescribed,
            self._last,
            self._settings,
            self._contacts,
            problem.restored,
            None
            if turned is None or solved_gap is None
            else StepFrames(turned, solved_gap),
        )
        return revise(
            step,
            free_motion_text=self._describe_motion(step, moving),
            load=load,
            prescribed=prescribed,
            gap=offsets,
            frame=None if moving is None else moving.frame,
            drag=None if moving is None else moving.drag,
            traction=self._contacts.tractions(step.reaction),
            recovery=recovery,
            inquiry=engine.inquiry(data),
            computed=computed,
            stats={**step.stats, REPLACED: 1} if self._replaced else step.stats,
        )

    def _accept_converged(self, step: Step) -> Step:
        """Accept a step; raise if it did not converge."""
        if not step.converged:
            raise self.make_failure(step)
        self.accept(step)
        return step

    def accept(self, step: Step) -> None:
        """Add a converged step to the path."""
        self.steps.append(step)
        self._last = step.relative_displacement
        if self._bond.dilation is not None:
            self._bond = replace(self._bond, dilation=step.dilation)

    def make_failure(self, step: Step) -> NoEquilibriumError | NotConvergedError:
        """Make the error of a step that did not converge."""
        none = step.outcome is Outcome.NO_EQUILIBRIUM
        engine, direction = self.path.engine, None
        if step.free_motion is not None and isinstance(engine, Direct):
            modes, d = engine.modes(), self._contacts.d
            direction = motion.move_contacts(modes, step.free_motion, d)
            friction = name_friction(self._contacts.law.mu)
            load, moved, bolts = step.load, step.prescribed, self._problem.latches
            if none and load is not None and moved is not None and bolts is None:
                e = engine.load_motions(load, moved)
                friction = describe_friction(modes.T, e, self._bond.weakened, d)
            text = f"{step.free_motion_text}, {friction}"
            step = replace(step, free_motion_text=text)
        return self.add_steps(
            (NoEquilibriumError if none else NotConvergedError)(
                step.message, None, direction
            )
        )

    def add_steps(self, error: E) -> E:
        """Add the number of the step that failed, and the steps before it, to an error."""
        error.at_step(len(self.steps) + 1)
        error.result = self.result(False, str(error))
        return error

    def result(self, success: bool = True, message: str | None = None) -> Result:
        """Make the `Result` of the steps so far."""
        count = count_noun(len(self.steps), "step")
        problem, restored = self._problem, self._problem.restored
        return problem.make_result(
            self.steps,
            contacts=self._contacts.arrays(),
            shape=self._contacts.shape,
            start=self.before,
            # Filled further when displacements are asked for.
            seconds=self._seconds,
            success=success,
            message=f"{count} converged" if message is None else message,
            remarks=(
                *problem.remarks.add_path(self.steps, self._contacts.x),
                *_list_remarks(self.steps, self._first),
            ),
            stiffness_rtol=None if restored is None else restored.digits.rtol,
            rigid_motions_off=None if restored is None else restored.off,
            first_step=self._first,
            derivatives=self._derivatives,
        )

    def solve_all(self, totals: Sequence[Totals]) -> Result:
        """Make the `Result` of steps that are solved now, also if an error ends them."""
        try:
            for asked in totals:
                self.advance(*asked)
        except (NoEquilibriumError, NotConvergedError, ValueError) as failed:
            return self.result(False, str(failed))
        return self.result()

    def take_all(
        self,
        totals: Sequence[Totals],
        answers: tuple[Sequence[_core.LoadStep], Exception | None],
    ) -> Result:
        """Make the `Result` of steps that the core solved, also if an error ended them."""
        solved, error = answers
        try:
            for core, asked in zip(solved, totals, strict=False):
                step = make_step(core)
                self._seconds["solve"] += step.seconds
                self._accept_converged(self._complete(step, *asked))
            if isinstance(error, NoEquilibriumError):
                raise self.add_steps(error)
            if error is not None:
                raise error
        except (NoEquilibriumError, NotConvergedError, ValueError) as failed:
            return self.result(False, str(failed))
        return self.result()

    def _describe_motion(self, step: Step, moving: MovingGaps | None) -> str:
        """Describe the free motion of each body."""
        amounts, engine = step.free_motion, self.path.engine
        if amounts is None or not isinstance(engine, Direct):
            return ""
        contacts, d = self._contacts.shape
        modes = engine.modes()
        felt = np.abs(modes.reshape(len(modes), contacts, d)).max(axis=2) > 0
        stats = engine.stats
        owners = stats["rigid_motion_bodies"]
        # A body without a name is identified by its most moved degree of freedom.
        names: dict[int, str] = {}
        for body, dof in zip(owners, stats["rigid_motion_dofs"], strict=True):
            names.setdefault(body, body_of(dof, self._problem.bodies))
        meeting = [
            tuple(dict.fromkeys(names[owners[k]] for k in np.flatnonzero(felt[:, i])))
            for i in range(contacts)
        ]
        return motion.describe_motion(
            motion.move_contacts(modes, amounts, d),
            find_opening(step.outcome, self._contacts.law.mu),
            points=self._contacts.x,
            frame=self._contacts.frame if moving is None else moving.frame,
            bodies=meeting,
        )


def _subtract_spent(settings: _core.Settings, spent: Step) -> _core.Settings:
    """What the limits of a step leave for the rest of it: at least one iteration."""
    seconds = settings.max_seconds
    if seconds is not None:
        seconds = max(seconds - spent.seconds, sys.float_info.min)
    iterations = max(settings.max_iterations - spent.iterations, 1)
    return _core.Settings(settings.method, settings.tol, iterations, seconds)


def _list_remarks(steps: Sequence[Step], first: int) -> list[str]:
    """The remarks of load steps, each with the number of its step."""
    return [
        f"load step {first + k + 1}: {remark}"
        for k, step in enumerate(steps)
        for remark in step.remarks
    ]


@dataclass(frozen=True)
class HeldRecovery:
    """Displacements of all degrees of freedom, from those that the engine solves for."""

    recovery: Recovery
    held: Held = field(compare=False)
    # Those of the engine in this step, in which bolts may be free.
    prescribed: Floats = field(compare=False)

    def has_factor(self) -> bool:
        """As `Recovery`."""
        return self.recovery.has_factor()

    def primal(self) -> _core.Primal | None:
        """As `Recovery`."""
        return self.recovery.primal()

    def condensed(self) -> _core.Condensed:
        """As `Recovery`."""
        return self.recovery.condensed()

    def recover(self, steps: Sequence[Step], /) -> Floats:
        """As `Recovery`."""
        of_engine = [
            revise(step, prescribed=step.recovery.prescribed)
            for step in steps
            if isinstance(step.recovery, HeldRecovery)
        ]
        solved = self.recovery.recover(of_engine)
        return np.stack([self.held.displacement(y) for y in solved])


def has_frames(path: PathSolver, totals: Sequence[Totals]) -> bool:
    """Whether a step of a path, or the step before it, has frames of its own."""
    at = path.before
    starts_turned = at is not None and at.frame is not None
    return starts_turned or any(isinstance(gap, MovingGaps) for _, _, gap in totals)


def find_start(start: Start | None, shape: tuple[int, int]) -> Step | None:
    """The step to continue from; its reactions must have the shape ``(n_c, d)``."""
    step = last_step(start)
    if step is not None and step.reaction.shape != shape:
        raise ValueError(
            f"start has reactions of shape {step.reaction.shape}, expected {shape}: "
            "pass a result of a problem with the same contacts"
        )
    return step


# ``W``, ``q``, ``rigid`` and the law of a `ReducedProblem`.
ReducedArguments: TypeAlias = tuple[
    Floats | CsrMatrix, Floats, tuple[Floats, Floats] | None, ContactLaw
]


def reduce_step(
    core: _core.Condensed,
    loading: Loading,
    loads: Loads,
    start: Start | None,
    gap: ArrayLike | MovingGaps | None,
) -> ReducedArguments:
    """Reduce one step to its reactions; see `ContactProblem.reduced`."""
    contacts, d = loading.contacts.shape
    before = find_start(start, (contacts, d))
    if gap is not None or (before is not None and before.frame is not None):
        core, before = _turn_core(core, loading, before, gap)
    q, modes, force = core.free_part(*loads)
    if before is not None:
        q[:, 1:] -= before.relative_displacement[:, 1:]
    bond = Bond.begin(loading.contacts, before)
    if bond.dilation is not None:
        q[:, 0] -= bond.dilation
    rigid = (np.ascontiguousarray(modes.T), force) if len(force) else None
    blocks = core.sparse_compliance()
    if blocks is None:
        return core.compliance(), q, rigid, bond.weakened
    from scipy.sparse import bsr_array

    first, columns, values = blocks
    entries = values.reshape(-1, d, d), columns, first
    W = bsr_array(entries, shape=(d * contacts, d * contacts)).tocsr()
    return W, q, rigid, bond.weakened


def _turn_core(
    core: _core.Condensed,
    loading: Loading,
    before: Step | None,
    gap: ArrayLike | MovingGaps | None,
) -> tuple[_core.Condensed, Step | None]:
    """The condensed bodies and the state before a step, in the frames of the step."""
    contacts = loading.contacts
    base = contacts.frame
    has_frame = before is not None and before.frame is not None
    placed = None if gap is None else loading.read_gap(gap)
    if base is None:
        if has_frame:
            raise ValueError(NO_FRAME)
        # `Loading` refuses moving gaps without these frames.
        return core if placed is None else core.with_gap(
            list_components(placed)
        ), before
    frame = placed.frame if isinstance(placed, MovingGaps) else base
    if frame is not base:
        core = core.rotated(find_rotation(frame, base))
    if before is not None and (has_frame or frame is not base):
        before = carry_step(before, frame, base, contacts.gap_by_component[:, 0])
    if placed is not None:
        core = core.with_gap(list_components(placed))
    return core, before
