"""One run of a scene: read, mesh, assemble, condense, solve, keep."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from bipot_rs import _core
from bipot_rs._lib.messages import counted, later
from bipot_rs.cli import output_files
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.output_files import recoverable
from bipot_rs.cli.output_folder import RESULT, draft_in, ours, replace
from bipot_rs.cli.output_folder import told as files_of
from bipot_rs.cli.peak_memory import peak_mb
from bipot_rs.cli.progress import Progress, complain, line

if TYPE_CHECKING:
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.result import Result
    from bipot_rs.contact.solution import Step
    from bipot_rs.discretisation.estimator import DiscretisationError, Estimator
    from bipot_rs.scene.case import Case
    from bipot_rs.scene.schema.root import Scene

# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
# What a run of any scene asks for on its way: imported while signals wait, and not on
# the time of what asks first.
_LATER = ("bipot_rs.fem.paraview", "bipot_rs.cli.report")
PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write", "total")


class Job:
    """One run: its clock, what it has reached, and what it tells."""

    def __init__(
        self,
        name: str | None,
        *,
        as_json: bool,
        interrupts: Interrupts | None = None,
    ) -> None:
        self.name = name
        self.as_json = as_json
        self.interrupts = Interrupts() if interrupts is None else interrupts
        self.started = perf_counter()
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.folder = Path()
        # As --set gave them.
        self.settings: list[str] = []
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        # Load steps reached: what is told of each, and the step. Pairs, so that an
        # interrupt between the two cannot tear them apart.
        self.reached: list[tuple[dict[str, Any], Step]] = []
        # How many there are to be; of automatic ones nobody knows.
        self.count: int | None = None
        # Whether the files of this run are in its folder.
        self.kept = False
        # How many of them an earlier run left.
        self.resumed = 0
        # With --error: what finds it, what it found for each step, and what it could not.
        self.estimator: Estimator | None = None
        self.errors: list[DiscretisationError | None] = []
        self.no_error = ""
        # What residuals are held to, and what decided it, where the mesh does.
        self.tol = 0.0
        self.enough = ""
        self.progress = Progress(0, 0, quiet=True)

    def run(
        self,
        settings: list[str],
        folder: Path,
        method: str | None,
        tol: float | str | None,
        *,
        plot: bool,
        fclib: bool = False,
        resume: bool = False,
        error: bool = False,
    ) -> int:
        """Go from the scene to the files; returns the exit status.

        A signal stops the work between imports and files; both are gone through.
        """
        # An import that is torn apart leaves half a module behind.
        self.interrupts.hold()
        # Arrays come and go; memory that went back to the system is touched anew.
        _core.keep_heap()
        self.folder, self.settings = folder, settings
        try:
            from bipot_rs.cli import cost_forecast
            from bipot_rs.cli.resume import earlier, left_off, stamps
            from bipot_rs.contact.reduced import refuse_settings
            from bipot_rs.files.export import require
            from bipot_rs.scene.reading import read

            require()
            self.scene = scene = read(self.name or "", settings)
            method = scene.solver.method if method is None else method
            tol = scene.solver.tol if tol is None else tol
            refuse_settings(method, tol)
            cost_forecast.fits(scene)
            stamp = stamps(scene, method, tol)
            for later in _LATER:
                import_module(later)
            if not scene.path.increments:
                self.count = scene.path.count()
            done = None
            if resume:
                done = earlier(folder / RESULT, stamp, self.count)
                if done.success:
                    return self._complete_already(folder, done, fclib=fclib)
                if not self.as_json:
                    kept = counted(len(done), "load step")
                    complain(f"{folder / RESULT}: going on behind {kept}")
            elif not self.as_json and (folder / RESULT).exists():
                remark = left_off(folder / RESULT, stamp, self.count)
                if remark:
                    complain(remark)
            with (
                draft_in(folder) as draft,
                Progress(
                    len(PHASES) - 1, self.count, quiet=self.as_json
                ) as self.progress,
            ):
                code, message = self._attempt(
                    scene, method, tol, folder, done, error=error
                )
                code, message = self._keep(
                    draft, folder, code, message, stamp, plot=plot, fclib=fclib
                )
        except KeyboardInterrupt:
            code, message = self.interrupts.status, "interrupted"
        except (ImportError, ValueError, OSError, MemoryError) as error:
            code, message = BAD_INPUT, str(error) or type(error).__name__
            if self.interrupts.came is not None:
                # Libraries turn an interrupt into errors of their own.
                code, message = self.interrupts.status, "interrupted"
        if self.reached and code != self.interrupts.status and not self.as_json:
            self._print(folder, solved=code == SOLVED)
        return self.end(code, message)

    def _complete_already(self, folder: Path, done: Result, *, fclib: bool) -> int:
        self.reached = [({}, step) for step in done]
        message = f"{folder / RESULT} is complete already, nothing to resume"
        if fclib:
            message += ": --fclib writes problems of what is solved, without --resume"
        if not self.as_json:
            complain(message)
        return self.end(SOLVED, message)

    def end(self, code: int, message: str) -> int:
        """Tell the outcome: the last line of --json, or a complaint if there is one."""
        self.interrupts.told = True
        self.seconds["total"] = perf_counter() - self.started
        if self.as_json:
            model = self.case.model if self.case else None
            line(
                scene=self.name,
                dofs=None if model is None else model.n,
                contacts=None if model is None else len(model.gap),
                steps=len(self.reached),
                success=code == SOLVED,
                seconds={phase: round(s, 6) for phase, s in self.seconds.items()},
                peak_mb=peak_mb(),
                message=message,
            )
        elif code != SOLVED:
            complain(message)
        return code

    def _attempt(
        self,
        scene: Scene,
        method: str,
        tol: float | str,
        folder: Path,
        done: Result | None,
        *,
        error: bool,
    ) -> tuple[int, str]:
        """Mesh, assemble, solve; the steps reached stay in `reached`."""
        try:
            try:
                self.interrupts.release()
                return self._solve(scene, method, tol, folder, done, error=error)
            finally:
                self.interrupts.hold()
        except KeyboardInterrupt:
            return self.interrupts.status, "interrupted"

    def _solve(
        self,
        scene: Scene,
        method: str,
        tol: float | str,
        folder: Path,
        done: Result | None,
        *,
        error: bool,
    ) -> tuple[int, str]:
        from bipot_rs.cli.cost_forecast import fits
        from bipot_rs.cli.output_files import contacts
        from bipot_rs.cli.resume import same_contacts
        from bipot_rs.contact.errors import (
            FloatingBodyError,
            NoEquilibriumError,
            NotConvergedError,
        )
        from bipot_rs.scene.build import bodies
        from bipot_rs.scene.reading import assemble

        first = 0 if done is None else len(done)
        try:
            with self._phase("mesh"):
                meshed = bodies(scene)
                fits(scene, meshed)
            with self._phase("assemble"):
                case = assemble(scene, meshed)
                estimator = None
                if error or tol == ENOUGH:
                    from bipot_rs.discretisation.estimator import Estimator

                    estimator = Estimator(case)
                    self.estimator = estimator if error else None
                if done is not None:
                    same_contacts(folder / RESULT, done, contacts(case))
                    self.resumed = first
                    self.reached = [
                        (self._told(k, case.step_parameter(k, step), step), step)
                        for k, step in enumerate(case.loaded(done))
                    ]
                    self.progress.skip(first)
                self.case = case
            with self._phase("condense"):
                self.problem = problem = case.problem(
                    on_forecast=None if self.as_json else self._foretell
                )

            def on_step(local: int, step: Step) -> None:
                k = first + local
                told = self._told(k, case.step_parameter(k, step), step)
                self.reached.append((told, step))
                if self.as_json:
                    line(**told)
                self.progress.step(told)
                self.interrupts.check()

            with self._phase("solve"):
                if estimator is not None and tol == ENOUGH:
                    from bipot_rs.discretisation.stopping import tolerance

                    limit = scene.solver.max_iterations
                    enough = tolerance(
                        estimator, problem, method=method, max_iterations=limit
                    )
                    tol = enough.tol
                    self.enough = (
                        f"tol {enough.tol:.1e}: the mesh leaves an error of "
                        f"{enough.discretisation:.1%}"
                    )
                self.tol = float(tol)
                case.solve(
                    problem,
                    method=method,
                    tol=self.tol,
                    start=done,
                    first=first,
                    on_step=on_step,
                )
        except (NoEquilibriumError, FloatingBodyError) as error:
            return NO_ANSWER, self._of_path(str(error))
        except NotConvergedError as error:
            return NOT_CONVERGED, self._of_path(str(error))
        without = f"no discretisation error: {self.no_error}" if self.no_error else ""
        return SOLVED, "; ".join(filter(None, ("solved", self.enough, without)))

    def _foretell(self, counts: Mapping[str, Any]) -> None:
        """Say what the work will take, before it is done."""
        from bipot_rs.cli.cost_forecast import (
            cores,
            cost,
            duration,
            remarked,
            seconds,
            sizes,
        )

        if self.case is None or self.scene is None:
            return
        title = [self.scene.title] if self.scene.title else []
        known = sizes(self.case.model, len(self.case.parameter))
        remarks = remarked(self.case.remarks())
        self.progress.block("\n".join([*title, *known, *cost(counts), *remarks]))
        self.progress.foretell(duration(seconds(counts, cores())))

    def _told(self, k: int, parameter: float, step: Step) -> dict[str, Any]:
        """What is told of a load step, its discretisation error included if asked for."""
        from bipot_rs.cli.report import row as of_step

        row = of_step(k, parameter, step)
        if self.estimator is None:
            return row
        start = perf_counter()
        found = None
        try:
            whole = self.estimator.error(step, k)
            # Stresses in all parts of all elements of all steps would fill the memory.
            found = dataclasses.replace(whole, stress=())
        except ValueError as error:
            self.no_error = str(error)
        self.errors.append(found)
        # It happens between load steps, and is no part of solving them.
        seconds = perf_counter() - start
        self.seconds["recover"] += seconds
        self.seconds["solve"] -= seconds
        return row | {
            "error": None if found is None else found.relative,
            "error_kind": None if found is None else found.kind,
        }

    def _of_path(self, message: str) -> str:
        """The message with its load step counted from the start of the whole path."""
        return later(message, self.resumed, self._of_all())

    def _of_all(self) -> str:
        """``of 5``, where it is known how many load steps there are."""
        return "" if self.count is None else f" of {self.count}"

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
        self,
        draft: Path,
        folder: Path,
        code: int,
        message: str,
        stamp: Mapping[str, Any],
        *,
        plot: bool,
        fclib: bool,
    ) -> tuple[int, str]:
        """Write what was reached, which decides how the run has ended."""
        interrupted = code == self.interrupts.status
        nothing_new = len(self.reached) == self.resumed
        if interrupted and nothing_new and (folder / RESULT).exists():
            # Whatever it holds is worth more.
            return code, f"{message}, {folder / RESULT} is as it was"
        if self.case is not None and self.scene is not None:
            code, message = self._recovered(code, message)
            self._write_fields(self.scene, self.case, draft, plot=plot)
            if fclib and self.problem is not None:
                with self._phase("write"):
                    output_files.write_problems(
                        *(draft, folder, self.name or "", self.scene, self.case),
                        *(self.problem, self.reached, message),
                    )
        elif not interrupted:
            return code, message
        if code == SOLVED and self.interrupts.came is not None:
            code, message = self.interrupts.status, "interrupted"
        with self._phase("write"):
            output_files.write_result(
                *(draft, folder, self.case, self.reached, self.errors),
                complete=code == SOLVED,
                attributes={
                    "scene": self.name or "",
                    "message": message,
                    "settings": json.dumps(self.settings),
                    **({} if self.count is None else {"planned": self.count}),
                    **output_files.labels(self.scene),
                    **stamp,
                },
            )
        replace(draft, folder)
        self.kept = True
        if code != SOLVED:
            message += f" (load steps in {folder}: {len(self.reached)})"
            if interrupted and self.reached:
                message += "; --resume goes on from there"
        return code, message

    def _recovered(self, code: int, message: str) -> tuple[int, str]:
        """Find the displacements; steps from one on that has none were not reached."""
        with self._phase("recover"):
            found, error = recoverable([step for _, step in self.reached])
        if error is None:
            return code, message
        del self.reached[found:]
        return NOT_CONVERGED, f"load step {found + 1}: {error}"

    def _write_fields(
        self, scene: Scene, case: Case, draft: Path, *, plot: bool
    ) -> None:
        """What is there to be looked at: the series, the table, the pictures."""
        from bipot_rs.cli.report import COLUMNS

        with self._phase("write"):
            given = draft, self.folder
            output_files.write_series(*given, case, self.reached, self.errors)
            rows = self._rows(case)
            forces = [key for key in (rows[0] if rows else ()) if " of " in key]
            columns = [*COLUMNS[:5], *forces, *COLUMNS[5:], *self._extra()]
            output_files.write_table(*given, columns, rows)
            if plot and self.reached:
                output_files.write_pictures(
                    *given, scene, case, self.reached, self.errors
                )

    def _extra(self) -> tuple[str, ...]:
        return () if self.estimator is None else ("error", "error_kind")

    def _rows(self, case: Case) -> list[dict[str, Any]]:
        """What is told of the load steps, with the forces of the contact surfaces."""
        from bipot_rs.cli.report import forces

        return [row | forces(case.model, step) for row, step in self.reached]

    def _print(self, folder: Path, *, solved: bool) -> None:
        """The table of load steps, and what it comes to."""
        from bipot_rs.cli.report import closing, console, print_table
        from bipot_rs.fem.review import review

        if self.case is None or self.scene is None:
            return
        rows, screen = self._rows(self.case), console()
        print_table(
            screen,
            rows,
            title=self.scene.title,
            unit=self.scene.units.force,
            more=self._extra()[:1],
        )

        def say(text: str) -> None:
            screen.print(text, markup=False, soft_wrap=True)

        if self.enough:
            say(self.enough)
        if self.estimator is not None:
            told = [error for error in self.errors if error is not None]
            for kind in dict.fromkeys(error.kind for error in told):
                why = dict.fromkeys(
                    r for e in told if e.kind == kind for r in e.reasons
                )
                reason = f" ({'; '.join(why)})" if why else ""
                say(f"error: of u in the energy norm, {kind}{reason}")
            if self.no_error:
                say(f"no error: {self.no_error}")
        if solved:
            remarks = review(self.case.model, [step for _, step in self.reached])
            for sentence in closing(rows, self.tol, folder, remarks):
                say(sentence)
        times = ", ".join(
            f"{phase} {self.seconds[phase]:.2f} s" for phase in PHASES[:-1]
        )
        model = self.case.model
        say(
            f"{model.n} degrees of freedom, {counted(len(model.gap), 'contact')}: {times}"
        )
        say(files_of(folder) if self.kept else _nothing_written(folder))


def _nothing_written(folder: Path) -> str:
    """Of a run whose files could not be written, as on a full disk."""
    said = f"{folder}: nothing was written"
    return said + (", its files are of an earlier run" if ours(folder) else "")
