"""The iterative engine: Newton on the displacements, with a multigrid preconditioner.

No factor of ``K`` and no ``W`` is formed. Time and memory grow in proportion to the entries
of ``K``, so that bodies of millions of degrees of freedom fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Record
from bipot_rs._lib.validation import Settings
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.messages.diagnosis import FailedSolve, diagnose
from bipot_rs.contact.path.contacts import Contacts
from bipot_rs.contact.path.engine import Engine, EnginePath, StepData
from bipot_rs.contact.path.loose import Loose
from bipot_rs.contact.results.core_answer import make_newton_step
from bipot_rs.contact.results.error_bound import ErrorBound, make_unavailable
from bipot_rs.contact.results.solution import Computed, Recovery, Solution, Step


@dataclass
class IterationRecord:
    """What the engine did, of all load paths of a problem."""

    newton: int = 0
    krylov: int = 0
    bytes_multigrid: int = 0
    # Why the direct engine replaced it in the last path; empty if it did not.
    replaced: str = ""


@dataclass(frozen=True)
class Iterative:
    """Solves in the displacements.

    Attributes
    ----------
    direct
        Makes the direct engine, for a step that this one cannot solve; it raises
        `MemoryError` if the factor does not fit.
    loose
        Degrees of freedom without stiffness, to which ``core`` has springs.
    """

    core: _core.Primal
    direct: Callable[[], Engine]
    shape: tuple[int, int]
    gap: Floats | None = None
    law: ContactLaw | None = None
    record: IterationRecord = field(default_factory=IterationRecord)
    loose: Loose = field(default_factory=lambda: Loose(np.zeros(0, np.int64), 0.0))
    rotation: Floats | None = None
    name = "iterative"

    @property
    def stats(self) -> Record:
        """Counts; nothing is condensed."""
        stiffness, forecast = self.core.bytes
        return {
            "bytes_stiffness": stiffness,
            "bytes_forecast": forecast,
            "newton": self.record.newton,
            "krylov": self.record.krylov,
            "bytes_multigrid": self.record.bytes_multigrid,
        }

    def modes(self) -> Floats:
        """No rigid motions: they are not unknowns of their own."""
        contacts, d = self.shape
        return np.empty((0, d * contacts))

    def with_gap(self, gap: Floats) -> Iterative:
        """The same problem with other gaps."""
        return replace(self, gap=gap)

    def with_law(self, law: ContactLaw) -> Iterative:
        """The same problem with another law of its contacts."""
        return replace(self, core=self.core.with_law(law), law=law)

    def with_rotation(self, rotation: Floats) -> Engine:
        """The same problem in other frames, Q by rows.

        It is the direct engine if, in the new frames, a support holds a contact along a
        direction that is neither its normal nor a tangent.
        """
        core = self.core.rotated(rotation)
        if core is None:
            direct = self.replacement(
                "in the frames of a step, a support holds a contact along a direction that is "
                "neither its normal nor a tangent"
            )
            return direct.with_rotation(rotation)
        return replace(self, core=core, rotation=rotation)

    def path(self, at: Step | None) -> IterativePath:
        """A load path that starts from a step, or from the unloaded bodies."""
        return IterativePath(self, self.from_step(at), at)

    def from_step(self, at: Step | None) -> _core.PrimalPath:
        """The path of the core that starts from a step."""
        if at is None:
            return _core.PrimalPath(self.core)
        state = at.reaction, at.relative_displacement, at.status
        return _core.PrimalPath(self.core, state, at.computed.displacement)

    def recovery(
        self, seconds: dict[str, float], contacts: Contacts
    ) -> IterativeRecovery:
        """What computes the displacements of steps."""
        return IterativeRecovery(self, seconds, contacts)

    def inquiry(self, data: StepData) -> UncondensedStep:
        """What answers questions about a step."""
        return UncondensedStep(data)

    def replacement(self, why: str = "", /) -> Engine:
        """The direct engine with the same law and frames, and why it takes over."""
        made = self.direct()
        self.record.replaced = why or self.record.replaced
        made = made if self.law is None else made.with_law(self.law)
        return made if self.rotation is None else made.with_rotation(self.rotation)


class IterativePath:
    """A load path in progress.

    A step that stalls is tried again by the direct engine, if its factor fits into memory.
    The path then stays with that engine.
    """

    def __init__(
        self, engine: Iterative, core: _core.PrimalPath, at: Step | None
    ) -> None:
        self.engine: Engine = engine
        self._iterative = engine
        self._core = core
        self._other: EnginePath | None = None
        self._last = at

    def step(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: Settings,
    ) -> Step:
        """Make a step to the total loads."""
        if self._other is not None:
            return self._other.step(load, prescribed, gap, settings)
        asked = load, prescribed, gap, settings
        loose = self._iterative.loose.dofs.size
        step, reason = (
            self._solve_with_springs(*asked) if loose else self._solve_in_core(*asked)
        )
        if step.outcome is Outcome.STALLED:
            try:
                direct = self._iterative.replacement(reason)
            except MemoryError:
                return step
            other = direct.path(self._last)
            step = other.step(*asked)
            self._other, self.engine = other, direct
        elif step.converged:
            computed = step.computed if loose else Computed()
            self._last = replace(step, computed=computed)
        return step

    def _solve_in_core(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: Settings,
    ) -> tuple[Step, str]:
        """One step of the core, and why it stalled if it did."""
        core, displacement = self._core.step(load, prescribed, gap, *settings)
        record = self._iterative.record
        record.newton += core.newton
        record.krylov += core.krylov
        record.bytes_multigrid = max(record.bytes_multigrid, core.bytes_multigrid)
        return make_newton_step(core, displacement, Step), core.reason or ""

    def _solve_with_springs(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: Settings,
    ) -> tuple[Step, str]:
        """A step with degrees of freedom without stiffness, from the last state each time."""
        loose, last = self._iterative.loose, self._last
        u = None if last is None else last.computed.displacement
        at = np.zeros(len(loose.dofs)) if u is None else u[loose.dofs]

        def step(stretched: Floats) -> tuple[Step, str]:
            self._core = self._iterative.from_step(last)
            return self._solve_in_core(stretched, prescribed, gap, settings)

        return loose.solve(step, load, at, settings.tol)


@dataclass(frozen=True, eq=False)
class IterativeRecovery:
    """Steps of this engine have their displacements already."""

    engine: Iterative
    seconds: dict[str, float]
    contacts: Contacts

    def has_factor(self) -> bool:
        """Displacements are always available."""
        return True

    def primal(self) -> _core.Primal | None:
        """The bodies, for derivatives; None if the core has springs of its own."""
        return None if self.engine.loose.dofs.size else self.engine.core

    def condensed(self) -> _core.Condensed:
        """The bodies as the direct engine condenses them, if derivatives stall."""
        return self._make_direct_recovery().condensed()

    def recover(self, steps: Sequence[Step]) -> Floats:
        """Compute the displacements of steps that have none, by the direct engine."""
        return self._make_direct_recovery().recover(steps)

    def _make_direct_recovery(self) -> Recovery:
        direct = self.engine.replacement()
        return direct.recovery(self.seconds, self.contacts)


@dataclass(frozen=True)
class UncondensedStep:
    """Answers about a step; proofs and bounds need ``W``, which this engine does not form."""

    data: StepData

    def unique(self, _step: Solution, /) -> str:
        """Whether the solution is unique."""
        return "unknown"

    def error_estimate(self, _step: Solution, /) -> tuple[float, float] | None:
        """Not known: a step that converged brings its estimate along."""
        return None

    def error(self, step: Solution, /) -> ErrorBound:
        """Guaranteed bound of the error."""
        return make_unavailable("engine", step.bipotential_gap)

    def diagnosis(self, step: Step, /) -> str:
        """Why the solve failed."""
        v = np.column_stack([step.relative_displacement[:, 0], step.slip])
        d = v.shape[1]
        tried = FailedSolve(
            method=self.data.settings.method,
            max_seconds=self.data.settings.max_seconds,
            law=self.data.contacts.law,
            W=lambda: None,
            modes=lambda: np.empty((d * len(v), 0)),
            several=lambda _step: False,
            points=self.data.contacts.x,
        )
        return diagnose(tried, step, v)

    def derivatives(self) -> None:
        """None: `Result` differentiates the whole path."""
