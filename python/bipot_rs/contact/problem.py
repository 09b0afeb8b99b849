"""The problem: bodies, contacts and supports, condensed once, and its load paths."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs import _core
from bipot_rs._lib.messages import body_of, counted
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import (
    RATIO,
    Csr,
    Parts,
    Settings,
    areas,
    by_component,
    callback,
    choice_of_dimension,
    contact_array,
    csr,
    enforced,
    floats,
    frames,
    friction,
    indices,
    integer,
    matrices,
    one_triangle,
    places,
    settings,
    threads,
)
from bipot_rs.contact import dof_order, remarks, summary
from bipot_rs.contact import rigid_motions as motion
from bipot_rs.contact.errors import FloatingBodyError, NoEquilibriumError
from bipot_rs.contact.existence import Existence
from bipot_rs.contact.load_path import Following, Known, state
from bipot_rs.contact.load_steps import Held, Loading, Totals, check_case
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.result import Result
from bipot_rs.contact.solution import Step
from bipot_rs.contact.step_control import follow, increments

if TYPE_CHECKING:
    from bipot_rs.contact.stiffness_digits import Digits


class _Given(NamedTuple):
    """What `_core.Condensed` takes of a problem after the stiffness, in its order."""

    contact: Parts
    gap: Floats
    mu: Floats
    fixed: Ints
    num_threads: int | None
    coordinates: Floats | None
    loads: Any
    memory_limit: int | None
    working_set: bool | None


class ContactProblem:
    """Bodies, contacts and supports, condensed onto the contact set once.

    ``K u = f + Bᵀ r``, ``v = B u + gap``, and Signorini's and Coulomb's laws between
    ``v`` and ``r`` at every contact: equations (1), (2) and (9).

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``, symmetric positive semidefinite: anything SciPy calls
        sparse, or dense; of both triangles, which mirror each other, the lower is read.
    B
        Contact operator, ``(d n_c, n)``: row ``d i + k`` is component ``k`` of contact
        ``i``, normal first, so that ``B u + gap`` is the relative displacement and
        ``Bᵀ r`` the force on the bodies.
    gap
        Normal gap, ``(n_c,)``, open when positive, or ``(n_c, d)`` to offset every
        component.
    mu
        Friction coefficient, a number or ``(n_c,)``; in space also ``(n_c, 2)``, those
        along ``t1`` and ``t2`` of each contact (8e): both zero, or both positive and
        within a factor of 1e6 of each other.
    fixed
        Prescribed degrees of freedom, integers.
    area
        Tributary areas, ``(n_c,)``, for tractions.
    dim
        Dimension, 2 or 3; needed only without contacts.
    num_threads
        Threads, 1024 at the most; default ``BIPOT_NUM_THREADS``, ``RAYON_NUM_THREADS``,
        or all cores.
    points
        Places of the contacts, ``(n_c, d)``, for results and files.
    frame
        Local bases ``(n_c, d, d)``, rows ``n, t1[, t2]``, for results and files:
        unit vectors at right angles, to 1e-6, of either hand.
    coordinates
        Where each degree of freedom is, ``(n, 2)`` or ``(n, 3)``, in any unit: a second
        elimination order is then tried, and the one of fewer operations taken. Rigid
        motions are then known exactly. Degrees of freedom may be ordered by nodes,
        ``numpy.repeat(nodes, d, axis=0)``, or by components, ``numpy.tile(nodes, (d, 1))``.
    loads
        All loads there will be, where no displacement will be asked for: ``load`` of
        `solve`, or the tuple ``(load, prescribed)``. The factor of ``K`` is then not
        kept, only what the loads do at the contacts; `solve` without loads takes
        these. Bodies that contact alone holds keep their factor, and so do those whose
        ``W`` has lost digits that only ``K`` itself gives back. All contacts are then
        condensed onto, whatever ``working_set`` says.
    memory_limit
        Bytes that the condensation may take; default what the machine has free.
    working_set
        Whether ``W`` is formed only of contacts that may close, growing in each step
        until no other penetrates. Default: where a body has hundreds of candidates,
        and three in four or more are apart at the start.
    gaps
        Gaps of each load step where obstacles move, ``(steps, n_c)`` or
        ``(steps, n_c, d)``: what `solve` takes for its ``gap`` where it is given none.
        ``gap`` itself is that of the start.
    on_forecast
        Called once the order of elimination is known and before any of its numbers,
        with what they will take, a mapping with ``bodies``, ``n_contact_dofs``,
        ``nnz_factor``, ``flops``, ``bytes_factor``, ``bytes_peak`` and ``ordering`` as in
        `stats`. An exception it raises ends the work and comes out here.
    bodies
        Names of the bodies, each with its first degree of freedom, by which messages
        then call them: ``{"upper": 0, "lower": 240}``.
    stiffness_rtol
        Relative error of the entries of ``K``, where another program has written it with
        six to twelve digits: 1e-8 for eight. Its rigid motions, which ``coordinates``
        tell, are then restored exactly, by the least change of its entries;
        ``stats["rigid_motions_off"]`` says how far they were off. Digits beyond are not
        invented: `Solution.error_estimate` and `Result.remarks` count what is missing.

    Raises
    ------
    TypeError, ValueError
        An argument of the wrong kind, shape or value, ``K`` not symmetric or
        indefinite; the message names the argument and the place.
    FloatingBodyError
        The contact set cannot hold a body.
    MemoryError
        The factor or ``W`` does not fit, with the figure, before it is allocated.

    Warns
    -----
    UserWarning
        ``K`` times a rigid motion is not zero in rows without supports, in the order of
        the degrees of freedom that ``coordinates`` show; or the columns of ``B`` are those
        of another order than the rigid translations of ``K``.

    Notes
    -----
    It pickles as what it was made of, and is condensed again, to the same bits, where it
    is read.

    Examples
    --------
    A bar of two springs in line, its left end held, its right end 1 mm in front of a wall.
    Contact components are ``(n, t)``; the wall is to the right, its normal points left:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> K = np.zeros((4, 4))  # u_x, u_y of the middle, then of the right end
    >>> K[::2, ::2] = 1e6 * np.array([[2.0, -1.0], [-1.0, 1.0]])
    >>> K[1::2, 1::2] = 1e6 * np.eye(2)  # something holds it sideways
    >>> B = np.array([[0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    >>> problem = bp.ContactProblem(K, B, gap=[1e-3], mu=0.2)
    >>> push = np.array([0.0, 0.0, 1.0, 0.0])
    >>> result = problem.solve([400.0 * push, 2000.0 * push])
    >>> result.relative_displacement[:, 0, 0].round(9)  # what is left of the gap, m
    array([0.0002, 0.    ])
    >>> result.reaction[:, 0, 0].round(6)  # N
    array([   0., 1500.])
    """

    # Nodes that planes across the axes hold: every load must know of them.
    _held: Held | None = None

    def __init__(
        self,
        K: Any,
        B: Any,
        *,
        gap: ArrayLike,
        mu: ArrayLike,
        fixed: ArrayLike | None = None,
        area: ArrayLike | None = None,
        dim: int | None = None,
        num_threads: int | None = None,
        points: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        coordinates: ArrayLike | None = None,
        loads: ArrayLike | tuple[ArrayLike | None, ArrayLike | None] | None = None,
        memory_limit: int | None = None,
        working_set: bool | None = None,
        gaps: ArrayLike | None = None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
        bodies: Mapping[str, int] | None = None,
        stiffness_rtol: float | None = None,
    ) -> None:
        stiffness, contact = matrices(K, B)
        n = stiffness.shape[0]
        offsets = floats("gap", gap)
        if offsets.ndim not in (1, 2):
            raise ValueError(
                f"gap has shape {offsets.shape}, expected (n_c,) or (n_c, d)"
            )
        contacts = len(offsets)
        d = choice_of_dimension(dim, contacts, contact.shape[0], offsets)
        whole = by_component(offsets, d) if offsets.ndim == 1 else offsets
        if num_threads is not None:
            num_threads = threads(num_threads)
        bases = frames(frame, contacts, d)
        coefficients = friction(mu, contacts, d, ratio=RATIO)
        self._contacts: dict[str, NDArray[Any] | None] = {
            "x": contact_array("points", points, contacts, d),
            "normal": None if bases is None else bases[:, 0, :].copy(),
            "frame": bases,
            "area": areas(area, contacts),
            "gap": offsets,
            "mu": coefficients,
        }
        self._mu = coefficients
        self._fixed = indices("fixed", fixed, n)
        self._shape = (n, contacts, d)
        self._loading = Loading.of(
            n, len(self._fixed), contacts, d, loads, gaps, held=self._held
        )
        self._bodies = _named(bodies, n)
        self._where = _of_components(coordinates, places(coordinates, n), d)
        self._contact = contact
        limit = memory_limit
        if limit is not None:
            limit = integer("memory_limit", memory_limit, least=1, most=2**63 - 1)
        if working_set is not None and not isinstance(working_set, bool):
            raise TypeError(f"working_set is {working_set!r}, expected a bool or None")
        at = places(coordinates, n)
        self._digits: Digits | None = None
        if stiffness_rtol is not None:
            from bipot_rs.contact.stiffness_digits import checked

            self._digits = checked(stiffness_rtol, at, d, self._bodies)
        self._given = _Given(
            contact.parts,
            whole,
            coefficients,
            self._fixed,
            num_threads,
            at,
            self._loading.loads,
            limit,
            working_set,
        )
        callback("on_forecast", on_forecast)
        restored, known = self._with_digits(stiffness)
        self._remarks, self._strength = self._looked_at(restored, whole)
        self._condense(restored.parts, None, on_forecast)
        self._known = known

    @classmethod
    def _on_inclined_supports(
        cls, held: Held | None, K: Any, B: Any, **given: Any
    ) -> ContactProblem:
        """The problem of these arguments, with nodes held by planes across the axes."""
        problem = cls.__new__(cls)
        problem._held = held
        problem.__init__(K, B, **given)  # type: ignore[misc]
        return problem

    def __getstate__(self) -> dict[str, Any]:
        # What it was made of and not what came of it: the factor may be a hundred
        # times as large, and condensing again gives the same bits.
        known = {name: value for name, value in vars(self).items() if name != "_core"}
        return known | {"_stiffness": self._core.stiffness()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        parts = state.pop("_stiffness")
        vars(self).update(state)
        self._condense(parts, None)

    def __repr__(self) -> str:
        n, contacts, d = self._shape
        dofs = counted(n, "degree") + " of freedom"
        return f"ContactProblem({dofs}, {summary.places(contacts, d)})"

    def __str__(self) -> str:
        return summary.text(self._summary())

    def _repr_html_(self) -> str:
        return summary.html(self._summary())

    def _summary(self) -> summary.Summary:
        fixed = len(self._fixed)
        return summary.of_problem(
            self._shape, fixed, self._contacts, self.stats, self._remarks
        )

    @property
    def compliance(self) -> Floats:
        """The compliance ``W`` of (3), dense, ``(d n_c, d n_c)``, of all contacts.

        With bodies held by contact alone it is ``B_c (S + α R Rᵀ)⁻¹ B_cᵀ`` with their
        rigid motions ``R`` and ``α = tr S / m``: the ``W`` of `reduced`.

        Raises
        ------
        MemoryError
            It does not fit; contacts on separate bodies need no dense ``W``.
        """
        return self._core.compliance()

    @property
    def stats(self) -> Mapping[str, Any]:
        """Counts and seconds of the condensation.

        Among them ``n``, ``n_contact_dofs``, ``nnz_factor``, ``flops``, ``bytes_factor``,
        ``bytes_peak`` (foretold), ``cond_S``, ``ordering``, ``working_set`` (how many
        contacts it began with, or ``None``), ``rigid_motions``, and seconds: ``seconds_order``,
        ``seconds_symbolic``, ``seconds_factor``, ``seconds_compliance`` and their whole,
        ``seconds_condense``.

        ``orderings`` is the number of bodies that had to be ordered and analysed: none
        where this process has met their pattern before, in this problem or in another.
        What it has met it keeps within ``BIPOT_PATTERN_CACHE_MB`` megabytes, 64 by
        default; 0 keeps nothing. Results have the same bits either way.

        With ``stiffness_rtol``, ``rigid_motions_off`` is the largest ``|K z|`` of a row,
        ``z`` a rigid motion, over the sum of sizes of its terms, before it was restored.
        """
        known = self._core.stats | {"seconds_condense": self._seconds}
        if self._known is None:
            return known
        return known | {"rigid_motions_off": self._known.off}

    @property
    def rigid_motions(self) -> tuple[str, ...]:
        """In words, the motions that supports leave free and contact alone must hold.

        Directions are the axes ``x, y[, z]`` where ``frame`` is known, else those of the
        contacts, ``n, t1[, t2]``; of bodies without a name a degree of freedom is named
        that moves most.
        """
        contacts, d = self._shape[1:]
        return motion.left_free(
            self._core.modes().reshape(-1, contacts, d),
            self.stats["rigid_motion_bodies"],
            self.stats["rigid_motion_dofs"],
            self._contacts["frame"],
            self._bodies,
        )

    def reduced(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Result | Step | None = None,
        *,
        gap: ArrayLike | None = None,
    ) -> ReducedProblem:
        """The reduced problem (5) of one step, from the unloaded state or from ``start``.

        Its ``W`` is sparse where separate bodies make most of it zero.

        Parameters
        ----------
        load, prescribed
            Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``; missing is zero.
        start
            A `Result` or one of its steps, whose slip history is folded into ``q``.
        gap
            Gaps of the step, ``(n_c,)`` or ``(n_c, d)``; default the ``gap`` of the
            problem.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named.
        NoEquilibriumError
            A contact penetrates and nothing can move it.
        MemoryError
            ``W`` of all contacts does not fit.
        """
        _, contacts, d = self._shape
        loads, core = self._loading.one(load, prescribed), self._core
        if gap is not None:
            core = core.with_gap(self._loading.gap(gap))
        q, modes, force = core.free_part(*loads)
        before = state(start, contacts, d)
        if before is not None:
            q[:, 1:] -= before.relative_displacement[:, 1:]
        rigid = (np.ascontiguousarray(modes.T), force) if len(force) else None
        blocks = self._core.sparse_compliance()
        if blocks is None:
            return ReducedProblem(self.compliance, q, self._mu, rigid=rigid)
        from scipy.sparse import bsr_array

        first, columns, values = blocks
        entries = values.reshape(-1, d, d), columns, first
        W = bsr_array(entries, shape=(d * contacts, d * contacts)).tocsr()
        return ReducedProblem(W, q, self._mu, rigid=rigid)

    def existence(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Result | Step | None = None,
        *,
        exhaust: bool = False,
        gap: ArrayLike | None = None,
    ) -> Existence:
        """Whether one step must have an answer, can have none, or may have either.

        As `ReducedProblem.existence`, with the rigid motion at all degrees of freedom
        besides. It forms ``W`` of all contacts.

        Parameters
        ----------
        load, prescribed, start, gap
            As in `reduced`.
        exhaust
            As in `ReducedProblem.existence`.

        Returns
        -------
        Existence
            Its ``verdict``, the ``reason`` in words, and what witnesses it.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named.
        MemoryError
            ``W`` of all contacts does not fit.

        Examples
        --------
        A point that nothing but a wall holds, pressed and pulled away:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> free = bp.ContactProblem(np.zeros((2, 2)), np.eye(2), gap=[0.0], mu=0.3)
        >>> [free.existence(load).verdict for load in ([-1.0, 0.0], [1.0, 0.0])]
        ['guaranteed', 'none']
        """
        try:
            reduced = self.reduced(load, prescribed, start, gap=gap)
        except NoEquilibriumError as error:
            return Existence(verdict="none", reason=str(error))
        found = reduced.existence(exhaust=exhaust)
        if found.motion is None or reduced.rigid is None:
            return found
        R = reduced.rigid[0]
        fit = np.linalg.lstsq(R, found.motion.ravel(), rcond=None)[0]
        amounts = np.asarray(fit, np.float64)
        n, contacts, d = self._shape
        still = np.zeros(n), np.zeros(len(self._fixed)), np.zeros((contacts, d))
        (moved,) = self._core.displacements([(*still, amounts)])
        return replace(found, displacement=np.asarray(moved, np.float64))

    def solve(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Result | Step | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        gap: ArrayLike | None = None,
    ) -> Result:
        """Follow a load path, step by step, with slip history.

        Parameters
        ----------
        load
            ``(n,)`` or ``(steps, n)``, totals at the end of each step.
        prescribed
            ``(len(fixed),)`` or ``(steps, len(fixed))``; missing is zero. Where one of the
            two has several rows and the other one, the one is repeated.
        method
            ``"auto"``, or one of those it is compared with: ``"newton"``,
            ``"gauss_seidel"``, ``"nesterov"``, ``"uzawa"`` (one projection,
            [dSF91, 79-81]), ``"uzawa_two_projection"`` ([dSF91, 82-87]), and the
            paper's principles: ``"displacement_principle"`` ([dSF91, 68]),
            ``"alternating_principles"`` ([dSF91, 69, 70]), ``"stress_principle"``
            ([dSF91, 72]), ``"minimising_sequence"`` ([dSF91, 31-34]), ``"pivoting"``
            (complementary pivoting, after [dSF91, 75]). The second, fourth and fifth
            need bodies that supports hold, else a `ValueError` says so. Each of them
            may come to a stand where friction is strong.
        tol
            Residual η to reach; rounding may allow no less than `Solution.tolerance`.
        max_iterations, max_seconds
            Limits of one step.
        start
            A `Result` or one of its steps to continue from, to the bits of a path that
            went through. ``load``, ``prescribed`` and ``gap`` are then those of the steps
            to come, totals all the same. What is not given and the problem has of its
            own, its ``gaps`` and ``loads``, goes on behind the steps that ``start`` and
            the paths before it have done; a single step does not tell how many, and is
            refused there.
        on_step
            Called as ``on_step(k, step)`` after each step.
        gap
            Gaps of each step where obstacles move, ``(steps, n_c)`` along the normals
            or ``(steps, n_c, d)`` by component; of one step also ``(n_c,)``; default the
            ``gaps`` of the problem, or else its ``gap`` in all steps. Totals, and as many
            rows as the loads have or one. A
            tangential gap is where the body stands relative to its obstacle at
            ``u = 0``: an obstacle that moves by ``s`` along a tangent makes it ``-s``,
            and ``slip`` counts that motion too.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named.
        NoEquilibriumError
            No answer exists: contacts contradict each other, or the loads on a body
            that contact alone holds lie outside what friction and pressure can carry.
            The message says how the body moves, and ``.direction (n_c, d)`` how each
            contact does: a proof, no reaction works on it and the loads do.
        NotConvergedError
            A step did not converge. ``.result`` of these two holds the steps before.

        Examples
        --------
        A path in two pieces; the second goes on where the first has ended:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> path = np.array([[-10.0, 5.0], [-10.0, 0.0], [-10.0, -5.0]])
        >>> whole = problem.solve(path)
        >>> first = problem.solve(path[:1])
        >>> rest = problem.solve(path[1:], start=first)
        >>> np.array_equal(rest.slip, whole.slip[1:])
        True
        """
        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        following = self._following(self._core, self._mu, chosen, start)
        steps = self._loading.totals(load, prescribed, gap, start)
        for k, asked in enumerate(steps):
            step = following.advance(*asked)
            if on_step is not None:
                on_step(k, step)
        return following.result()

    def follow(
        self,
        load: ArrayLike | Callable[[float], ArrayLike] | None = None,
        prescribed: ArrayLike | Callable[[float], ArrayLike] | None = None,
        *,
        stops: ArrayLike = 1.0,
        first: float | None = None,
        largest: float | None = None,
        smallest: float | None = None,
        slip: float | None = None,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Result | Step | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        gap: Callable[[float], ArrayLike] | None = None,
    ) -> Result:
        """Follow a load path in steps as long as they may be, with slip history.

        A step that has no answer, does not converge or slips too far is halved; after
        one that was not, the next may be twice as long. The answer of each step is, to
        the bit, that of `solve` over the same load points, which ``result.s`` tells.

        Parameters
        ----------
        load, prescribed
            Totals at ``s``, functions that return ``(n,)`` and ``(len(fixed),)``, called
            once for each attempt; or arrays, which grow in proportion to ``s``. Missing
            is zero.
        stops
            Ascending values of ``s`` at which a step must end, such as corners of the
            path; the last is its end.
        first, largest, smallest
            The first step tried, ``largest`` if not given; the longest, if not given the
            whole path; and the shortest, below which the path is given up, if not given
            a thousandth of it.
        slip
            The most that a pressed contact may slip over a step [length].
        method, tol, max_iterations, max_seconds, on_step
            As in `solve`.
        start
            A `Result` of such a path or one of its steps: it goes on where that ended,
            with the steps and the bits it would have had. From a state of another path
            it begins at ``s = 0``.
        gap
            Gaps where obstacles move, a function of ``s`` that returns ``(n_c,)`` or
            ``(n_c, d)``, totals as those of `solve`; default the ``gap`` of the problem,
            throughout.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named.
        NoEquilibriumError, NotConvergedError
            No step of length ``smallest`` leads on, with the last ``s``. ``.result``
            holds the steps up to there.

        Examples
        --------
        A point on two springs, pressed by 10 N and pulled by 5 N in proportion, slides
        along the wall by 2 mm, in steps of 1.5 mm at the most:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> result = problem.follow([-10.0, 5.0], slip=1.5e-3)
        >>> result.s
        array([0.5, 1. ])
        >>> result.slip[:, 0, 0].round(9)  # of each step
        array([0.001, 0.001])
        """
        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        callback("gap", gap)
        plan = increments(stops, first, largest, smallest, slip)
        loads = self._loading.along(load, prescribed, gap, plan.stops[-1])
        following = self._following(self._core, self._mu, chosen, start)
        return follow(following, loads, plan, on_step)

    def solve_many(
        self,
        cases: Iterable[Mapping[str, Any]],
        *,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
    ) -> list[Result]:
        """Follow several load paths on the one factorisation, side by side.

        Parameters
        ----------
        cases
            Of each path a mapping with any of the keys ``load``, ``prescribed``,
            ``gap`` and ``start``, as `solve` takes them, and ``mu``, friction
            coefficients ``(n_c,)`` or one, in place of the problem's.
        method, tol, max_iterations, max_seconds
            As in `solve`.

        Returns
        -------
        list of Result
            One a case, in their order, with the bits that `solve` gives. A path that has
            no answer or does not converge keeps the others from nothing: its ``success``
            is false, its ``message`` says why, and it holds the steps before.

        Raises
        ------
        TypeError, ValueError
            A wrong argument, named with the number of its case.

        Examples
        --------
        A point on two springs, pressed by 10 N and pulled along the wall by 5 N, on a
        smooth wall and on a rough one:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> cases = [{"load": [-10.0, 5.0], "mu": mu} for mu in (0.1, 0.9)]
        >>> for result in problem.solve_many(cases):
        ...     print(result[-1].reaction[0].round(9))  # n, t, in N
        [10. -1.]
        [10. -5.]
        """
        chosen = settings(method, tol, max_iterations, max_seconds)
        paths: list[Following] = []
        totals: list[list[Totals]] = []
        if not isinstance(cases, Iterable):
            raise TypeError(
                f"cases is a {type(cases).__name__}, expected mappings, one a path"
            )
        for k, case in enumerate(cases):
            check_case(k, case)
            core, mu = self._core, self._mu
            try:
                if case.get("mu") is not None:
                    mu = friction(case["mu"], *self._shape[1:], ratio=RATIO)
                    core = core.with_mu(mu)
                start = case.get("start")
                paths.append(self._following(core, mu, chosen, start))
                load, prescribed, gap = map(case.get, ("load", "prescribed", "gap"))
                totals.append(self._loading.totals(load, prescribed, gap, start))
            except (TypeError, ValueError) as error:
                raise type(error)(f"case {k}: {error}") from None
        followed = _core.follow([path.path for path in paths], totals, *chosen)
        parts = zip(paths, totals, followed, strict=True)
        return [path.through(asked, done) for path, asked, done in parts]

    def update(self, K: Any) -> None:
        """Take another stiffness, in place: other materials or thicknesses.

        Where ``K`` has the pattern of the one before, orderings and symbolic work are
        used again, and the memory of a factor that is no longer needed. Contacts,
        supports and settings stay. Results made before keep the stiffness they were
        made with, and its factor for their displacements.

        Parameters
        ----------
        K
            As in `ContactProblem`, of the same shape.

        Raises
        ------
        TypeError, ValueError, FloatingBodyError, MemoryError
            As `ContactProblem` does; the problem is then as it was.

        Examples
        --------
        A point on two springs is pulled away from a wall by 1 N; springs of twice the
        stiffness let it go half as far:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> before = problem.solve([1.0, 0.0])
        >>> problem.update(2e3 * np.eye(2))
        >>> after = problem.solve([1.0, 0.0])
        >>> before.displacement[0, 0], after.displacement[0, 0]
        (np.float64(0.001), np.float64(0.0005))
        """
        stiffness = csr("K", K)
        n = self._shape[0]
        if stiffness.shape != (n, n):
            raise ValueError(
                f"K has shape {stiffness.shape}, expected ({n}, {n}): whole, as before, "
                "with the degrees of freedom that are held"
            )
        if self._loading.held is not None:
            from scipy.sparse import csr_array

            stiffness = csr("K", self._loading.held.stiffness(csr_array(K)))
        restored, known = self._with_digits(stiffness)
        found = self._looked_at(restored, self._given.gap)
        self._condense(restored.parts, self._core)
        self._known = known
        self._remarks, self._strength = found

    def _with_digits(self, stiffness: Csr) -> tuple[Csr, Known | None]:
        """K as it is condensed, and what is known of its digits."""
        if self._digits is None:
            return stiffness, None
        from scipy.sparse import csr_array

        parts, off = self._digits.restore(stiffness)
        matrix = csr_array(parts[::-1], shape=stiffness.shape)
        return Csr(matrix, stiffness.shape, parts), Known(self._digits, off)

    def _looked_at(
        self, stiffness: Csr, gap: Floats
    ) -> tuple[tuple[str, ...], remarks.Strength | None]:
        """Sentences on what was given, and how stiff the bodies are where it is known."""
        places, d = self._where, self._shape[2]
        outward, known, said = None, None, []
        # Inclined supports are written into K: its nodes have no rigid motions.
        if self._held is None:
            misplaced = dof_order.unlike(
                stiffness.parts, self._contact.parts, places, d
            )
            if misplaced is not None:
                warnings.warn(misplaced, stacklevel=3)
                said.append(misplaced)
            elif places is not None:
                with np.errstate(over="ignore", invalid="ignore"):
                    outward = remarks.surfaces(stiffness, places, d)
                    known = remarks.strength(stiffness, places, d)
        said += remarks.at_start(
            self._contact,
            gap,
            points=self._contacts["x"],
            places=places,
            outward=outward,
        )
        return tuple(said), known

    def _condense(
        self,
        parts: Parts,
        before: _core.Condensed | None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
    ) -> None:
        started = time.perf_counter()
        try:
            self._core = _core.Condensed(parts, *self._given, before, on_forecast)
        except (FloatingBodyError, ValueError) as error:
            dof = getattr(error, "dof", None)
            cause = ""
            if isinstance(error, ValueError):
                cause = one_triangle(parts) or enforced(parts)
            if cause:
                raise ValueError(f"{error}{cause}") from None
            if dof is None:
                raise
            said = str(error) + self._of_digits(str(error), parts, dof)
            if self._bodies is not None:
                said = f"{body_of(dof, self._bodies)}: {said}"
            elif said == str(error):
                raise
            named = type(error)(said)
            if isinstance(named, FloatingBodyError):
                named.dof = dof
            raise named from None
        self._seconds = time.perf_counter() - started

    def _of_digits(self, said: str, parts: Parts, dof: int) -> str:
        """What the digits of K may have to do with an error of the core."""
        from bipot_rs.contact.stiffness_digits import OFFER, said_of_indefinite

        if "K is indefinite" in said:
            return said_of_indefinite(parts, self._fixed, dof, self._digits)
        few = "K has too few digits" in said and self._digits is None
        return OFFER if few else ""

    def _following(
        self,
        core: _core.Condensed,
        mu: Floats,
        chosen: Settings,
        start: Result | Step | None,
    ) -> Following:
        shape, contacts = self._shape[1:], self._contacts | {"mu": mu}
        before, known = self._remarks, self._strength

        def said(steps: Sequence[Step]) -> tuple[str, ...]:
            return (*before, *remarks.of_path(steps, contacts, known))

        return Following(
            core,
            contacts,
            mu,
            shape,
            chosen,
            start,
            condense=self._seconds,
            bodies=self._bodies,
            known=self._known,
            remarks=said,
        )


def _of_components(given: Any, found: Floats | None, d: int) -> Floats | None:
    """Places ``(n, d)`` of degrees of freedom, of those the core takes; None if unknown."""
    if found is None or (d == 3 and np.shape(given)[1] == 2):
        return None
    if d == 2 and np.ptp(found[:, 2]) > 0:
        return None
    return np.ascontiguousarray(found[:, :d])


def _named(bodies: Mapping[str, int] | None, n: int) -> dict[str, int] | None:
    """Names of bodies with their first degrees of freedom, checked."""
    if bodies is None:
        return None
    if not isinstance(bodies, Mapping):
        raise TypeError(
            f"bodies is a {type(bodies).__name__}, expected a mapping of names to first "
            "degrees of freedom"
        )
    found = {
        str(name): integer(f"bodies[{name!r}]", first, least=0, most=max(n - 1, 0))
        for name, first in bodies.items()
    }
    if len(set(found.values())) < len(found):
        raise ValueError(f"bodies is {found}, expected each to begin somewhere else")
    return found
