"""A load path on a condensed problem: solves its steps one by one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.messages import body_of, counted
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import Settings, by_component
from bipot_rs.contact import rigid_motions as motion
from bipot_rs.contact.diagnosis import NEAR, Tried, diagnose
from bipot_rs.contact.error_bound import ErrorBound, from_core, without
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.contact.load_steps import Totals, done, reached
from bipot_rs.contact.reduced import opening, solution_fields
from bipot_rs.contact.result import Result
from bipot_rs.contact.solution import Solution, Step
from bipot_rs.contact.status import Outcome

if TYPE_CHECKING:
    from bipot_rs.contact.stiffness_digits import Digits

Contacts = Mapping[str, NDArray[Any] | None]


@dataclass(frozen=True)
class Known:
    """Relative error of K, and the error of its rigid motions before they were restored."""

    digits: Digits
    off: float


class Following:
    """A load path whose steps are being solved.

    Attributes
    ----------
    path
        State of the core.
    before
        The step that the path started from; ``None`` for the unloaded bodies.
    steps
        The steps that converged.
    """

    def __init__(
        self,
        core: _core.Condensed,
        contacts: Contacts,
        mu: Floats,
        shape: tuple[int, int],
        settings: Settings,
        start: Result | Step | None,
        condense: float,
        bodies: Mapping[str, int] | None = None,
        known: Known | None = None,
        remarks: Callable[[Sequence[Step]], Sequence[str]] | None = None,
    ) -> None:
        self._core = core
        self._contacts = contacts
        self._mu = mu
        self._shape = shape
        self._settings = settings
        # Names, each with the first degree of freedom of the body.
        self._bodies = bodies
        self._known = known
        self._remarks = remarks
        self.before = state(start, *shape)
        self._first = done(start)
        self.steps: list[Step] = []
        self.rewind()
        self._seconds = {"condense": condense, "solve": 0.0, "recover": 0.0}
        offsets = np.asarray(contacts["gap"])
        if offsets.ndim == 1:
            offsets = by_component(offsets, shape[1])
        self._recovery = _Recovery(core, self._seconds, offsets)

    def rewind(self) -> None:
        """Set the core to the state after the last step."""
        at = self.steps[-1] if self.steps else self.before
        self._last = None if at is None else at.relative_displacement
        stand = _start(at, self._core.stats["rigid_motions"])
        self.path = _core.Path(self._core, stand, _working_set(at))
        if at is not None and at.stats.get("bytes_beside_W", 0):
            # An earlier step made the inverse of W, and counted this work.
            self._core.make_inverse()

    def advance(
        self, load: Floats, prescribed: Floats, gap: Floats | None = None
    ) -> Step:
        """Solve one step and add it to the path; raise if that fails.

        ``gap (n_c, d)`` are the gaps of the step; the default is those of the problem.
        """
        try:
            step = self.attempt(load, prescribed, gap)
        except NoEquilibriumError as error:
            raise self.ended(error) from None
        return self._add(step)

    def attempt(
        self, load: Floats, prescribed: Floats, gap: Floats | None = None
    ) -> Step:
        """Solve a trial step. It joins the path only if it is accepted.

        Raises
        ------
        NoEquilibriumError
            Contacts contradict each other.
        """
        began = time.perf_counter()
        try:
            raw = self.path.step(load, prescribed, gap, *self._settings)
        finally:
            self._seconds["solve"] += time.perf_counter() - began
        return self._made(raw, load, prescribed, gap)

    def _made(
        self,
        raw: dict[str, Any],
        load: Floats,
        prescribed: Floats,
        gap: Floats | None = None,
    ) -> Step:
        """Make a `Step` from the answer of the core."""
        area = self._contacts["area"]
        core = self._core if gap is None else self._core.with_gap(gap)
        return Step(
            **solution_fields(raw),
            _words=self._words(raw),
            slip=raw["slip"],
            **_set_fields(raw["working_set"]),
            load=load,
            prescribed=prescribed,
            gap=gap,
            traction=None if area is None else raw["reaction"] / area[:, None],
            _recover=self._recovery,
            _problem=_StepProblem(
                core,
                load,
                prescribed,
                self._last,
                self._tried(core, load, prescribed),
                area,
                self._known,
            ),
        )

    def _add(self, step: Step) -> Step:
        """Accept a step; raise if it did not converge."""
        if not step.converged:
            raise self.failure(step)
        self.accept(step)
        return step

    def accept(self, step: Step) -> None:
        """Add a converged step to the path."""
        self.steps.append(step)
        self._last = step.relative_displacement

    def failure(self, step: Step) -> NoEquilibriumError | NotConvergedError:
        """Make the error of a step that did not converge."""
        message = f"load step {len(self.steps) + 1}: {step.message}"
        none = step.outcome is Outcome.NO_EQUILIBRIUM
        direction = None
        if step.free_motion is not None:
            modes, d = self._core.modes(), self._shape[1]
            direction = motion.at_contacts(modes, step.free_motion, d)
        return (NoEquilibriumError if none else NotConvergedError)(
            message, self.result(False, message), direction
        )

    def ended(self, error: Exception) -> NoEquilibriumError:
        """Make the error of a step without a solution, with the steps before it."""
        message = f"load step {len(self.steps) + 1}: {error}"
        return NoEquilibriumError(message, self.result(False, message))

    def result(self, success: bool = True, message: str | None = None) -> Result:
        """Make the `Result` of the steps so far."""
        count = counted(len(self.steps), "step")
        made = Result(
            self.steps,
            contacts=self._contacts,
            shape=self._shape,
            start=self.before,
            seconds=None,
            success=success,
            message=f"{count} converged" if message is None else message,
            remarks=() if self._remarks is None else self._remarks(self.steps),
        )
        made._first = self._first
        if self._known is not None:
            made.stiffness_rtol = self._known.digits.rtol
            made.rigid_motions_off = self._known.off
        made.seconds = self._seconds  # filled further when displacements are asked for
        return made

    def through(
        self,
        totals: Sequence[Totals],
        followed: tuple[Sequence[dict[str, Any]], Exception | None],
    ) -> Result:
        """Make the `Result` of steps that the core solved, also if an error ended them."""
        raws, error = followed
        try:
            for raw, asked in zip(raws, totals, strict=False):
                self._seconds["solve"] += raw["seconds"]
                self._add(self._made(raw, *asked))
            if isinstance(error, NoEquilibriumError):
                raise self.ended(error)
            if error is not None:
                raise error
        except (NoEquilibriumError, NotConvergedError, ValueError) as failed:
            return self.result(False, str(failed))
        return self.result()

    def _tried(self, core: _core.Condensed, load: Floats, prescribed: Floats) -> Tried:
        before = self._last

        def several(step: Solution) -> bool:
            asked = load, prescribed, before, step.reaction
            near = step.residual <= NEAR
            return near and _core.assess_step(core, *asked) == "others exist"

        return Tried(
            method=self._settings.method,
            max_seconds=self._settings.max_seconds,
            mu=self._mu,
            W=lambda: _compliance(core),
            modes=lambda: core.modes().T,
            several=several,
            condition=lambda: float(core.stats["cond_S"]),
            points=self._contacts["x"],
        )

    def _words(self, raw: dict[str, Any]) -> str:
        """Describe the free motion of each body."""
        amounts = raw["free_motion"]
        if not len(amounts):
            return ""
        contacts, d = self._shape
        modes = self._core.modes()
        felt = np.abs(modes.reshape(len(modes), contacts, d)).max(axis=2) > 0
        stats = self._core.stats
        owners = stats["rigid_motion_bodies"]
        # A body without a name is identified by its most moved degree of freedom.
        names: dict[int, str] = {}
        for body, dof in zip(owners, stats["rigid_motion_dofs"], strict=True):
            names.setdefault(body, body_of(dof, self._bodies))
        meeting = [
            tuple(dict.fromkeys(names[owners[k]] for k in np.flatnonzero(felt[:, i])))
            for i in range(contacts)
        ]
        return motion.describe(
            motion.at_contacts(modes, amounts, d),
            opening(raw, self._mu),
            points=self._contacts["x"],
            frame=self._contacts["frame"],
            bodies=meeting,
        )


@dataclass(frozen=True)
class _StepProblem:
    """The problem of a step, for the properties of its solution that are computed on use."""

    core: _core.Condensed
    load: Floats
    prescribed: Floats
    before: Floats | None
    tried: Tried
    area: Floats | None
    known: Known | None = None

    def unique(self, step: Solution, /) -> str:
        return _core.assess_step(
            self.core, self.load, self.prescribed, self.before, step.reaction
        )

    def error_estimate(self, step: Any, /) -> tuple[float, float] | None:
        if not self.core.stats["factor_kept"]:
            return None  # the estimate needs the factor of K
        motion = np.empty(0) if step.rigid_motion is None else step.rigid_motion
        found = _core.forward_errors_of_step(
            self.core, self.load, self.prescribed, self.before, step.reaction, motion
        )
        if found is None or self.known is None:
            return found
        # Add the effect of the error of K.
        digits = self.known.digits
        factor = digits.amplification(self.core.stiffness(), step.displacement)
        unknown = max(digits.rtol, self.known.off) * factor
        return found[0] + unknown, found[1] + unknown

    def error(self, step: Any, /) -> ErrorBound:
        motion = np.empty(0) if step.rigid_motion is None else step.rigid_motion
        raw = _core.error_bound_of_step(
            self.core,
            self.load,
            self.prescribed,
            self.before,
            step.reaction,
            step.relative_displacement,
            motion,
        )
        if raw is None:
            return without("working set", step.bipotential_gap)
        return from_core(raw, self.area)

    def diagnosis(self, step: Any, /) -> str:
        # The law of a step is about its slip, not the total tangential displacement.
        v = np.column_stack([step.relative_displacement[:, 0], step.slip])
        return diagnose(self.tried, step, v)


def state(start: Result | Step | None, contacts: int, d: int) -> Step | None:
    """The step to continue from, with its shape checked."""
    step = reached(start)
    if step is not None and step.reaction.shape != (contacts, d):
        raise ValueError(
            f"start has reactions of shape {step.reaction.shape}, expected {(contacts, d)}"
        )
    return step


def _start(
    step: Step | None, motions: int
) -> tuple[Floats, Floats, NDArray[np.int8], Floats] | None:
    if step is None:
        return None
    rigid = np.empty(0) if step.rigid_motion is None else step.rigid_motion
    if len(rigid) != motions:
        raise ValueError(
            f"start has {counted(len(rigid), 'rigid motion')}, this problem {motions}"
        )
    return step.reaction, step.relative_displacement, step.status, rigid


def _working_set(
    step: Step | None,
) -> tuple[Ints, Floats, bool] | None:
    """The working set of a step, from which the next step starts."""
    if step is None or step.working_set is None:
        return None
    motion = np.empty(0) if step.working_motion is None else step.working_motion
    return step.working_set, motion, bool(step.stats.get("bytes_beside_W", 0))


def _set_fields(raw: tuple[Ints, Floats] | None) -> dict[str, Any]:
    if raw is None:
        return {}
    members, motion = raw
    return {
        "working_set": members,
        "working_motion": motion if len(motion) else None,
    }


@dataclass(frozen=True, eq=False)
class _Recovery:
    """Computes displacements of steps.

    Steps refer to this and not to their path: a path refers to the step that it started
    from, and all steps of a long chain would stay in memory.
    """

    core: _core.Condensed
    seconds: dict[str, float]
    gap: Floats

    def has_factor(self) -> bool:
        """Whether the problem keeps the factor that this takes."""
        return bool(self.core.stats["factor_kept"])

    def __call__(self, steps: Sequence[Step]) -> Floats:
        began = time.perf_counter()
        none = np.empty(0)
        states, confirmed = [], []
        for step in steps:
            if step.load is None or step.prescribed is None:
                continue
            amounts = none if step.rigid_motion is None else step.rigid_motion
            states.append((step.load, step.prescribed, step.reaction, amounts))
            gap = self.gap if step.gap is None else step.gap
            slip = np.zeros_like(step.relative_displacement)
            slip[:, 1:] = step.slip
            confirmed.append((step.relative_displacement, gap, slip))
        u = self.core.displacements(states, confirmed)
        self.seconds["recover"] += time.perf_counter() - began
        return u


def _compliance(core: _core.Condensed) -> Floats | None:
    if core.stats["working_set"] is not None:
        return None  # a diagnosis does not justify condensing onto all candidates
    return core.compliance()
