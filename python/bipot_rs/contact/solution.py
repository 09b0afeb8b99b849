"""The answer of one contact problem, and of one step of a load path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact import error_bound, summary
from bipot_rs.contact.error_bound import ErrorBound
from bipot_rs.contact.status import Outcome

# Displacements found together: as many as a pass over the factor serves well.
BLOCK = 32

# For what has lost its problem.
_REASONS = {
    Outcome.STALLED: "the residual stopped falling",
    Outcome.ITERATION_LIMIT: "max_iterations was reached",
    Outcome.TIME_LIMIT: "max_seconds was reached",
}


class Inquiry(Protocol):
    """The problem behind a solution, for what is found out when asked for."""

    def unique(self, solution: Any, /) -> str:
        """Whether the solution is the only one."""

    def error_estimate(self, solution: Any, /) -> tuple[float, float] | None:
        """Its relative forward errors."""

    def error(self, solution: Any, /) -> ErrorBound:
        """How far it is from the answer, as far as that can be proved."""

    def diagnosis(self, solution: Any, /) -> str:
        """Why it is no answer, in a sentence."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Solution:
    """The answer of one contact problem, or the best point that was reached.

    Components are normal first, ``(n, t1[, t2])``; units are the caller's.

    Attributes
    ----------
    reaction
        Nodal contact forces, ``(n_c, d)``; ``r_n >= 0`` presses.
    relative_displacement
        ``v``, ``(n_c, d)``; ``v_n >= 0`` is the opening.
    status
        `Status` of each contact, ``(n_c,)`` of ``int8``.
    converged, outcome
        Whether ``residual <= tolerance`` was confirmed by a fresh evaluation,
        and why the solver stopped.
    residual, tolerance
        η of equation (13), and what it was held to: the larger of ``tol`` and
        the rounding of η itself.
    iterations, work
        Iterations, and their cost in products with ``W``.
    rigid_motion
        Amounts of the rigid motions of bodies held by contact alone, ``(k,)``.
    free_motion
        Amounts of a rigid motion, ``(k,)``, scaled so that the contact that moves most
        moves by 1. With ``no_equilibrium`` a proof: it lies in the dual cone of every
        contact and the loads work on it; ``None`` where something else is the proof. With
        another outcome what the iteration moved along when it ended, an observation;
        ``None`` where it did not run away.
    history
        A row ``(work, residual)`` an iteration.
    bipotential_gap
        ``r·v + mu r_n |v_t|`` of each contact in units of work, ``(n_c,)``, (10); with
        two coefficients ``r·v + r_n |D v_t|``, (10e). Zero on the law. Where
        ``v_n >= 0`` and r lies in its cone it is zero nowhere else, and positive;
        of a contact that penetrates, pulls or has more friction than its limit it may be
        of either sign, or zero.
    seconds
        Time taken.
    stats
        ``bytes_beside_W``: what the solver held beside ``W``, its inverse or, of an
        asymmetric one, its transpose; 0 for neither.
    """

    reaction: Floats
    relative_displacement: Floats
    status: NDArray[np.int8]
    outcome: Outcome
    residual: float
    tolerance: float
    iterations: int
    work: float
    rigid_motion: Floats | None = None
    free_motion: Floats | None = None
    history: Floats = field(default_factory=lambda: np.empty((0, 2)))
    bipotential_gap: Floats = field(default_factory=lambda: np.empty(0))
    seconds: float = 0.0
    stats: Mapping[str, int] = field(default_factory=dict)
    _problem: Inquiry | None = None
    _known: dict[str, Any] = field(default_factory=dict)
    _words: str = ""
    _statuses_tried: int = 0

    def __repr__(self) -> str:
        # What is told without asking: `message` may look for a cause first.
        contacts = counted(len(self.status), "contact")
        iterations = counted(self.iterations, "iteration")
        return (
            f"{type(self).__name__}({contacts}, {self.outcome} in {iterations}, "
            f"residual {self.residual:.1e}, held to {self.tolerance:.1e})"
        )

    def __str__(self) -> str:
        return summary.text(summary.of_solution(self))

    def _repr_html_(self) -> str:
        return summary.html(summary.of_solution(self))

    def _ask(self, name: str, unknown: Any) -> Any:
        if name not in self._known:
            if self._problem is None or not self.converged:
                return unknown
            self._known[name] = getattr(self._problem, name)(self)
        return self._known[name]

    @property
    def error_estimate(self) -> tuple[float, float] | None:
        """Relative errors of reaction and relative displacement, as far as they go.

        ``‖r - r*‖ / ‖r*‖`` and ``‖v - v*‖ / ‖v*‖`` by one further Newton correction (19),
        with ``v`` from sums in twice the precision (of ``K`` where there is one), found
        out when first asked for: about one factorisation of the closed contacts. Where
        all contacts stick, ``v`` is rounding, and so is what is said of it. Where
        ``stiffness_rtol`` was given, what entries of ``K`` within it can change is added
        to both.
        ``None`` where it is not determined (reactions of redundant supports), for what
        has not converged, or has lost its problem (it was read from a file, or sent
        by another process, before this was asked for).
        """
        estimate: tuple[float, float] | None = self._ask("error_estimate", None)
        return estimate

    @property
    def error(self) -> ErrorBound:
        """A guaranteed bound of the error, found out when first asked for.

        Of what has not converged, too. Some factorisations of the size of ``W``; where
        there is none `ErrorBound.reason` says why. Its constitutive part is there in
        any case.
        """
        if "error" not in self._known:
            if self._problem is None:
                return error_bound.without("lost", self.bipotential_gap)
            self._known["error"] = self._problem.error(self)
        found: ErrorBound = self._known["error"]
        return found

    @property
    def unique(self) -> str:
        """Whether this answer is the only one, found out when first asked for.

        ``"proved"``, ``"others exist"`` or ``"unknown"``, by the criteria of section 10
        of ``docs/theory.md``. Some factorisations of the size of ``W``; ``"unknown"``
        without trying where they would take more than half a gigabyte: 2100 contacts
        with friction that feel each other in the plane, 1400 in space, 5700 without
        friction, or 3000 unknowns of a sparse ``W``. ``"unknown"`` also for what has
        not converged, or has lost its problem (it was read from a file, or sent by
        another process, before this was asked for).
        """
        return str(self._ask("unique", "unknown"))

    def __getstate__(self) -> dict[str, Any]:
        # The problem stays where it is: it may be gigabytes.
        return self.__dict__ | {"_problem": None}

    @property
    def converged(self) -> bool:
        """Whether this is an answer."""
        return self.outcome is Outcome.CONVERGED

    @property
    def message(self) -> str:
        """One sentence on how it ended.

        Where it did not converge: what was tried, the contact that misses the law by
        most, the likely cause and what to do, found out when first asked for.
        """
        judged = f"residual {self.residual:.1e}, held to {self.tolerance:.1e}"
        if self.converged:
            return f"converged in {counted(self.iterations, 'iteration')} ({judged})"
        if self.outcome is Outcome.NO_EQUILIBRIUM:
            if self._words:
                return (
                    "no answer exists: the loads lie outside what contact can carry, "
                    f"nothing stops this motion: {self._words}; add a support that stops "
                    "it, or loads that do not work on it"
                )
            if self._statuses_tried:
                contacts = counted(len(self.reaction), "contact")
                return (
                    f"no answer exists: all {self._statuses_tried} statuses were tried, "
                    f"each of {contacts} open, sticking, or sliding to either side, and "
                    "none holds; add a support, or change mu or the ratio of the loads"
                )
            return (
                "no answer exists: contacts contradict each other, or one penetrates "
                f"that nothing can move{self._diagnosis()}"
            )
        if self._words:
            return (
                f"not converged, seems to slide away: {self._words}; add a "
                "support that stops it, or change mu or the ratio of the loads "
                f"({judged})"
            )
        reason = _REASONS.get(self.outcome, str(self.outcome))
        return self._diagnosis() or f"not converged, {reason} ({judged})"

    def _diagnosis(self) -> str:
        if "diagnosis" not in self._known:
            if self._problem is None:
                return ""
            self._known["diagnosis"] = self._problem.diagnosis(self)
        return str(self._known["diagnosis"])


class Recovery(Protocol):
    """Displacements of steps, from their reactions."""

    def __call__(self, steps: Sequence[Step], /) -> Floats:
        """Find them, a row each."""

    def at_hand(self) -> bool:
        """Whether the problem keeps the factor that this takes."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Step(Solution):
    """One load step: a `Solution` with what belongs to a path.

    Attributes
    ----------
    slip
        Increment of the tangential relative displacement over the step,
        ``(n_c, d - 1)``; ``relative_displacement`` is the total, ``B u + gap``.
    load, prescribed
        Total loads ``(n,)`` and prescribed displacements ``(len(fixed),)``;
        ``None`` in a result that was read from a file.
    traction
        ``reaction / area``, ``(n_c, d)``; ``None`` without areas.
    s, ahead
        Where on a path of automatic steps this one ends, and the length that is tried
        next (`ContactProblem.follow`); ``None`` where steps were given.
    gap
        Gaps of this step, ``(n_c, d)``, where obstacles moved; ``None`` where they are
        those of the problem.
    working_set
        Numbers of the contacts that ``W`` was formed of, ascending; ``None`` where it is
        formed of all from the start. With it a path goes on from this step to the bits
        of one that went through.
    working_motion
        Where that set has grown to all contacts of bodies that contact alone holds,
        amounts of the rigid motions of these bodies as condensed onto all contacts,
        from which the next step begins; else ``None``.
    """

    slip: Floats
    load: Floats | None = None
    prescribed: Floats | None = None
    traction: Floats | None = None
    s: float | None = None
    ahead: float | None = None
    gap: Floats | None = None
    working_set: Ints | None = None
    working_motion: Floats | None = None
    _recover: Recovery | None = None
    _kept: dict[str, Floats] = field(default_factory=dict)

    @property
    def path_parameter(self) -> float | None:
        """`s`: where on a path of automatic steps this one ends."""
        return self.s

    @property
    def dissipation(self) -> float:
        """Work that friction took over the step, ``-Σ r_t · slip``, in force times length.

        Of the reactions at its end, as the law of the step has it: it is then
        ``Σ mu r_n ‖slip‖`` and not negative, but for the residual. Of a path it is the
        energy balance's where normal forces stay; where they change, to first order in
        the size of the steps.
        """
        return -float(np.sum(self.reaction[:, 1:] * self.slip))

    @property
    def displacement(self) -> Floats:
        """Displacement of all degrees of freedom, ``(n,)``, computed when first asked for.

        Raises
        ------
        ValueError
            The step has lost its problem (it was read from a file, or from
            another process) before the displacement was asked for.
        """
        if "u" not in self._kept:
            if self._recover is None:
                raise ValueError(
                    "displacement was not computed before this step was saved or sent: "
                    "ask for it where the problem is at hand"
                )
            recover([self])
        return self._kept["u"]

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_recover": None}


def recover(steps: Sequence[Step]) -> None:
    """Find the displacements of steps of one path that have none yet, as one block.

    One reading of the factor then serves many steps.
    """
    wanting = [step for step in steps if "u" not in step._kept]
    for found, of_path in groupby(wanting, key=lambda step: step._recover):
        rest = list(of_path)
        while found is not None and rest:
            block, rest = rest[:BLOCK], rest[BLOCK:]
            for step, u in zip(block, found(block), strict=True):
                # A copy, so that one step does not hold the memory of its block.
                step._kept["u"] = u.copy() if len(block) > 1 else u
