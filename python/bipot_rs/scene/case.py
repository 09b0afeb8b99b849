"""A scene as arrays, and its loads at any point of the load path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats, Record
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import FloatingBodyError, with_message
from bipot_rs.contact.path.load_path import show_progress
from bipot_rs.contact.path.load_steps import Totals, find_difference, last_step
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem.assembly.assemble import assemble as assemble_model
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.stress_recovery import stress
from bipot_rs.fem.checks.free_bodies import describe_free_bodies
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.scene.build import LoadHistory, make_loads, make_parts
from bipot_rs.scene.histories import Histories
from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError
from bipot_rs.scene.schema.root import Scene

if TYPE_CHECKING:
    from bipot_rs.contact.wear.record import Wear

    class _SolverSettings(TypedDict):
        method: str
        tol: float
        max_iterations: int | None


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
    loads : tuple of LoadHistory
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
    loads: tuple[LoadHistory, ...] = ()
    scene: Scene | None = None
    gaps: Floats | MovingGaps | None = None

    __repr__ = short_repr

    def released(self, problem: ContactProblem) -> Case:
        """The same without K, if ``problem`` does not need it: see `Assembly.released`."""
        return replace(self, model=self.model.released(problem))

    def with_stiffness(self, engine: str | None = None) -> Case:
        """The same with K, unless the engine that will solve reads it in parts."""
        engine = self._engine(engine)
        if self.model.K is not None or self.model.reads_parts(engine, self._steps()):
            return self
        return replace(self, model=self.model.with_stiffness())

    def _engine(self, engine: str | None) -> str:
        if engine is not None:
            return engine
        return "auto" if self.scene is None else self.scene.solver.engine

    def problem(
        self,
        *,
        num_threads: int | None = None,
        on_forecast: Callable[[Record], object] | None = None,
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
        engine = self._engine(engine)
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
            # The core names a degree of freedom only. `describe_free_bodies` names bodies, but it
            # does not see a free part within a body.
            problems = list(describe_free_bodies(self.model, rough=True))
            if not problems:
                raise
            raise with_message(error, "; ".join(problems)) from None

    def _steps(self) -> int:
        """About as many load steps as the path takes."""
        if self.scene is not None and self.scene.wear is not None:
            return len(self.parameter) * self.scene.wear.cycles
        adaptive = self.scene is not None and self.scene.path.increments is not None
        return len(self.parameter) * (tuning.ADAPTIVE_STEPS if adaptive else 1)

    def sampled(self, t: ArrayLike) -> Case:
        """Copy with load steps that end at ``t``; load step k of the scene ends at k + 1.

        Between load steps, tables are interpolated linearly and waves evaluated. In the
        first load step all loads grow linearly from zero at ``t = 0``.
        """
        if self.scene is None:
            raise ValueError(
                "this case was made without a scene: loads between its steps are unknown"
            )
        histories = Histories(self.scene, np.atleast_1d(np.asarray(t)))
        return _make_case(self.scene, self.model, self.loads, histories)

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
        progress: bool = False,
    ) -> Result:
        """Solve the path with the settings of the scene, by given or automatic steps.

        Parameters
        ----------
        problem
            `problem` of this case, if it was made before.
        method, tol, max_iterations
            Replace the settings of the scene.
        start
            State that an earlier run reached after `first` steps.
        first
            Number of load steps already solved.
        on_step
            Called as ``on_step(k, step)``, k counted from ``first``.
        progress
            As in `ContactProblem.solve`.

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
        chosen = self._settings(method, tol, max_iterations)
        asked = self.problem() if problem is None else problem
        plan = self.scene.path.increments
        if plan is None:
            self._check_start(start, first)
            rest = slice(first, None)
            left = len(self.parameter[rest])
            # Not by the problem: that of several processes prints its steps itself.
            with show_progress(progress, left, on_step) as report:
                return asked.solve(
                    *self._part(rest),
                    gap=self._gaps_of(rest),
                    start=start,
                    on_step=report,
                    **chosen,
                )
        steps = self.scene.path.count()
        totals: dict[float, Totals] = {}

        def at(t: float) -> Totals:
            # Called three times for each t: for load, displacement and gap.
            if t not in totals:
                totals.clear()
                totals[t] = self._at(t)
            return totals[t]

        def gap(t: float) -> Floats | MovingGaps:
            gap_of_step = at(t)[2]
            return self.model.gap if gap_of_step is None else gap_of_step

        with show_progress(progress, steps, on_step) as report:
            return asked.follow(
                lambda t: at(t)[0],
                lambda t: at(t)[1],
                stops=np.arange(1.0, steps + 1),
                first=plan.largest if plan.first is None else plan.first,
                largest=plan.largest,
                smallest=plan.smallest,
                slip=plan.slip,
                gap=None if self.gaps is None else gap,
                start=start,
                on_step=report,
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
    ) -> Wear:
        """Solve the load steps before the cycle, then the cycles of the table ``[wear]``.

        Parameters
        ----------
        problem, method, tol, max_iterations
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
        chosen = self._settings(method, tol, max_iterations)
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
    ) -> _SolverSettings:
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
        totals = {
            "load": nothing if self.load is None else self.load[first - 1],
            "prescribed": self.prescribed[first - 1],
            "gap": None if self.gaps is None else self.gaps[first - 1],
        }
        other = find_difference(last, totals)
        if other is not None:
            raise ValueError(
                f"start belongs to another path: its {other} is not that of load step "
                f"{first} of this path"
            )

    def remarks(self) -> list[str]:
        """Warnings before solving, one sentence each (`fem.inspection`)."""
        strained = sum(
            np.outer(acting.history, acting.nodal)
            for acting in self.loads
            if acting.load is not None and acting.load.strain is not None
        )
        remarks = inspect(
            self.model,
            load=self.load,
            prescribed=self.prescribed,
            strained=strained,
        )
        if (
            self.load is None
            and self.gaps is None
            and not np.any(np.nan_to_num(self.prescribed))
            and not (self.model.gap < 0).any()
        ):
            remarks.append(
                "nothing moves: there is no load, all prescribed displacements are zero, "
                "and no obstacle moves or penetrates"
            )
        if self.scene is not None:
            remarks += [
                f"{key}: has no effect, since no formula uses it"
                for key in self.scene.unused()
            ]
        return remarks

    def describe_unbalanced(self) -> str | None:
        """The first load step that contact cannot carry, described; None if there is none."""
        if self.load is None:
            return None
        from bipot_rs.fem.checks.free_bodies import describe_unbalanced

        return describe_unbalanced(self.model, self.load, self.gaps)

    def stress_at_rest(self, step: int | Step) -> Floats | None:
        """Stress of the initial strains at zero displacement, ``(cells, 3, 3)`` [Pa].

        Mean over each cell of all bodies, at the end of a load step; None without initial
        strains. The total stress is this plus the stress of the displacements.
        """
        acting = [
            (load_case.load, load_case.history)
            for load_case in self.loads
            if load_case.load is not None and load_case.load.strain is not None
        ]
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
        stress_of_cells = np.zeros((ends[-1], 3, 3))
        for load, history in acting:
            numbered = self.model.numbered[load.body]
            body, b = numbered.body, numbered.index
            still = np.zeros(body.points.size)
            unit = stress(body, still, load.strain, space=True)
            stress_of_cells[ends[b] : ends[b + 1]] += history[step] * unit
        return stress_of_cells

    def rest_of(self, k: int, step: Step) -> Floats | None:
        """`stress_at_rest` of step ``k`` of a result."""
        is_last = step.s is None and step.cycle is None
        return self.stress_at_rest(k if is_last else step)

    def step_parameter(self, k: int, step: Step) -> float:
        """Path parameter of the scene at the end of step ``k`` of a result."""
        if step.cycle is not None:
            # The end of a cycle.
            return float(self.parameter[-1])
        if step.s is None:
            return float(self.parameter[k])
        if self.scene is None:
            return step.s
        return float(Histories(self.scene, np.array([step.s])).parameter[0])

    def add_loads(self, result: Sequence[Step]) -> list[Step]:
        """Add the loads to steps read from a file, which does not store them."""
        nothing = np.zeros(self.model.n)
        loads = []
        for k, step in enumerate(result):
            if step.s is None:
                load = None if self.load is None else self.load[k]
                moved = self.prescribed[k]
            else:
                load, moved, _ = self._at(step.s)
            loads.append(
                replace(step, load=nothing if load is None else load, prescribed=moved)
            )
        return loads

    def _at(self, t: float) -> Totals:
        case = self.sampled(t)
        load = np.zeros(self.model.n) if case.load is None else case.load[0]
        return load, case.prescribed[0], None if case.gaps is None else case.gaps[0]


def assemble(scene: Scene, meshed: Sequence[Body], *, stiffness: bool = True) -> Case:
    """Make the arrays of a scene on its meshes; all but K without ``stiffness``.

    Raises
    ------
    SceneError
        Mistakes that need the meshes: nodes of a pair that do not match, supports that
        contradict each other, a contact without nodes.
    """
    try:
        histories = Histories(scene)
        parts = make_parts(scene, histories.make_motions())
        model = assemble_model(meshed, **parts, stiffness=stiffness)
        loads = make_loads(scene, meshed, model)
        return _make_case(scene, model, loads, histories)
    except SceneError:
        raise
    except ValueError as error:
        mistake = Mistake("", str(error), MistakeKind.MESH)
        raise SceneError(scene.title, [mistake]) from error


def _make_case(
    scene: Scene,
    model: Assembly,
    loads: tuple[LoadHistory, ...],
    histories: Histories,
) -> Case:
    acting = tuple(replace(o, history=histories.evaluate(o.number)) for o in loads)
    load = np.zeros((len(histories.ends), model.n))
    for load_case in acting:
        load += np.outer(load_case.history, load_case.nodal)
    return Case(
        model=model,
        load=load if load.any() else None,
        prescribed=histories.prescribe(model),
        parameter=histories.parameter,
        loads=acting,
        scene=scene,
        gaps=histories.find_gaps(model),
    )
