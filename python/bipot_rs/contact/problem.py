"""`ContactProblem`: bodies, contacts and supports, condensed once, and its load paths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Bools, Floats, Ints, MatrixLike, Record
from bipot_rs._lib.validation import (
    Csr,
    callback,
    csr,
    matrices,
    settings,
)
from bipot_rs.contact.errors import NoEquilibriumError
from bipot_rs.contact.messages.remarks import ProblemRemarks, examine_arrays
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.engine import Engine
from bipot_rs.contact.path.load_path import (
    PathProblem,
    PathSolver,
    reduce_step,
    show_progress,
)
from bipot_rs.contact.path.load_steps import Loading, last_step
from bipot_rs.contact.path.mesh_stiffness import MeshStiffness
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.path.prepared import PreparedStiffness, StiffnessOptions
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results import summary
from bipot_rs.contact.results.latches import Latches
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.sensitivity.model import Held, PathModel
from bipot_rs.contact.sensitivity.path import Differentiable

if TYPE_CHECKING:
    from bipot_rs.contact.path.cases import Case
    from bipot_rs.contact.path.prepared import OnForecast
    from bipot_rs.contact.proof.existence import Existence
    from bipot_rs.contact.results.state import Start
    from bipot_rs.contact.wear.record import Wear


class ContactProblem:
    """Bodies, contacts and supports, condensed onto the contact set once.

    The problem is ``K u = f + Bᵀ r``, ``v = B u + gap``, with the laws of Signorini and
    Coulomb between ``v`` and ``r`` at every contact: equations (1), (2) and (9).

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``, symmetric positive semidefinite: any sparse format of
        SciPy, or dense. It holds both triangles; of entries that differ by rounding, the
        direct engine uses the upper ones.
    B
        Contact operator, ``(d n_c, n)``: row ``d i + k`` is component ``k`` of contact
        ``i``, normal first, so that ``B u + gap`` is the relative displacement and
        ``Bᵀ r`` the force on the bodies.
    gap
        Normal gap, ``(n_c,)``, positive when open, or ``(n_c, d)`` to offset every
        component.
    mu
        Friction coefficient, a number or ``(n_c,)``. In space also ``(n_c, 2)``, the
        coefficients along ``t1`` and ``t2`` of each contact (8e): both zero, or both
        positive with a ratio of at most 1e6.
    fixed
        Numbers of the prescribed degrees of freedom.
    area
        Tributary areas, ``(n_c,)``, for tractions.
    cohesion
        Cohesion ``c`` of each contact, a force: ``|r_t| <= c + mu r_n``, a number or
        ``(n_c,)``; a stress times ``area``. A contact that is open at the start, or opens in
        a step, loses it for good (`Result.broken`): all that open in a step break together,
        and the step is solved again until no other opens. A contact that slips keeps it. A
        path along which contacts break depends on its steps. At the start, contacts with a
        gap above 1e-9 of the extent of ``points`` are open; without ``points``, above zero.
    dilatancy
        Dilatancy ``beta`` of each contact, from zero to ``mu``, a number or ``(n_c,)``: a
        contact that slips opens by ``beta`` times its slip. Later steps keep this opening.
    dim
        Dimension, 2 or 3; needed only if there are no contacts.
    num_threads
        Number of threads, at most 1024. The default is ``BIPOT_NUM_THREADS``,
        ``RAYON_NUM_THREADS``, or all cores.
    points
        Coordinates of the contacts, ``(n_c, d)``, for results and files.
    frame
        Local bases ``(n_c, d, d)`` with rows ``n, t1[, t2]``, for results and files:
        orthonormal to 1e-6, right-handed or left-handed.
    coordinates
        Coordinates of each degree of freedom, ``(n, 2)`` or ``(n, 3)``, in any unit. They
        give the exact rigid motions and a second elimination order; the order with fewer
        operations is used. Degrees of freedom may be ordered by nodes,
        ``numpy.repeat(nodes, d, axis=0)``, or by components, ``numpy.tile(nodes, (d, 1))``.
    loads
        All loads of all steps, if no displacements are needed: ``load`` of `solve`, or
        the tuple ``(load, prescribed)``. The factor of ``K`` is then not kept, only the
        effect of the loads on the contacts, and `solve` is called without loads. The
        factor is kept for bodies that contact alone holds, and for bodies whose ``W`` has
        lost digits that only ``K`` can restore. ``working_set`` has no effect.
    memory_limit
        Bytes that the condensation may use. The default is the free memory.
    working_set
        Whether ``W`` is formed only for contacts that may close. The set grows in each
        step until no other contact penetrates. By default a working set is used if a body
        has hundreds of candidates and at least 3/4 of them are open at the start.
    gaps
        Gaps of each load step for moving obstacles, ``(steps, n_c)``,
        ``(steps, n_c, d)`` or `MovingGaps`: the default of ``gap`` in `solve`. ``gap``
        itself holds the gaps at the start.
    on_forecast
        Called after the ordering and before the factorisation, with a forecast of the
        cost: a mapping with ``bodies``, ``n_contact_dofs``, ``nnz_factor``, ``flops``,
        ``bytes_factor``, ``bytes_peak`` and ``ordering`` as in `stats`. If it raises an
        exception, the work ends with this exception.
    bodies
        Names of the bodies for messages, each with its first degree of freedom:
        ``{"upper": 0, "lower": 240}``.
    stiffness_rtol
        Relative error of the entries of ``K``, if another program wrote it with six to
        twelve digits: 1e-8 for eight. The rigid motions, known from ``coordinates``, are
        then restored exactly with the least change of the entries.
        ``stats["rigid_motions_off"]`` is their error before that. No other digits are
        restored: `Solution.error_estimate` and `Result.remarks` account for them.

    engine
        ``"direct"`` factors ``K`` and condenses it onto the contacts. ``"iterative"`` solves
        in the displacements with a multigrid preconditioner: time and memory grow in
        proportion to the entries of ``K``, but nothing that needs ``W`` is available.
        Without ``coordinates`` it takes more iterations, and supports must hold each body.
        ``"auto"`` chooses for each load path by a forecast of time and memory;
        ``stats["engine"]`` and ``stats["engine_reason"]`` say which and why. A step that
        the iterative engine cannot solve is solved by the direct one, if its factor fits
        into memory.

    Attributes
    ----------
    contacts, loading, stiffness
        The parts of the problem: the contacts; the loads and gaps; ``K`` with the engines
        that solve.
    remarks
        Warnings about the arrays: ``remarks.at_start``, a sentence each.

    Raises
    ------
    TypeError, ValueError
        An argument has the wrong type, shape or value, or ``K`` is asymmetric or
        indefinite, or ``engine="iterative"`` cannot solve this problem. The message names
        the argument and the place.
    FloatingBodyError
        The contacts cannot hold a body.
    MemoryError
        The factor or ``W`` does not fit into memory. This is known before it is
        allocated; the message gives the number of bytes.

    Warns
    -----
    UserWarning
        The degrees of freedom of ``K`` seem to have another order than ``coordinates`` or
        the columns of ``B``: ``K`` times a rigid motion is not zero in rows without
        supports.

    Notes
    -----
    A pickle holds the arguments. Unpickling condenses the problem again, to the same bits.

    Examples
    --------
    A bar of two springs is fixed at its left end. Its right end is 1 mm to the left of a
    wall, whose normal points left. Contact components are ``(n, t)``:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> K = np.zeros((4, 4))  # u_x, u_y of the middle, then of the right end
    >>> K[::2, ::2] = 1e6 * np.array([[2.0, -1.0], [-1.0, 1.0]])
    >>> K[1::2, 1::2] = 1e6 * np.eye(2)  # springs across the bar
    >>> B = np.array([[0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    >>> problem = bp.ContactProblem(K, B, gap=[1e-3], mu=0.2)
    >>> push = np.array([0.0, 0.0, 1.0, 0.0])
    >>> result = problem.solve([400.0 * push, 2000.0 * push])
    >>> result.relative_displacement[:, 0, 0].round(9)  # remaining gap, m
    array([0.0002, 0.    ])
    >>> result.reaction[:, 0, 0].round(6)  # N
    array([   0., 1500.])
    """

    def __init__(
        self,
        K: MatrixLike | MeshStiffness,
        B: MatrixLike,
        *,
        gap: ArrayLike,
        mu: ArrayLike,
        fixed: ArrayLike | None = None,
        area: ArrayLike | None = None,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
        dim: int | None = None,
        num_threads: int | None = None,
        points: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        coordinates: ArrayLike | None = None,
        loads: ArrayLike | tuple[ArrayLike | None, ArrayLike | None] | None = None,
        memory_limit: int | None = None,
        working_set: bool | None = None,
        gaps: ArrayLike | MovingGaps | None = None,
        on_forecast: OnForecast | None = None,
        bodies: Mapping[str, int] | None = None,
        stiffness_rtol: float | None = None,
        engine: str = "auto",
        _held: Held | None = None,
        _steps: int | None = None,
        _kinematics: tuple[Floats, Floats, Floats] | None = None,
        _latches: tuple[Ints, Floats] | None = None,
        _interference: Bools | None = None,
    ) -> None:
        # `fem` has supports that K and B do not contain, and knows the number of steps, the
        # rigid motions of reference points, and which contacts are meant to penetrate.
        self._interference = _interference
        stiffness: Csr | MeshStiffness
        if isinstance(K, MeshStiffness):
            stiffness, operator = K, csr("B", B)
        else:
            stiffness, operator = matrices(K, B)
        n = stiffness.shape[0]
        self.contacts = ContactSet.check(
            operator,
            gap=gap,
            mu=mu,
            cohesion=cohesion,
            dilatancy=dilatancy,
            dim=dim,
            area=area,
            points=points,
            frame=frame,
        )
        if working_set is True and not self.contacts.law.is_coulomb:
            raise ValueError(
                "working_set is True, expected None or False: with cohesion or dilatancy W "
                "is formed for all contacts"
            )
        options = StiffnessOptions.check(
            n,
            self.contacts.d,
            fixed=fixed,
            num_threads=num_threads,
            coordinates=coordinates,
            memory_limit=memory_limit,
            working_set=working_set,
            bodies=bodies,
            stiffness_rtol=stiffness_rtol,
            engine=engine,
            steps=_steps,
            kinematics=_kinematics,
            latched=_latches is not None,
        )
        latches = None
        if _latches is not None and isinstance(stiffness, Csr):
            rows = stiffness.matrix[_latches[0] + 1]
            latches = Latches(*_latches, options.fixed, rows)
        self.loading = Loading.check(
            n, len(options.fixed), self.contacts, loads, gaps, _held, latches
        )
        callback("on_forecast", on_forecast)
        restored, digits = stiffness, None
        if isinstance(stiffness, Csr):
            restored, digits = options.restore(stiffness)
        self.remarks = self._examine(restored, options)
        self.stiffness = PreparedStiffness(
            restored, digits, self.contacts, options, self.loading.loads, on_forecast
        )

    def __copy__(self) -> ContactProblem:
        # `update` of one must not change the other.
        return deepcopy(self)

    def __repr__(self) -> str:
        dofs = count_noun(self.loading.n, "degree") + " of freedom"
        return (
            f"ContactProblem({dofs}, {summary.describe_places(*self.contacts.shape)})"
        )

    def __str__(self) -> str:
        return summary.format_text(self._summary())

    def _repr_html_(self) -> str:
        return summary.format_html(self._summary())

    def _summary(self) -> summary.Summary:
        return summary.summarise_problem(
            (self.loading.n, *self.contacts.shape),
            self.loading.fixed,
            self.contacts.arrays(),
            self.stats,
            self.remarks.at_start,
        )

    @property
    def compliance(self) -> Floats:
        """Compliance ``W`` of all contacts (3), dense, ``(d n_c, d n_c)``.

        For bodies held by contact alone it is ``B_c (S + α R Rᵀ)⁻¹ B_cᵀ`` with their
        rigid motions ``R`` and ``α = tr S / m``, as in `reduced`.

        Raises
        ------
        MemoryError
            The dense ``W`` does not fit into memory.
        """
        return self.stiffness.core.compliance()

    @property
    def stats(self) -> Record:
        """Counts and seconds of the condensation.

        They include ``n``, ``n_contact_dofs``, ``nnz_factor``, ``flops``, ``bytes_factor``,
        ``bytes_peak`` (predicted), ``cond_S``, ``keeps_digits``, ``ordering``,
        ``working_set`` (the number of contacts in it at the start, or ``None``),
        ``rigid_motions``, and the times
        ``seconds_order``, ``seconds_symbolic``, ``seconds_factor``, ``seconds_compliance``
        and ``seconds_condense``, the total.

        ``orderings`` is the number of bodies that were ordered and analysed. It does not
        count bodies whose pattern is in the cache of this process, which holds up to
        ``BIPOT_PATTERN_CACHE_MB`` megabytes: 64 by default, 0 for no cache. The cache does
        not change a bit of the results.

        ``engine`` and ``engine_reason`` say what solves the load steps, and why. With the
        iterative engine, ``newton`` and ``krylov`` are its iterations in all load paths so
        far, and ``bytes_multigrid`` the memory of its largest hierarchy; what belongs to the
        factor is ``None``.

        With ``stiffness_rtol``, ``rigid_motions_off`` is the largest ``|K z|`` of a row for
        a rigid motion ``z``, relative to the sum of the absolute values of its terms,
        before the rigid motions were restored.
        """
        return self.stiffness.stats

    @property
    def rigid_motions(self) -> tuple[str, ...]:
        """Names of the rigid motions that supports leave free and contact must hold.

        Directions are the axes ``x, y[, z]`` if ``frame`` is known, else the axes
        ``n, t1[, t2]`` of the contacts. A body without a name is identified by the degree
        of freedom that moves most.
        """
        return self.stiffness.name_rigid_motions()

    def reduced(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Start | None = None,
        *,
        gap: ArrayLike | MovingGaps | None = None,
    ) -> ReducedProblem:
        """Reduced problem (5) of one step, from the unloaded state or from ``start``.

        Its ``W`` is sparse if there are separate bodies and most of ``W`` is zero. Contacts
        that are broken before the step have no cohesion in it; those that open in it keep
        theirs.

        Parameters
        ----------
        load, prescribed
            Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``. The default is
            zero.
        start
            A `Result`, one of its steps, or a `State`, whose slip history enters ``q``.
        gap
            Gaps of the step, ``(n_c,)``, ``(n_c, d)`` or `MovingGaps` of one step. The
            default is the ``gap`` of the problem.

        Raises
        ------
        NoEquilibriumError
            A contact penetrates and no reaction can move it.
        MemoryError
            ``W`` of all contacts does not fit into memory.
        """
        if self.loading.latches is not None:
            raise ValueError(
                "the model has bolts: W and the free part of a step depend on which of them "
                "it tightens; solve the path"
            )
        loads = self.loading.read_step(load, prescribed)
        core = self.stiffness.core
        W, q, rigid, law = reduce_step(core, self.loading, loads, start, gap)
        return ReducedProblem(W, q, law.mu, rigid=rigid, **law.without_mu())

    def existence(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Start | None = None,
        *,
        exhaust: bool = False,
        gap: ArrayLike | MovingGaps | None = None,
    ) -> Existence:
        """Whether a solution of one step exists, as far as this can be proved.

        This is `ReducedProblem.existence`, with the rigid motion also at all degrees of
        freedom. It forms ``W`` of all contacts.

        Parameters
        ----------
        load, prescribed, start, gap
            As in `reduced`.
        exhaust
            As in `ReducedProblem.existence`.

        Returns
        -------
        Existence
            The ``verdict``, the ``reason`` in words, and the proof.

        Raises
        ------
        MemoryError
            ``W`` of all contacts does not fit into memory.

        Examples
        --------
        A point without supports is pressed onto a wall, then pulled away from it:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> free = bp.ContactProblem(np.zeros((2, 2)), np.eye(2), gap=[0.0], mu=0.3)
        >>> [free.existence(load).verdict for load in ([-1.0, 0.0], [1.0, 0.0])]
        ['guaranteed', 'none']
        """
        from bipot_rs.contact.proof.existence import Existence

        try:
            reduced = self.reduced(load, prescribed, start, gap=gap)
        except NoEquilibriumError as error:
            return Existence(verdict="none", reason=str(error))
        existence = reduced.existence(exhaust=exhaust)
        if existence.motion is None or reduced.rigid is None:
            return existence
        R, motion = reduced.rigid[0], existence.motion.ravel()
        amounts = np.asarray(np.linalg.lstsq(R, motion, rcond=None)[0], np.float64)
        moved = self.stiffness.move_rigidly(amounts)
        if self.loading.held is not None:
            moved = self.loading.held.displacement(moved)
        return replace(existence, displacement=moved)

    def solve(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Start | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        progress: bool = False,
        gap: ArrayLike | MovingGaps | None = None,
        mu: ArrayLike | None = None,
    ) -> Result:
        """Solve a load path step by step, with slip history.

        Parameters
        ----------
        load
            ``(n,)`` or ``(steps, n)``, totals at the end of each step.
        prescribed
            ``(len(fixed),)`` or ``(steps, len(fixed))``, totals; the default is zero. A
            single row of ``load`` or ``prescribed`` is used in all steps.
        method
            ``"auto"``, or a method to compare it with: ``"newton"``,
            ``"gauss_seidel"``, ``"nesterov"``, ``"uzawa"`` (one projection,
            [dSF91, 79-81]), ``"uzawa_two_projection"`` ([dSF91, 82-87]),
            ``"return_mapping"`` and ``"perturbed_lagrangian"`` (a penalty, and multipliers
            that remove its error), and the paper's principles:
            ``"displacement_principle"`` ([dSF91, 68]), ``"alternating_principles"``
            ([dSF91, 69, 70]), ``"stress_principle"`` ([dSF91, 72]),
            ``"minimising_sequence"`` ([dSF91, 31-34], with the fields in
            `Solution.minimising_sequence`), ``"pivoting"`` (complementary pivoting, after
            [dSF91, 75]). ``"alternating_principles"``, ``"minimising_sequence"`` and
            ``"pivoting"`` need bodies that supports hold. The methods to compare with may
            stall if friction is strong; a point of theirs that does not satisfy (13) is
            never called converged.
        tol
            Residual η to reach. `Solution.tolerance` is larger if rounding needs that.
        max_iterations, max_seconds
            Limits of one step.
        start
            A `Result` or one of its steps to continue from; the results have the same bits
            as those of one uninterrupted path. ``load``, ``prescribed`` and ``gap`` are the
            totals of the following steps. If the problem has its own ``gaps`` or
            ``loads``, the rows after the finished steps are used. This needs a `Result`,
            because a step does not hold the number of steps before it. A `State` is a
            start of one's own: reactions and relative displacements from elsewhere.
        on_step
            Called as ``on_step(k, step)`` after each step.
        progress
            Whether to show a progress bar, of tqdm or of Rich, one of which is needed.
        mu
            Friction coefficients instead of those of the problem.
        gap
            Gaps of each step for moving obstacles, totals: ``(steps, n_c)`` along the
            normals or ``(steps, n_c, d)`` by component; for one step also ``(n_c,)``. One
            row is used in all steps. The default is the ``gaps`` of the problem, else its
            ``gap`` in all steps. A tangential gap is the tangential position of the body
            relative to its obstacle at ``u = 0``: an obstacle that moves by ``s`` along a
            tangent has the gap ``-s``, and this motion is part of ``slip``. If frames change
            along the path, `MovingGaps`; each step then has the frame `Step.frame`.

        Raises
        ------
        NoEquilibriumError
            No solution exists: contacts contradict each other, or friction and pressure
            cannot balance the loads on a body that contact alone holds. In the second case
            the message describes the motion of the body and ``.direction (n_c, d)`` the
            motion of each contact. It is a proof: the loads do work on this motion and no
            reaction does work against it.
        NotConvergedError
            A step did not converge. ``.result`` of both errors holds the steps before.

        Examples
        --------
        A path in two parts; the second part continues from the end of the first:

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
        checked = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        steps = self.loading.list_totals(load, prescribed, gap, start)
        at = last_step(start)
        engine = self.stiffness.choose_engine(len(steps), method, at)
        path = self._begin_path(engine, checked, start, gap, mu)
        with show_progress(progress, len(steps), on_step) as report:
            for k, totals in enumerate(steps):
                step = path.advance(*totals)
                if report is not None:
                    report(k, step)
        return path.result()

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
        start: Start | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        progress: bool = False,
        gap: Callable[[float], ArrayLike | MovingGaps] | None = None,
    ) -> Result:
        """Solve a load path in adaptive steps, with slip history.

        A step that has no solution, does not converge or slips too far is halved. After a
        step that was not halved, the next step may be twice as long. The steps end at
        ``result.s``; `solve` at these points gives the same bits.

        Parameters
        ----------
        load, prescribed
            Totals: functions of ``s`` that return ``(n,)`` and ``(len(fixed),)``, called
            once for each attempt, or arrays, which are scaled in proportion to ``s``. The
            default is zero.
        stops
            Ascending values of ``s`` at which a step must end, such as corners of the
            path. The last value is the end of the path.
        first, largest, smallest
            Length of the first step (default ``largest``), the longest step (default the
            whole path) and the shortest step (default 1/1000 of the path). The path
            stops if a step of length ``smallest`` fails.
        slip
            Largest slip of a closed contact in one step [length].
        method, tol, max_iterations, max_seconds, on_step, progress
            As in `solve`.
        start
            A `Result` of such a path or one of its steps. The path continues from there,
            with the same steps and bits as one uninterrupted path. From a step of
            another kind of path, or from a `State`, it begins at ``s = 0``.
        gap
            Gaps for moving obstacles: a function of ``s`` that returns ``(n_c,)`` or
            ``(n_c, d)``, or `MovingGaps` of one step, totals as in `solve`. The default is
            the ``gap`` of the problem.

        Raises
        ------
        NoEquilibriumError, NotConvergedError
            A step of length ``smallest`` failed. The message gives the last ``s``, and
            ``.result`` holds the steps up to there.

        Examples
        --------
        A point on two springs is pressed onto a wall by 10 N and pulled along it by 5 N,
        both growing in proportion. It slips by 2 mm, in steps of at most 1.5 mm:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> result = problem.follow([-10.0, 5.0], slip=1.5e-3)
        >>> result.s
        array([0.5, 1. ])
        >>> result.slip[:, 0, 0].round(9)  # of each step
        array([0.001, 0.001])
        """
        from bipot_rs.contact.path.step_control import (
            check_increments,
            solve_adaptively,
        )

        checked = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        callback("gap", gap)
        plan = check_increments(stops, first, largest, smallest, slip)
        totals = self.loading.make_totals(load, prescribed, gap, plan.stops[-1])
        engine = self.stiffness.choose_engine(plan.steps, method, last_step(start))
        path = self._begin_path(engine, checked, start, gap)
        with show_progress(progress, float(plan.stops[-1]), on_step) as report:
            return solve_adaptively(path, totals, plan, report)

    def solve_many(
        self,
        cases: Iterable[Case],
        *,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
    ) -> list[Result]:
        """Solve several load paths in parallel with one factorisation.

        Parameters
        ----------
        cases
            For each path a mapping with any of the keys ``load``, ``prescribed``,
            ``gap`` and ``start``, as in `solve`, and ``mu``, the friction coefficients
            that replace those of the problem.
        method, tol, max_iterations, max_seconds
            As in `solve`.

        Returns
        -------
        list of Result
            One result for each case, with the same bits as from `solve`. If a path has no
            solution or does not converge, its ``success`` is false, its ``message`` gives
            the reason, and it holds the steps before. The other paths are not affected.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong; the message names it and the number of its case.

        Examples
        --------
        A point on two springs is pressed onto a wall by 10 N and pulled along it by 5 N,
        with a small and a large friction coefficient:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> cases = [{"load": [-10.0, 5.0], "mu": mu} for mu in (0.1, 0.9)]
        >>> for result in problem.solve_many(cases):
        ...     print(result[-1].reaction[0].round(9))  # n, t, in N
        [10. -1.]
        [10. -5.]
        """
        from bipot_rs.contact.path.cases import solve_cases

        checked = settings(method, tol, max_iterations, max_seconds)

        def begin_paths(steps: int) -> Callable[[Case], PathSolver]:
            engine = self.stiffness.choose_engine(steps, method)

            def begin(case: Case) -> PathSolver:
                start, gap, mu = case.get("start"), case.get("gap"), case.get("mu")
                return self._begin_path(engine, checked, start, gap, mu)

            return begin

        return solve_cases(cases, self.loading, begin_paths, checked)

    def wear(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        coefficient: ArrayLike,
        cycles: int,
        jump: bool = True,
        rtol: float = 0.01,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        max_seconds: float | None = None,
        start: Wear | Start | None = None,
        on_cycle: Callable[[int, Step], object] | None = None,
        gap: ArrayLike | MovingGaps | None = None,
    ) -> Wear:
        """Repeat a load path, and wear the contacts by Archard's law.

        After each load step the gap of each contact grows by ``k p ‖slip‖`` with the
        pressure ``p = r_n / area``, equation (28). The slip history continues from cycle to
        cycle. Only gaps change: nothing is factored again. ``area`` must be known.

        The depth that a cycle wears off changes slowly, so that cycles may be jumped over
        by Heun's method: see section 15 of ``docs/theory.md`` for its estimate of the error,
        and for the bound of jumps beyond which pressures would oscillate.

        Parameters
        ----------
        load, prescribed, gap
            One cycle, as in `solve`. With `MovingGaps` each step wears along its own normal;
            the bound of jumps uses the frames of B.
        coefficient
            Wear coefficient ``k``, depth per pressure and slip [1/stress], a number or
            ``(n_c,)``: Archard's dimensionless coefficient divided by the hardness. For two
            worn bodies it is the sum of theirs.
        cycles
            Number of cycles.
        jump
            Whether cycles may be jumped over. Otherwise every cycle is solved.
        rtol
            Allowed error of the depth by jumps, relative to the largest depth.
        method, tol, max_iterations, max_seconds
            As in `solve`.
        start
            State before the first cycle: a `Result`, a step or a `State` that presses the
            bodies, which wears nothing, or a `Wear` to continue, whose cycles and depths are
            counted on.
            `solve` continues from ``wear.result`` with ``gap`` plus ``wear.depth[-1]``.
        on_cycle
            Called as ``on_cycle(number, step)`` with the last step of each cycle that was
            solved; ``step.wear`` is the depth.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the areas are not known; the message names it.
        NoEquilibriumError, NotConvergedError
            A load step of a cycle failed. ``.result`` holds the steps of this cycle before
            it, and ``.wear`` the cycles before. If this happens in a trial, the jump is
            rejected instead.

        Examples
        --------
        A point on two springs is held 10 mm below a surface and pulled along it by 4 mm to
        and fro. The pressure decays with the depth that is worn off:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> K, B = 1e3 * np.eye(2), np.array([[1.0, 0.0], [0.0, 1.0]])
        >>> problem = bp.ContactProblem(K, B, gap=[-0.01], mu=0.0, area=[1e-4])
        >>> pull = np.array([[0.0, 4.0], [0.0, -4.0]])
        >>> wear = problem.wear(pull, coefficient=2.5e-8, cycles=400, jump=False)
        >>> wear.pressure[[0, 199, 399], 0].round(-1)  # Pa
        array([99900., 45030., 20220.])
        >>> jumped = problem.wear(pull, coefficient=2.5e-8, cycles=400, rtol=1e-3)
        >>> jumped.paths < 120, bool(abs(jumped.depth[-1] / wear.depth[-1] - 1) < 1e-3)
        (True, True)
        """
        from bipot_rs.contact.wear.cycle import Cycles, Stability
        from bipot_rs.contact.wear.jumps import CycleSolver
        from bipot_rs.contact.wear.record import check_wear

        checked = settings(method, tol, max_iterations, max_seconds)
        callback("on_cycle", on_cycle)
        arguments = check_wear(self.contacts, coefficient, cycles, jump, rtol, start)
        totals = self.loading.list_totals(load, prescribed, gap)
        if not totals:
            raise ValueError(
                "load and prescribed have no load steps, expected a cycle of at least one"
            )
        count, at = arguments.cycles * len(totals), arguments.state.at
        engine = self.stiffness.choose_engine(count, method, at)
        stability = Stability(
            self.stiffness.matrix(),
            self.contacts.operator,
            self.stiffness.options.fixed,
            self.contacts.d,
        )

        def begin(at: Step | None) -> PathSolver:
            return self._begin_path(engine, checked, at)

        framed = any(isinstance(moved, MovingGaps) for _, _, moved in totals)
        # With loads= only those can be solved.
        divisible = self.loading.loads is None and not framed
        cycles_of_path = Cycles(begin, totals, arguments, stability, divisible)
        return CycleSolver(cycles_of_path, on_cycle).solve()

    def update(self, K: MatrixLike) -> None:
        """Replace the stiffness in place, for other materials or thicknesses.

        If ``K`` has the same pattern as before, the orderings, the symbolic analysis and
        the memory of the old factor are reused. Contacts, supports and settings stay.
        Earlier results keep their stiffness, and its factor for their displacements.

        Parameters
        ----------
        K
            As in `ContactProblem`, of the same shape.

        Raises
        ------
        TypeError, ValueError, FloatingBodyError, MemoryError
            As in `ContactProblem`. The problem is then unchanged.

        Examples
        --------
        A point on two springs is pulled away from a wall by 1 N. With springs of twice the
        stiffness it moves half as far:

        >>> import numpy as np
        >>> import bipot_rs as bp
        >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
        >>> before = problem.solve([1.0, 0.0])
        >>> problem.update(2e3 * np.eye(2))
        >>> after = problem.solve([1.0, 0.0])
        >>> before.displacement[0, 0], after.displacement[0, 0]
        (np.float64(0.001), np.float64(0.0005))
        """
        stiffness, n = csr("K", K), self.loading.n
        if stiffness.shape != (n, n):
            raise ValueError(
                f"K has shape {stiffness.shape}, expected ({n}, {n}) as before, including "
                "the prescribed degrees of freedom"
            )
        if self.loading.held is not None:
            from scipy.sparse import csr_array

            stiffness = csr("K", self.loading.held.stiffness(csr_array(K)))
        restored, digits = self.stiffness.options.restore(stiffness)
        remarks = self._examine(restored, self.stiffness.options)
        self.stiffness.update(restored, digits)
        latches = self.loading.latches
        if latches is not None:
            latches = replace(latches, rows=restored.matrix[latches.dofs + 1])
            self.loading = replace(self.loading, latches=latches)
        self.remarks = remarks

    def _examine(
        self, stiffness: Csr | MeshStiffness, options: StiffnessOptions
    ) -> ProblemRemarks:
        """Warnings about the arrays."""
        contacts = self.contacts
        return examine_arrays(
            contacts.operator,
            contacts.gap_by_component,
            contacts.x,
            # With inclined supports and of a body of revolution it has no rigid motions in the
            # plane to compare with.
            (stiffness if isinstance(stiffness, Csr) else stiffness.bodies)
            if self.loading.held is None and options.kinematics is None
            else None,
            options.places,
            interference=self._interference,
            stacklevel=3,
        )

    def _begin_path(
        self,
        engine: Engine,
        checked: _core.Settings,
        start: Start | None,
        gap: ArrayLike | MovingGaps | Callable[[float], object] | None = None,
        mu: ArrayLike | None = None,
    ) -> PathSolver:
        """Begin a load path; ``mu`` replaces the friction coefficients of the problem."""
        contacts, loading, options = (
            self.contacts,
            self.loading,
            self.stiffness.options,
        )
        if mu is not None:
            law = contacts.law.with_mu(mu, contacts.d)
            contacts = replace(contacts, law=law)
            engine = engine.with_law(contacts.law)
        latches = loading.latches

        def set_free(free: Bools) -> Engine:
            stiffness = self.stiffness
            if latches is not None:
                stiffness = stiffness.set_free(latches.dofs[free])
            made = stiffness.choose_engine(options.steps or 1, checked.method)
            return made if mu is None else made.with_law(contacts.law)

        problem = PathProblem(
            contacts,
            self.remarks,
            self.stiffness.seconds,
            options.bodies,
            self.stiffness.restored,
            loading.held,
            latches=loading.latches,
            engine_of=set_free,
        )
        model = PathModel(
            contacts.operator.matrix,
            options.fixed,
            contacts.gap.shape,
            loading.are_by_component(gap),
            loading.held,
            latches,
        )
        return PathSolver(engine, problem, checked, start, Differentiable(model))
