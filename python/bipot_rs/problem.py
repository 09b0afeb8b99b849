"""The ways in: `ContactProblem`, `solve` and `project`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs import _core, motion
from bipot_rs.check import (
    Array,
    callback,
    choice_of_dimension,
    contact_array,
    csr,
    floats,
    frames,
    friction,
    indices,
    loads,
    settings,
    threads,
)
from bipot_rs.diagnosis import NEAR, Tried, diagnose
from bipot_rs.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.reduced import ReducedProblem, opening, solution_fields
from bipot_rs.result import Outcome, Result, Solution, Step
from bipot_rs.words import counted


def project(
    tau: ArrayLike, mu: ArrayLike, base: ArrayLike | None = None
) -> tuple[Array, NDArray[np.int8]]:
    """Project onto Coulomb's cone, contact by contact, in parallel.

    Parameters
    ----------
    tau
        Points to project, ``(n_c, d)``, normal first.
    mu
        Friction coefficient, a number or ``(n_c,)``.
    base
        Start state ``t0``, ``(n_c, d)``. With it ``tau`` is an increment, projected
        onto ``ΔK_μ = K_μ - t0`` [dSF91, 53].

    Returns
    -------
    t, status
        The projection ``(n_c, d)``, equation (12), and its `Status` ``(n_c,)``. With
        ``mu = 0`` a pressed contact is ``SLIP``.

    Raises
    ------
    TypeError, ValueError
        An argument of the wrong kind or shape, or not finite.
    """
    points = floats("tau", tau, ndim=2, copy=False)
    if points.shape[1] not in (2, 3):
        raise ValueError(f"tau has shape {points.shape}, expected (n_c, 2) or (n_c, 3)")
    coefficients = friction(mu, len(points))
    start = None if base is None else floats("base", base, shape=points.shape)
    if start is not None:
        with np.errstate(over="ignore"):
            total = points + start
        if not np.isfinite(total).all():
            raise ValueError("base + tau overflows, expected numbers below 1e300")
    return _core.project(points, coefficients, start)


class ContactProblem:
    """Bodies, contacts and supports, condensed onto the contact set once.

    ``K u = f + Bᵀ r``, ``v = B u + gap``, and Signorini's and Coulomb's laws between
    ``v`` and ``r`` at every contact: equations (1), (2) and (9).

    Parameters
    ----------
    K
        Stiffness, ``(n, n)``, symmetric positive semidefinite: anything SciPy calls
        sparse, or dense. Its lower triangle is read.
    B
        Contact operator, ``(d n_c, n)``: row ``d i + k`` is component ``k`` of contact
        ``i``, normal first, so that ``B u + gap`` is the relative displacement and
        ``Bᵀ r`` the force on the bodies.
    gap
        Normal gap, ``(n_c,)``, open when positive, or ``(n_c, d)`` to offset every
        component.
    mu
        Friction coefficient, a number or ``(n_c,)``.
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

    Raises
    ------
    TypeError, ValueError
        An argument of the wrong kind, shape or value, ``K`` not symmetric or
        indefinite; the message names the argument and the place.
    FloatingBodyError
        The contact set cannot hold a body.
    MemoryError
        The factor or ``W`` does not fit, with the figure, before it is allocated.
    """

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
    ) -> None:
        stiffness = csr("K", K)
        contact = csr("B", B)
        n = stiffness.shape[0]
        if stiffness.shape != (n, n):
            raise ValueError(f"K has shape {stiffness.shape}, expected a square matrix")
        if contact.shape[1] != n:
            raise ValueError(
                f"B has shape {contact.shape}, expected {counted(n, 'column')}, as many "
                "as K has rows"
            )
        offsets = floats("gap", gap)
        if offsets.ndim not in (1, 2):
            raise ValueError(
                f"gap has shape {offsets.shape}, expected (n_c,) or (n_c, d)"
            )
        contacts = len(offsets)
        d = choice_of_dimension(dim, contacts, contact.shape[0], offsets)
        whole = np.zeros((contacts, d))
        if offsets.ndim == 1:
            whole[:, 0] = offsets
        else:
            whole[:] = offsets
        areas = None if area is None else floats("area", area, shape=(contacts,))
        if areas is not None and not (areas > 0).all():
            at = int(np.argmin(areas > 0))
            raise ValueError(
                f"area of contact {at} is {areas[at]}, expected a positive number"
            )
        if num_threads is not None:
            num_threads = threads(num_threads)
        bases = frames(frame, contacts, d)
        coefficients = friction(mu, contacts)
        self._contacts: dict[str, NDArray[Any] | None] = {
            "x": contact_array("points", points, contacts, d),
            "normal": None if bases is None else bases[:, 0, :].copy(),
            "frame": bases,
            "area": areas,
            "gap": offsets,
            "mu": coefficients,
        }
        self._mu = coefficients
        self._fixed = indices("fixed", fixed, n)
        self._shape = (n, contacts, d)
        started = time.perf_counter()
        self._core = _core.Condensed(
            stiffness.parts,
            contact.parts,
            whole,
            coefficients,
            self._fixed,
            num_threads,
        )
        self._seconds = time.perf_counter() - started

    @property
    def compliance(self) -> Array:
        """The compliance ``W`` of (3), dense, ``(d n_c, d n_c)``.

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
        """Counts and seconds of the condensation."""
        return self._core.stats | {"seconds_condense": self._seconds}

    @property
    def rigid_motions(self) -> tuple[str, ...]:
        """In words, the motions that supports leave free and contact alone must hold.

        Directions are the axes ``x, y[, z]`` where ``frame`` is known, else those of the
        contacts, ``n, t1[, t2]``; the degree of freedom named is one that moves most.
        """
        _, contacts, d = self._shape
        modes = self._modes()
        bodies, dofs = (
            self.stats["rigid_motion_bodies"],
            self.stats["rigid_motion_dofs"],
        )
        axes = ("n", "t1", "t2")
        fields = modes.reshape(len(modes), contacts, d)
        frame = self._contacts["frame"]
        if frame is not None:
            axes = ("x", "y", "z")
            fields = np.einsum("kid,ide->kie", fields, frame)
        words: list[str] = []
        for body in dict.fromkeys(bodies):
            own = [k for k, b in enumerate(bodies) if b == body]
            words += motion.name_all(fields[own], axes, dofs[own[0]])
        return tuple(words)

    def reduced(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        start: Result | Step | None = None,
    ) -> ReducedProblem:
        """The reduced problem (5) of one step, from the unloaded state or from ``start``.

        Its ``W`` is sparse where separate bodies make most of it zero.

        Parameters
        ----------
        load, prescribed
            Totals at the end of the step, ``(n,)`` and ``(len(fixed),)``; missing is zero.
        start
            A `Result` or one of its steps, whose slip history is folded into ``q``.
        """
        n, contacts, d = self._shape
        steps = loads(load, prescribed, n, len(self._fixed))
        if len(steps) != 1:
            raise ValueError(
                f"load and prescribed have {counted(len(steps), 'step')}, expected one"
            )
        q, modes, force = self._core.free_part(*steps[0])
        before = _state(start, contacts, d)
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
            [dSF91, 79-81]), ``"uzawa_two_projection"`` ([dSF91, 82-87]).
        tol
            Residual η to reach; rounding may allow no less than `Solution.tolerance`.
        max_iterations, max_seconds
            Limits of one step.
        start
            A `Result` or one of its steps to continue from.
        on_step
            Called as ``on_step(k, step)`` after each step.

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
        """
        n, contacts, d = self._shape
        chosen = settings(method, tol, max_iterations, max_seconds)
        callback("on_step", on_step)
        totals = loads(load, prescribed, n, len(self._fixed))
        before = _state(start, contacts, d)
        path = _core.Path(
            self._core, _start(start, contacts, d, self.stats["rigid_motions"])
        )
        if before is not None and before.stats.get("bytes_beside_W", 0):
            # The inverse of W was made in a step before, and counted as its work.
            self._core.make_inverse()
        steps: list[Step] = []
        seconds = {"condense": self._seconds, "solve": 0.0, "recover": 0.0}

        def recover(load: Array, prescribed: Array, step: Step) -> Array:
            began = time.perf_counter()
            rigid = np.empty(0) if step.rigid_motion is None else step.rigid_motion
            u = self._core.displacement(load, prescribed, step.reaction, rigid)
            seconds["recover"] += time.perf_counter() - began
            return u

        last = None if before is None else before.relative_displacement

        def result(success: bool, message: str) -> Result:
            made = Result(
                steps,
                contacts=self._contacts,
                shape=(contacts, d),
                start=before,
                seconds=None,
                success=success,
                message=message,
            )
            made.seconds = seconds  # filled further when displacements are asked for
            return made

        for k, (force, moved) in enumerate(totals):
            began = time.perf_counter()
            try:
                raw = path.step(force, moved, *chosen)
            except NoEquilibriumError as error:
                message = f"step {k}: {error}"
                raise NoEquilibriumError(message, result(False, message)) from None
            seconds["solve"] += time.perf_counter() - began
            step = self._step(
                raw,
                force,
                moved,
                partial(recover, force, moved),
                _StepProblem(
                    self._core,
                    force,
                    moved,
                    last,
                    self._tried(method, chosen[3], force, moved, last),
                ),
            )
            if not step.converged:
                message = f"step {k}: {step.message}"
                none = step.outcome is Outcome.NO_EQUILIBRIUM
                raise (NoEquilibriumError if none else NotConvergedError)(
                    message, result(False, message), self._direction(step.free_motion)
                )
            steps.append(step)
            last = step.relative_displacement
            if on_step is not None:
                on_step(k, step)
        count = len(steps)
        return result(True, f"{count} step{'' if count == 1 else 's'} converged")

    def _tried(
        self,
        method: str,
        max_seconds: float | None,
        load: Array,
        prescribed: Array,
        before: Array | None,
    ) -> Tried:
        core = self._core

        def several(step: Solution) -> bool:
            asked = load, prescribed, before, step.reaction
            near = step.residual <= NEAR
            return near and _core.assess_step(core, *asked) == "others exist"

        return Tried(
            method=method,
            max_seconds=max_seconds,
            mu=self._mu,
            W=core.compliance,
            modes=lambda: self._modes().T,
            several=several,
            condition=lambda: float(core.stats["cond_S"]),
            points=self._contacts["x"],
        )

    def _modes(self) -> Array:
        """Rigid motions at the contacts, ``(k, d n_c)``."""
        n = self._shape[0]
        return self._core.free_part(np.zeros(n), np.zeros(len(self._fixed)))[1]

    def _direction(self, amounts: Array | None) -> Array | None:
        if amounts is None:
            return None
        return motion.at_contacts(self._modes(), amounts, self._shape[2])

    def _words(self, raw: dict[str, Any]) -> str:
        """The free motion in words, body by body."""
        amounts = raw["free_motion"]
        if not len(amounts):
            return ""
        _, contacts, d = self._shape
        modes = self._modes()
        felt = np.abs(modes.reshape(len(modes), contacts, d)).max(axis=2) > 0
        stats = self.stats
        owners = stats["rigid_motion_bodies"]
        # A body is known by a degree of freedom that a motion of it moves most.
        names: dict[int, str] = {}
        for body, dof in zip(owners, stats["rigid_motion_dofs"], strict=True):
            names.setdefault(body, f"the body of degree of freedom {dof}")
        meeting = [
            tuple(dict.fromkeys(names[owners[k]] for k in np.flatnonzero(felt[:, i])))
            for i in range(contacts)
        ]
        return motion.describe(
            motion.at_contacts(modes, amounts, d),
            opening(raw, self._mu),
            points=self._contacts["x"],
            frame=self._contacts["frame"],
            bodies=meeting,
        )

    def _step(
        self,
        raw: dict[str, Any],
        load: Array,
        prescribed: Array,
        recover: Callable[[Step], Array],
        inquiry: _StepProblem,
    ) -> Step:
        area = self._contacts["area"]
        return Step(
            **solution_fields(raw),
            _words=self._words(raw),
            slip=raw["slip"],
            load=load,
            prescribed=prescribed,
            traction=None if area is None else raw["reaction"] / area[:, None],
            _recover=recover,
            _problem=inquiry,
        )


@dataclass(frozen=True)
class _StepProblem:
    """The problem of one step, for what is found out of its solution when asked for."""

    core: _core.Condensed
    load: Array
    prescribed: Array
    before: Array | None
    tried: Tried

    def unique(self, step: Solution, /) -> str:
        return _core.assess_step(
            self.core, self.load, self.prescribed, self.before, step.reaction
        )

    def error_estimate(self, step: Solution, /) -> tuple[float, float] | None:
        motion = np.empty(0) if step.rigid_motion is None else step.rigid_motion
        return _core.forward_errors_of_step(
            self.core, self.load, self.prescribed, self.before, step.reaction, motion
        )

    def diagnosis(self, step: Any, /) -> str:
        # The law of a step is on its slip, not on where the contact has been before.
        v = np.column_stack([step.relative_displacement[:, 0], step.slip])
        return diagnose(self.tried, step, v)


def _state(start: Result | Step | None, contacts: int, d: int) -> Step | None:
    """The step to continue from, checked."""
    if start is None:
        return None
    step = start
    if isinstance(start, Result):
        if not len(start):
            # Nothing was added to what that path itself started from.
            return start.start
        step = start[-1]
    if not isinstance(step, Step):
        raise TypeError(
            f"start is a {type(start).__name__}, expected a Result or one of its steps"
        )
    if step.reaction.shape != (contacts, d):
        raise ValueError(
            f"start has reactions of shape {step.reaction.shape}, expected {(contacts, d)}"
        )
    return step


def _start(
    start: Result | Step | None, contacts: int, d: int, motions: int
) -> tuple[Array, Array, NDArray[np.int8], Array] | None:
    step = _state(start, contacts, d)
    if step is None:
        return None
    rigid = np.empty(0) if step.rigid_motion is None else step.rigid_motion
    if len(rigid) != motions:
        raise ValueError(
            f"start has {counted(len(rigid), 'rigid motion')}, this problem {motions}"
        )
    return step.reaction, step.relative_displacement, step.status, rigid


def solve(
    K: Any,
    B: Any,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
    *,
    gap: ArrayLike,
    mu: ArrayLike,
    fixed: ArrayLike | None = None,
    area: ArrayLike | None = None,
    dim: int | None = None,
    num_threads: int | None = None,
    points: ArrayLike | None = None,
    frame: ArrayLike | None = None,
    **settings: Any,
) -> Result:
    """``ContactProblem(K, B, ...).solve(load, prescribed, ...)`` in one call.

    ``settings`` are the keywords of `ContactProblem.solve`; see there and at
    `ContactProblem` for arguments, results and errors.
    """
    problem = ContactProblem(
        K,
        B,
        gap=gap,
        mu=mu,
        fixed=fixed,
        area=area,
        dim=dim,
        num_threads=num_threads,
        points=points,
        frame=frame,
    )
    return problem.solve(load, prescribed, **settings)
