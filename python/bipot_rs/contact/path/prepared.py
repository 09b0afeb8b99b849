"""K of a problem, prepared for the engine that solves: condensed, or as it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import bipot_rs._core as _core
from bipot_rs._lib.memory import available
from bipot_rs._lib.messages import body_of
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import Csr, Parts, csr, enforced, one_triangle
from bipot_rs.contact.errors import FloatingBodyError, NotIterativeError
from bipot_rs.contact.path import choice
from bipot_rs.contact.path.direct import Direct
from bipot_rs.contact.path.engine import Engine, Known

if TYPE_CHECKING:
    from bipot_rs.contact.path.iterative import Iterative
    from bipot_rs.contact.stiffness.digits import Digits


class Given(NamedTuple):
    """Arguments of `_core.Condensed` after the stiffness, in its order."""

    contact: Parts
    gap: Floats
    mu: Floats
    fixed: Ints
    num_threads: int | None
    coordinates: Floats | None
    loads: Any
    memory_limit: int | None
    working_set: bool | None


class Prepared:
    """The part of a `ContactProblem` that knows K: its digits, engines and pickle.

    With ``engine="auto"`` in space, the first load path chooses. Until then K is kept as it
    is; once it is condensed, the core has it.
    """

    _given: Given
    # Degrees of freedom, contacts, components of a contact.
    _shape: tuple[int, int, int]
    _fixed: Ints
    # The engine that was asked for.
    _asked: str
    _bodies: dict[str, int] | None
    _digits: Digits | None
    _known: Known | None
    _seconds: float
    # Number of load steps, where it is known before the first load path.
    _steps: int | None = None
    # The condensed problem, once it is made; the iterative engine, while it may be used.
    _condensed: _core.Condensed | None = None
    _iterative: Iterative | None = None
    # K, until it is condensed, or what makes it once more.
    _parts: Parts | None = None
    _again: Callable[[], Any] | None = None
    # Name of the engine, and why.
    _chosen: tuple[str, str] = ("direct", "")
    _on_forecast: Callable[[Mapping[str, Any]], object] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # The arguments, not the factor, which may be a hundred times as large:
        # condensing again gives the same bits.
        made = {"_condensed", "_iterative", "_parts", "_again", "_on_forecast"}
        known = {name: value for name, value in vars(self).items() if name not in made}
        return known | {"_stiffness": self._matrix()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        parts = state.pop("_stiffness")
        vars(self).update(state)
        self._prepare(parts, None)

    def _matrix(self) -> Parts:
        """K, which the core has once it is condensed."""
        if self._parts is not None:
            return self._parts
        if self._again is not None:
            return csr("K", self._again()).parts
        return self._core.stiffness()

    def _release(self, again: Callable[[], Any]) -> bool:
        """Drop K if the iterative engine will solve; ``again`` makes it once more."""
        if self._iterative is None or self._chosen[0] != "iterative":
            return False
        self._parts, self._again = None, again
        return True

    def _with_digits(self, stiffness: Csr) -> tuple[Csr, Known | None]:
        """K with its rigid motions restored, and how far they were off."""
        if self._digits is None:
            return stiffness, None
        from scipy.sparse import csr_array

        parts, off = self._digits.restore(stiffness)
        matrix = csr_array(parts[::-1], shape=stiffness.shape)
        return Csr(matrix, stiffness.shape, parts), Known(self._digits, off)

    def _prepare(
        self,
        parts: Parts,
        before: _core.Condensed | None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
    ) -> None:
        """Condense, or make the iterative engine and leave the choice to the load path."""
        iterative = self._make_iterative(parts)
        if iterative is None:
            self._condense(parts, before, on_forecast)
            self._iterative = None
            return
        self._condensed, self._iterative, self._parts = None, iterative, parts
        self._again = None
        self._on_forecast = on_forecast
        if self._asked == "iterative":
            self._chosen = "iterative", "it was asked for"
            self._tell_iterative()
        elif self._steps is not None:
            self._engine(self._steps, "auto")

    def _condense(
        self,
        parts: Parts,
        before: _core.Condensed | None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
    ) -> None:
        started = time.perf_counter()
        told = on_forecast
        if on_forecast is not None:
            name, why = self._chosen

            def told(counts: Mapping[str, Any]) -> None:
                on_forecast({**counts, "engine": name, "engine_reason": why})

        try:
            self._condensed = _core.Condensed(parts, *self._given, before, told)
        except (FloatingBodyError, ValueError) as error:
            dof = getattr(error, "dof", None)
            cause = ""
            if isinstance(error, ValueError):
                cause = one_triangle(parts) or enforced(parts)
            if cause:
                raise ValueError(f"{error}{cause}") from None
            if dof is None:
                raise
            said = str(error) + self._of_digits(error, parts, dof)
            if self._bodies is not None:
                said = f"{body_of(dof, self._bodies)}: {said}"
            elif said == str(error):
                raise
            named = type(error)(said)
            if isinstance(named, FloatingBodyError):
                named.dof = dof
            raise named from None
        self._seconds = time.perf_counter() - started
        self._parts = self._again = None

    def _make_iterative(self, parts: Parts) -> Iterative | None:
        """The iterative engine, if it is wanted and can solve the problem."""
        n, contacts, d = self._shape
        given = self._given
        free = n - len(self._fixed)
        if self._asked == "direct":
            self._chosen = "direct", "it was asked for"
            return None
        if self._asked == "auto":
            why = ""
            if d == 2:
                why = "the problem is plane"
            elif free < choice.LEAST:
                why = f"{free} free degrees of freedom are few"
            elif given.loads is not None or given.working_set is not None:
                why = "loads or working_set is given"
            elif self._digits is not None:
                why = "stiffness_rtol is given"
            if why:
                self._chosen = "direct", why
                return None
        from bipot_rs.contact.path.iterative import Iterative
        from bipot_rs.contact.path.loose import Loose

        started = time.perf_counter()
        loose = Loose.of(parts, self._fixed, given.num_threads)
        try:
            core = _core.Primal(loose.stiffened(parts), *given[:6])
        except NotIterativeError as error:
            if self._asked == "iterative":
                raise
            self._chosen = "direct", str(error.reason)
            return None
        except ValueError as error:
            cause = one_triangle(parts) or enforced(parts)
            raise ValueError(f"{error}{cause}") from None
        self._seconds = time.perf_counter() - started
        self._chosen = "auto", "the first load path decides"
        return Iterative(core, self._direct, (contacts, d), loose=loose)

    def _direct(self) -> Direct:
        """The direct engine; condenses if that was not done before."""
        if self._condensed is None:
            if self._parts is None and self._again is None:
                raise ValueError("the stiffness of this problem is not available")
            self._condense(self._matrix(), None, self._on_forecast)
        if self._condensed is None:
            raise ValueError("the stiffness of this problem is not available")
        return Direct(self._condensed)

    @property
    def _core(self) -> _core.Condensed:
        """The condensed problem, for what needs the compliance ``W``."""
        if self._condensed is None and self._asked == "iterative":
            raise ValueError(
                "this needs the compliance W, which engine='iterative' does not form: "
                "use engine='direct'"
            )
        return self._direct().core

    def _engine(self, steps: int, method: str) -> Engine:
        """The engine of a load path."""
        iterative = self._iterative
        if iterative is None:
            return self._direct()
        if method not in choice.METHODS:
            if self._asked == "iterative":
                choice.check_method(method, self._asked)
            return self._direct()
        if self._asked == "auto" and self._condensed is None:
            limit = self._given.memory_limit
            free = self._shape[0] - len(self._fixed)
            self._chosen = choice.choose(
                free,
                self._shape[1],
                steps,
                available() if limit is None else limit,
            )
            if self._chosen[0] == "iterative":
                self._tell_iterative()
        if self._condensed is not None or self._chosen[0] == "direct":
            self._iterative = None
            self._chosen = "direct", self._chosen[1]
            return self._direct()
        return iterative

    def _tell_iterative(self) -> None:
        """Call ``on_forecast`` with the counts of the iterative engine, once."""
        told, self._on_forecast = self._on_forecast, None
        iterative = self._iterative
        if told is None or iterative is None:
            return
        n, contacts, d = self._shape
        counts = iterative.stats
        told(
            {
                "engine": "iterative",
                "engine_reason": self._chosen[1],
                "bodies": None,
                "n_contact_dofs": d * contacts,
                "nnz_factor": 0,
                "flops": choice.STEP_FLOPS * n * (self._steps or 1),
                "bytes_factor": 0,
                "bytes_peak": counts["bytes_stiffness"] + counts["bytes_forecast"],
                "ordering": None,
            }
        )

    def _of_digits(self, error: Exception, parts: Parts, dof: int) -> str:
        """Text to add to an error of the core if few digits of K may be its cause."""
        from bipot_rs.contact.stiffness.digits import OFFER, said_of_indefinite

        kind = getattr(error, "kind", "")
        if kind == "indefinite":
            return said_of_indefinite(parts, self._fixed, dof, self._digits)
        few = kind == "few_digits" and self._digits is None
        return OFFER if few else ""
