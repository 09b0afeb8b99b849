"""The direct engine: ``K`` is factored and condensed onto the contacts once."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Floats, Ints, Record
from bipot_rs.contact import tuning
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.frames import find_rotation
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.engine import StepData
from bipot_rs.contact.path.moving_gaps import rotate
from bipot_rs.contact.results.error_bound import (
    ErrorBound,
    make_unavailable,
    read_error_bound,
)
from bipot_rs.contact.results.solution import Solution, Step, make_step

# Most paths are solved: only one that fails is diagnosed.
if TYPE_CHECKING:
    from bipot_rs.contact.messages.diagnosis import FailedSolve


@dataclass(frozen=True)
class Direct:
    """Solves with the compliance ``W`` of the condensed bodies."""

    core: _core.Condensed
    name = "direct"

    @property
    def stats(self) -> Record:
        """As `_core.CondensationStats`."""
        return self.core.stats.as_dict()

    def modes(self) -> Floats:
        """Each rigid motion at the contacts, as a row."""
        return self.core.modes()

    def load_motions(self, load: Floats, prescribed: Floats) -> Floats:
        """The work of total loads on each rigid motion."""
        return self.core.free_part(load, prescribed)[2]

    def with_gap(self, gap: Floats) -> Direct:
        """The same problem with other gaps."""
        return Direct(self.core.with_gap(gap))

    def with_law(self, law: ContactLaw) -> Direct:
        """The same problem with another law of its contacts."""
        return Direct(self.core.with_law(law))

    def with_rotation(self, rotation: Floats) -> Direct:
        """The same problem in other frames, Q by rows."""
        return Direct(self.core.rotated(rotation))

    def replacement(self, _why: str = "", /) -> Direct:
        """Nothing replaces this engine."""
        return self

    def path(self, at: Step | None) -> DirectPath:
        """A load path that starts from a step, or from the unloaded bodies."""
        stand = _read_start(at, self.core.stats.rigid_motions)
        path = _core.Path(self.core, stand, _read_working_set(at))
        if at is not None and at.stats.get("bytes_beside_W", 0):
            # An earlier step made the inverse of W, and counted this work.
            self.core.make_inverse()
        return DirectPath(self, path)

    def recovery(
        self, seconds: dict[str, float], contacts: ContactSet
    ) -> DirectRecovery:
        """What computes the displacements of steps."""
        return DirectRecovery(self.core, seconds, contacts)

    def inquiry(self, data: StepData) -> CondensedStep:
        """What answers questions about a step."""
        return CondensedStep(self.core, data)


@dataclass(frozen=True)
class DirectPath:
    """A load path in progress."""

    engine: Direct
    core: _core.Path

    def step(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
    ) -> Step:
        """Make a step to the total loads."""
        return make_step(self.core.step(load, prescribed, gap, settings))


@dataclass(frozen=True)
class CondensedStep:
    """The problem of a step, for the properties of its solution that are computed on use."""

    bodies: _core.Condensed
    data: StepData

    @property
    def core(self) -> _core.Condensed:
        """The condensed bodies with the frames and gaps of the step."""
        frames = self.data.frames
        if frames is None:
            return self.bodies
        return self.bodies.rotated(frames.rotation).with_gap(frames.gap)

    @property
    def _loads(self) -> tuple[Floats, Floats, Floats | None]:
        return self.data.load, self.data.prescribed, self.data.before

    def unique(self, step: Solution, /) -> str:
        """Whether the solution is unique: a proof needs reactions that K determines."""
        verdict = self.core.assess(*self._loads, step.reaction)
        if verdict == "proved" and not self.core.stats.keeps_digits:
            errors = step.error_estimate
            if errors is None or max(errors) > tuning.UNDETERMINED:
                return "unknown"
        return verdict

    def error_estimate(self, step: Step, /) -> tuple[float, float] | None:
        """Relative forward errors, by one more Newton correction."""
        core = self.core
        if not core.stats.factor_kept:
            return None  # the estimate needs the factor of K
        motion = np.empty(0) if step.rigid_motion is None else step.rigid_motion
        errors = core.forward_errors(*self._loads, step.reaction, motion)
        restored = self.data.restored
        if errors is None or restored is None:
            return errors
        # Add the effect of the error of K.
        digits = restored.digits
        factor = digits.amplification(core.stiffness(), step.displacement)
        unknown = max(digits.rtol, restored.off) * factor
        return errors[0] + unknown, errors[1] + unknown

    def error(self, step: Solution, /) -> ErrorBound:
        """Guaranteed bound of the error."""
        motion = np.empty(0) if step.rigid_motion is None else step.rigid_motion
        bound = self.core.error_bound(
            *self._loads, step.reaction, step.relative_displacement, motion
        )
        if bound is None:
            return make_unavailable("working set", step.bipotential_gap)
        return read_error_bound(bound, self.data.contacts.area)

    def diagnosis(self, step: Step, /) -> str:
        """Why the solve failed."""
        from bipot_rs.contact.messages.diagnosis import diagnose

        # The law of a step is about its slip, not the total tangential displacement.
        v = np.column_stack([step.relative_displacement[:, 0], step.slip])
        return diagnose(self._describe_solve(), step, v)

    def derivatives(self) -> None:
        """None: `Result` differentiates the whole path."""

    def _describe_solve(self) -> FailedSolve:
        from bipot_rs.contact.messages.diagnosis import FailedSolve

        core = self.core

        def several(step: Solution) -> bool:
            return (
                step.residual <= tuning.NEAR_SOLUTION
                and self.unique(step) == "others exist"
            )

        return FailedSolve(
            settings=self.data.settings,
            law=self.data.contacts.law,
            W=lambda: _find_compliance(core),
            modes=lambda: core.modes().T,
            loads=lambda: core.free_part(self.data.load, self.data.prescribed)[2],
            several=several,
            condition=lambda: core.stats.cond_S,
            points=self.data.contacts.x,
        )


@dataclass(frozen=True)
class DirectRecovery:
    """Computes displacements of steps.

    Steps refer to this and not to their path: a path refers to the step that it started
    from, and all steps of a long chain would stay in memory. `recover_displacements` groups
    steps by it: those of one core are equal.
    """

    core: _core.Condensed
    seconds: dict[str, float] = field(compare=False)
    contacts: ContactSet = field(compare=False)

    def has_factor(self) -> bool:
        """Whether the problem keeps the factor that this takes."""
        return self.core.stats.factor_kept

    def primal(self) -> None:
        """Nothing: the bodies are condensed."""

    def condensed(self) -> _core.Condensed:
        """The condensed bodies, for derivatives."""
        return self.core

    def recover(self, steps: Sequence[Step]) -> Floats:
        """Compute the displacements, a row for each step."""
        began = time.perf_counter()
        none, contacts = np.empty(0), self.contacts
        states, confirmed = [], []
        for step in steps:
            if step.load is None or step.prescribed is None:
                continue
            amounts = none if step.rigid_motion is None else step.rigid_motion
            gap = contacts.gap_by_component if step.gap is None else step.gap
            slip = np.zeros_like(step.relative_displacement)
            slip[:, 1:] = step.slip
            reaction, v = step.reaction, step.relative_displacement
            if step.frame is not None and contacts.frame is not None:
                # The factor belongs to B, whose rows are in the frames of the problem.
                back = find_rotation(contacts.frame, step.frame)
                reaction, v = rotate(back, reaction), rotate(back, v)
                gap, slip = rotate(back, gap), rotate(back, slip)
            states.append((step.load, step.prescribed, reaction, amounts))
            confirmed.append((v, gap, slip))
        u = self.core.displacements(states, confirmed)
        self.seconds["recover"] += time.perf_counter() - began
        return u


def _read_start(
    step: Step | None, motions: int
) -> tuple[Floats, Floats, NDArray[np.int8], Floats] | None:
    """The state of a step as the core takes it."""
    if step is None:
        return None
    rigid = np.empty(0) if step.rigid_motion is None else step.rigid_motion
    if "krylov" in step.stats or step.from_state:
        # The iterative engine and a `State` have no amounts of rigid motions; they are a
        # start value.
        rigid = np.zeros(motions)
    if len(rigid) != motions:
        raise ValueError(
            f"start has {count_noun(len(rigid), 'rigid motion')}, expected {motions}: pass a "
            "result of a problem with the same supports"
        )
    return step.reaction, step.relative_displacement, step.status, rigid


def _read_working_set(
    step: Step | None,
) -> tuple[Ints, Floats, bool] | None:
    """The working set of a step, from which the next step starts."""
    if step is None or step.working_set is None:
        return None
    motion = np.empty(0) if step.working_motion is None else step.working_motion
    return step.working_set, motion, bool(step.stats.get("bytes_beside_W", 0))


def _find_compliance(core: _core.Condensed) -> Floats | None:
    if core.stats.working_set is not None:
        return None  # a diagnosis does not justify condensing onto all candidates
    return core.compliance()
