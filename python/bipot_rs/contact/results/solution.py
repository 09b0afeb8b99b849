"""The answer of one contact problem, and of one step of a load path, from that of the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.records import copy_sharing, deepcopy_sharing
from bipot_rs._lib.types import Bools, Floats, Ints, MatrixLike, OpenRecord
from bipot_rs.contact import tuning
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.results import error_bound, summary
from bipot_rs.contact.results.derivatives import (
    LOST,
    ReducedGradient,
    ReducedTangent,
    SolutionDerivatives,
)
from bipot_rs.contact.results.error_bound import ErrorBound

if TYPE_CHECKING:
    from bipot_rs.contact.results.error_bound import MinimisingSequence

# A solution, or a step, that is asked about.
S = TypeVar("S", contravariant=True)
A = TypeVar("A", bound="Solution")
# A class of steps.
K = TypeVar("K", bound="Step")

# A call of the class takes as long as all other fields.
_OUTCOMES = {outcome.value: outcome for outcome in Outcome}

# For solutions without their problem, which cannot be diagnosed.
_REASONS = {
    Outcome.STALLED: "the residual stopped falling",
    Outcome.ITERATION_LIMIT: "max_iterations was reached",
    Outcome.TIME_LIMIT: "max_seconds was reached",
}


class Inquiry(Protocol[S]):
    """The problem of a solution, for the properties that are computed on first use."""

    def unique(self, solution: S, /) -> str:
        """Whether the solution is unique."""

    def error_estimate(self, solution: S, /) -> tuple[float, float] | None:
        """Relative forward errors of the solution."""

    def error(self, solution: S, /) -> ErrorBound:
        """Guaranteed bound of the error of the solution."""

    def diagnosis(self, solution: S, /) -> str:
        """Why the solve failed, in one sentence."""

    def derivatives(self) -> SolutionDerivatives[Solution] | None:
        """Derivatives of the solution; None for a step of a load path."""


@dataclass(eq=False)
class Computed:
    """What was computed of a solution so far; None for what was not asked yet."""

    displacement: Floats | None = None  # (n,): displacement of all degrees of freedom
    # unique, error_estimate, error, diagnosis: the answers of `Inquiry`.
    unique: str | None = None
    error_estimate: tuple[float, float] | None = None
    error: ErrorBound | None = None
    diagnosis: str | None = None


def describe_not_carried(motion: str) -> str:
    """Why there is no solution, if the loads work on a motion that no reaction resists."""
    return (
        "no solution exists: contact cannot carry the loads, and nothing stops this motion: "
        f"{motion}; add a support that stops it, or change the loads so that they do no work "
        "on it"
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Solution:
    """The solution of one contact problem, or the best point that was reached.

    Components are normal first, ``(n, t1[, t2])``. Units are those of the caller.

    Attributes
    ----------
    reaction
        Nodal contact forces, ``(n_c, d)``; ``r_n >= 0`` presses.
    relative_displacement
        ``v``, ``(n_c, d)``; ``v_n >= 0`` is the opening.
    status
        `Status` of each contact, ``(n_c,)`` of ``int8``.
    converged, outcome
        Whether a fresh evaluation confirmed ``residual <= tolerance``, and why the
        solver stopped.
    residual, tolerance
        η of equation (13) and its limit, which is the larger of ``tol`` and the rounding
        error of η.
    iterations, work
        Number of iterations, and their cost in products with ``W``.
    rigid_motion
        Amplitudes of the rigid motions of bodies held by contact alone, ``(k,)``.
    free_motion
        Amplitudes of a rigid motion, ``(k,)``, scaled so that the largest displacement of
        a contact is 1. If ``outcome`` is ``no_equilibrium``, it is a proof: the motion
        lies in the dual cone of every contact and the loads do work on it; it is ``None``
        if there is another proof. With another outcome it is the direction in which the
        iteration diverged, which proves nothing; ``None`` if it did not diverge.
    history
        A row ``(work, residual)`` for each iteration.
    bipotential_gap
        ``r·v + mu r_n |v_t|`` of each contact in units of work, ``(n_c,)``, (10); with
        two coefficients ``r·v + r_n |D v_t|``, (10e). It is zero if the contact law holds.
        Otherwise it is positive if ``v_n >= 0`` and r lies in its cone; it may have any
        sign, or be zero, if the contact penetrates, pulls or exceeds its friction limit.
    minimising_sequence
        The fields ``(u_i, σ_i)`` of ``method="minimising_sequence"`` and the bifunctional
        along them; ``None`` for other methods, for steps whose ``W`` was formed for some
        of the contacts only (`Step.working_set`), and in a result that was read from a file.
    seconds
        Time of the solve.
    stats
        ``bytes_beside_W``: memory of the solver in addition to ``W``, for its inverse or
        the transpose of an asymmetric ``W``; 0 for neither.
    computed
        What was computed on first use so far.
    inquiry
        The problem, for what is computed on first use; ``None`` if it is not available:
        the solution was read from a file or came from another process.
    free_motion_text, statuses_tried
        For `message`: the free motion in words, and the number of combinations of statuses
        that were tried to prove that no solution exists.
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
    minimising_sequence: MinimisingSequence | None = None
    seconds: float = 0.0
    stats: Mapping[str, int] = field(default_factory=dict)
    computed: Computed = field(default_factory=Computed)
    inquiry: Inquiry[Any] | None = None
    free_motion_text: str = ""
    statuses_tried: int = 0

    def __repr__(self) -> str:
        # Not `message`, which may compute a diagnosis.
        contacts = count_noun(len(self.status), "contact")
        iterations = count_noun(self.iterations, "iteration")
        return (
            f"{type(self).__name__}({contacts}, {self.outcome} in {iterations}, "
            f"residual {self.residual:.1e}, held to {self.tolerance:.1e})"
        )

    def _summarise(self) -> summary.Summary:
        # None: not computed yet.
        unique = {
            None: "not checked: see .unique",
            "proved": "yes, proved",
            "unknown": "unknown",
            "others exist": "no",
        }[self.computed.unique]
        how = "converged in" if self.converged else f"{self.outcome} after"
        if not self.converged:
            unique = "no solution, only the best point that was reached: see .message"
        residual = f"{self.residual:.2g}, limit {self.tolerance:.2g}"
        if (estimate := self.computed.error_estimate) is not None:
            r, v = estimate
            residual += f"; forward error of r {r:.1g}, of v {v:.1g}"
        where = summary.describe_places(*self.reaction.shape)
        took = summary.format_seconds(self.seconds)
        iterations = count_noun(self.iterations, "iteration")
        return f"{type(self).__name__}: {how} {iterations}", [
            ("contacts", f"{where}: {summary.describe_statuses(self.status)}"),
            ("forces", summary.describe_forces(self.reaction)),
            ("residual", residual),
            ("unique", unique),
            ("cost", f"{self.work:.4g} products with W, {took}"),
        ]

    def __str__(self) -> str:
        return summary.format_text(self._summarise())

    def _repr_html_(self) -> str:
        return summary.format_html(self._summarise())

    @property
    def error_estimate(self) -> tuple[float, float] | None:
        """Estimated relative errors of the reaction and of the relative displacement.

        ``‖r - r*‖ / ‖r*‖`` and ``‖v - v*‖ / ‖v*‖``, estimated with one more Newton
        correction (19), where ``v`` is summed in double the precision (with ``K``, if
        there is one). It is computed on first use, at the cost of about one factorisation
        of the closed contacts. If all contacts stick, ``v`` is rounding error: the second is
        then relative to ``W r`` or ``q``, which cancel in it. With ``stiffness_rtol`` both
        include the effect of the error of ``K``. The iterative engine estimates both in
        each step, with one application of its preconditioner.

        It is ``None`` if the reactions are not determined (redundant supports), if the
        solve did not converge, or if the problem is not available: the solution was read
        from a file or came from another process, and this was not computed before.
        """
        computed = self.computed
        if computed.error_estimate is None and self.inquiry and self.converged:
            computed.error_estimate = self.inquiry.error_estimate(self)
        return computed.error_estimate

    @property
    def error(self) -> ErrorBound:
        """Guaranteed bound of the error, also of a solve that did not converge.

        It is computed on first use, at the cost of some factorisations of the size of
        ``W``. If there is no bound, `ErrorBound.reason` says why; the constitutive part is
        always available.
        """
        if self.computed.error is None:
            if self.inquiry is None:
                return error_bound.make_unavailable("lost", self.bipotential_gap)
            self.computed.error = self.inquiry.error(self)
        return self.computed.error

    @property
    def unique(self) -> str:
        """Whether this solution is unique: ``"proved"``, ``"others exist"`` or ``"unknown"``.

        The criteria are in section 10 of ``docs/theory.md``. It is computed on first use,
        at the cost of some factorisations of the size of ``W``. It is ``"unknown"`` if
        they would need more than half a gigabyte: for more than 2100 coupled contacts with
        friction in the plane, 1400 in space, 5700 without friction, or 3000 unknowns of a
        sparse ``W``. It is also ``"unknown"`` if the solve did not converge, or if the
        problem is not available: the solution was read from a file or came from another
        process, and this was not computed before.
        """
        if self.computed.unique is None:
            if self.inquiry is None or not self.converged:
                return "unknown"
            self.computed.unique = self.inquiry.unique(self)
        return self.computed.unique

    def jvp(
        self,
        W: MatrixLike | None = None,
        q: ArrayLike | None = None,
        mu: ArrayLike | None = None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> ReducedTangent:
        """Exact derivatives of the solution of a `ReducedProblem` in a direction (33).

        Parameters
        ----------
        W, q, mu, cohesion, dilatancy
            Changes of the data, shaped as in `ReducedProblem`; the default is zero.

        Returns
        -------
        ReducedTangent
            Derivatives of ``reaction`` and ``relative_displacement``. With contacts on a
            border between two statuses (``one_sided``) these are directional derivatives.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, the solve did not converge, or the problem is not
            available.
        NotDifferentiableError
            The derivative does not exist or is not unique: reactions are not determined,
            or several changes of statuses fit the direction.

        Examples
        --------
        >>> import bipot_rs as bp
        >>> problem = bp.ReducedProblem([[2.0, 0.0], [0.0, 1.0]], [[-1.0, 0.75]], 0.5)
        >>> problem.solve().jvp(mu=1.0).reaction.round(12)
        array([[ 0. , -0.5]])
        """
        return self._derivatives().jvp(self, W, q, mu, cohesion, dilatancy)

    def vjp(
        self,
        reaction: ArrayLike | None = None,
        relative_displacement: ArrayLike | None = None,
    ) -> ReducedGradient:
        """Exact gradient of a number that depends on a solution of a `ReducedProblem` (34).

        Parameters
        ----------
        reaction, relative_displacement
            Derivatives of the number by these, ``(n_c, d)``; the default is zero.

        Returns
        -------
        ReducedGradient
            Derivatives by ``W``, ``q`` and ``mu``.

        Raises
        ------
        TypeError, ValueError, NotDifferentiableError
            As `jvp`.
        """
        return self._derivatives().vjp(self, reaction, relative_displacement)

    def _derivatives(self) -> SolutionDerivatives[Solution]:
        if self.inquiry is None:
            raise ValueError(LOST)
        derivatives = self.inquiry.derivatives()
        if derivatives is None:
            raise ValueError(
                "this is a step of a load path: use jvp and vjp of its Result"
            )
        return derivatives

    def __getstate__(self) -> dict[str, object]:
        # Without the problem, which may be gigabytes.
        return self.__dict__ | {"inquiry": None}

    def __copy__(self) -> Self:
        return copy_sharing(self)

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return deepcopy_sharing(self, memo, ("inquiry", "recovery"))

    @property
    def converged(self) -> bool:
        """Whether the solve converged."""
        return self.outcome is Outcome.CONVERGED

    @property
    def message(self) -> str:
        """How the solve ended, in one sentence.

        If it did not converge: the method, the contact with the largest violation of the
        law, the likely cause and what to do. This is computed on first use.
        """
        judged = f"residual {self.residual:.1e}, limit {self.tolerance:.1e}"
        if self.converged:
            return f"converged in {count_noun(self.iterations, 'iteration')} ({judged})"
        if self.outcome is Outcome.NO_EQUILIBRIUM:
            if self.free_motion_text:
                return describe_not_carried(self.free_motion_text)
            if self.statuses_tried:
                contacts = count_noun(len(self.reaction), "contact")
                return (
                    f"no solution exists: all {self.statuses_tried} combinations of "
                    f"statuses were tried, with each of {contacts} open, sticking, or "
                    "slipping to either side, and none satisfies the contact law; add a "
                    "support, or change mu or the ratio of the loads"
                )
            return (
                "no solution exists: contacts contradict each other, or a contact "
                f"penetrates that no reaction can move{self._diagnosis()}"
            )
        if self.free_motion_text:
            return (
                f"not converged, a body seems to slide away: {self.free_motion_text}; add a "
                "support that stops it, or change mu or the ratio of the loads "
                f"({judged})"
            )
        reason = _REASONS.get(self.outcome, str(self.outcome))
        return self._diagnosis() or f"not converged, {reason} ({judged})"

    def _diagnosis(self) -> str:
        if self.computed.diagnosis is None:
            if self.inquiry is None:
                return ""
            self.computed.diagnosis = self.inquiry.diagnosis(self)
        return self.computed.diagnosis


class Recovery(Protocol):
    """Computes displacements of steps from their reactions."""

    def recover(self, steps: Sequence[Step], /) -> Floats:
        """Compute the displacements, a row for each step."""

    def has_factor(self) -> bool:
        """Whether the problem keeps the factor that displacements need."""

    def primal(self) -> _core.Primal | None:
        """The bodies of the iterative engine, for derivatives; None for another engine."""

    def condensed(self) -> _core.Condensed:
        """The condensed bodies, for derivatives.

        Raises `MemoryError`: they were not condensed, and the factor does not fit into memory.
        """


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Step(Solution):
    """One load step: a `Solution` with its loads, slip and place on the path.

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
        Path parameter at the end of an adaptive step, and the length of the next step to
        try (`ContactProblem.follow`); ``None`` for other steps.
    gap
        Gaps of this step, ``(n_c, d)``, if obstacles moved; else ``None``.
    frame, drag
        Frames of the contacts in this step, ``(n_c, d, d)``, and displacement of the surface
        of the obstacle under them since the start of the path, ``(n_c, d)`` in global
        components, if frames change along the path (`MovingGaps`); else ``None``.
    working_set
        Numbers of the contacts for which ``W`` was formed, ascending; ``None`` if it was
        formed for all contacts at the start. A path that continues from this step then
        has the same bits as an uninterrupted one.
    working_motion
        Amplitudes of rigid motions from which the next step begins, if the working set has
        grown to all contacts of bodies that contact alone holds; else ``None``.
    wear, cycle
        Depth worn off each contact until the end of the step, ``(n_c,)``, and number of the
        cycle (`ContactProblem.wear`); else ``None``.
    broken
        Contacts that have lost their cohesion until the end of the step, ``(n_c,)``; ``None``
        for a problem without cohesion.
    dilation, lift
        Opening at which the surfaces meet after the step, because dilatancy has lifted them,
        ``(n_c,)``, and the part of it from this step; ``None`` without dilatancy.
    shortening, bolt_force, tightened
        Shortening of each bolt since the start, its force, tension positive, and whether the
        force determined the shortening in this step, ``(m,)``; ``None`` without bolts.
    opened
        Contacts that are open by more than the tolerance, ``(n_c,)``; ``None`` in a result
        that was read from a file.
    remarks
        Sentences about the step: contacts that broke.
    recovery
        What computes the displacements; ``None`` if the problem is not available.
    from_state
        Whether the step stands for a `State`, which has no amplitudes of rigid motions.
    """

    slip: Floats
    load: Floats | None = None
    prescribed: Floats | None = None
    traction: Floats | None = None
    s: float | None = None
    ahead: float | None = None
    gap: Floats | None = None
    frame: Floats | None = None
    drag: Floats | None = None
    working_set: Ints | None = None
    working_motion: Floats | None = None
    wear: Floats | None = None
    cycle: int | None = None
    broken: Bools | None = None
    dilation: Floats | None = None
    lift: Floats | None = None
    shortening: Floats | None = None
    bolt_force: Floats | None = None
    tightened: Bools | None = None
    opened: Bools | None = None
    remarks: tuple[str, ...] = ()
    recovery: Recovery | None = None
    from_state: bool = False

    @property
    def path_parameter(self) -> float | None:
        """Path parameter at the end of an adaptive step: another name of `s`."""
        return self.s

    @property
    def pressure(self) -> Floats:
        """Normal part of `traction`, ``(n_c,)``; a `ValueError` without areas."""
        return self._known_traction()[:, 0]

    @property
    def shear_traction(self) -> Floats:
        """Tangential part of `traction`, ``(n_c, d - 1)``; a `ValueError` without areas."""
        return self._known_traction()[:, 1:]

    def _known_traction(self) -> Floats:
        if self.traction is None:
            raise ValueError("the areas are not known: give area= to ContactProblem")
        return self.traction

    @property
    def dissipation(self) -> float:
        """Energy dissipated by friction in the step, ``-Σ r_t · slip``.

        The reactions are those at the end of the step, as in the law of the step. It is
        therefore ``Σ mu r_n ‖slip‖`` up to the residual, and not negative. Over a path it
        is exact in the energy balance if normal forces are constant, and first order in
        the step size if they change. The work ``Σ r_n lift`` against the pressure, which
        dilatancy stores, is no part of it.
        """
        work = -float(np.sum(self.reaction[:, 1:] * self.slip))
        return (
            work if self.lift is None else work - float(self.reaction[:, 0] @ self.lift)
        )

    @property
    def displacement(self) -> Floats:
        """Displacement of all degrees of freedom, ``(n,)``, computed when first asked for.

        Raises
        ------
        ValueError
            The problem is not available: the step was read from a file or came from
            another process, and the displacement was not computed before.
        """
        recover_displacements([self])
        if self.computed.displacement is None:
            raise ValueError(
                "displacement was not computed before this step was saved or sent to "
                "another process: use step.displacement before that, or save with "
                "displacements=True"
            )
        return self.computed.displacement

    def minimising_displacements(self) -> Floats:
        """Displacements ``u_i`` of `minimising_sequence`, ``(k, n)``.

        Raises
        ------
        ValueError
            The step has no minimising sequence, or the problem is not available: the step
            came from another process.
        """
        sequence = self.minimising_sequence
        if sequence is None:
            raise ValueError(
                "this step has no minimising sequence: solve with "
                'method="minimising_sequence", and with W of all contacts'
            )
        if self.recovery is None:
            raise ValueError(
                "the problem of this step is not available: compute "
                "minimising_displacements before the step is sent to another process"
            )
        before = self.relative_displacement.copy()
        before[:, 0] = 0.0
        before[:, 1:] -= self.slip
        along = zip(
            sequence.balanced_reaction, sequence.relative_displacement, strict=True
        )
        steps = [
            replace(
                self,
                reaction=reaction,
                relative_displacement=before + v,
                slip=v[:, 1:],
                computed=Computed(),
            )
            for reaction, v in along
        ]
        recover_displacements(steps)
        displacements = [step.displacement for step in steps]
        return (
            np.stack(displacements)
            if displacements
            else np.empty((0, self.displacement.size))
        )

    def __getstate__(self) -> dict[str, object]:
        return super().__getstate__() | {"recovery": None}


def make(kind: type[A], fields: OpenRecord) -> A:
    """A solution with these fields, all that have no plain default among them.

    As when unpickled: ``__init__`` of a frozen class takes as long as a small problem.
    """
    made = object.__new__(kind)
    object.__setattr__(made, "__dict__", fields)
    return made


def revise(solution: A, **changes: Any) -> A:
    """A solution with other fields, as `dataclasses.replace` but much faster."""
    return make(type(solution), {**solution.__dict__, **changes})


def recover_displacements(steps: Sequence[Step]) -> None:
    """Compute the missing displacements of steps, in blocks for each problem.

    One pass over the factor then serves many steps.
    """
    without = [step for step in steps if step.computed.displacement is None]
    for recovery, of_path in groupby(without, key=lambda step: step.recovery):
        rest = list(of_path)
        while recovery is not None and rest:
            block, rest = (
                rest[: tuning.DISPLACEMENTS_TOGETHER],
                rest[tuning.DISPLACEMENTS_TOGETHER :],
            )
            for step, u in zip(block, recovery.recover(block), strict=True):
                # A copy, so that a step does not keep the memory of its block.
                step.computed.displacement = u.copy() if len(block) > 1 else u


def make_solution(
    core: _core.ReducedSolution, inquiry: Inquiry[Solution], free_motion_text: str
) -> Solution:
    """A `Solution` of a reduced problem."""
    # Without `__init__`: its defaults are those of the class.
    fields = _fields(core)
    fields["computed"] = object.__new__(Computed)
    fields["inquiry"] = inquiry
    fields["free_motion_text"] = free_motion_text
    return make(Solution, fields)


def make_step(core: _core.LoadStep) -> Step:
    """A step of a condensed problem, without its loads and its problem."""
    fields = _fields(core.solution)
    fields["computed"] = Computed()
    fields["slip"] = core.slip
    fields["opened"] = core.opened
    fields["working_set"] = core.working_set
    fields["working_motion"] = core.working_motion
    return make(Step, fields)


def make_newton_step(core: _core.NewtonStep, displacement: Floats, kind: type[K]) -> K:
    """A step of Newton in the displacements, without its loads and its problem.

    ``kind`` is its class.
    """
    fields = _fields(core.solution)
    fields["stats"] |= {"newton": core.newton, "krylov": core.krylov}
    return kind(
        **fields,
        slip=core.slip,
        opened=core.opened,
        computed=Computed(displacement, error_estimate=core.error_estimate),
    )


def find_opening(outcome: str, mu: Floats) -> Floats:
    """Ratio of opening to slip that the free motion contains: mu for a proof, else zero.

    A proof lies in the dual cone; a direction of divergence is a displacement.
    """
    return mu if outcome == Outcome.NO_EQUILIBRIUM else np.zeros_like(mu)


def _fields(core: _core.ReducedSolution) -> OpenRecord:
    """Fields of a `Solution` that the core knows."""
    fields, sequence = core.minimising_sequence, None
    if fields is not None:
        from bipot_rs.contact.results.error_bound import read_sequence

        sequence = read_sequence(fields, core.reaction.shape)
    return {
        "reaction": core.reaction,
        "relative_displacement": core.relative_displacement,
        "status": core.status,
        "outcome": _OUTCOMES[core.outcome],
        "residual": core.residual,
        "tolerance": core.tolerance,
        "iterations": core.iterations,
        "work": core.work,
        "rigid_motion": core.rigid_motion,
        "free_motion": core.free_motion,
        "history": core.history,
        "bipotential_gap": core.bipotential_gap,
        "minimising_sequence": sequence,
        "seconds": core.seconds,
        "stats": {"bytes_beside_W": core.bytes_beside},
        "statuses_tried": core.statuses_tried,
    }
