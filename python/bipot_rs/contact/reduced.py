"""`ReducedProblem`: a contact problem whose only unknowns are the reactions."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib import validation
from bipot_rs._lib.messages import count_noun, size
from bipot_rs._lib.types import CsrMatrix, Floats, MatrixLike, OpenRecord
from bipot_rs._lib.validation import (
    csr,
    floats,
    integer,
    positive,
    settings,
    threads,
    vectors,
)
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import (
    FloatingBodyError,
    NoEquilibriumError,
    NotConvergedError,
)
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.messages import rigid_motion_names as rigid_motions
from bipot_rs.contact.proof.equilibrium import describe_friction, name_friction
from bipot_rs.contact.results import summary
from bipot_rs.contact.results.error_bound import ErrorBound, read_error_bound
from bipot_rs.contact.results.solution import Solution, find_opening, make_solution

# Most problems are only solved: methods for anything else import what they need.
if TYPE_CHECKING:
    from bipot_rs.contact.proof.equilibrium import Equilibrium, LimitMultiplier
    from bipot_rs.contact.proof.existence import Answers, Existence
    from bipot_rs.contact.proof.reaction_range import ReactionRange
    from bipot_rs.contact.sensitivity.reduced import ReducedModel

# Iterations of each solve of a search for the largest multiplier.
_CLIMB = 300
# A residual that most problems reach; the limit is rounding if that is larger.
_TIGHT = 1e-14


class ReducedProblem:
    """A contact problem whose only unknowns are the reactions, ``v = W r + q`` (5).

    Parameters
    ----------
    W
        Compliance, ``(d n_c, d n_c)``, dense or sparse. It is used as given and not made
        symmetric; see ``asymmetry``. A C-ordered array of float64 is not copied, and every
        call reads it.
    q
        Relative displacement without reactions, ``(n_c, d)``, normal first.
    mu
        Friction coefficient, a number or ``(n_c,)``; in space also ``(n_c, 2)``, as in
        `ContactProblem`. With two coefficients the problem is solved in scaled variables,
        in which friction is isotropic, and every call copies ``W``.
    rigid
        ``(R (d n_c, k), e (k,))`` for bodies held by contact alone:
        ``v = W r + R a + q`` with ``Rᵀ r + e = 0``; ``R`` is dense or sparse.
    cohesion
        Cohesion ``c``, a force, a number or ``(n_c,)``: ``|r_t| <= c + mu r_n``. A contact
        keeps it when it opens.
    dilatancy
        Dilatancy ``beta``, a number or ``(n_c,)``, from zero to ``mu``: ``v_n >= beta |v_t|``.

    Raises
    ------
    NoEquilibriumError
        A contact penetrates and no reaction can move it.
    FloatingBodyError
        A column of ``R`` moves no contact.

    Examples
    --------
    One contact, which without reactions penetrates by 1 and slips by 0.75:

    >>> import bipot_rs as bp
    >>> problem = bp.ReducedProblem([[2.0, 0.0], [0.0, 1.0]], [[-1.0, 0.75]], 0.5)
    >>> solution = problem.solve()
    >>> solution.reaction
    array([[ 0.5 , -0.25]])
    >>> solution.relative_displacement.round(12)
    array([[0. , 0.5]])
    >>> solution.outcome.value, solution.unique
    ('converged', 'proved')
    """

    def __init__(
        self,
        W: MatrixLike,
        q: ArrayLike,
        mu: ArrayLike,
        *,
        rigid: tuple[MatrixLike, ArrayLike] | None = None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> None:
        free = vectors("q", q)
        contacts, d = free.shape
        size = contacts * d
        parts = _find_islands(W, contacts, d)
        if rigid is None:
            border: Floats | CsrMatrix = np.empty((size, 0))
            force = np.empty(0)
        else:
            given: Any = rigid
            if not isinstance(given, tuple | list) or len(given) != 2:
                raise TypeError(
                    f"rigid is {validation.show_value(rigid)}, expected the pair (R, e)"
                )
            border = _check_motions(rigid[0])
            if border.shape[0] != size:
                raise ValueError(
                    f"R of rigid has shape {border.shape}, expected ({size}, k)"
                )
            force = floats("e of rigid", rigid[1], shape=(border.shape[1],))
        # As it was given.
        self.W: Any = W
        self.q = free
        self.law = ContactLaw.check(
            contacts, d, mu=mu, cohesion=cohesion, dilatancy=dilatancy
        )
        self.rigid: tuple[Any, Floats] | None = (
            None if rigid is None else (border, force)
        )
        self._parts = parts
        _ = self._problem  # the checks that only the core makes

    def __reduce__(self) -> tuple[object, ...]:
        keywords: OpenRecord = {"rigid": self.rigid, **self.law.without_mu()}
        return partial(ReducedProblem, **keywords), (self.W, self.q, self.mu)

    def __repr__(self) -> str:
        return f"ReducedProblem({summary.describe_places(*self.q.shape)})"

    def __str__(self) -> str:
        return summary.format_text(self._summary())

    def _repr_html_(self) -> str:
        return summary.format_html(self._summary())

    def _summary(self) -> summary.Summary:
        rows = self.q.size
        W = f"{rows} x {rows}, "
        if hasattr(self.W, "tocsr"):
            W += f"sparse, {count_noun(self.W.nnz, 'entry')}"
        else:
            W += f"dense, {size(8.0 * rows**2)}"
        held = count_noun(self._motions, "motion") if self._motions else "none"
        return f"{type(self).__name__}: {summary.describe_places(*self.q.shape)}", [
            ("W", W),
            ("q", summary.describe_gaps(self.q[:, 0])),
            ("friction", summary.describe_friction(self.mu)),
            *summary.describe_law(self.law),
            ("rigid motions", f"{held} held by contact alone"),
        ]

    @cached_property
    def _problem(self) -> _core.Reduced:
        """The problem in the core."""
        force = np.empty(0) if self.rigid is None else self.rigid[1]
        rows, columns = self.q.size, len(force)
        if columns == 0:
            modes = _NO_MODES
        elif isinstance(self._R, np.ndarray):
            starts = np.arange(0, rows * columns + 1, columns)
            modes = starts, np.tile(np.arange(columns), rows), self._R.ravel()
        else:
            from bipot_rs.contact.proof.equilibrium import csr_parts

            modes = csr_parts(self._R)
        return _core.Reduced(self._parts, self.q, self.law, modes, force)

    @property
    def _R(self) -> Any:
        """``R (d n_c, k)``, dense or sparse; without columns if no motion is rigid."""
        return np.zeros((self.q.size, 0)) if self.rigid is None else self.rigid[0]

    @cached_property
    def _statics(self) -> _core.Statics:
        from bipot_rs.contact.proof.equilibrium import make_statics

        return make_statics(self._R, self.law, *self.q.shape)

    @property
    def mu(self) -> Floats:
        """Friction coefficients, ``(n_c,)`` or ``(n_c, 2)``."""
        return self.law.mu

    @property
    def cohesion(self) -> Floats | None:
        """Cohesion, ``(n_c,)``; ``None`` if it is zero at all contacts."""
        return self.law.cohesion

    @property
    def dilatancy(self) -> Floats | None:
        """Dilatancy, ``(n_c,)``; ``None`` if it is zero at all contacts."""
        return self.law.dilatancy

    @property
    def asymmetry(self) -> float:
        """Largest ``|W_ij - W_ji|`` over the largest entry of ``W``.

        `fclib.GlobalProblem.asymmetry` is relative to ``√|M_ii M_jj|`` instead, because the
        unknowns of a body may have different units.
        """
        return self._problem.asymmetry

    @property
    def _motions(self) -> int:
        """Number of rigid motions."""
        return 0 if self.rigid is None else len(self.rigid[1])

    def residual(self, r: ArrayLike, a: ArrayLike | None = None) -> float:
        """Residual η of (13) at the reactions ``r (n_c, d)``, the same for all methods.

        If there are rigid motions and ``a (k,)`` is not given, which it must be with cohesion
        or dilatancy, η is the least over all ``a``: of a solution at most ten times that with
        its own ``a``, to rounding. If ``mu`` is ``(n_c, 2)``, η is that of the scaled variables
        of section 3 of ``docs/theory.md``.
        """
        reaction = floats("r", r, shape=self.q.shape)
        rigid = None if a is None else floats("a", a, shape=(self._motions,))
        if rigid is None and self._motions:
            self.law.require_coulomb("residual without a")
        return self._problem.residual(reaction, rigid)

    def error_bound(self, r: ArrayLike) -> ErrorBound:
        """Guaranteed bound of the error of reactions ``r (n_c, d)``.

        ``r`` may lie outside its cones; ``v`` is ``W r + q``.
        """
        return self.error_bounds(floats("r", r, shape=self.q.shape)[None])[0]

    def error_bounds(self, reactions: ArrayLike) -> list[ErrorBound]:
        """`error_bound` of many reactions ``(k, n_c, d)``, with one factorisation."""
        points = floats("reactions", reactions, ndim=3)
        if points.shape[1:] != self.q.shape:
            raise ValueError(
                f"reactions has shape {points.shape}, expected (k, *{self.q.shape})"
            )
        rigid = np.zeros(self._motions)
        rows = points.reshape(-1, self.q.shape[1])
        bounds = self._problem.error_bounds(rows, len(points), rigid)
        return [read_error_bound(bound) for bound in bounds]

    def solve(
        self,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Solution | ArrayLike | None = None,
        *,
        num_threads: int | None = None,
        callback: Callable[[int, float, float], object] | None = None,
    ) -> Solution:
        """Solve, and return how the solve ended in `Solution.outcome`.

        Parameters
        ----------
        method, tol, max_iterations, max_seconds
            As in `ContactProblem.solve`.
        start
            A `Solution`, or reactions ``(n_c, d)``, to start from.
        num_threads
            As in `ContactProblem`.
        callback
            Called as ``callback(iterations, work, residual)`` about 20 times per second,
            with the smallest residual so far (infinite before the first one). If it raises
            an exception, the solve ends with this exception.
        """
        chosen = settings(method, tol, max_iterations, max_seconds)
        if callback is not None:
            validation.callback("callback", callback)
        reaction, rigid = None, None
        if start is None:
            pass
        elif isinstance(start, Solution):
            reaction = floats("start", start.reaction, shape=self.q.shape)
            rigid = start.rigid_motion
            if rigid is not None and len(rigid) != self._motions:
                raise ValueError(
                    f"start has {count_noun(len(rigid), 'rigid motion')}, expected "
                    f"{self._motions}"
                )
        else:
            reaction = floats("start", start, shape=self.q.shape)
        if num_threads is not None:
            num_threads = threads(num_threads)
        core = self._problem.solve(chosen, reaction, rigid, num_threads, callback)
        return self._complete(core, chosen)

    def answers(self, *, restarts: int = 40, seed: int = 0) -> Answers:
        """Find all solutions of a problem that may have several.

        In the plane with up to 12 contacts all combinations of statuses are tried. This
        finds every solution, or proves that there is none, and `Answers.complete` is true.
        Other problems are solved from many starts, and solutions with different relative
        displacements are returned; `Answers.complete` is then false. It is also false if
        reactions are not determined (redundant supports).

        Parameters
        ----------
        restarts
            Number of starts, if not all combinations are tried.
        seed
            Seed of the random starts.
        """
        from bipot_rs.contact.proof.existence import Answers, search_answers

        restarts = positive("restarts", restarts)
        seed = integer("seed", seed, least=0)
        if not len(self.q):
            return Answers([self.solve()], complete=True)
        exhausted = self._problem.answers()
        if exhausted is not None:
            cores, complete = exhausted
            chosen = settings("auto", 1e-10, None, None)
            solutions = [self._complete(core, chosen) for core in cores]
            return Answers(solutions, complete=complete)
        contacts, d = self.q.shape
        whole = self.W if hasattr(self.W, "diagonal") else np.asarray(self.W)
        diagonal = np.asarray(whole.diagonal(), float).reshape(contacts, d).mean(axis=1)
        moved = np.linalg.norm(self.q, axis=1)
        # The reaction that moves a contact by its own q.
        size = np.divide(moved, diagonal, where=diagonal > 0, out=np.zeros(contacts))
        if self.rigid is not None:
            size += np.abs(self.rigid[1]).max(initial=0.0) / contacts
        return search_answers(
            lambda start: self.solve(tol=1e-12, max_iterations=1000, start=start),
            size,
            self.mu,
            d,
            restarts,
            seed,
            0.0 if self.rigid is not None else float(np.abs(self.q).max(initial=0.0)),
        )

    def reaction_range(
        self, contact: int, component: int = 0, *, solution: Solution | None = None
    ) -> ReactionRange:
        """Least and largest value of a reaction over all answers with the same ``v``.

        With redundant supports, or rigid bodies on many contacts, reactions are not
        determined by the loads. Section 18 of ``docs/theory.md`` defines the answers.

        Parameters
        ----------
        contact
            Number of the contact.
        component
            0 for the normal component, 1 or 2 for a tangential one.
        solution
            A solution of this problem, whose relative displacement is kept. Default: one
            solved to rounding. Bounds are as exact as the slip in the solution.

        Raises
        ------
        NotConvergedError, NoEquilibriumError
            There is no solution to start from; or a bound was not found to 1e-3.

        Examples
        --------
        A rigid beam on three supports, pressed by 1 above the middle one, which carries
        all or nothing:

        >>> import bipot_rs as bp
        >>> legs = [[1, -1], [0, 0], [1, 0], [0, 0], [1, 1], [0, 0]]
        >>> beam = bp.ReducedProblem(
        ...     [[0.0] * 6] * 6, [[0.0, 0.0]] * 3, 0.0, rigid=(legs, [-1.0, 0.0])
        ... )
        >>> middle = beam.reaction_range(1)
        >>> round(middle.least, 12), round(middle.largest, 12)
        (0.0, 1.0)
        """
        if not len(self.q):
            raise ValueError(f"contact is {contact}, but the problem has no contacts")
        contact = integer("contact", contact, least=0, most=len(self.q) - 1)
        return self._ranges([contact], component, solution)[0]

    def reaction_ranges(
        self, component: int = 0, *, solution: Solution | None = None
    ) -> list[ReactionRange]:
        """`reaction_range` of all contacts, with one null space.

        Raises
        ------
        TypeError, ValueError, NotConvergedError, NoEquilibriumError
            As `reaction_range`.
        """
        return self._ranges(list(range(len(self.q))), component, solution)

    def _ranges(
        self, contacts: list[int], component: int, solution: Solution | None
    ) -> list[ReactionRange]:
        from bipot_rs.contact.proof.reaction_range import find_ranges

        component = integer("component", component, least=0, most=self.q.shape[1] - 1)
        self.law.require_coulomb("reaction_range")
        if solution is None:
            # Slip to rounding, if it can be had: it decides which reactions are answers.
            solution = self.solve(tol=_TIGHT)
            if not solution.converged:
                solution = self.solve()
            if solution.outcome is Outcome.NO_EQUILIBRIUM:
                raise NoEquilibriumError(solution.message)
            if not solution.converged:
                raise NotConvergedError(solution.message)
        elif not isinstance(solution, Solution):
            raise TypeError(
                f"solution is a {type(solution).__name__}, expected a Solution"
            )
        elif not solution.converged:
            raise ValueError(
                "solution did not converge, and its slip does not tell which reactions "
                "are answers: solve with a larger max_iterations or another method"
            )
        else:
            reaction = floats("solution", solution.reaction, shape=self.q.shape)
            eta = self.residual(reaction, solution.rigid_motion)
            if eta > 10 * max(solution.tolerance, solution.residual):
                raise ValueError(
                    f"solution has the residual {eta:.1e} in this problem: pass a solution of "
                    "this problem, or leave it out"
                )
        if not contacts:
            return []
        return find_ranges(
            self.W, self.q, self.mu, self.rigid, solution, contacts, component
        )

    def equilibrium(self, *, max_seconds: float | None = None) -> Equilibrium:
        """Whether reactions in their cones balance the loads on the rigid motions.

        One cone programme decides it, with a proof, at any size. The compliance and the free
        displacement do not matter. Without them (``W = 0``, ``q = 0``) the reactions are a
        solution, with ``v = 0``; with them, balanced reactions are necessary for one.

        Parameters
        ----------
        max_seconds
            Limit of time of each of the programmes; after it the verdict is
            ``"undecided"``.

        Examples
        --------
        A block on a plane with friction 0.5, pulled to the side by 0.4 of its weight:

        >>> import bipot_rs as bp
        >>> corners = [[1, 0, -1], [0, 1, 1], [1, 0, 1], [0, 1, 1]]
        >>> W, q = [[0.0] * 4] * 4, [[0.0, 0.0]] * 2
        >>> block = bp.ReducedProblem(W, q, 0.5, rigid=(corners, [-1.0, 0.4, 0.0]))
        >>> block.equilibrium().verdict
        'balanced'
        >>> round(block.limit_multiplier([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]).upper, 6)
        0.5
        """
        from bipot_rs.contact.proof.equilibrium import Equilibrium, read_decision

        max_seconds = settings("auto", 1e-10, None, max_seconds).max_seconds
        if self.rigid is None or not self._motions:
            return Equilibrium(
                verdict="balanced",
                reason="no rigid motion has to be balanced",
                margin=np.inf,
                reaction=np.zeros(self.q.shape),
            )
        decision = self._statics.decide(self.rigid[1], max_seconds)
        return read_decision(
            decision,
            self.q.shape,
            lambda motion: f"{self._describe_amounts(motion)}, {self._name_friction()}",
        )

    def limit_multiplier(self, e0: ArrayLike, e1: ArrayLike) -> LimitMultiplier:
        """The largest ``λ`` for which contact carries the loads ``e0 + λ e1``.

        Parameters
        ----------
        e0, e1
            Dead and live loads on the rigid motions, ``(k,)``; ``e`` of ``rigid`` is not
            used.

        Raises
        ------
        NoEquilibriumError
            No reactions balance ``e0`` alone.
        NotConvergedError
            Whether reactions balance ``e0`` alone, or whether there is a largest multiplier,
            was not decided.
        """
        from bipot_rs.contact.proof.equilibrium import read_limit

        dead = floats("e0", e0, shape=(self._motions,))
        live = floats("e1", e1, shape=(self._motions,))

        def solve(multiplier: float, start: Solution | None) -> Solution | None:
            loaded = ReducedProblem(
                self.W,
                self.q,
                self.mu,
                rigid=(self._R, dead + multiplier * live),
                **self.law.without_mu(),
            )
            solution = loaded.solve(max_iterations=_CLIMB, start=start)
            return solution if solution.converged else None

        return read_limit(
            self._statics.find_limit(dead, live),
            self.q.shape,
            self._describe_amounts,
            None if self._moves_rigidly() else solve,
        )

    def _moves_rigidly(self) -> bool:
        """Whether only rigid motions displace the contacts, ``W = 0`` and ``q = 0``."""
        W = self.W.data if hasattr(self.W, "tocsr") else np.asarray(self.W)
        return not self.q.any() and not np.any(W)

    def _move_contacts(self, amounts: Floats) -> Floats:
        """Displacement of each contact ``(n_c, d)``, the largest of length 1."""
        return rigid_motions.move_contacts(self._R.T, amounts, self.q.shape[1])

    def _describe_amounts(self, amounts: Floats) -> str:
        """Amounts of the rigid motions in words."""
        return self._describe_motion(amounts, self._move_contacts(amounts), self.mu)

    def _name_friction(self) -> str:
        """The friction, and which one could balance the loads, which this one cannot."""
        if self.rigid is None:
            return name_friction(self.mu)
        return describe_friction(self._R, self.rigid[1], self.law, self.q.shape[1])

    def existence(self, *, exhaust: bool = False) -> Existence:
        """Whether a solution exists, as far as this can be proved without solving.

        The conditions are those of section 10 of ``docs/theory.md``. ``"guaranteed"``: a
        possible displacement lies inside every dual cone, and normal reactions alone can
        balance the loads on rigid motions, or friction of contacts in one plane holds a
        body against translation for any distribution of pressure. ``"none"``: no reaction
        in the cones can balance the loads, or contacts contradict each other.
        ``"unknown"``: for example if friction is needed to balance the loads.

        Parameters
        ----------
        exhaust
            Whether to try all combinations of statuses, as `answers` does, if the
            conditions decide nothing: in the plane, with up to 12 contacts.
        """
        from scipy.sparse import csr_array, diags_array

        from bipot_rs.contact.proof.existence import Existence, judge_existence

        validation.logical("exhaust", exhaust)
        # In components scaled by these factors, friction is isotropic.
        by, mu = _core.isotropic(self.mu, self.q.shape[1])
        scaling = diags_array(by.ravel())
        rigid = self.rigid
        if rigid is not None and len(rigid[1]):
            statics = self.equilibrium()
            if statics.motion is not None:
                return Existence(
                    verdict="none",
                    reason=statics.reason,
                    motion=self._move_contacts(statics.motion),
                )
            if self._moves_rigidly():
                # Without compliance, what balances the loads is a solution.
                balanced = statics.verdict == "balanced"
                return Existence(
                    verdict="guaranteed" if balanced else "unknown",
                    reason=statics.reason,
                )
            rigid = scaling @ csr_array(self._R), rigid[1]
        W = scaling @ csr_array(self.W) @ scaling
        existence = judge_existence(self._problem, W, by * self.q, mu, rigid, self.law)
        existence = replace(
            existence,
            motion=None if existence.motion is None else existence.motion / by,
            inside=None if existence.inside is None else existence.inside / by,
        )
        if existence.verdict == "unknown" and exhaust:
            tried = self._problem.answers()
            if tried is not None and (len(tried[0]) or tried[1]):
                some = len(tried[0]) > 0
                return Existence(
                    verdict="guaranteed" if some else "none",
                    reason="all combinations of statuses were tried, and "
                    f"{len(tried[0]) or 'none'} satisfied the contact law",
                )
        return existence

    def _describe_motion(self, amounts: Floats, direction: Floats, mu: Floats) -> str:  # noqa: ARG002
        """Describe ``R a``, whose displacements of the contacts are ``direction``."""
        return rigid_motions.describe_motion(direction, mu)

    def _model(self) -> ReducedModel:
        """The data of this problem, for derivatives."""
        from bipot_rs.contact.sensitivity.reduced import ReducedModel

        W = self.W if hasattr(self.W, "tocsr") else np.asarray(self.W)
        return ReducedModel(self._problem, W, self.law, self._R)

    def _has_several(self, solution: Solution) -> bool:
        exhausted = self._problem.answers()
        if exhausted is not None and len(exhausted[0]) > 1:
            return True
        near = solution.residual <= tuning.NEAR_SOLUTION
        return near and self._problem.assess(solution.reaction) == "others exist"

    def _complete(
        self, core: _core.ReducedSolution, settings: _core.Settings
    ) -> Solution:
        """The solution with this problem, for what is computed on first use."""
        words = ""
        if self.rigid is not None and core.free_motion is not None:
            direction = self._move_contacts(core.free_motion)
            opening = find_opening(core.outcome, self.mu)
            words = self._describe_motion(core.free_motion, direction, opening)
            none = core.outcome == Outcome.NO_EQUILIBRIUM
            words += f", {self._name_friction() if none else name_friction(self.mu)}"
        # As `_ReducedInquiry(...)`, whose own `__new__` takes twice as long.
        inquiry = tuple.__new__(_ReducedInquiry, (self, settings))
        return make_solution(core, inquiry, words)


class _ReducedInquiry(NamedTuple):
    """A reduced problem and a solve, for what is computed of its solution on use."""

    problem: ReducedProblem
    settings: _core.Settings

    @property
    def core(self) -> _core.Reduced:
        return self.problem._problem

    def unique(self, solution: Solution, /) -> str:
        return self.core.assess(solution.reaction)

    def error_estimate(self, solution: Solution, /) -> tuple[float, float] | None:
        amounts = solution.rigid_motion
        rigid = np.empty(0) if amounts is None else amounts
        return self.core.forward_errors(solution.reaction, rigid)

    def error(self, solution: Solution, /) -> ErrorBound:
        amounts = solution.rigid_motion
        rigid = np.empty(0) if amounts is None else amounts
        reported = solution.relative_displacement
        (bound,) = self.core.error_bounds(solution.reaction, 1, rigid, reported)
        return read_error_bound(bound)

    def diagnosis(self, solution: Solution, /) -> str:
        from bipot_rs.contact.messages.diagnosis import FailedSolve, diagnose
        from bipot_rs.contact.proof.existence import make_dense

        problem = self.problem
        tried = FailedSolve(
            settings=self.settings,
            law=problem.law,
            W=lambda: make_dense(problem.W),
            modes=lambda: make_dense(problem._R),
            loads=lambda: np.empty(0) if problem.rigid is None else problem.rigid[1],
            several=problem._has_several,
        )
        return diagnose(tried, solution, solution.relative_displacement)

    def derivatives(self) -> ReducedModel:
        return self.problem._model()


def _check_motions(R: MatrixLike) -> Floats | CsrMatrix:
    """``R`` of rigid, with its numbers checked."""
    if not hasattr(R, "tocsr"):
        return floats("R of rigid", R, ndim=2)
    from scipy.sparse import csr_array

    sparse: CsrMatrix = csr_array(csr("R of rigid", R).matrix, dtype=np.float64)
    still = np.flatnonzero(abs(sparse).sum(axis=0) == 0)
    if len(still):
        raise FloatingBodyError(
            f"rigid motion {still[0]} moves no contact, so that nothing holds it: leave its "
            "column out of R"
        )
    return sparse


_Part = tuple[list[int], Floats, tuple[list[int], list[int]] | None]

# `R` without columns: made once, because a problem of few contacts takes microseconds.
_NO_MODES = np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0)


def _find_islands(W: MatrixLike, contacts: int, d: int) -> list[_Part]:
    """Contacts, values and, if sparse, the pattern of each independent block of ``W``."""
    size = contacts * d
    if not hasattr(W, "tocsr"):
        dense = floats("W", W, ndim=2, finite=False, copy=False)
        if dense.shape != (size, size):
            raise ValueError(f"W has shape {dense.shape}, expected {(size, size)}")
        return [(list(range(contacts)), dense.ravel(), None)] if contacts else []
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    sparse = csr("W", W)
    if sparse.shape != (size, size):
        raise ValueError(f"W has shape {sparse.shape}, expected {(size, size)}")
    whole = sparse.matrix
    entries = coo_array(whole)
    row, column = entries.row // d, entries.col // d
    graph = coo_array((np.ones(entries.nnz), (row, column)), (contacts, contacts))
    graph = graph.tocsr()
    count, label = connected_components(graph, directed=False)
    blocks = np.bincount(label, weights=np.diff(graph.indptr), minlength=count)
    order = np.argsort(label, kind="stable")
    bounds = np.searchsorted(label[order], np.arange(count + 1))
    place = np.empty(contacts, int)
    place[order] = np.arange(contacts) - bounds[label[order]]
    # Entries sorted by island: each slice of W itself would read all of it.
    sorted_by = np.argsort(label[row], kind="stable")
    starts = np.searchsorted(label[row][sorted_by], np.arange(count + 1))
    values = entries.data[sorted_by].astype(np.float64)
    i = (d * place[row] + entries.row % d)[sorted_by]
    j = (d * place[column] + entries.col % d)[sorted_by]
    parts: list[_Part] = []
    for k, (begin, end) in enumerate(itertools.pairwise(bounds.tolist())):
        names, members = order[begin:end].tolist(), slice(starts[k], starts[k + 1])
        n = end - begin
        if _core.is_sparse(int(blocks[k]), n):
            block = coo_array(
                (values[members], (i[members], j[members])), (d * n, d * n)
            )
            stored = block.tobsr(blocksize=(d, d))
            pattern = stored.indptr.tolist(), stored.indices.tolist()
            parts.append((names, np.ascontiguousarray(stored.data).ravel(), pattern))
        else:
            dense = np.zeros((d * n, d * n))
            dense[i[members], j[members]] = values[members]
            parts.append((names, dense.ravel(), None))
    return parts
