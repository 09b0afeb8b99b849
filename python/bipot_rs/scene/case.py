"""A scene as arrays, and its loads at any point of the load path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import instead
from bipot_rs._lib.short_repr import short_repr
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import iteration_limit
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.frames import of_step
from bipot_rs.contact.path.choice import ADAPTIVE_STEPS
from bipot_rs.contact.path.load_steps import Totals, find_difference, last_step
from bipot_rs.contact.path.moving_gaps import MovingGaps, drop_equal_frames, join_steps
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.stress_recovery import Initial, stress
from bipot_rs.fem.checks.free_bodies import unheld
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.references import reference_named
from bipot_rs.obstacle.motion import Motion
from bipot_rs.scene.schema.contact import Rigid
from bipot_rs.scene.schema.load import Pressure
from bipot_rs.scene.schema.path import LoadPath
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import Varying

if TYPE_CHECKING:
    from bipot_rs.contact.wear.record import Wear


@dataclass(frozen=True)
class Load:
    """A force per area of a surface, or per volume of a body, along a path.

    Attributes
    ----------
    body
        Index of the body.
    facets : (m,) or None
        Facets of its mesh; None for a force per volume.
    density : (d,) or (m, d)
        Force per area or volume for factor 1, the same everywhere or one for each facet.
    history : (steps,)
        Factor at the end of each load step.
    nodal : (n,) or None
        Nodal forces for factor 1.
    number
        The value and amplitude in the scene, from which the factor is computed.
    strain
        For an initial strain: the strain for factor 1.
    """

    body: int
    facets: Ints | None
    density: Floats
    history: Floats
    nodal: Floats | None = None
    number: Varying | Pressure | None = None
    strain: Initial | None = None

    __repr__ = short_repr


@dataclass(frozen=True)
class Case:
    """A scene as arrays: what `ContactProblem` takes, and its load path.

    Attributes
    ----------
    model
        K, B, gap, … (`fem.Assembly`).
    load : (steps, n) or None
        Total nodal forces at the end of each load step [N]; None without loads.
    prescribed : (steps, len(model.fixed))
        Total prescribed displacements at the end of each load step [m].
    parameter : (steps,)
        Path parameter of the scene.
    loads : tuple of Load
        The loads whose nodal forces add up to `load`.
    scene : Scene or None
        The scene that this case was made from.
    gaps : (steps, n_c, d), MovingGaps or None
        If obstacles move: gaps at each load step [m], as `fem.Assembly.gaps`.
    """

    model: Assembly
    load: Floats | None
    prescribed: Floats
    parameter: Floats
    loads: tuple[Load, ...] = ()
    scene: Scene | None = None
    gaps: Floats | MovingGaps | None = None

    __repr__ = short_repr

    def released(self, problem: ContactProblem) -> Case:
        """The same without K, if ``problem`` does not need it: see `Assembly.released`."""
        return replace(self, model=self.model.released(problem))

    def problem(
        self,
        *,
        num_threads: int | None = None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
        engine: str | None = None,
    ) -> ContactProblem:
        """Make the `ContactProblem` of these arrays.

        Parameters
        ----------
        num_threads, on_forecast, engine
            As in `ContactProblem`. The default of ``engine`` is that of the scene.

        Raises
        ------
        FloatingBodyError
            A body can move without deforming supports or contacts; the message says
            which body and how.
        """
        if engine is None:
            engine = "auto" if self.scene is None else self.scene.solver.engine
        if engine == "petsc":
            raise ValueError(
                "engine is 'petsc', which solves scenes by bipot run, under mpirun for "
                "several processes; here use 'auto', 'direct' or 'iterative', or make a "
                "bipot_rs.petsc.ContactProblem"
            )
        try:
            return self.model.problem(
                num_threads=num_threads,
                on_forecast=on_forecast,
                engine=engine,
                steps=self._steps(),
            )
        except FloatingBodyError as error:
            # The core names a degree of freedom only. `unheld` names bodies, but it
            # does not see a free part within a body.
            problems = list(unheld(self.model, rough=True))
            if not problems:
                raise
            named = FloatingBodyError("; ".join(problems))
            named.dof = error.dof
            raise named from None

    def _steps(self) -> int:
        """About as many load steps as the path takes."""
        if self.scene is not None and self.scene.wear is not None:
            return len(self.parameter) * self.scene.wear.cycles
        adaptive = self.scene is not None and self.scene.path.increments is not None
        return len(self.parameter) * (ADAPTIVE_STEPS if adaptive else 1)

    def sampled(self, t: ArrayLike) -> Case:
        """Copy with load steps that end at ``t``; load step k of the scene ends at k + 1.

        Between load steps, tables are interpolated linearly and waves evaluated. In the
        first load step all loads grow linearly from zero at ``t = 0``.
        """
        if self.scene is None:
            raise ValueError(
                "this case was made without a scene: loads between its steps are unknown"
            )
        return along(self.scene, self.model, self.loads, np.atleast_1d(np.asarray(t)))

    def solve(
        self,
        problem: ContactProblem | None = None,
        *,
        method: str | None = None,
        tol: float | None = None,
        max_iterations: int | None = None,
        start: Result | Step | None = None,
        first: int = 0,
        on_step: Callable[[int, Step], object] | None = None,
        maxiter: int | None = None,
    ) -> Result:
        """Solve the path with the settings of the scene, by given or automatic steps.

        Parameters
        ----------
        problem
            `problem` of this case, if it was made before.
        method, tol, max_iterations
            Replace the settings of the scene.
        maxiter
            Another name of ``max_iterations``, that of SciPy.
        start
            State that an earlier run reached after `first` steps.
        first
            Number of load steps already solved.
        on_step
            Called as ``on_step(k, step)``, k counted from ``first``.

        Raises
        ------
        NoEquilibriumError, NotConvergedError
            As `ContactProblem.solve` and `ContactProblem.follow`.
        """
        if self.scene is None:
            raise ValueError(
                "this case was made without a scene: use problem().solve(...) instead"
            )
        if self.scene.wear is not None:
            raise ValueError(
                "the scene has [wear], which `bipot run` and Case.wear solve, as in "
                "model.assemble().wear(); remove it to solve the load path once"
            )
        limit = iteration_limit(max_iterations, maxiter)
        chosen = self._settings(method, tol, limit)
        chosen |= {"start": start, "on_step": on_step}
        asked = self.problem() if problem is None else problem
        plan = self.scene.path.increments
        if plan is None:
            self._check_start(start, first)
            rest = slice(first, None)
            return asked.solve(*self._part(rest), gap=self._gaps_of(rest), **chosen)
        steps = self.scene.path.count()
        known: dict[float, Totals] = {}

        def at(t: float) -> Totals:
            # Called three times for each t: for load, displacement and gap.
            if t not in known:
                known.clear()
                known[t] = self._at(t)
            return known[t]

        def gap(t: float) -> Floats | MovingGaps:
            found = at(t)[2]
            return self.model.gap if found is None else found

        return asked.follow(
            lambda t: at(t)[0],
            lambda t: at(t)[1],
            stops=np.arange(1.0, steps + 1),
            first=plan.largest if plan.first is None else plan.first,
            largest=plan.largest,
            smallest=plan.smallest,
            slip=plan.slip,
            gap=None if self.gaps is None else gap,
            **chosen,
        )

    def wear(
        self,
        problem: ContactProblem | None = None,
        *,
        method: str | None = None,
        tol: float | None = None,
        max_iterations: int | None = None,
        on_cycle: Callable[[int, Step], object] | None = None,
        maxiter: int | None = None,
    ) -> Wear:
        """Solve the load steps before the cycle, then the cycles of the table ``[wear]``.

        Parameters
        ----------
        problem, method, tol, max_iterations, maxiter
            As in `solve`.
        on_cycle
            As in `ContactProblem.wear`.

        Raises
        ------
        ValueError
            The scene has no ``[wear]``.
        NoEquilibriumError, NotConvergedError
            As `ContactProblem.solve` and `ContactProblem.wear`.
        """
        table = None if self.scene is None else self.scene.wear
        if table is None:
            raise ValueError("the scene has no [wear], expected coefficient and cycles")
        limit = iteration_limit(max_iterations, maxiter)
        chosen = self._settings(method, tol, limit)
        asked = self.problem() if problem is None else problem
        count = len(self.parameter)
        once = slice(0, count - (table.steps or count))
        cycle = slice(once.stop, count)
        start = None
        if once.stop:
            start = asked.solve(*self._part(once), gap=self._gaps_of(once), **chosen)
        return asked.wear(
            *self._part(cycle),
            gap=self._gaps_of(cycle),
            coefficient=table.coefficient,
            cycles=table.cycles,
            jump=table.jump,
            rtol=table.rtol,
            start=start,
            on_cycle=on_cycle,
            **chosen,
        )

    def _settings(
        self, method: str | None, tol: float | None, max_iterations: int | None
    ) -> dict[str, Any]:
        """Settings of the solver: those given, else those of the scene."""
        if self.scene is None:
            raise ValueError("this case was made without a scene")
        settings = self.scene.solver
        tolerance = settings.tol if tol is None else tol
        if isinstance(tolerance, str):
            raise ValueError(
                f"tol is {tolerance!r}, expected a number; only `bipot run` computes tol "
                "from the mesh"
            )
        limit = settings.max_iterations if max_iterations is None else max_iterations
        return {
            "method": settings.method if method is None else method,
            "tol": tolerance,
            "max_iterations": limit,
        }

    def _part(self, steps: slice) -> tuple[Floats | None, Floats]:
        """Loads and prescribed displacements of some load steps."""
        return None if self.load is None else self.load[steps], self.prescribed[steps]

    def _gaps_of(self, steps: slice) -> Floats | MovingGaps | None:
        return None if self.gaps is None else self.gaps[steps]

    def _check_start(self, start: Result | Step | None, first: int) -> None:
        """Refuse a start whose last loads are not those of this path."""
        last = last_step(start)
        if last is None or not first:
            return
        nothing = np.zeros(self.model.n)
        own = {
            "load": nothing if self.load is None else self.load[first - 1],
            "prescribed": self.prescribed[first - 1],
            "gap": None if self.gaps is None else self.gaps[first - 1],
        }
        other = find_difference(last, own)
        if other is not None:
            raise ValueError(
                f"start belongs to another path: its {other} is not that of load step "
                f"{first} of this path"
            )

    def remarks(self) -> list[str]:
        """Warnings before solving, one sentence each (`fem.inspection`)."""
        strained = sum(
            np.outer(one.history, one.nodal)
            for one in self.loads
            if one.strain is not None and one.nodal is not None
        )
        found = inspect(
            self.model, load=self.load, prescribed=self.prescribed, strained=strained
        )
        if (
            self.load is None
            and self.gaps is None
            and not np.any(self.prescribed)
            and not (self.model.gap < 0).any()
        ):
            found.append(
                "nothing moves: there is no load, all prescribed displacements are zero, "
                "and no obstacle moves or penetrates"
            )
        if self.scene is not None and self.scene.lacks_n():
            found.append("mesh.n: has no effect, since no body uses n")
        return found

    def stress_at_rest(self, step: int | Step) -> Floats | None:
        """Stress of the initial strains at zero displacement, ``(cells, 3, 3)`` [Pa].

        Mean over each cell of all bodies, at the end of a load step; None without initial
        strains. The total stress is this plus the stress of the displacements.
        """
        acting = [load for load in self.loads if load.strain is not None]
        if not acting:
            return None
        if isinstance(step, Step) and step.cycle is not None:
            step = len(self.parameter) - 1
        if isinstance(step, Step):
            if step.s is None:
                raise ValueError(
                    "step is a Step of the given load steps: pass its index"
                )
            return self.sampled(step.s).stress_at_rest(0)
        counts = [int(body.mesh.t.shape[1]) for body in self.model.bodies]
        ends = np.cumsum([0, *counts])
        found = np.zeros((ends[-1], 3, 3))
        for load in acting:
            body = self.model.bodies[load.body]
            still = np.zeros(body.points.size)
            unit = stress(body, still, load.strain, space=True)
            found[ends[load.body] : ends[load.body + 1]] += load.history[step] * unit
        return found

    def rest_of(self, k: int, step: Step) -> Floats | None:
        """`stress_at_rest` of step ``k`` of a result."""
        given = step.s is None and step.cycle is None
        return self.stress_at_rest(k if given else step)

    def step_parameter(self, k: int, step: Step) -> float:
        """Path parameter of the scene at the end of step ``k`` of a result."""
        if step.cycle is not None:
            # The end of a cycle.
            return float(self.parameter[-1])
        if step.s is None:
            return float(self.parameter[k])
        if self.scene is None:
            return step.s
        return float(_parameter(self.scene.path, np.array([step.s]))[0])

    def loaded(self, result: Sequence[Step]) -> list[Step]:
        """Add the loads to steps read from a file, which does not store them."""
        nothing = np.zeros(self.model.n)
        found = []
        for k, step in enumerate(result):
            if step.s is None:
                load = None if self.load is None else self.load[k]
                moved = self.prescribed[k]
            else:
                load, moved, _ = self._at(step.s)
            found.append(
                replace(step, load=nothing if load is None else load, prescribed=moved)
            )
        return found

    def _at(self, t: float) -> Totals:
        case = self.sampled(t)
        load = np.zeros(self.model.n) if case.load is None else case.load[0]
        return load, case.prescribed[0], None if case.gaps is None else case.gaps[0]

    def contacts_of(self, name: str) -> Ints:
        """Numbers of the contacts on a surface ``"body.surface"``, ascending.

        The surface is ``on`` of the contact's table: its nodes are the contacts.

        Raises
        ------
        ValueError
            No contact is on it; the message lists the surfaces with contacts.
        """
        known = self.contacts
        if name not in known:
            raise ValueError(f"there is no contact on {name!r}{instead(name, known)}")
        return known[name]

    @property
    def contacts(self) -> dict[str, Ints]:
        """Numbers of the contacts on each surface that has contacts."""
        names = [f"{c.body}.{c.surface}" for c in self.model.contacts]
        own = np.array(names)[self.model.group]
        return {name: np.flatnonzero(own == name) for name in dict.fromkeys(names)}

    def contact_force(self, result: Result, name: str) -> Floats:
        """Force of the contacts on a surface on its body, ``(steps, d)`` [N].

        In global components.
        """
        contacts = self.contacts_of(name)
        found = np.zeros((len(result), self.model.dim))
        for force, step in zip(found, result, strict=True):
            frame = of_step(step, self.model.frame)[contacts]
            force[:] = np.einsum("ck,ckd->d", step.reaction[contacts], frame)
        return found

    def support_force(self, result: Result, name: str) -> Floats:
        """Force of the supports on a surface on their body, ``(steps, d)`` [N].

        ``K u - f - Bᵀ r`` at the prescribed degrees of freedom, in global components. One
        that several supports prescribe counts once in each surface.

        Raises
        ------
        ValueError
            No support is on it; the message lists the surfaces with supports.
        """
        model = self.model
        names = [
            s.body if s.surface is None else f"{s.body}.{s.surface}"
            for s in model.supports
        ]
        mine = [
            d
            for d, known in zip(model.support_dofs, names, strict=True)
            if known == name
        ]
        if not mine:
            raise ValueError(
                f"there is no support on {name!r}" + instead(name, dict.fromkeys(names))
            )
        dofs = np.unique(np.concatenate([d.ravel() for d in mine]))
        found = np.zeros((len(result), model.dim))
        for force, step in zip(found, result, strict=True):
            out = model.K[dofs] @ step.displacement
            out -= model.in_step(step).B[:, dofs].T @ step.reaction.ravel()
            if step.load is not None:
                out -= step.load[dofs]
            np.add.at(force, dofs % model.dim, out)
        return found

    def reference_motion(self, result: Result, name: str) -> tuple[Floats, Floats]:
        """Translation ``(steps, d)`` and rotation ``(steps, 3)`` of a reference point.

        Parameters
        ----------
        result
            Result of this case, with displacements.
        name
            An obstacle with a force: its translation in addition to its ``move``, and no
            rotation. Or a remote that is not distributed: translation [m] and rotation
            [rad], in the plane ``(steps, 1)``.

        Raises
        ------
        ValueError
            There is no such reference point; the message lists the known ones.
        """
        return self.model.reference_motion(
            name, np.stack([step.displacement for step in result])
        )

    def reference_force(self, result: Result, name: str) -> tuple[Floats, Floats]:
        """Total force ``(steps, d)`` [N] and moment at a reference point [N m].

        ``K u - Bᵀ r`` at its degrees of freedom: the loads, and the reactions of its
        prescribed components, which balance the contact forces of an obstacle and the
        stress at a rigid set. Arguments and errors as `reference_motion`; the moment has
        the shape of the rotation. A component that a support on nodes of the set
        determines is zero here: its reaction is in `support_force`. So is one that another
        set with common nodes determines: its load is part of the force of that set.
        """
        model = self.model
        one = reference_named(model.references, name)
        dofs = np.concatenate([one.dofs, one.turns])
        carried = np.ones(len(dofs))
        if model.ties is not None:
            carried[np.isin(dofs, model.ties.dependent)] = 0.0
        K = model.K[dofs]
        force = np.stack(
            [
                K @ step.displacement
                - model.in_step(step).B[:, dofs].T @ step.reaction.ravel()
                for step in result
            ]
        )
        force *= carried
        d = model.dim
        return force[:, :d], force[:, d:] * (one.arm or 1.0)


def along(scene: Scene, model: Assembly, loads: Sequence[Load], t: Floats) -> Case:
    """Make the case whose load steps end at ``t (steps,)``."""
    count = scene.path.count()
    if not ((t >= 0) & (t <= count)).all():
        raise ValueError(
            f"t is {t.tolist()}, expected values from 0 to {count}, the number of load "
            "steps"
        )
    history = _histories(scene.path, t)
    load = np.zeros((len(t), model.n))
    acting = []
    for one in loads:
        if one.number is None or one.nodal is None:
            raise ValueError("loads holds one without number, not made from a scene")
        acting.append(replace(one, history=history(one.number)))
        np.add(load, np.outer(acting[-1].history, one.nodal), out=load)
    rows = [[history(v) for v in s.components().values()] for s in scene.support]
    points = {
        name: [history(v) for v in remote.given().get("move", {}).values()]
        + [np.deg2rad(history(v)) for v in remote.given().get("turn", {}).values()]
        for name, remote in scene.remote.items()
        if not remote.distributed
    }
    prescribed = [
        model.prescribed(
            [[float(h[step]) for h in row] for row in rows],
            {name: [float(h[step]) for h in row] for name, row in points.items()},
        )
        for step in range(len(t))
    ]
    return Case(
        model=model,
        load=load if load.any() else None,
        prescribed=np.array(prescribed).reshape(len(t), len(model.fixed)),
        parameter=_parameter(scene.path, t),
        loads=tuple(acting),
        scene=scene,
        gaps=_gaps(scene, model, t),
    )


def _histories(path: LoadPath, t: Floats) -> Callable[[Varying | Pressure], Floats]:
    """Function that evaluates a number of the scene at the ends ``t`` of steps."""
    factor = {name: a.at(t, path.count()) for name, a in path.amplitude.items()}
    # Without an amplitude a number grows in the first load step and then stays constant.
    constant = np.minimum(t, 1.0)

    def history(number: Varying | Pressure) -> Floats:
        found: Floats = number.value * (
            factor[number.amplitude] if number.amplitude else constant
        )
        return found

    return history


def _parameter(path: LoadPath, t: Floats) -> Floats:
    if path.parameter is None:
        return t.astype(np.float64)
    return path.amplitude[path.parameter].at(t, path.count())


def motion_of(rigid: Rigid, path: LoadPath, t: Floats) -> Motion | None:
    """Motion of an obstacle at the ends ``t`` of steps; None if it is at rest."""
    if rigid.move is None and rigid.turn is None:
        return None
    history = _histories(path, t)
    turn = rigid.turn
    about = turn.about if turn is not None and turn.about else rigid.centre
    axis = None if turn is None else turn.axis
    moved = {} if rigid.move is None else rigid.move.components()
    # The file of a surface has not been read here: z or an axis means three dimensions.
    in_space = 2 in moved or axis is not None
    dim = len(about) if about else 3 if in_space else 2
    translation = np.zeros((len(t), dim))
    for k, number in moved.items():
        translation[:, k] = history(number)
    return Motion(
        translation,
        None if turn is None else history(turn.angle),
        about=None if turn is None else about,
        axis=axis,
        degrees=True,
    )


def _gaps(scene: Scene, model: Assembly, t: Floats) -> Floats | MovingGaps | None:
    """Gaps at the ends of steps; None if no obstacle moves."""
    whole = model.gaps(scene.path.count())
    if whole is None:
        return None
    found = []
    for place in t:
        before = int(place)
        if before == place and before > 0:
            ended = model.placed_between(before, [None] * len(scene.contact))
        else:
            ends = np.array([before, place], np.float64)
            motions = [
                motion_of(scene.obstacle[c.obstacle], scene.path, ends)
                if c.obstacle
                else None
                for c in scene.contact
            ]
            ended = model.placed_between(before, motions)
        if ended is not None:
            found.append(ended)
    return drop_equal_frames(join_steps(found), model.frame)
