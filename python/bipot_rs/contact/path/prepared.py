"""K of a problem, prepared for the engine that solves: condensed, or as it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.machine import available
from bipot_rs._lib.messages import body_of, place
from bipot_rs._lib.types import Floats, Ints, MatrixLike, Record
from bipot_rs._lib.validation import (
    Csr,
    Parts,
    csr,
    describe_enforced,
    indices,
    integer,
    one_of,
    one_triangle,
    places,
    threads,
)
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import (
    FloatingBodyError,
    NotIterativeError,
    describe_contact,
    with_message,
    with_reason,
)
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.messages import rigid_motion_names
from bipot_rs.contact.path import choice
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.direct import Direct
from bipot_rs.contact.path.engine import REPLACED, Engine, RestoredDigits
from bipot_rs.contact.path.load_steps import Loads
from bipot_rs.contact.path.mesh_stiffness import MeshStiffness, whole_parts
from bipot_rs.contact.results.solution import Step

if TYPE_CHECKING:
    from bipot_rs.contact.path.iterative import Iterative
    from bipot_rs.contact.stiffness.digits import Digits


class _State(TypedDict):
    """What a pickle holds of a `PreparedStiffness`."""

    restored: RestoredDigits | None
    options: StiffnessOptions
    contacts: ContactSet
    loads: list[Loads] | None
    choice: tuple[str, str]
    stiffness: Parts


# Choices with which the iterative engine is made; "auto" is decided by each load path.
_ITERATIVE = ("auto", "iterative")

# Called with a forecast of the cost, before the factorisation.
OnForecast = Callable[[Record], object]

# Entries of `ContactProblem.stats` that only a factor has.
WITHOUT_FACTOR: dict[str, object] = dict.fromkeys(
    (
        "nnz_factor",
        "flops",
        "bytes_factor",
        "bytes_compliance",
        "bytes_peak",
        "cond_S",
        "keeps_digits",
        "ordering",
        "orderings",
        "working_set",
        "bodies",
        "islands",
    )
) | {"rigid_motions": 0, "factor_kept": False}


@dataclass(frozen=True, eq=False)
class StiffnessOptions:
    """What a problem says of its stiffness, checked."""

    n: int  # number of degrees of freedom
    fixed: Ints  # numbers of the prescribed ones
    num_threads: int | None = None
    # Coordinates of each degree of freedom, (n, 3), and the same, (n, d), unless they are in
    # another dimension than the contacts.
    coordinates: Floats | None = None
    places: Floats | None = None
    memory_limit: int | None = None
    working_set: bool | None = None
    bodies: dict[str, int] | None = None  # names, each with its first degree of freedom
    digits: Digits | None = None  # relative error of K, if it is not rounding
    engine: str = "auto"
    steps: int | None = None  # load steps, where known before the first load path
    # What only a mesh knows, for the direct engine: positions (n, 3), what all rigid motions
    # move at each degree of freedom (n, m), and the loss (n,), the terms from which each row of
    # K was summed over its entries.
    kinematics: tuple[Floats, Floats, Floats] | None = None
    latched: bool = False  # whether K is kept, for `PreparedStiffness.set_free`

    @classmethod
    def check(
        cls,
        n: int,
        d: int,
        *,
        fixed: ArrayLike | None,
        num_threads: int | None,
        coordinates: ArrayLike | None,
        memory_limit: int | None,
        working_set: bool | None,
        bodies: Mapping[str, int] | None,
        stiffness_rtol: float | None,
        engine: str,
        steps: int | None,
        kinematics: tuple[Floats, Floats, Floats] | None,
        latched: bool,
    ) -> StiffnessOptions:
        """Check the arguments of a `ContactProblem` that are about its stiffness.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong; the message names it.
        """
        if num_threads is not None:
            num_threads = threads(num_threads)
        in_space = places(coordinates, n)
        if memory_limit is not None:
            memory_limit = integer(
                "memory_limit", memory_limit, least=1, most=2**63 - 1
            )
        if working_set is not None and not isinstance(working_set, bool):
            raise TypeError(f"working_set is {working_set!r}, expected a bool or None")
        names = _check_bodies(bodies, n)
        digits = None
        if stiffness_rtol is not None:
            from bipot_rs.contact.stiffness.digits import check_digits

            digits = check_digits(stiffness_rtol, in_space, d, names)
        return cls(
            n,
            indices("fixed", fixed, n),
            num_threads,
            in_space,
            _drop_components(coordinates, in_space, d),
            memory_limit,
            working_set,
            names,
            digits,
            one_of("engine", engine, choice.ENGINES),
            steps,
            kinematics,
            latched,
        )

    @property
    def free(self) -> int:
        """Number of degrees of freedom that are not prescribed."""
        return self.n - len(self.fixed)

    def restore(self, stiffness: Csr) -> tuple[Csr, RestoredDigits | None]:
        """K with its rigid motions restored, and how far they were off."""
        if self.digits is None:
            return stiffness, None
        from scipy.sparse import csr_array

        parts, off = self.digits.restore(stiffness)
        matrix = csr_array(parts[::-1], shape=stiffness.shape)
        return Csr(matrix, stiffness.shape, parts), RestoredDigits(self.digits, off)


def _check_bodies(bodies: Mapping[str, int] | None, n: int) -> dict[str, int] | None:
    """Names of bodies and their first degrees of freedom."""
    if bodies is None:
        return None
    if not isinstance(bodies, Mapping):
        raise TypeError(
            f"bodies is a {type(bodies).__name__}, expected a mapping from each name to "
            "the first degree of freedom of the body"
        )
    names = {
        str(name): integer(f"bodies[{name!r}]", first, least=0, most=max(n - 1, 0))
        for name, first in bodies.items()
    }
    if len(set(names.values())) < len(names):
        raise ValueError(
            f"bodies is {names}, expected a different first degree of freedom for each"
        )
    return names


def _drop_components(
    coordinates: ArrayLike | None, in_space: Floats | None, d: int
) -> Floats | None:
    """Coordinates ``(n, d)``; None if they are in another dimension."""
    if coordinates is None or in_space is None:
        return None
    if d == 3 and np.shape(coordinates)[1] == 2:
        return None
    if d == 2 and np.ptp(in_space[:, 2]) > 0:
        return None
    return np.ascontiguousarray(in_space[:, :d])


class PreparedStiffness:
    """K with the engines that solve, one of which is chosen.

    With ``engine="auto"`` in space, each load path chooses. Until one is direct, K is kept as
    it is; once it is condensed, the core has it. A pickle holds K and not the factor, which may
    be a hundred times as large: condensing again gives the same bits.

    ``stiffness, restored``: K, and the digits of it that were restored. ``loads``: those of all
    steps, if K is not needed after these. ``on_forecast``: as in `ContactProblem`.
    ``seconds``: time of the condensation.
    """

    # The condensed problem, once it is made; the iterative engine, if it may be used.
    _condensed: _core.Condensed | None
    _iterative: Iterative | None
    # Bytes that the direct engine may use, before it is made; None if unknown.
    _memory: int | None
    # K, until it is condensed, or what assembles it once more.
    _parts: Parts | None
    _assemble: Callable[[], MatrixLike] | None
    # K, where some prescribed degrees of freedom become free.
    _kept: Parts | None
    _on_forecast: OnForecast | None

    def __init__(
        self,
        stiffness: Csr | MeshStiffness,
        restored: RestoredDigits | None,
        contacts: ContactSet,
        options: StiffnessOptions,
        loads: list[Loads] | None = None,
        on_forecast: OnForecast | None = None,
    ) -> None:
        self.restored, self.options = restored, options
        self.seconds = 0.0
        self._contacts, self._loads = contacts, loads
        # Name of the engine, and why.
        self._choice = "direct", ""
        given = stiffness if isinstance(stiffness, MeshStiffness) else stiffness.parts
        self._prepare(given, None, on_forecast)

    def __getstate__(self) -> _State:
        return {
            "restored": self.restored,
            "options": self.options,
            "contacts": self._contacts,
            "loads": self._loads,
            "choice": self._choice,
            "stiffness": self.matrix(),
        }

    def __setstate__(self, state: _State) -> None:
        self.restored, self.options = state["restored"], state["options"]
        self.seconds = 0.0
        self._contacts, self._loads = state["contacts"], state["loads"]
        self._choice = state["choice"]
        self._prepare(state["stiffness"], None)

    def update(self, stiffness: Csr, restored: RestoredDigits | None) -> None:
        """Replace K by another one; after an error the old one is kept."""
        self._prepare(stiffness.parts, self._condensed)
        self.restored = restored

    def matrix(self) -> Parts:
        """K, which the core has once it is condensed."""
        if self._kept is not None:
            return self._kept
        if self._parts is not None:
            return self._parts
        if self._assemble is not None:
            return csr("K", self._assemble()).parts
        return self.core.stiffness()

    def release(self, assemble: Callable[[], MatrixLike]) -> bool:
        """Drop K if the iterative engine will solve; ``assemble`` makes it once more."""
        if self._iterative is None or self._choice[0] != "iterative" or self._kept:
            return False
        self._parts, self._assemble = None, assemble
        return True

    def set_free(self, dofs: Ints) -> PreparedStiffness:
        """The same K with some of the prescribed degrees of freedom free, made once."""
        key = tuple(dofs.tolist())
        if not key:
            return self
        if key not in self._with_free:
            from scipy.sparse import csr_array

            options, parts = self.options, self.matrix()
            fixed = np.setdiff1d(options.fixed, dofs)
            shape = options.n, options.n
            self._with_free[key] = PreparedStiffness(
                Csr(csr_array(parts[::-1], shape=shape), shape, parts),
                self.restored,
                self._contacts,
                replace(options, fixed=fixed, latched=False),
            )
        return self._with_free[key]

    @property
    def core(self) -> _core.Condensed:
        """The condensed problem, for what needs the compliance ``W``."""
        if self._condensed is None and self.options.engine == "iterative":
            raise ValueError(
                "this needs the compliance W, which engine='iterative' does not form: "
                "use engine='direct'"
            )
        return self.make_direct().core

    def make_direct(self) -> Direct:
        """The direct engine; condenses if that was not done before."""
        if self._condensed is None:
            self._condensed = self._condense(self.matrix(), None, self._on_forecast)
            self._parts = self._assemble = None
        return Direct(self._condensed)

    def choose_engine(
        self, steps: int | None, method: str, start: Step | None = None
    ) -> Engine:
        """The engine of a load path.

        It does not depend on earlier paths. A path that continues from the step ``start``
        keeps the engine of that step.
        """
        iterative = self._iterative
        if iterative is not None:
            iterative.record.replaced = ""
            before = None
            if start is not None and not start.from_state:
                iterated = start.stats.keys() & {"krylov", REPLACED}
                before = "iterative" if iterated else "direct"
            self._choice = self._choose(steps, method, before, iterative)
            if self._choice[0] in _ITERATIVE:
                self._tell_iterative(iterative)
                return iterative
        # Makers of the other engines by their names: without its maker here an engine would be
        # another one under its name.
        makers = {"direct": self.make_direct}
        return makers[self._choice[0]]()

    @property
    def stats(self) -> Record:
        """As `ContactProblem.stats`."""
        name, why = self._choice
        contacts, d = self._contacts.shape
        stats: dict[str, object] = (
            WITHOUT_FACTOR | {"n": self.options.n, "n_contact_dofs": d * contacts}
            if self._condensed is None
            else self._condensed.stats.as_dict()
        )
        stats |= {
            "engine": name,
            "engine_reason": why,
            "seconds_condense": self.seconds,
        }
        if self._iterative is not None and name != "direct":
            stats |= self._iterative.stats
            replaced = self._iterative.record.replaced
            if replaced:
                stats["engine_reason"] = f"the iterative engine stalled: {replaced}"
        if self.restored is not None:
            stats["rigid_motions_off"] = self.restored.off
        return stats

    def name_rigid_motions(self) -> tuple[str, ...]:
        """As `ContactProblem.rigid_motions`."""
        stats = self.core.stats
        return rigid_motion_names.name_free_motions(
            self.core.modes().reshape(-1, *self._contacts.shape),
            stats.rigid_motion_bodies,
            stats.rigid_motion_dofs,
            self._contacts.frame,
            self.options.bodies,
        )

    def move_rigidly(self, amounts: Floats) -> Floats:
        """Displacements ``(n,)`` of rigid motions with these amplitudes, without loads."""
        options = self.options
        still = np.zeros(options.n), np.zeros(len(options.fixed))
        reaction = np.zeros(self._contacts.shape)
        moved = self.core.displacements([(*still, reaction, amounts)])
        return np.asarray(moved[0], np.float64)

    def _prepare(
        self,
        given: Parts | MeshStiffness,
        before: _core.Condensed | None,
        on_forecast: OnForecast | None = None,
    ) -> None:
        """Condense, or make the iterative engine and leave the choice to the load path."""
        options = self.options
        iterative = self._make_iterative(given)
        if isinstance(given, MeshStiffness):
            parts, assemble = None, given.assemble
        else:
            parts, assemble = given, None
        # The core drops what is between prescribed degrees of freedom.
        self._kept = parts if options.latched else None
        condensed = None
        if iterative is None:
            condensed = self._condense(whole_parts(given), before, on_forecast)
            parts = assemble = None
        self._condensed, self._iterative = condensed, iterative
        self._parts, self._assemble = parts, assemble
        self._with_free: dict[tuple[int, ...], PreparedStiffness] = {}
        self._on_forecast = None if iterative is None else on_forecast
        if iterative is None:
            return
        limit = options.memory_limit
        self._memory = available() if limit is None else limit
        if options.engine == "iterative" or options.steps is not None:
            self.choose_engine(options.steps, "auto")

    def _arguments(
        self,
    ) -> tuple[Parts, Floats, ContactLaw, Ints, int | None, Floats | None]:
        """Arguments of the core after the stiffness, in its order."""
        contacts, options = self._contacts, self.options
        return (
            contacts.operator.parts,
            contacts.gap_by_component,
            contacts.law,
            options.fixed,
            options.num_threads,
            options.coordinates,
        )

    def _condense(
        self,
        parts: Parts,
        before: _core.Condensed | None,
        on_forecast: OnForecast | None = None,
    ) -> _core.Condensed:
        started = time.perf_counter()
        options, (name, why) = self.options, self._choice

        def tell(counts: _core.CondensationForecast) -> None:
            if on_forecast is not None:
                on_forecast({**counts.as_dict(), "engine": name, "engine_reason": why})

        def condense(
            loads: list[Loads] | None,
            before: _core.Condensed | None,
            on_forecast: object = None,
        ) -> _core.Condensed:
            # All loads are known before a working set could grow.
            known = self._loads is not None or not self._contacts.law.is_coulomb
            return _core.Condensed(
                parts,
                *self._arguments(),
                loads,
                options.memory_limit,
                False if known else options.working_set,
                before,
                None if on_forecast is None else tell,
                options.kinematics,
            )

        try:
            condensed = condense(self._loads, before, on_forecast)
            counts = condensed.stats
            if not counts.keeps_digits and not counts.factor_kept:
                # The steps are corrected with K: beside the body that has lost digits, and
                # keeps its factor, this needs the factors of the others.
                condensed = condense(None, condensed)
        except (FloatingBodyError, ValueError) as error:
            raise self._explain(error, parts) from None
        self.seconds = time.perf_counter() - started
        return condensed

    def _explain(
        self, error: FloatingBodyError | ValueError, parts: Parts
    ) -> FloatingBodyError | ValueError:
        """An error of the condensation with its likely cause and the name of the body."""
        if isinstance(error, ValueError):
            cause = one_triangle(parts) or describe_enforced(parts)
            if cause:
                return with_message(error, f"{error}{cause}")
        dof = getattr(error, "dof", None)
        if dof is None:
            return error
        if getattr(error, "kind", "") == "few_digits":
            return with_message(error, self._describe_undecided(dof))
        text = str(error) + self._explain_digits(error, parts, dof)
        where = self._describe_place(dof)
        return with_message(error, f"{where}: {text}" if where else text)

    def _describe_undecided(self, dof: int) -> str:
        """The message of a motion that K has too few digits to call free or held."""
        from bipot_rs.contact.stiffness.digits import (
            COORDINATES,
            OFFER,
            describe_undecided,
        )

        options, motion = self.options, f"motion at degree of freedom {dof}"
        if options.coordinates is not None:
            direction = _core.dof_directions(options.coordinates, self._contacts.d)
            kind, axis = divmod(int(direction[dof]), 3)
            words = {0: "motion along", 1: "rotation about"}.get(kind)
            if words is not None and options.places is not None:
                motion = f"{words} {'xyz'[axis]} at {place(options.places[dof])}"
        offer = "" if options.digits is not None else OFFER
        if options.coordinates is None:
            offer = COORDINATES + offer
        return describe_undecided(body_of(dof, options.bodies), motion) + offer

    def _describe_place(self, dof: int) -> str:
        """The name of the body of a degree of freedom, and its place, if they are known."""
        options = self.options
        words = [] if options.bodies is None else [body_of(dof, options.bodies)]
        at = options.coordinates if options.places is None else options.places
        if at is not None:
            words.append(f"at {place(at[dof])}")
        return " ".join(words)

    def _explain_digits(self, error: Exception, parts: Parts, dof: int) -> str:
        """Text to add to an error of the core if few digits of K may be its cause."""
        from bipot_rs.contact.stiffness.digits import describe_indefinite

        if getattr(error, "kind", "") != "indefinite":
            return ""
        options = self.options
        return describe_indefinite(parts, options.fixed, dof, options.digits)

    def _describe_refusal(self, error: NotIterativeError) -> str:
        """Why the iterative engine cannot solve, with the place of the contact if it is known."""
        if error.contact is None:
            where = "" if error.dof is None else self._describe_place(error.dof)
            return f"{where}: {error.reason}" if where else error.reason
        x = self._contacts.x
        where = "" if x is None else f" at {place(x[error.contact])}"
        return describe_contact(error, where)

    def _make_iterative(self, given: Parts | MeshStiffness) -> Iterative | None:
        """The iterative engine, if it is wanted and can solve the problem."""
        options = self.options
        self._choice = self._choose()
        if self._choice[0] not in _ITERATIVE:
            return None
        from bipot_rs.contact.path.iterative import make_iterative

        started = time.perf_counter()
        moved = None if options.kinematics is None else options.kinematics[1]
        try:
            iterative = make_iterative(
                given,
                self._contacts,
                options.fixed,
                options.coordinates,
                options.num_threads,
                self.make_direct,
                # A body of revolution has no rigid motion along r.
                hoops=moved is not None and not moved.any(axis=0).all(),
            )
        except NotIterativeError as error:
            reason = self._describe_refusal(error)
            if options.engine == "iterative":
                raise with_reason(error, reason) from None
            self._choice = "direct", reason
            return None
        except ValueError as error:
            if isinstance(given, MeshStiffness):
                raise
            cause = one_triangle(given) or describe_enforced(given)
            raise with_message(error, f"{error}{cause}") from None
        self.seconds = time.perf_counter() - started
        return iterative

    def _choose(
        self,
        steps: int | None = None,
        method: str = "auto",
        before: str | None = None,
        iterative: Iterative | None = None,
    ) -> tuple[str, str]:
        """The engine of a path of so many load steps, and why; ``"auto"`` without them."""
        options, contacts = self.options, self._contacts
        return choice.choose_engine(
            options.engine,
            contacts.d,
            options.free,
            contacts.count,
            steps,
            None if steps is None else self._memory,
            method=method,
            needs_compliance=self._loads is not None or options.working_set is not None,
            before=before,
            copies=0 if iterative is None else iterative.springs.contacts.size,
        )

    def _tell_iterative(self, iterative: Iterative) -> None:
        """Call ``on_forecast`` with the counts of the iterative engine, once."""
        tell, self._on_forecast = self._on_forecast, None
        if tell is None:
            return
        contacts, d = self._contacts.shape
        solutions = self.options.steps or 1
        if iterative.springs.contacts.size:
            solutions *= tuning.COPY_SOLUTIONS
        bytes_peak = float(sum(iterative.core.bytes))
        if choice.joins_surfaces(self._contacts.operator.matrix, d):
            size = (self.options.n / tuning.JOINED_SIZE) ** tuning.JOINED_GROWTH
            solutions *= tuning.JOINED_SOLUTIONS * size
            bytes_peak *= tuning.JOINED_BYTES
        tell(
            {
                "engine": "iterative",
                "engine_reason": self._choice[1],
                "bodies": None,
                "n_contact_dofs": d * contacts,
                "nnz_factor": 0,
                "flops": tuning.STEP_FLOPS * self.options.n * solutions,
                "bytes_factor": 0,
                "bytes_peak": bytes_peak,
                "ordering": None,
            }
        )
