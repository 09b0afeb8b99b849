"""What a solve returns: one `Solution`, or the `Step` s of a path in a `Result`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from itertools import groupby
from typing import Any, Protocol, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.messages import counted
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact import error_bound, summary
from bipot_rs.contact.error_bound import ErrorBound
from bipot_rs.contact.status import Outcome, Status
from bipot_rs.files import export

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


class Result(Sequence[Step]):
    """The steps of a load path, stacked; ``result[k]`` is step ``k``.

    Attributes
    ----------
    steps
        The complete steps.
    contacts
        What is known of the contacts: ``x``, ``normal``, ``frame``, ``area``,
        ``gap``, ``mu``; ``None`` for what is not.
    start
        The step that the path started from, ``None`` for the unloaded bodies.
    seconds
        ``condense``, ``solve``, ``recover``.
    success, message
        Whether the whole path was solved, and a sentence on it.
    remarks
        What a person should look at, a sentence each: contacts that penetrate at the
        start, normals that point out of their body, degrees of freedom in another order
        than their places, no contact that closes, loads that look mixed in units. Where
        ``coordinates`` were given all of them are looked for. Empty where nothing is
        suspicious.
    units
        Names of the units by ``"length"``, ``"force"``, ``"stress"``, for labels; empty
        where they are not known. May be set.
    stiffness_rtol, rigid_motions_off
        Relative error of the entries of K where that was given, and how far it left
        rigid motions off before they were restored; else ``None``.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        *,
        contacts: Mapping[str, NDArray[Any] | None],
        shape: tuple[int, int],
        start: Step | None = None,
        seconds: Mapping[str, float] | None = None,
        success: bool,
        message: str,
        units: Mapping[str, str] | None = None,
        remarks: Sequence[str] = (),
    ) -> None:
        self.steps = tuple(steps)
        self.contacts = dict(contacts)
        self._shape = shape
        self.start = start
        self.seconds = dict.fromkeys(("condense", "solve", "recover"), 0.0) | dict(
            seconds or {}
        )
        self.success = success
        self.message = message
        # Steps of the path before these, where a `Model` has gone on with one.
        self._first = 0
        self.units = dict(units or {})
        self.stiffness_rtol: float | None = None
        self.rigid_motions_off: float | None = None
        self._remarks = tuple(remarks)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should look at, a sentence each."""
        if self.stiffness_rtol is None:
            return self._remarks
        off = self.rigid_motions_off or 0.0
        known = f"the entries of K are known to {self.stiffness_rtol:g} only"
        restored = f"its rigid motions were off by {off:.1e} and are restored"
        digits = f"{known}, and the results to no more; {restored}"
        return (*self._remarks, digits)

    def __len__(self) -> int:
        return len(self.steps)

    @overload
    def __getitem__(self, k: SupportsIndex) -> Step: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[Step, ...]: ...
    def __getitem__(self, k: Any) -> Any:
        return self.steps[k]

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def __repr__(self) -> str:
        contacts = len(self.status[-1]) if self.steps else 0
        return (
            f"Result({counted(len(self), 'step')}, {counted(contacts, 'contact')}, "
            f"{self.message})"
        )

    def __str__(self) -> str:
        return summary.text(summary.of_result(self))

    def _repr_html_(self) -> str:
        return summary.html(summary.of_result(self))

    def _stack(
        self, name: str, empty: tuple[int, ...], dtype: Any = np.float64
    ) -> NDArray[Any]:
        if not self.steps:
            return np.empty(empty, dtype)
        return np.stack([np.asarray(getattr(step, name), dtype) for step in self.steps])

    @property
    def reaction(self) -> Floats:
        """Nodal contact forces, ``(steps, n_c, d)``."""
        return self._stack("reaction", (0, *self._shape))

    @property
    def traction(self) -> Floats | None:
        """``reaction / area``, ``(steps, n_c, d)``; ``None`` without areas."""
        if self.contacts.get("area") is None:
            return None
        return self._stack("traction", (0, *self._shape))

    @property
    def relative_displacement(self) -> Floats:
        """Total relative displacement ``B u + gap``, ``(steps, n_c, d)``."""
        return self._stack("relative_displacement", (0, *self._shape))

    @property
    def slip(self) -> Floats:
        """Slip increment of each step, ``(steps, n_c, d - 1)``."""
        contacts, d = self._shape
        return self._stack("slip", (0, contacts, max(d - 1, 0)))

    @property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact, ``(steps, n_c)``."""
        return self._stack("status", (0, self._shape[0]), np.int8)

    @property
    def displacement(self) -> Floats:
        """Displacement of all degrees of freedom, ``(steps, n)``, computed when asked for."""
        recover(self.steps)
        return self._stack("displacement", (0, 0))

    @property
    def dissipation(self) -> Floats:
        """`Step.dissipation`, friction's work over each step, ``(steps,)``."""
        return self._stack("dissipation", (0,))

    @property
    def resultant(self) -> Floats:
        """Sum of the contact forces on the bodies that have the contacts, ``(steps, d)``.

        In global components where the frames of the contacts are known. Otherwise the
        sums of the components ``(n, t1[, t2])``: a force where all contacts have the
        same frame.
        """
        return self.resultants(np.zeros(self._shape[0], np.int64))[:, 0]

    def resultants(self, group: NDArray[np.integer[Any]]) -> Floats:
        """`resultant` of each group of contacts, ``(steps, groups, d)``.

        Parameters
        ----------
        group
            Number of the group of each contact, ``(n_c,)`` integers from 0, such as
            ``fem.Assembly.group``.

        Raises
        ------
        TypeError, ValueError
            ``group`` holds something else.
        """
        number = np.asarray(group)
        contacts = self._shape[0]
        if number.dtype.kind not in "iu":
            raise TypeError(
                f"group has entries of type {number.dtype}, expected integers"
            )
        if number.shape != (contacts,):
            raise ValueError(f"group has shape {number.shape}, expected ({contacts},)")
        if (number < 0).any():
            raise ValueError(
                f"group of contact {int(np.argmax(number < 0))} is {number.min()}, "
                "expected it from 0"
            )
        force, frame = self.reaction, self.contacts.get("frame")
        if frame is not None:
            force = np.einsum("sck,ckd->scd", force, frame)
        # One group even of no contacts: their sum is zero.
        groups = range(int(number.max(initial=0)) + 1)
        return np.stack([force[:, number == g].sum(axis=1) for g in groups], axis=1)

    @property
    def work(self) -> Floats:
        """Cost of each step in products with ``W``, ``(steps,)``."""
        return self._stack("work", (0,))

    @property
    def s(self) -> Floats | None:
        """Where on the path each step ends, ``(steps,)``; ``None`` where steps were given."""
        if not self.steps or any(step.s is None for step in self.steps):
            return None
        return self._stack("s", (0,))

    @property
    def error(self) -> tuple[ErrorBound, ...]:
        """`Solution.error` of each step, found out when first asked for."""
        return tuple(step.error for step in self.steps)

    @property
    def residual(self) -> Floats:
        """η of each step, ``(steps,)``."""
        return self._stack("residual", (0,))

    @property
    def iterations(self) -> Ints:
        """Iterations of each step, ``(steps,)``."""
        return self._stack("iterations", (0,), np.int64)

    @property
    def converged(self) -> Bools:
        """Whether each step is an answer, ``(steps,)``."""
        return self._stack("converged", (0,), np.bool_)

    def save(
        self, path: str | os.PathLike[str], *, displacements: bool | None = None
    ) -> None:
        """Write the result to an HDF5 file; `load` reads it back.

        Parameters
        ----------
        path
            File to write or to replace.
        displacements
            Whether displacements ``(n,)`` that nobody has asked for are found first, a
            solve a load step. By default where the problem keeps its factor, not where
            ``loads=`` did without, nor beyond the memory of the machine. The steps keep
            them. Those that have been found are written in any case, and a file without
            them can give none.

        Raises
        ------
        OSError
            The file cannot be written; an earlier one of that name is intact.
        ValueError
            ``displacements=True`` and steps that have lost their problem.
        """
        if displacements is None:
            ways = [(step, step._recover) for step in self.steps]
            with suppress(MemoryError):
                recover(
                    [step for step, way in ways if way is not None and way.at_hand()]
                )
        elif displacements:
            recover(self.steps)
            for step in self.steps:
                _ = step.displacement  # of one that has lost its problem, refused
        export.write_result(
            path,
            self.contacts,
            [_record(step, self._load(k)) for k, step in enumerate(self.steps)],
            complete=self.success,
            attributes={
                "message": self.message,
                "first_step": self._first,
                "remarks": json.dumps(self._remarks),
            }
            | {f"seconds_{name}": value for name, value in self.seconds.items()}
            | {f"unit_{name}": unit for name, unit in self.units.items()}
            | {
                name: value
                for name in _OF_STIFFNESS
                if (value := getattr(self, name)) is not None
            },
        )

    def _load(self, k: int) -> float:
        """By what step ``k`` is told in a file."""
        return float(k + 1)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a PVD series of the contacts for ParaView, a point each.

        Fields are those of `Step`, by components ``(n, t1[, t2])``, and where the frames
        are known ``force``, the reaction in global components, to draw as arrows.

        Raises
        ------
        ValueError
            The places of the contacts are not known, or a name that does not end in
            ``.pvd``.
        OSError
            A file cannot be written.
        """
        index = export.indexed(path)
        x = self.contacts.get("x")
        if x is None:
            raise ValueError(
                "the places of the contacts are not known: give points= to ContactProblem "
                "or solve to write them for ParaView"
            )
        names = ("reaction", "traction", "relative_displacement", "slip", "status")
        series = [{name: getattr(step, name) for name in names} for step in self.steps]
        frame = self.contacts.get("frame")
        if frame is not None:
            for fields_of, step in zip(series, self.steps, strict=True):
                fields_of["force"] = np.einsum("ck,ckd->cd", step.reaction, frame)
        export.write_series(
            index,
            x,
            None,
            [{k: v for k, v in s.items() if v is not None} for s in series],
        )


# What a file tells of a stiffness that is known to some digits.
_OF_STIFFNESS = ("stiffness_rtol", "rigid_motions_off")
# What of a step is not written as it stands.
_NOT_WRITTEN = {"load", "prescribed", "traction", "free_motion", "stats"}


def _record(step: Step, load: float) -> dict[str, Any]:
    record = {name: getattr(step, name) for name in _written()}
    record["outcome"] = str(step.outcome)
    record |= step.stats
    record["load"] = load
    record["displacement"] = step._kept.get("u")
    # What has not been asked for is not worth a factorisation.
    record["unique"] = step._known.get("unique")
    estimate = step._known.get("error_estimate")
    if estimate is not None:
        record["error_estimate"] = np.asarray(estimate)
    return record


def _written() -> list[str]:
    names = (f.name for f in fields(Step) if not f.name.startswith("_"))
    return [name for name in names if name not in _NOT_WRITTEN]


def load_result(path: str | os.PathLike[str]) -> Result:
    """Read a result that `Result.save` or the command line wrote.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is not a result, or damaged.
    """
    contacts, records, attributes = export.read_result(path)
    area = contacts.get("area")
    shape = _shape(contacts, records)
    steps = []
    for k, record in enumerate(records):
        try:
            steps.append(_from_record(record, area, shape))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ValueError(
                f"{path} is not a result that can be read: step {k}: {error}"
            ) from None

    def named(prefix: str) -> dict[str, Any]:
        return {
            k[len(prefix) :]: v for k, v in attributes.items() if k.startswith(prefix)
        }

    found = Result(
        steps,
        contacts=contacts,
        shape=shape,
        seconds=named("seconds_"),
        units=_units(attributes) | named("unit_"),
        remarks=_remarks(attributes),
        success=bool(attributes["complete"]),
        message=str(attributes.get("message", "")),
    )
    found._first = int(attributes.get("first_step", 0))
    for name in _OF_STIFFNESS:
        if name in attributes:
            setattr(found, name, float(attributes[name]))
    return found


def _remarks(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    """Those of a file, where it has some."""
    try:
        return tuple(map(str, json.loads(str(attributes.get("remarks", "[]")))))
    except (ValueError, TypeError):
        return ()


def _units(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Names of units as the command line writes them, where it did."""
    try:
        told = json.loads(str(attributes.get("units", "{}")))
        return {str(name): str(unit) for name, unit in told.items() if unit}
    except (ValueError, AttributeError):
        return {}


def _shape(
    contacts: Mapping[str, NDArray[Any]], records: Sequence[Mapping[str, Any]]
) -> tuple[int, int]:
    """``(n_c, d)``; zero for what the file does not tell."""
    told = records[0].get("reaction") if records else contacts.get("x")
    if told is not None and np.ndim(told) == 2:
        return told.shape[0], told.shape[1]
    return len(contacts.get("gap", ())), 0


# What makes a step; the rest has a default.
_NEEDED = {
    "reaction",
    "relative_displacement",
    "slip",
    "status",
    "residual",
    "tolerance",
    "iterations",
    "work",
    "outcome",
}


def _check_set(record: Mapping[str, Any], contacts: int) -> None:
    """Refuse a working set that is none, or a motion without numbers."""
    found = np.asarray(record.get("working_set", np.empty(0, np.int64)))
    bounded = np.concatenate([[-1], found.ravel(), [contacts]])
    if found.ndim != 1 or found.dtype != np.int64 or not (np.diff(bounded) > 0).all():
        raise ValueError("working_set holds something else than ascending contacts")
    motion = np.asarray(record.get("working_motion", np.empty(0)))
    if motion.ndim != 1 or motion.dtype != np.float64 or not np.isfinite(motion).all():
        raise ValueError("working_motion holds something else than finite numbers")


def _from_record(
    record: Mapping[str, Any], area: NDArray[Any] | None, shape: tuple[int, int]
) -> Step:
    contacts, d = shape
    missing = _NEEDED - record.keys()
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} missing")
    for name, expected in (
        ("reaction", (contacts, d)),
        ("relative_displacement", (contacts, d)),
        ("slip", (contacts, max(d - 1, 0))),
        ("status", (contacts,)),
        ("residual", ()),
        ("tolerance", ()),
        ("iterations", ()),
        ("work", ()),
    ):
        value = np.asarray(record[name])
        if value.shape != expected:
            raise ValueError(f"{name} has shape {value.shape}, expected {expected}")
        if value.dtype.kind not in "if" or not np.isfinite(value).all():
            raise ValueError(f"{name} holds something else than finite numbers")
    if "gap" in record and np.shape(record["gap"]) != (contacts, d):
        found = np.shape(record["gap"])
        raise ValueError(f"gap has shape {found}, expected {(contacts, d)}")
    _check_set(record, contacts)
    status = record["status"]
    if not np.isin(status, list(Status)).all():
        raise ValueError("status holds something else than 0, 1 and 2")
    known = {name: record[name] for name in _written() if name in record}
    known["outcome"] = Outcome(known["outcome"])
    known["stats"] = {k: int(record[k]) for k in ("bytes_beside_W",) if k in record}
    asked: dict[str, Any] = {}
    if "error_estimate" in record:
        estimate = record["error_estimate"]
        asked["error_estimate"] = (float(estimate[0]), float(estimate[1]))
    if "unique" in record:
        asked["unique"] = str(record["unique"])
    kept = {"u": record["displacement"]} if "displacement" in record else {}
    traction = None if area is None else known["reaction"] / area[:, None]
    return Step(**known, traction=traction, _kept=kept, _known=asked)


# The promised name before it.
load = load_result
