"""The iterative engine: Newton on the displacements, with a multigrid preconditioner.

No factor of ``K`` and no ``W`` is formed. Time and memory grow in proportion to the entries
of ``K``, so that bodies of millions of degrees of freedom fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Ints, Record
from bipot_rs._lib.validation import Parts, csr
from bipot_rs.contact.errors import NotIterativeError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.messages.diagnosis import FailedSolve, diagnose
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.direct import Direct, DirectRecovery
from bipot_rs.contact.path.engine import Engine, EnginePath, StepData
from bipot_rs.contact.path.mesh_stiffness import MeshStiffness, whole_parts
from bipot_rs.contact.path.springs import (
    Springs,
    find_bodies,
    number_by_nodes,
    turn_tangents,
)
from bipot_rs.contact.results.error_bound import ErrorBound, make_unavailable
from bipot_rs.contact.results.solution import Solution, Step, make_newton_step


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
    springs
        Springs that ``core`` has beside K.
    turn : (n_c, 3, 3) or None
        Rotations from the frames of the caller to those of ``core``.
    """

    core: _core.Primal
    direct: Callable[[], Direct]
    springs: Springs
    law: ContactLaw | None = None
    record: IterationRecord = field(default_factory=IterationRecord)
    turn: Floats | None = None
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

    def with_law(self, law: ContactLaw) -> Iterative:
        """The same problem with another law of its contacts."""
        return replace(self, core=self.core.with_law(law), law=law)

    def with_rotation(self, rotation: Floats) -> Engine:
        """The same problem in other frames, Q by rows.

        It is the direct engine if tangents follow supports, or a contact has no node of its
        own in the new frames.
        """
        changed = self.turn is not None or self.springs.contacts.size > 0
        core = None if changed else self.core.rotated(rotation)
        if core is None:
            direct = self.replacement(
                "frames change at contacts whose supports are neither along the normal nor a "
                "tangent, or which share nodes"
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
        u = at.computed.displacement
        if u is not None and self.springs.contacts.size:
            u = self.springs.spread(u)
        r, v = self.turned(at.reaction), self.turned(at.relative_displacement)
        return _core.PrimalPath(self.core, (r, v, at.status), u)

    def turned(self, values: Floats) -> Floats:
        """Values at the contacts in the frames of the core."""
        if self.turn is None:
            return values
        turned: Floats = np.einsum("ckl,cl->ck", self.turn, values)
        return turned

    def recovery(
        self, seconds: dict[str, float], contacts: ContactSet
    ) -> IterativeRecovery:
        """What computes the displacements of steps."""
        return IterativeRecovery(self, seconds, contacts)

    def inquiry(self, data: StepData) -> UncondensedStep:
        """What answers questions about a step."""
        return UncondensedStep(data)

    def replacement(self, why: str = "", /) -> Direct:
        """The direct engine with the same law and frames, and why it takes over."""
        made = self.direct()
        self.record.replaced = why or self.record.replaced
        made = made if self.law is None else made.with_law(self.law)
        return made if self.rotation is None else made.with_rotation(self.rotation)


def make_iterative(
    given: Parts | MeshStiffness,
    contacts: ContactSet,
    fixed: Ints,
    coordinates: Floats | None,
    num_threads: int | None,
    direct: Callable[[], Direct],
    *,
    hoops: bool = False,
) -> Iterative:
    """The engine of a problem with this K, whose weak springs may be ``hoops`` of thin rings.

    Raises
    ------
    NotIterativeError, ValueError
        It cannot solve the problem, or an array is wrong.
    """
    if isinstance(given, MeshStiffness):
        springs = Springs.hold([], 0.0, given.shape[0], contacts.d)
    else:
        springs = Springs.find(given, fixed, contacts.d, num_threads)
    operator, gap, turn = contacts.operator.parts, contacts.gap_by_component, None
    matrix, law = contacts.operator.matrix, contacts.law
    turned = None
    if contacts.d == 3 and law.mu.ndim == 1 and len(fixed):
        turned = turn_tangents(matrix, contacts.count, fixed)
    if turned is not None:
        turn, matrix = turned
        operator = csr("B", matrix).parts
        gap = np.einsum("ckl,cl->ck", turn, gap)
    data = gap, law, fixed, num_threads
    try:
        core = (
            _core.Primal.of_rows(given.rows, operator, gap, law)
            if isinstance(given, MeshStiffness)
            else _core.Primal(
                springs.add_to(given), operator, *data, coordinates, hoops
            )
        )
    except NotIterativeError as error:
        if not error.contacts:
            raise
        parts = whole_parts(given)
        d = contacts.d
        place = number_by_nodes(len(springs.place), d, coordinates)
        body = find_bodies(parts, d, place)
        diagonal = _core.diagonal(parts, num_threads)
        copied, changed = springs.with_copies(
            place, body, diagonal, matrix, error.contacts, fixed
        )
        if not copied.contacts.size:
            raise
        springs = copied
        data = gap, law, springs.place[fixed], num_threads
        at = springs.place_coordinates(coordinates)
        core = _core.Primal(
            springs.add_to(parts), csr("B", changed).parts, *data, at, True
        )
    return Iterative(core, direct, springs, turn=turn)


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
        settings: _core.Settings,
    ) -> Step:
        """Make a step to the total loads."""
        if self._other is not None:
            return self._other.step(load, prescribed, gap, settings)
        asked = load, prescribed, gap, settings
        springs = self._iterative.springs.stiffness.size
        if springs or self._iterative.turn is not None:
            # The core has another state than the step: a path that continues has the same bits.
            self._core = self._iterative.from_step(self._last)
        step, reason = (
            self._solve_with_springs(*asked) if springs else self._solve_in_core(*asked)
        )
        if (turn := self._iterative.turn) is not None:
            step = replace(
                step,
                reaction=np.einsum("ckl,ck->cl", turn, step.reaction),
                relative_displacement=np.einsum(
                    "ckl,ck->cl", turn, step.relative_displacement
                ),
                slip=np.einsum("ckl,ck->cl", turn[:, 1:, 1:], step.slip),
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
            self._last = step
        return step

    def _solve_in_core(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
        again: bool = False,
        draft: bool = False,
    ) -> tuple[Step, str]:
        """One step of the core, and why it stalled if it did."""
        if gap is not None:
            gap = self._iterative.turned(gap)
        asked = load, prescribed, gap, settings
        core, displacement = self._core.step(*asked, again, draft)
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
        settings: _core.Settings,
    ) -> tuple[Step, str]:
        """A step with springs, from the last state each time."""
        engine, last = self._iterative, self._last

        def step(stretched: Floats, *how: bool) -> tuple[Step, str]:
            return self._solve_in_core(stretched, prescribed, gap, settings, *how)

        reaction = None if last is None else engine.turned(last.reaction)
        u = None if last is None else last.computed.displacement
        return engine.springs.solve(step, load, reaction, u, settings.tol)


@dataclass(frozen=True, eq=False)
class IterativeRecovery:
    """Steps of this engine have their displacements already."""

    engine: Iterative
    seconds: dict[str, float]
    contacts: ContactSet

    def has_factor(self) -> bool:
        """Displacements are always available."""
        return True

    def primal(self) -> _core.Primal | None:
        """The bodies, for derivatives; None if the core has springs or frames of its own."""
        engine = self.engine
        changed = engine.springs.stiffness.size or engine.turn is not None
        return None if changed else engine.core

    def condensed(self) -> _core.Condensed:
        """The bodies as the direct engine condenses them, if derivatives stall."""
        return self._make_direct_recovery().condensed()

    def recover(self, steps: Sequence[Step]) -> Floats:
        """Compute the displacements of steps that have none, by the direct engine."""
        return self._make_direct_recovery().recover(steps)

    def _make_direct_recovery(self) -> DirectRecovery:
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
            settings=self.data.settings,
            law=self.data.contacts.law,
            W=lambda: None,
            modes=lambda: np.empty((d * len(v), 0)),
            loads=lambda: np.empty(0),
            several=lambda _step: False,
            points=self.data.contacts.x,
        )
        return diagnose(tried, step, v)

    def derivatives(self) -> None:
        """None: `Result` differentiates the whole path."""
