"""One run of a scene: solve it and write its tables, pictures and results."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import replace as replaced
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import bipot_rs._core as _core
from bipot_rs._lib.machine import peak_mb
from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import Progress, complain, tell
from bipot_rs.cli.run.output_files import Output, origin
from bipot_rs.cli.run.output_folder import (
    LINK,
    RESULT,
    UNFINISHED,
    describe,
    ours,
    replace,
)
from bipot_rs.cli.run.runner import ENOUGH, PETSC, PHASES, Runner, outcome
from bipot_rs.petsc.run.ranks import World, read_launcher

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray
    from bipot_rs.cli.run.output_files import Checkpoint
    from bipot_rs.contact.errors import BipotError
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.results.result import Result
    from bipot_rs.contact.results.solution import Step
    from bipot_rs.contact.wear.record import Wear
    from bipot_rs.discretisation.estimator import DiscretisationError, Estimator
    from bipot_rs.petsc.run.distributed import DistributedProblem
    from bipot_rs.scene.case import Case
    from bipot_rs.scene.schema.root import Scene

# Every run needs these. They are imported while signals wait, and before the clocks of
# the phases start.
_NEEDED = (
    "bipot_rs.fem.paraview",
    "bipot_rs.cli.run.report",
    "bipot_rs.files.csv_tables",
)


@dataclass(frozen=True)
class RunOptions:
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


class Job:
    """One run of a scene, which `runner` carries out."""

    def __init__(
        self,
        request: RunOptions,
        *,
        as_json: bool,
        interrupts: Interrupts | None = None,
    ) -> None:
        self.runner = Runner(
            self,
            as_json=as_json,
            interrupts=interrupts,
            save=lambda: self._save(always=True),
        )
        self.request = request
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        # The same on several ranks.
        self.distributed: DistributedProblem | None = None
        self.checkpoint: Checkpoint | None = None
        self.peaks: list[float] = []
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
        # With [wear]: the cycles.
        self.wear: Wear | None = None
        # Bound of the residuals, and the reason for it if it depends on the mesh.
        self.tol = 0.0
        self.enough = ""

    def work(self) -> tuple[int, str]:
        """Read, mesh, assemble, condense, solve and write."""
        runner = self.runner
        # An import that a signal interrupts leaves half a module.
        runner.interrupts.hold()
        from bipot_rs._lib import validation
        from bipot_rs.files.export import require
        from bipot_rs.scene.reading import read

        require()
        request = self.request
        if request.engine == PETSC:
            runner.join()
            # Copies of a part of K are needed for a moment only.
            _core.return_heap()
        with runner.ranks.together():
            self.scene = scene = read(request.scene or "", request.settings)
        if scene.solver.engine == PETSC and request.engine is None:
            runner.join()
        with runner.ranks.together():
            method = scene.solver.method if request.method is None else request.method
            tol = scene.solver.tol if request.tol is None else request.tol
            validation.settings(
                method, 1e-10 if isinstance(tol, str) else tol, None, None
            )
            stamp = self._prepare(scene, method, tol)
        files = "reads another scene, or another file that it names, than rank 0"
        runner.ranks.check_same(stamp, files)
        with runner.ranks.together():
            message = "" if scene.wear is not None else self._earlier(stamp)
        if message:
            return SOLVED, message
        with (
            runner.draft(request.folder) as draft,
            Progress(
                len(PHASES) - 1, self.count, quiet=runner.as_json
            ) as runner.progress,
        ):
            with runner.ranks.together():
                self._begin_checkpoint(draft, stamp)
            code, message = runner.attempt(lambda: self._solve(scene, method, tol))
            if code == SOLVED:
                if self.enough:
                    message += f"; {self.enough}"
                if self.no_error:
                    message += f"; no discretisation error: {self.no_error}"
            return self._keep(draft, code, message, stamp)

    def _prepare(
        self, scene: Scene, method: str, tol: float | str
    ) -> Mapping[str, object]:
        """Check what the run needs; returns what identifies it."""
        from bipot_rs.cli.run import cost_forecast
        from bipot_rs.cli.run.resume import stamps

        if scene.wear is not None:
            self._check_wear(tol)
            self.count = scene.wear.cycles
        elif not scene.path.increments:
            self.count = scene.path.count()
        if self.runner.shared:
            self._check_petsc(scene, method, tol)
        elif read_launcher()[1] > 1 and not self.runner.as_json:
            complain(
                f"this is one of {read_launcher()[1]} processes, and each solves the whole "
                "scene: --engine petsc would share it among them"
            )
        cost_forecast.fits(scene, share=self.runner.ranks.share)
        stamp = stamps(scene, method, tol)
        for needed in _NEEDED:
            import_module(needed)
        return stamp

    def _check_wear(self, tol: float | str) -> None:
        """Refuse what a run with [wear] does not have."""
        request, why = self.request, "this scene has [wear]"
        if self.runner.shared:
            raise ValueError(f"engine is 'petsc', but {why}: use another engine")
        if request.fclib:
            raise ValueError(f"--fclib writes the load steps of a path, but {why}")
        if request.error or tol == ENOUGH:
            what = "--error" if request.error else f"tol {ENOUGH!r}"
            raise ValueError(f"{what} is for the load steps of a path, but {why}")
        if request.resume:
            raise ValueError(
                f"--resume continues the load steps of a path, but {why}: run it again, or "
                "continue in Python with ContactProblem.wear(start=)"
            )

    def _check_petsc(self, scene: Scene, method: str, tol: float | str) -> None:
        """Refuse what engine petsc does not have, as the iterative engine does."""
        from bipot_rs.contact.path.choice import check_method

        check_method(method, "petsc")
        if (tied := scene.tied()) is not None:
            raise ValueError(
                f"engine='petsc' does not support {tied}: use engine='direct' or 'iterative'"
            )
        if self.request.fclib:
            raise ValueError(
                "--fclib writes the compliance W, which engine='petsc' does not form: use "
                "engine='direct'"
            )
        if self.request.error or tol == ENOUGH:
            what = "--error" if self.request.error else f"tol {ENOUGH!r}"
            raise ValueError(
                f"{what} needs the whole K in one process, which engine='petsc' does not "
                "have: use another engine"
            )

    def _earlier(self, stamp: Mapping[str, object]) -> str:
        """Find load steps of an earlier run; a message if that one is complete."""
        from bipot_rs.cli.run.resume import describe_unfinished, earlier

        remark, path = "", self._source()
        if self.request.resume:
            self.done = earlier(path, stamp, self.count)
            if self.done.success:
                return self._complete_already(self.done)
            kept = count_noun(len(self.done), "load step")
            remark = f"{path}: continuing after {kept}"
        elif not self.runner.as_json:
            remark = describe_unfinished(path, stamp, self.count)
        if remark and not self.runner.as_json:
            complain(remark)
        return ""

    def _source(self) -> Path:
        """The file with the load steps of the last run in the folder."""
        unfinished = self.request.folder / UNFINISHED
        return unfinished if unfinished.exists() else self.request.folder / RESULT

    def _begin_checkpoint(self, draft: Path, stamp: Mapping[str, object]) -> None:
        """Let rank 0 of several keep each load step."""
        from bipot_rs.cli.run.output_files import Checkpoint
        from bipot_rs.cli.run.resume import describe_unfinished

        if not self.runner.shared or not self.runner.ranks.first:
            return
        path = self.request.folder / RESULT
        ours = self.done is not None or describe_unfinished(path, stamp, self.count)
        if path.exists() and not ours:
            path = self.request.folder / UNFINISHED
        attributes = self._make_attributes("the run has not ended", stamp)
        self.checkpoint = Checkpoint(draft, path, attributes)

    def _save(self, *, always: bool = False) -> None:
        """Keep the load steps reached, on rank 0 of several."""
        if self.checkpoint is not None:
            folder = self.request.folder
            out = Output(
                self.checkpoint.draft,
                folder,
                self.scene,
                self.case,
                self.runner.reached,
                [],
            )
            self.checkpoint.save(out, always=always)

    def _complete_already(self, done: Result) -> str:
        self.runner.reached = [({}, step) for step in done]
        message = f"{self._source()} is already complete, nothing to resume"
        if self.request.fclib:
            message += "; to write FCLIB files, run without --resume"
        if not self.runner.as_json:
            complain(message)
        return message

    def last_line(self, code: int, message: str) -> dict[str, object]:
        """Keys of the last line of --json."""
        runner = self.runner
        runner.seconds["total"] = perf_counter() - runner.started
        model = self.case.model if self.case else None
        ranks = {"ranks": runner.ranks.count} if runner.shared else {}
        return {
            "scene": self.request.scene,
            "dofs": None if model is None else model.n,
            "contacts": None if model is None else len(model.gap),
            "steps": len(runner.reached),
            "success": code == SOLVED,
            "seconds": {phase: round(s, 6) for phase, s in runner.seconds.items()},
            "peak_mb": max(self.peaks, default=peak_mb()),
            **ranks,
            "message": message,
        }

    def _solve(self, scene: Scene, method: str, tol: float | str) -> None:
        runner = self.runner
        from bipot_rs.cli.run.cost_forecast import fits
        from bipot_rs.cli.run.output_files import contacts
        from bipot_rs.cli.run.report import by_surface, forces
        from bipot_rs.cli.run.resume import same_contacts
        from bipot_rs.scene.build import bodies
        from bipot_rs.scene.case import assemble

        done = self.done
        with runner.phase("mesh"):
            meshed = bodies(scene)
            fits(scene, meshed, runner.ranks.share)
        with runner.phase("assemble"):
            estimates = self.request.error or tol == ENOUGH
            # Wear and the discretisation error read K.
            whole = (estimates or scene.wear is not None) and not runner.shared
            case = assemble(scene, meshed, stiffness=whole)
            if not runner.shared:
                case = case.with_stiffness(self._engine)
            estimator = None
            if estimates:
                from bipot_rs.discretisation.estimator import Estimator

                estimator = Estimator(case)
                self.estimator = estimator if self.request.error else None
            if done is not None:
                same_contacts(self._source(), done, contacts(case))
                self.resumed = len(done)
                runner.reached = [
                    (self._row(k, case, step), step)
                    for k, step in enumerate(case.add_loads(done))
                ]
                runner.progress.skip(self.resumed)
            self.case = case
        with runner.phase("condense"):
            problem = self._problem(case)
            if self.problem is not None and not whole:
                self.case = case = case.released(self.problem)
        with runner.phase("solve"):
            if estimator is not None and tol == ENOUGH and not runner.shared:
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
                with runner.ranks.together(held=True):
                    row = self._row(self.resumed + local, case, step)
                    runner.reach(
                        row,
                        step,
                        lambda: {"forces": by_surface(forces(case.model, step))},
                    )
                    self._save()

            if scene.wear is not None:
                self.wear = case.wear(
                    problem,
                    method=method,
                    tol=self.tol,
                    on_cycle=lambda _, step: on_step(len(runner.reached), step),
                )
                return
            case.solve(
                problem,
                method=method,
                tol=self.tol,
                start=done,
                first=self.resumed,
                on_step=on_step,
            )

    def _problem(self, case: Case) -> Any:
        """The problem of the scene, with the engine asked for."""
        runner = self.runner
        from bipot_rs.cli.run import cost_forecast

        if isinstance(runner.ranks, World):
            from bipot_rs.petsc.run.distributed import DistributedProblem

            if runner.ranks.first and not runner.as_json:
                ranks = cost_forecast.of_ranks(case.model, runner.ranks.count)
                self._announce(case, [ranks])
            self.distributed = DistributedProblem(case, runner.ranks)
            return self.distributed

        def on_forecast(counts: Mapping[str, object]) -> None:
            lines = cost_forecast.cost(counts, case.model, len(case.parameter))
            stalling = cost_forecast.describe_stalling(counts, case.model)
            self._announce(case, [*lines, *cost_forecast.list_remarks(stalling)])
            runner.progress.forecast(cost_forecast.seconds(counts))

        self.problem = case.problem(
            on_forecast=(
                None
                if runner.as_json
                else cost_forecast.with_memory(on_forecast, case.model)
            ),
            engine=self._engine,
        )
        return self.problem

    @property
    def _engine(self) -> str | None:
        """The engine asked for; the FCLIB file of a step holds W."""
        return "direct" if self.request.fclib else self.request.engine

    def _announce(self, case: Case, cost: Sequence[str]) -> None:
        """Print the title, the sizes, the expected cost and remarks, before condensing."""
        from bipot_rs.cli.run import cost_forecast

        title = [self.scene.title] if self.scene and self.scene.title else []
        sizes = cost_forecast.sizes(case.model, len(case.parameter))
        remarks = cost_forecast.list_remarks(case.remarks())
        self.runner.progress.block("\n".join([*title, *sizes, *cost, *remarks]))

    def _row(self, k: int, case: Case, step: Step) -> dict[str, object]:
        """The row of a load step, with its discretisation error if that is asked for."""
        from bipot_rs.contact.results.tables import make_row as of_step
        from bipot_rs.contact.results.tables import measure_wear

        row: dict[str, object] = {
            **of_step(k, case.step_parameter(k, step), step),
            **measure_wear(step, case.model.area),
        }
        if self.estimator is None:
            return row
        start = perf_counter()
        estimate = None
        try:
            whole = self.estimator.error(step, k)
            # Stresses of all elements in all steps would fill the memory.
            estimate = replaced(whole, stress=())
        except ValueError as error:
            self.no_error = str(error)
        self.errors.append(estimate)
        # This runs between load steps, within the clock of the phase "solve".
        seconds = perf_counter() - start
        self.runner.seconds["recover"] += seconds
        self.runner.seconds["solve"] -= seconds
        return row | {
            "error": None if estimate is None else estimate.relative,
            "error_kind": None if estimate is None else estimate.kind,
        }

    def failed(self, error: BipotError) -> tuple[int, str]:
        """Exit status and message of an error, its load step counted from the start."""
        if error.step is not None:
            error.at_step(error.step + self.resumed, self.count)
        self.wear = error.wear
        return outcome(error)

    def _keep(
        self, draft: Path, code: int, message: str, stamp: Mapping[str, object]
    ) -> tuple[int, str]:
        """Write the load steps reached; returns how the run has ended after that."""
        runner = self.runner
        request, folder = self.request, self.request.folder
        interrupted = code == runner.interrupts.status
        nothing_new = len(runner.reached) == self.resumed
        exists = runner.ranks.broadcast((folder / RESULT).exists())
        if interrupted and nothing_new and exists:
            # An earlier result is worth more than an empty one.
            return code, f"{message}; {folder / RESULT} is unchanged"
        scene, case = self.scene, self.case
        out = Output(draft, folder, scene, case, runner.reached, self.errors)
        if scene is not None and case is not None:
            with runner.phase("recover"):
                code, message = runner.recover(code, message)
            with runner.phase("write"):
                if runner.ranks.first:
                    self._tables(out, scene, case)
                if request.fclib and self.problem is not None:
                    name = request.scene or ""
                    out.problems(name, scene, case, self.problem, message)
            self._parts(out, case)
        elif not interrupted:
            return code, message
        of_cells: Iterator[Mapping[str, AnyArray]] = iter(())
        if scene is not None and case is not None:
            several = runner.ranks.count > 1
            of_cells = out.stresses(case) if several else out.bodies(case)

        def finish(came: int | None) -> dict[str, object]:
            """Attributes of the file, of which a signal up to now tells how the run ended."""
            nonlocal code, message
            if code == SOLVED and came is not None:
                runner.interrupts.take(came)
                code, message = runner.interrupted
            return {**self._make_attributes(message, stamp), "complete": code == SOLVED}

        finish(runner.ranks.broadcast(runner.interrupts.came))
        with runner.phase("write"):
            if runner.ranks.first:
                alone = runner.ranks.count == 1
                out.result(
                    lambda: finish(runner.interrupts.came if alone else None),
                    of_cells,
                )
                # Some file systems have no links.
                with suppress(OSError):
                    (draft / LINK).symlink_to(RESULT)
                replace(draft, folder)
        self.kept = True
        if runner.shared:
            self.peaks = runner.ranks.gather(peak_mb())
        if code != SOLVED:
            message += f" (load steps in {folder}: {len(runner.reached)})"
            if interrupted and runner.reached and (scene is None or scene.wear is None):
                message += "; --resume continues from there"
        return code, message

    def _tables(self, out: Output, scene: Scene, case: Case) -> None:
        """Write the tables, the contacts and the pictures."""
        from bipot_rs.contact.results.tables import list_columns

        out.contact_series(case)
        rows = self._list_rows(case)
        out.table(list_columns(rows, self._extra()), rows)
        if self.request.plot and self.runner.reached:
            out.pictures(scene, case)

    def _parts(self, out: Output, case: Case) -> None:
        """Write the series of the bodies, if several ranks write their cells."""
        runner = self.runner
        if runner.ranks.count == 1:
            return
        from bipot_rs.contact.results.solution import Computed
        from bipot_rs.fem.paraview import Part

        with runner.phase("write"):
            if self.distributed is None:
                return
            cells = self.distributed.numbering.list_own_cells(case.model)
            part = Part(runner.ranks.number, runner.ranks.count, cells)
            series = out.parts(case, part)
        for k, (_, step) in enumerate(runner.reached):
            u = runner.ranks.broadcast(step.computed.displacement)
            with runner.phase("write"):
                out.part(series, case, k, replaced(step, computed=Computed(u)))
        with runner.phase("write"):
            series.end()

    def _make_attributes(
        self, message: str, stamp: Mapping[str, object]
    ) -> dict[str, object]:
        """Attributes of the result file."""
        name, settings = self.request.scene or "", self.request.settings
        problem = self.distributed or self.problem
        return {**origin(name, settings, self.scene, problem, message), **stamp}

    def _extra(self) -> tuple[str, ...]:
        from bipot_rs.contact.results.tables import WEAR

        if self.scene is not None and self.scene.wear is not None:
            return WEAR
        return () if self.estimator is None else ("error", "error_kind")

    def _list_rows(self, case: Case) -> list[dict[str, object]]:
        """The rows of the load steps, with the forces of the contact surfaces."""
        from bipot_rs.cli.run.report import forces

        return [row | forces(case.model, step) for row, step in self.runner.reached]

    def show(self, code: int) -> None:
        """Print the table of load steps, remarks, times and the names of the files."""
        runner = self.runner
        from bipot_rs.cli.run.report import format_steps, list_closing
        from bipot_rs.cli.text_table import terminal_width
        from bipot_rs.fem.checks.inspection import review

        if (
            not runner.reached
            or code == runner.interrupts.status
            or not runner.ranks.first
        ):
            return
        if self.case is None or self.scene is None:
            return
        rows, model = self._list_rows(self.case), self.case.model
        table = format_steps(
            rows,
            title=self.scene.title,
            unit=self.scene.units.force,
            more=[name for name in self._extra() if name != "error_kind"],
            width=terminal_width(),
        )
        lines = [table, self.enough] if self.enough else [table]
        estimates = [error for error in self.errors if error is not None]
        for kind in dict.fromkeys(error.kind for error in estimates):
            why = dict.fromkeys(
                r for e in estimates if e.kind == kind for r in e.reasons
            )
            reason = f" ({'; '.join(why)})" if why else ""
            lines.append(
                f"error: relative error of u in the energy norm, {kind}{reason}"
            )
        if self.no_error:
            lines.append(f"no discretisation error: {self.no_error}")
        folder = self.request.folder
        if code == SOLVED:
            remarks = review(model, [step for _, step in runner.reached])
            lines += list_closing(rows, self.tol, folder, remarks)
        if self.wear is not None:
            lines.append(f"wear: {self.wear.said}")
        times = ", ".join(
            f"{phase} {runner.seconds[phase]:.2f} s" for phase in PHASES[:-1]
        )
        contacts = count_noun(len(model.gap), "contact")
        lines.append(f"{model.n} degrees of freedom, {contacts}: {times}")
        if self.kept:
            lines.append(describe(folder))
        else:
            # As on a full disk.
            earlier = "; its files are from an earlier run" if ours(folder) else ""
            lines.append(f"{folder}: nothing was written{earlier}")
        tell("\n".join(lines), sys.stdout)
