"""What a load path needs of the engine that solves its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Record
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.results.solution import Inquiry, Recovery, Step

if TYPE_CHECKING:
    from bipot_rs.contact.stiffness.digits import Digits


# Entry of the `stats` of a step of a path that the direct engine took over from another one.
# A path that continues from there stays with it.
REPLACED = "replaced"


@dataclass(frozen=True)
class RestoredDigits:
    """Relative error of K, and the error of its rigid motions before they were restored."""

    digits: Digits
    off: float


@dataclass(frozen=True)
class StepFrames:
    """A step in other frames than those of B: Q by rows, and gaps by component."""

    rotation: Floats
    gap: Floats


@dataclass(frozen=True)
class StepData:
    """One load step, for questions about its solution."""

    # load, prescribed: totals.
    load: Floats
    prescribed: Floats
    # Relative displacement after the step before; None for the unloaded bodies.
    before: Floats | None
    settings: _core.Settings
    contacts: ContactSet  # the contacts, with the friction of the path
    restored: RestoredDigits | None = None  # relative error of K, if it is not rounding
    # Frames and gaps of the step, if these are not those of the engine.
    frames: StepFrames | None = None


class EnginePath(Protocol):
    """A load path in progress."""

    @property
    def engine(self) -> Engine:
        """The engine that made the last step."""

    def step(
        self,
        load: Floats,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
        /,
    ) -> Step:
        """Make a step to the total loads; the path moves on only if it converges.

        The step has neither its loads nor its problem. Its ``stats`` say which engine made it:
        a path that continues from one with ``krylov`` stays with the iterative engine.
        """


class Engine(Protocol):
    """A problem that is ready to be solved.

    Rigid motions held by contact alone, and the problem with the gaps of a step, are asked of
    `Direct` only: an engine that forms ``W`` derives from it.
    """

    @property
    def name(self) -> str:
        """One of `choice.ENGINES`, or ``"petsc"``."""

    @property
    def stats(self) -> Record:
        """Counts and seconds."""

    def with_law(self, law: ContactLaw, /) -> Engine:
        """The same problem with another law of its contacts."""

    def with_rotation(self, rotation: Floats, /) -> Engine:
        """The same problem in other frames: Q of each contact by rows, ``(d n_c, d)``."""

    def replacement(self, why: str = "", /) -> Engine:
        """The engine that solves what this one cannot, and why; itself if there is none."""

    def path(self, at: Step | None, /) -> EnginePath:
        """A load path that starts from a step, or from the unloaded bodies."""

    def recovery(
        self, seconds: dict[str, float], contacts: ContactSet, /
    ) -> Recovery | None:
        """What computes the displacements of steps, and adds the time to ``seconds``.

        None if steps have them, and this engine makes the derivatives too.
        """

    def inquiry(self, data: StepData, /) -> Inquiry[Step]:
        """What answers questions about the solution of a step."""
