"""``bipot run``: solve a scene and write its tables, pictures and results."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import bipot_rs._core as _core
from bipot_rs._lib.messages import counted, later
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.output_files import Output, origin
from bipot_rs.cli.output_folder import RESULT, describe, draft_in, ours, replace
from bipot_rs.cli.peak_memory import peak_mb
from bipot_rs.cli.progress import Progress, complain
from bipot_rs.cli.runner import Runner

if TYPE_CHECKING:
    from bipot_rs.contact.errors import BipotError
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.result import Result
    from bipot_rs.contact.solution import Step
    from bipot_rs.discretisation.estimator import DiscretisationError, Estimator
    from bipot_rs.scene.case import Case
    from bipot_rs.scene.schema.root import Scene

# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
# Every run needs these. They are imported while signals wait, and before the clocks of
# the phases start.
_NEEDED = ("bipot_rs.fem.paraview", "bipot_rs.cli.report", "bipot_rs.files.csv_tables")
PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write", "total")


@dataclasses.dataclass(frozen=True)
class Request:
    """Arguments of the command. ``method`` and ``tol`` None: those of the scene."""

    scene: str | None = None
    settings: Sequence[str] = ()
    folder: Path = Path()
    method: str | None = None
    engine: str | None = None
    tol: float | str | None = None
    plot: bool = False
    fclib: bool = False
    resume: bool = False
    error: bool = False


class Job(Runner):
    """One run of a scene."""

    def __init__(
        self, request: Request, *, as_json: bool, interrupts: Interrupts | None = None
    ) -> None:
        super().__init__(as_json=as_json, interrupts=interrupts)
        self.request = request
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        # Load steps of the whole path; automatic steps have no known number.
        self.count: int | None = None
        # The result of an earlier run with --resume, and how many of its steps are used.
        self.done: Result | None = None
        self.resumed = 0
        # Whether the files of this run are in its folder.
        self.kept = False
        # With --error: the estimator, the error of each step, and why one is missing.
        self.estimator: Estimator | None = None
        self.errors: list[DiscretisationError | None] = []
        self.no_error = ""
        # Bound of the residuals, and the reason for it if it depends on the mesh.
        self.tol = 0.0
        self.enough = ""

    def work(self) -> tuple[int, str]:
        """Read, mesh, assemble, condense, solve and write."""
        # An import that a signal interrupts leaves half a module.
        self.interrupts.hold()
        # Memory that goes back to the system between two arrays costs page faults.
        _core.keep_heap()
        from bipot_rs.cli import cost_forecast
        from bipot_rs.cli.resume import earlier, left_off, stamps
        from bipot_rs.contact.reduced import refuse_settings
        from bipot_rs.files.export import require
        from bipot_rs.scene.reading import read

        require()
        request, folder = self.request, self.request.folder
        self.scene = scene = read(request.scene or "", request.settings)
        method = scene.solver.method if request.method is None else request.method
        tol = scene.solver.tol if request.tol is None else request.tol
        refuse_settings(method, tol)
        cost_forecast.fits(scene)
        stamp = stamps(scene, method, tol)
        for needed in _NEEDED:
            import_module(needed)
        if not scene.path.increments:
            self.count = scene.path.count()
        remark = ""
        if request.resume:
            self.done = earlier(folder / RESULT, stamp, self.count)
            if self.done.success:
                return SOLVED, self._complete_already(self.done)
            kept = counted(len(self.done), "load step")
            remark = f"{folder / RESULT}: continuing after {kept}"
        elif not self.as_json:
            remark = left_off(folder / RESULT, stamp, self.count)
        if remark and not self.as_json:
            complain(remark)
        with (
            draft_in(folder) as draft,
            Progress(len(PHASES) - 1, self.count, quiet=self.as_json) as self.progress,
        ):
            code, message = self.attempt(lambda: self._solve(scene, method, tol))
            if code == SOLVED:
                if self.enough:
                    message += f"; {self.enough}"
                if self.no_error:
                    message += f"; no discretisation error: {self.no_error}"
            return self._keep(draft, code, message, stamp)

    def _complete_already(self, done: Result) -> str:
        self.reached = [({}, step) for step in done]
        message = (
            f"{self.request.folder / RESULT} is already complete, nothing to resume"
        )
        if self.request.fclib:
            message += "; to write FCLIB files, run without --resume"
        if not self.as_json:
            complain(message)
        return message

    def last_line(self, code: int, message: str) -> dict[str, Any]:
        """Keys of the last line of --json."""
        self.seconds["total"] = perf_counter() - self.started
        model = self.case.model if self.case else None
        return {
            "scene": self.request.scene,
            "dofs": None if model is None else model.n,
            "contacts": None if model is None else len(model.gap),
            "steps": len(self.reached),
            "success": code == SOLVED,
            "seconds": {phase: round(s, 6) for phase, s in self.seconds.items()},
            "peak_mb": peak_mb(),
            "message": message,
        }

    def _solve(self, scene: Scene, method: str, tol: float | str) -> None:
        from bipot_rs.cli.cost_forecast import fits
        from bipot_rs.cli.output_files import contacts
        from bipot_rs.cli.resume import same_contacts
        from bipot_rs.scene.build import bodies
        from bipot_rs.scene.reading import assemble

        done = self.done
        with self._phase("mesh"):
            meshed = bodies(scene)
            fits(scene, meshed)
        with self._phase("assemble"):
            case = assemble(scene, meshed)
            estimator = None
            if self.request.error or tol == ENOUGH:
                from bipot_rs.discretisation.estimator import Estimator

                estimator = Estimator(case)
                self.estimator = estimator if self.request.error else None
            if done is not None:
                same_contacts(self.request.folder / RESULT, done, contacts(case))
                self.resumed = len(done)
                self.reached = [
                    (self._row(k, case, step), step)
                    for k, step in enumerate(case.loaded(done))
                ]
                self.progress.skip(self.resumed)
            self.case = case
        with self._phase("condense"):
            self.problem = problem = case.problem(
                on_forecast=None if self.as_json else self._forecast,
                # The FCLIB file of a step holds W.
                engine="direct" if self.request.fclib else self.request.engine,
            )
        with self._phase("solve"):
            if estimator is not None and tol == ENOUGH:
                from bipot_rs.discretisation.stopping import tolerance

                limit = scene.solver.max_iterations
                enough = tolerance(
                    estimator, problem, method=method, max_iterations=limit
                )
                tol = enough.tol
                self.enough = (
                    f"tol {enough.tol:.1e}: the discretisation error is "
                    f"{enough.discretisation:.1%}"
                )
            self.tol = float(tol)

            def on_step(local: int, step: Step) -> None:
                self.reach(self._row(self.resumed + local, case, step), step)

            case.solve(
                problem,
                method=method,
                tol=self.tol,
                start=done,
                first=self.resumed,
                on_step=on_step,
            )

    def _forecast(self, counts: Mapping[str, Any]) -> None:
        """Print the sizes and the expected memory and time, before condensing."""
        from bipot_rs.cli import cost_forecast

        if self.case is None or self.scene is None:
            return
        title = [self.scene.title] if self.scene.title else []
        known = cost_forecast.sizes(self.case.model, len(self.case.parameter))
        cost = cost_forecast.cost(counts)
        remarks = cost_forecast.remarked(self.case.remarks())
        self.progress.block("\n".join([*title, *known, *cost, *remarks]))
        seconds = cost_forecast.seconds(counts, cost_forecast.cores())
        self.progress.forecast(cost_forecast.duration(seconds))

    def _row(self, k: int, case: Case, step: Step) -> dict[str, Any]:
        """The row of a load step, with its discretisation error if that is asked for."""
        from bipot_rs.cli.report import row as of_step

        row = of_step(k, case.step_parameter(k, step), step)
        if self.estimator is None:
            return row
        start = perf_counter()
        found = None
        try:
            whole = self.estimator.error(step, k)
            # Stresses of all elements in all steps would fill the memory.
            found = dataclasses.replace(whole, stress=())
        except ValueError as error:
            self.no_error = str(error)
        self.errors.append(found)
        # This runs between load steps, within the clock of the phase "solve".
        seconds = perf_counter() - start
        self.seconds["recover"] += seconds
        self.seconds["solve"] -= seconds
        return row | {
            "error": None if found is None else found.relative,
            "error_kind": None if found is None else found.kind,
        }

    def failed(self, error: BipotError) -> tuple[int, str]:
        """As of any command, with the load step counted from the start of the path."""
        code, message = super().failed(error)
        of = "" if self.count is None else f" of {self.count}"
        return code, later(message, self.resumed, of)

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        self.progress.phase(name)
        self.interrupts.check()
        start = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += perf_counter() - start

    def _keep(
        self, draft: Path, code: int, message: str, stamp: Mapping[str, Any]
    ) -> tuple[int, str]:
        """Write the load steps reached; returns how the run has ended after that."""
        request, folder = self.request, self.request.folder
        interrupted = code == self.interrupts.status
        nothing_new = len(self.reached) == self.resumed
        if interrupted and nothing_new and (folder / RESULT).exists():
            # An earlier result is worth more than an empty one.
            return code, f"{message}; {folder / RESULT} is unchanged"
        from bipot_rs.cli.report import columns

        scene, case = self.scene, self.case
        out = Output(draft, folder, scene, case, self.reached, self.errors)
        if scene is not None and case is not None:
            with self._phase("recover"):
                code, message = self.recover(code, message)
            with self._phase("write"):
                out.series(case)
                rows = self._rows(case)
                out.table(columns(rows, self._extra()), rows)
                if request.plot and self.reached:
                    out.pictures(scene, case)
                if request.fclib and self.problem is not None:
                    name = request.scene or ""
                    out.problems(name, scene, case, self.problem, message)
        elif not interrupted:
            return code, message
        if code == SOLVED and self.interrupts.came is not None:
            code, message = self.interrupted
        attributes = origin(
            request.scene or "", request.settings, scene, self.problem, message
        )
        with self._phase("write"):
            out.result(complete=code == SOLVED, attributes={**attributes, **stamp})
        replace(draft, folder)
        self.kept = True
        if code != SOLVED:
            message += f" (load steps in {folder}: {len(self.reached)})"
            if interrupted and self.reached:
                message += "; --resume continues from there"
        return code, message

    def _extra(self) -> tuple[str, ...]:
        return () if self.estimator is None else ("error", "error_kind")

    def _rows(self, case: Case) -> list[dict[str, Any]]:
        """The rows of the load steps, with the forces of the contact surfaces."""
        from bipot_rs.cli.report import forces

        return [row | forces(case.model, step) for row, step in self.reached]

    def show(self, code: int) -> None:
        """Print the table of load steps, remarks, times and the names of the files."""
        from bipot_rs.cli.report import closing, console, print_table
        from bipot_rs.fem.review import review

        if not self.reached or code == self.interrupts.status:
            return
        if self.case is None or self.scene is None:
            return
        rows, screen, model = self._rows(self.case), console(), self.case.model
        print_table(
            screen,
            rows,
            title=self.scene.title,
            unit=self.scene.units.force,
            more=self._extra()[:1],
        )
        lines = [self.enough] if self.enough else []
        known = [error for error in self.errors if error is not None]
        for kind in dict.fromkeys(error.kind for error in known):
            why = dict.fromkeys(r for e in known if e.kind == kind for r in e.reasons)
            reason = f" ({'; '.join(why)})" if why else ""
            lines.append(
                f"error: relative error of u in the energy norm, {kind}{reason}"
            )
        if self.no_error:
            lines.append(f"no discretisation error: {self.no_error}")
        folder = self.request.folder
        if code == SOLVED:
            remarks = review(model, [step for _, step in self.reached])
            lines += closing(rows, self.tol, folder, remarks)
        times = ", ".join(
            f"{phase} {self.seconds[phase]:.2f} s" for phase in PHASES[:-1]
        )
        contacts = counted(len(model.gap), "contact")
        lines.append(f"{model.n} degrees of freedom, {contacts}: {times}")
        if self.kept:
            lines.append(describe(folder))
        else:
            # As on a full disk.
            earlier = "; its files are from an earlier run" if ours(folder) else ""
            lines.append(f"{folder}: nothing was written{earlier}")
        screen.print("\n".join(lines), markup=False, soft_wrap=True)
