"""`ContactProblem`: bodies, contacts and supports, condensed once, and its load paths."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bipot_rs._core as _core
from bipot_rs._lib.memory import available
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
    one_of,
    one_triangle,
    places,
    settings,
    threads,
)
from bipot_rs.contact import dof_order, remarks, summary
from bipot_rs.contact import rigid_motions as motion
from bipot_rs.contact.engines import choice
from bipot_rs.contact.engines.direct import Direct, DirectPath
from bipot_rs.contact.engines.engine import Engine, Known
from bipot_rs.contact.engines.iterative import Iterative
from bipot_rs.contact.errors import (
    FloatingBodyError,
    NoEquilibriumError,
    NotIterativeError,
)
from bipot_rs.contact.existence import Existence
from bipot_rs.contact.load_path import NO_FRAME, Following, state, with_frames
from bipot_rs.contact.load_steps import Held, Loading, Totals, check_case
from bipot_rs.contact.moving import MovingGaps, carried, gaps_by_component, rotation
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.result import Result
from bipot_rs.contact.sensitivity.model import PathModel
from bipot_rs.contact.sensitivity.path import Differentiable
from bipot_rs.contact.solution import Step
from bipot_rs.contact.step_control import follow, increments

if TYPE_CHECKING:
    from bipot_rs.contact.stiffness_digits import Digits
    from bipot_rs.contact.wear.record import Wear


# Entries of `ContactProblem.stats` that only a factor has.
WITHOUT_FACTOR: dict[str, Any] = dict.fromkeys(
    (
        "nnz_factor",
        "flops",
        "bytes_factor",
        "bytes_compliance",
        "bytes_peak",
        "cond_S",
        "ordering",
        "orderings",
        "working_set",
        "bodies",
        "islands",
    )
) | {"rigid_motions": 0, "factor_kept": False}


class _Given(NamedTuple):
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


class ContactProblem:
    """Bodies, contacts and supports, condensed onto the contact set once.

    The problem is ``K u = f + Bᵀ r``, ``v = B u + gap``, with the laws of Signorini and
    Coulomb between ``v`` and ``r`` at every contact: equations (1), (2) and (9).

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``, symmetric positive semidefinite: any sparse format of
        SciPy, or dense. It holds both triangles; the values of the lower one are used.
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
        ``"auto"`` chooses at the first load path by a forecast of time and memory;
        ``stats["engine"]`` and ``stats["engine_reason"]`` say which and why. A step that
        the iterative engine cannot solve is solved by the direct one, if its factor fits
        into memory.

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

    # Nodes on inclined supports, which change every load.
    _held: Held | None = None
    # Number of load steps, where it is known before the first load path.
    _steps: int | None = None
    # The condensed problem, once it is made; the iterative engine, while it may be used.
    _condensed: _core.Condensed | None = None
    _iterative: Iterative | None = None
    # K, until it is condensed.
    _parts: Parts | None = None
    # Name of the engine, and why.
    _chosen: tuple[str, str] = ("direct", "")
    _on_forecast: Callable[[Mapping[str, Any]], object] | None = None

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
        gaps: ArrayLike | MovingGaps | None = None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
        bodies: Mapping[str, int] | None = None,
        stiffness_rtol: float | None = None,
        engine: str = "auto",
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
            n,
            len(self._fixed),
            contacts,
            d,
            loads,
            gaps,
            held=self._held,
            framed=bases is not None,
        )
        self._gaps_by_component = not (
            gaps is None or isinstance(gaps, MovingGaps)
        ) and (np.ndim(gaps) == 3)
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
        self._asked = one_of("engine", engine, choice.ENGINES)
        restored, known = self._with_digits(stiffness)
        self._remarks, self._strength = self._looked_at(restored, whole)
        self._prepare(restored.parts, None, on_forecast)
        self._known = known

    @classmethod
    def _on_inclined_supports(
        cls,
        held: Held | None,
        K: Any,
        B: Any,
        *,
        steps: int | None = None,
        **given: Any,
    ) -> ContactProblem:
        """Make a problem with nodes on supports inclined to the axes.

        ``steps`` is the number of load steps, if it is known, for the choice of the engine.
        """
        problem = cls.__new__(cls)
        problem._held = held
        problem._steps = steps
        problem.__init__(K, B, **given)  # type: ignore[misc]
        return problem

    def __getstate__(self) -> dict[str, Any]:
        # The arguments, not the factor, which may be a hundred times as large:
        # condensing again gives the same bits.
        made = {"_condensed", "_iterative", "_parts", "_on_forecast"}
        known = {name: value for name, value in vars(self).items() if name not in made}
        return known | {"_stiffness": self._matrix()}

    def _matrix(self) -> Parts:
        """K, which the core has once it is condensed."""
        return self._core.stiffness() if self._parts is None else self._parts

    def __setstate__(self, state: dict[str, Any]) -> None:
        parts = state.pop("_stiffness")
        vars(self).update(state)
        self._prepare(parts, None)

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
        """Compliance ``W`` of all contacts (3), dense, ``(d n_c, d n_c)``.

        For bodies held by contact alone it is ``B_c (S + α R Rᵀ)⁻¹ B_cᵀ`` with their
        rigid motions ``R`` and ``α = tr S / m``, as in `reduced`.

        Raises
        ------
        MemoryError
            The dense ``W`` does not fit into memory.
        """
        return self._core.compliance()

    @property
    def stats(self) -> Mapping[str, Any]:
        """Counts and seconds of the condensation.

        They include ``n``, ``n_contact_dofs``, ``nnz_factor``, ``flops``, ``bytes_factor``,
        ``bytes_peak`` (predicted), ``cond_S``, ``ordering``, ``working_set`` (the number of
        contacts in it at the start, or ``None``), ``rigid_motions``, and the times
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
        name, why = self._chosen
        known = {
            "engine": name,
            "engine_reason": why,
            "seconds_condense": self._seconds,
        }
        if self._condensed is not None:
            known = dict(self._condensed.stats) | known
        else:
            n, contacts, d = self._shape
            known = WITHOUT_FACTOR | {"n": n, "n_contact_dofs": d * contacts} | known
        if self._iterative is not None:
            record = self._iterative.record
            known |= self._iterative.stats
            if record.replaced:
                known["engine_reason"] = (
                    f"the iterative engine stalled: {record.replaced}"
                )
        if self._known is None:
            return known
        return known | {"rigid_motions_off": self._known.off}

    @property
    def rigid_motions(self) -> tuple[str, ...]:
        """Names of the rigid motions that supports leave free and contact must hold.

        Directions are the axes ``x, y[, z]`` if ``frame`` is known, else the axes
        ``n, t1[, t2]`` of the contacts. A body without a name is identified by the degree
        of freedom that moves most.
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
        gap: ArrayLike | MovingGaps | None = None,
    ) -> ReducedProblem:
        """Reduced problem (5) of one step, from the unloaded state or from ``start``.

        Its ``W`` is sparse if there are separate bodies and most of ``W`` is zero.

        Parameters
        ----------
        load, prescribed
            Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``. The default is
            zero.
        start
            A `Result` or one of its steps, whose slip history enters ``q``.
        gap
            Gaps of the step, ``(n_c,)``, ``(n_c, d)`` or `MovingGaps` of one step. The
            default is the ``gap`` of the problem.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong; the message names it.
        NoEquilibriumError
            A contact penetrates and no reaction can move it.
        MemoryError
            ``W`` of all contacts does not fit into memory.
        """
        _, contacts, d = self._shape
        loads, core = self._loading.one(load, prescribed), self._core
        before = state(start, contacts, d)
        if gap is not None or (before is not None and before.frame is not None):
            core, before = self._placed(core, before, gap)
        q, modes, force = core.free_part(*loads)
        if before is not None:
            q[:, 1:] -= before.relative_displacement[:, 1:]
        rigid = (np.ascontiguousarray(modes.T), force) if len(force) else None
        blocks = core.sparse_compliance()
        if blocks is None:
            return ReducedProblem(core.compliance(), q, self._mu, rigid=rigid)
        from scipy.sparse import bsr_array

        first, columns, values = blocks
        entries = values.reshape(-1, d, d), columns, first
        W = bsr_array(entries, shape=(d * contacts, d * contacts)).tocsr()
        return ReducedProblem(W, q, self._mu, rigid=rigid)

    def _placed(
        self,
        core: _core.Condensed,
        before: Step | None,
        gap: ArrayLike | MovingGaps | None,
    ) -> tuple[_core.Condensed, Step | None]:
        """The condensed bodies and the state before a step, in the frames of the step."""
        base = self._contacts["frame"]
        own = before is not None and before.frame is not None
        placed = None if gap is None else self._loading.gap(gap)
        if base is None:
            if own:
                raise ValueError(NO_FRAME)
            # `Loading` refuses moving gaps without these frames.
            return core if placed is None else core.with_gap(
                gaps_by_component(placed)
            ), before
        frame = placed.frame if isinstance(placed, MovingGaps) else base
        if frame is not base:
            core = core.rotated(rotation(frame, base))
        if before is not None and (own or frame is not base):
            before = carried(before, frame, base, self._given.gap[:, 0])
        if placed is not None:
            core = core.with_gap(gaps_by_component(placed))
        return core, before

    def existence(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Result | Step | None = None,
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
        TypeError, ValueError
            An argument is wrong; the message names it.
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
        gap: ArrayLike | MovingGaps | None = None,
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
            [dSF91, 79-81]), ``"uzawa_two_projection"`` ([dSF91, 82-87]), and the
            paper's principles: ``"displacement_principle"`` ([dSF91, 68]),
            ``"alternating_principles"`` ([dSF91, 69, 70]), ``"stress_principle"``
            ([dSF91, 72]), ``"minimising_sequence"`` ([dSF91, 31-34]), ``"pivoting"``
            (complementary pivoting, after [dSF91, 75]). ``"alternating_principles"``,
            ``"minimising_sequence"`` and ``"pivoting"`` need bodies that supports hold. The
            methods from the paper may stall if friction is strong.
        tol
            Residual η to reach. `Solution.tolerance` is larger if rounding needs that.
        max_iterations, max_seconds
            Limits of one step.
        start
            A `Result` or one of its steps to continue from; the results have the same bits
            as those of one uninterrupted path. ``load``, ``prescribed`` and ``gap`` are the
            totals of the following steps. If the problem has its own ``gaps`` or
            ``loads``, the rows after the finished steps are used. This needs a `Result`,
            because a step does not hold the number of steps before it.
        on_step
            Called as ``on_step(k, step)`` after each step.
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
        TypeError, ValueError
            An argument is wrong; the message names it.
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
        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        steps = self._loading.totals(load, prescribed, gap, start)
        engine = self._engine(len(steps), method)
        following = self._following(engine, self._mu, chosen, start, gap)
        for k, asked in enumerate(steps):
            step = following.advance(*asked)
            if on_step is not None:
                on_step(k, step)
        return following.result()

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
        start: Wear | Result | Step | None = None,
        on_cycle: Callable[[int, Step], object] | None = None,
        gap: ArrayLike | MovingGaps | None = None,
    ) -> Wear:
        """Repeat a load path, and wear the contacts by Archard's law.

        After each load step the gap of each contact grows by ``k p ‖slip‖`` with the
        pressure ``p = r_n / area``, equation (28). The slip history continues from cycle to
        cycle. Only gaps change: nothing is factored again. ``area`` must be known.

        The depth that a cycle wears off changes slowly, so that cycles may be jumped over
        by Heun's method: see section 16 of ``docs/theory.md`` for its estimate of the error,
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
            State before the first cycle: a `Result` or a step that presses the bodies, which
            wears nothing, or a `Wear` to continue, whose cycles and depths are counted on.
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
        from bipot_rs.contact.wear.begin import begun, coefficients, relative
        from bipot_rs.contact.wear.cycle import Cycles
        from bipot_rs.contact.wear.jumps import Run
        from bipot_rs.contact.wear.stability import Stability

        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_cycle", on_cycle)
        area, contacts = self._contacts["area"], self._shape[1]
        if area is None:
            raise ValueError(
                "area is missing: wear needs pressures, so pass area= to ContactProblem"
            )
        k = coefficients(coefficient, contacts)
        count = integer("cycles", cycles, least=1)
        if not isinstance(jump, bool):
            raise TypeError(f"jump is {jump!r}, expected a bool")
        allowed = relative(rtol)
        at = begun(start, self._shape[1:])
        totals = self._loading.totals(load, prescribed, gap, None)
        engine = self._engine(count * len(totals), method)

        def path(at: Step | None) -> Following:
            return self._following(engine, self._mu, chosen, at)

        stability = Stability(
            self._matrix(), self._contact, self._fixed, self._shape[2]
        )
        made = Cycles(path, totals, self._given.gap, k, area)
        return Run(made, at, count, allowed, stability, jump, on_cycle).go()

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
        method, tol, max_iterations, max_seconds, on_step
            As in `solve`.
        start
            A `Result` of such a path or one of its steps. The path continues from there,
            with the same steps and bits as one uninterrupted path. From a step of
            another kind of path it begins at ``s = 0``.
        gap
            Gaps for moving obstacles: a function of ``s`` that returns ``(n_c,)`` or
            ``(n_c, d)``, or `MovingGaps` of one step, totals as in `solve`. The default is
            the ``gap`` of the problem.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong; the message names it.
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
        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        callback("gap", gap)
        plan = increments(stops, first, largest, smallest, slip)
        loads = self._loading.along(load, prescribed, gap, plan.stops[-1])
        engine = self._engine(choice.ADAPTIVE_STEPS * len(plan.stops), method)
        following = self._following(engine, self._mu, chosen, start, gap)
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
        chosen = settings(method, tol, max_iterations, max_seconds)
        paths: list[Following] = []
        totals: list[list[Totals]] = []
        if not isinstance(cases, Iterable):
            raise TypeError(
                f"cases is a {type(cases).__name__}, expected a list of mappings, one for "
                "each path"
            )
        cases = list(cases)
        for k, case in enumerate(cases):
            check_case(k, case)
            try:
                start = case.get("start")
                load, prescribed, gap = map(case.get, ("load", "prescribed", "gap"))
                totals.append(self._loading.totals(load, prescribed, gap, start))
            except (TypeError, ValueError) as error:
                raise type(error)(f"case {k}: {error}") from None
        engine = self._engine(sum(map(len, totals)), method)
        for k, case in enumerate(cases):
            own, mu = engine, self._mu
            try:
                if case.get("mu") is not None:
                    mu = friction(case["mu"], *self._shape[1:], ratio=RATIO)
                    own = own.with_mu(mu)
                start, gap = case.get("start"), case.get("gap")
                paths.append(self._following(own, mu, chosen, start, gap))
            except (TypeError, ValueError) as error:
                raise type(error)(f"case {k}: {error}") from None
        made = [path.path for path in paths]
        direct = [path.core for path in made if isinstance(path, DirectPath)]
        if len(direct) < len(made) or any(map(with_frames, paths, totals)):
            # Each linear system uses all threads; frames change from step to step.
            return [
                path.alone(asked) for path, asked in zip(paths, totals, strict=True)
            ]
        plain = [
            [(f, u, None if g is None else gaps_by_component(g)) for f, u, g in steps]
            for steps in totals
        ]
        followed = _core.follow(direct, plain, *chosen)
        parts = zip(paths, totals, followed, strict=True)
        return [path.through(asked, done) for path, asked, done in parts]

    def update(self, K: Any) -> None:
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
        stiffness = csr("K", K)
        n = self._shape[0]
        if stiffness.shape != (n, n):
            raise ValueError(
                f"K has shape {stiffness.shape}, expected ({n}, {n}) as before, including "
                "the prescribed degrees of freedom"
            )
        if self._loading.held is not None:
            from scipy.sparse import csr_array

            stiffness = csr("K", self._loading.held.stiffness(csr_array(K)))
        restored, known = self._with_digits(stiffness)
        found = self._looked_at(restored, self._given.gap)
        self._prepare(restored.parts, self._condensed)
        self._known = known
        self._remarks, self._strength = found

    def _with_digits(self, stiffness: Csr) -> tuple[Csr, Known | None]:
        """K with its rigid motions restored, and how far they were off."""
        if self._digits is None:
            return stiffness, None
        from scipy.sparse import csr_array

        parts, off = self._digits.restore(stiffness)
        matrix = csr_array(parts[::-1], shape=stiffness.shape)
        return Csr(matrix, stiffness.shape, parts), Known(self._digits, off)

    def _looked_at(
        self, stiffness: Csr, gap: Floats
    ) -> tuple[tuple[str, ...], remarks.Strength | None]:
        """Remarks on the arguments, and the stiffness of the bodies if it is known."""
        places, d = self._where, self._shape[2]
        outward, known, said = None, None, []
        # K with inclined supports has no rigid motions to compare with.
        if self._held is None:
            misplaced = dof_order.unlike(
                stiffness.parts, self._contact.parts, places, d
            )
            if misplaced is not None:
                warnings.warn(misplaced, stacklevel=3)
                said.append(misplaced)
            elif places is not None:
                with np.errstate(over="ignore", invalid="ignore"):
                    found = remarks.looked_at(stiffness, places, d)
                if found is not None:
                    outward, known = found
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
        self._parts = None

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
        self._on_forecast = on_forecast
        if self._asked == "iterative":
            self._chosen = "iterative", "it was asked for"
            self._tell_iterative()
        elif self._steps is not None:
            self._engine(self._steps, "auto")

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
        started = time.perf_counter()
        try:
            core = _core.Primal(parts, *given[:6])
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
        return Iterative(core, self._direct, (contacts, d))

    def _direct(self) -> Direct:
        """The direct engine; condenses if that was not done before."""
        if self._condensed is None:
            parts = self._parts
            if parts is None:
                raise ValueError("the stiffness of this problem is not available")
            self._condense(parts, None, self._on_forecast)
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

    def _of_digits(self, said: str, parts: Parts, dof: int) -> str:
        """Text to add to an error of the core if few digits of K may be its cause."""
        from bipot_rs.contact.stiffness_digits import OFFER, said_of_indefinite

        if "K is indefinite" in said:
            return said_of_indefinite(parts, self._fixed, dof, self._digits)
        few = "K has too few digits" in said and self._digits is None
        return OFFER if few else ""

    def _following(
        self,
        engine: Engine,
        mu: Floats,
        chosen: Settings,
        start: Result | Step | None,
        gap: ArrayLike | MovingGaps | Callable[[float], Any] | None = None,
    ) -> Following:
        shape, contacts = self._shape[1:], self._contacts | {"mu": mu}
        before, known = self._remarks, self._strength

        def said(steps: Sequence[Step]) -> tuple[str, ...]:
            return (*before, *remarks.of_path(steps, contacts, known))

        return Following(
            engine,
            contacts,
            mu,
            shape,
            chosen,
            start,
            condense=self._seconds,
            bodies=self._bodies,
            known=self._known,
            remarks=said,
            model=Differentiable(
                PathModel(
                    self._contact.matrix,
                    self._fixed,
                    np.shape(np.asarray(self._contacts["gap"])),
                    self._by_component(gap),
                    self._loading.held,
                )
            ),
        )

    def _by_component(
        self, gap: ArrayLike | MovingGaps | Callable[[float], Any] | None
    ) -> bool | None:
        """Whether the gaps of steps are by component; None without gaps of steps."""
        if gap is None:
            own = self._loading.gaps
            return None if own is None else self._gaps_by_component
        if isinstance(gap, MovingGaps):
            return False
        return callable(gap) or np.ndim(gap) == 3


def _of_components(given: Any, found: Floats | None, d: int) -> Floats | None:
    """Coordinates ``(n, d)`` of degrees of freedom; None if they are in another dimension."""
    if found is None or (d == 3 and np.shape(given)[1] == 2):
        return None
    if d == 2 and np.ptp(found[:, 2]) > 0:
        return None
    return np.ascontiguousarray(found[:, :d])


def _named(bodies: Mapping[str, int] | None, n: int) -> dict[str, int] | None:
    """Check the names of bodies and their first degrees of freedom."""
    if bodies is None:
        return None
    if not isinstance(bodies, Mapping):
        raise TypeError(
            f"bodies is a {type(bodies).__name__}, expected a mapping from each name to "
            "the first degree of freedom of the body"
        )
    found = {
        str(name): integer(f"bodies[{name!r}]", first, least=0, most=max(n - 1, 0))
        for name, first in bodies.items()
    }
    if len(set(found.values())) < len(found):
        raise ValueError(
            f"bodies is {found}, expected a different first degree of freedom for each"
        )
    return found
