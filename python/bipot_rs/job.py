"""One run of a scene: solve it, tell its progress, write its files."""

from __future__ import annotations

import csv
import fcntl
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TextIO

from bipot_rs import _core
from bipot_rs.interrupts import Interrupts
from bipot_rs.words import counted

if TYPE_CHECKING:
    from bipot_rs.discretisation import DiscretisationError, Estimator
    from bipot_rs.problem import ContactProblem
    from bipot_rs.result import Result, Step
    from bipot_rs.scene import Case
    from bipot_rs.schema import Scene

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
RESULT = "result.h5"
# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
_DRAFT = ".bipot-"
_NAMES = (RESULT, "result.pvd", "steps.csv", "tractions.png", "error.png")
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
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        # Load steps reached: what is told of each, and the step. Pairs, so that an
        # interrupt between the two cannot tear them apart.
        self.reached: list[tuple[dict[str, Any], Step]] = []
        # How many of them an earlier run left.
        self.resumed = 0
        # With --error: what finds it, what it found for each step, and what it could not.
        self.estimator: Estimator | None = None
        self.errors: list[DiscretisationError | None] = []
        self.no_error = ""
        # What decided the tolerance, where the mesh does.
        self.enough = ""

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
        self.folder = folder
        try:
            from bipot_rs.export import require
            from bipot_rs.resume import earlier, stamps
            from bipot_rs.scene import read

            require()
            self.scene = scene = read(self.name or "", settings)
            method = scene.solver.method if method is None else method
            tol = scene.solver.tol if tol is None else tol
            stamp = stamps(scene, method, tol)
            done = None
            if resume:
                done = earlier(folder / RESULT, stamp, scene.path.count())
                if done.success:
                    return self._complete_already(folder, done, fclib=fclib)
            with _draft(folder) as draft:
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
        if code == SOLVED and not self.as_json:
            self._print_table(folder)
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
            _line(
                scene=self.name,
                dofs=None if model is None else model.n,
                contacts=None if model is None else len(model.gap),
                steps=len(self.reached),
                success=code == SOLVED,
                seconds={phase: round(s, 6) for phase, s in self.seconds.items()},
                peak_mb=_peak_mb(),
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
        from bipot_rs.errors import (
            FloatingBodyError,
            NoEquilibriumError,
            NotConvergedError,
        )
        from bipot_rs.resume import same_contacts
        from bipot_rs.scene import assemble, bodies

        first = 0 if done is None else len(done)
        try:
            with _Progress(scene.path.count(), quiet=self.as_json) as progress:
                with self._phase("mesh", progress):
                    meshed = bodies(scene)
                with self._phase("assemble", progress):
                    case = assemble(scene, meshed)
                    estimator = None
                    if error or tol == ENOUGH:
                        from bipot_rs.discretisation import Estimator

                        estimator = Estimator(case)
                        self.estimator = estimator if error else None
                    if done is not None:
                        same_contacts(folder / RESULT, done, _contacts(case))
                        self.resumed = first
                        self.reached = [
                            (self._row(k, float(case.parameter[k]), step), step)
                            for k, step in enumerate(_loaded(case, done))
                        ]
                        progress.skip(first)
                    self.case = case
                with self._phase("condense", progress):
                    self.problem = problem = case.model.problem()

                def on_step(local: int, step: Step) -> None:
                    k = first + local
                    row = self._row(k, float(case.parameter[k]), step)
                    self.reached.append((row, step))
                    if self.as_json:
                        _line(**row)
                    progress.step(row)
                    self.interrupts.check()

                with self._phase("solve", progress):
                    if estimator is not None and tol == ENOUGH:
                        from bipot_rs.enough import tolerance

                        limit = scene.solver.max_iterations
                        enough = tolerance(
                            estimator, problem, method=method, max_iterations=limit
                        )
                        tol = enough.tol
                        self.enough = (
                            f"tol {enough.tol:.1e}: the mesh leaves an error of "
                            f"{enough.discretisation:.1%}"
                        )
                    problem.solve(
                        None if case.load is None else case.load[first:],
                        case.prescribed[first:],
                        method=method,
                        tol=float(tol),
                        max_iterations=scene.solver.max_iterations,
                        start=done,
                        on_step=on_step,
                    )
        except (NoEquilibriumError, FloatingBodyError) as error:
            return NO_ANSWER, self._of_path(str(error))
        except NotConvergedError as error:
            return NOT_CONVERGED, self._of_path(str(error))
        without = f"no discretisation error: {self.no_error}" if self.no_error else ""
        return SOLVED, "; ".join(filter(None, ("solved", self.enough, without)))

    def _row(self, k: int, parameter: float, step: Step) -> dict[str, Any]:
        """What is told of a load step, its discretisation error included if asked for."""
        row = _row(k, parameter, step)
        if self.estimator is None:
            return row
        start = perf_counter()
        found = None
        try:
            whole = self.estimator.error(step, k)
            # Stresses in all parts of all elements of all steps would fill the memory.
            found = replace(whole, stress=())
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
        """The message with the step counted from the start of the path."""
        here = len(self.reached)
        local = f"step {here - self.resumed}: "
        rest = message.removeprefix(local)
        return message if rest == message else f"step {here}: {rest}"

    @contextmanager
    def _phase(self, name: str, progress: _Progress | None = None) -> Iterator[None]:
        if progress is not None:
            progress.phase(name)
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
        if self.case is not None:
            self._write_fields(self.case, draft, plot=plot)
            if fclib:
                self._write_problems(draft, message)
        elif not interrupted:
            return code, message
        if code == SOLVED and self.interrupts.came is not None:
            code, message = self.interrupts.status, "interrupted"
        self._write_result(draft, message, stamp, complete=code == SOLVED)
        _replace(draft, folder)
        if code != SOLVED:
            message += f" (load steps in {folder}: {len(self.reached)})"
        return code, message

    def _write_fields(self, case: Case, folder: Path, *, plot: bool) -> None:
        """What is there to be looked at: the series, the table, the picture."""
        from bipot_rs.export import write_series, writing
        from bipot_rs.result import recover

        model = case.model
        with self._phase("recover"):
            recover([step for _, step in self.reached])  # kept by the steps
        with self._phase("write"):
            with writing(self.folder / "result.pvd"):
                write_series(
                    folder / "result.pvd",
                    model.nodes,
                    model.cells,
                    (
                        model.fields(step.displacement, step.reaction, step.status)
                        for _, step in self.reached
                    ),
                    [self._of_cells(k) for k in range(len(self.reached))],
                )
            with (
                writing(self.folder / "steps.csv"),
                (folder / "steps.csv").open("w", newline="", encoding="utf-8") as file,
            ):
                table = csv.DictWriter(file, [*_COLUMNS, *self._extra()])
                table.writeheader()
                table.writerows(row for row, _ in self.reached)
            if plot and self.reached and self.scene is not None:
                from bipot_rs.plot import tractions

                title, units = self.scene.title, self.scene.units.model_dump()
                with writing(self.folder / "tractions.png"):
                    tractions(
                        folder / "tractions.png",
                        _contacts(case),
                        self._steps(),
                        title=title,
                        units=units,
                    )
                last = self.errors[-1] if self.errors else None
                if last is not None and last.total > 0:
                    from bipot_rs.error_map import error_map

                    with writing(self.folder / "error.png"):
                        error_map(
                            folder / "error.png",
                            model.nodes,
                            model.cells,
                            last.cells,
                            contacts=model.points,
                            title=f"{title}: {last.kind} {last.relative:.1%}",
                            unit=units["length"],
                        )

    def _extra(self) -> tuple[str, ...]:
        return () if self.estimator is None else ("error", "error_kind")

    def _of_cells(self, k: int) -> dict[str, Any]:
        """Fields of the elements of a step for ParaView."""
        found = self.errors[k] if k < len(self.errors) else None
        if found is None:
            return {}
        return {"error": found.cells, "error_density": found.density}

    def _write_problems(self, folder: Path, message: str) -> None:
        """Write the problem of each step for other solvers."""
        from importlib.metadata import version

        from bipot_rs.export import writing
        from bipot_rs.fclib import write_path
        from bipot_rs.result import Result

        if self.problem is None or self.scene is None or self.case is None:
            return
        result = Result(
            [step for _, step in self.reached],
            contacts={},
            shape=self.case.model.points.shape,
            success=True,
            message=message,
        )
        units = self.scene.units.model_dump().items()
        info = {
            "title": self.scene.title,
            "description": f"scene {self.name} of bipot_rs {version('bipot-rs')}; "
            + ", ".join(f"{quantity} in {unit}" for quantity, unit in units),
        }
        with self._phase("write"), writing(self.folder / "problem-….hdf5"):
            write_path(folder / "problem", self.problem, result, info=info)

    def _write_result(
        self, folder: Path, message: str, stamp: Mapping[str, Any], *, complete: bool
    ) -> None:
        """What is there to be read back."""
        from bipot_rs.export import write_result, writing

        with self._phase("write"), writing(self.folder / RESULT):
            write_result(
                folder / RESULT,
                {} if self.case is None else _contacts(self.case),
                self._steps(),
                complete=complete,
                attributes={"scene": self.name or "", "message": message, **stamp},
            )

    def _steps(self) -> list[dict[str, Any]]:
        """Fields of a step under their own names: `bipot_rs.load` takes them."""
        return [
            {name: getattr(step, name) for name in _FIELDS}
            | {
                "load": row["load"],
                "outcome": str(step.outcome),
                "displacement": step.displacement,
            }
            | dict(step.stats)
            | self._errors_of(k)
            for k, (row, step) in enumerate(self.reached)
        ]

    def _errors_of(self, k: int) -> dict[str, Any]:
        """The discretisation error of a step, for the result file."""
        found = self.errors[k] if k < len(self.errors) else None
        if found is None:
            return {}
        return {
            "error_cells": found.cells,
            "error_contacts": found.contacts,
            "error_total": found.total,
            "error_relative": found.relative,
            "error_kind": found.kind,
        }

    def _print_table(self, folder: Path) -> None:
        from rich.console import Console
        from rich.table import Table

        console = Console()
        title = self.scene.title if self.scene else None
        table = Table(title=title, title_justify="left")
        columns = [*_COLUMNS, *self._extra()[:1]]
        for column in columns:
            table.add_column(column, justify="right")
        for row, _ in self.reached:
            table.add_row(*_cells(row, columns))
        console.print(table)
        if self.enough:
            console.print(self.enough, highlight=False, soft_wrap=True)
        if self.estimator is not None:
            told = [error for error in self.errors if error is not None]
            for kind in dict.fromkeys(error.kind for error in told):
                why = dict.fromkeys(
                    r for e in told if e.kind == kind for r in e.reasons
                )
                reason = f" ({'; '.join(why)})" if why else ""
                console.print(
                    f"error: of u in the energy norm, {kind}{reason}",
                    highlight=False,
                    soft_wrap=True,
                )
            if self.no_error:
                console.print(
                    f"no error: {self.no_error}", highlight=False, soft_wrap=True
                )
        times = ", ".join(
            f"{phase} {self.seconds[phase]:.2f} s" for phase in PHASES[:-1]
        )
        model = self.case.model if self.case else None
        size = (
            f"{model.n} degrees of freedom, {counted(len(model.gap), 'contact')}: "
            if model
            else ""
        )
        console.print(size + times, highlight=False, soft_wrap=True)
        # The pieces of the series are named by its index, result.pvd.
        names = sorted(path.name for path in _ours(folder) if path.suffix != ".vtu")
        problems = [name for name in names if name.endswith(".hdf5")]
        if len(problems) > 2:
            names = [name for name in names if name not in problems[1:-1]]
            names.insert(names.index(problems[0]) + 1, "…")
        console.print(f"{folder}: {', '.join(names)}", highlight=False, soft_wrap=True)


_COLUMNS = (
    "step",
    "load",
    "open",
    "slip",
    "stick",
    "residual",
    "iterations",
    "seconds",
)


_FIELDS = (
    "reaction",
    "relative_displacement",
    "slip",
    "status",
    "residual",
    "tolerance",
    "iterations",
    "work",
    "rigid_motion",
    "bipotential_gap",
    "seconds",
)


def _contacts(case: Case) -> dict[str, Any]:
    model = case.model
    return {
        "x": model.points,
        "normal": model.frame[:, 0],
        "area": model.area,
        "gap": model.gap,
        "mu": model.mu,
        "frame": model.frame,
    }


def _row(k: int, parameter: float, step: Step) -> dict[str, Any]:
    """Collect what is told of a load step: a line of --json, of the table, of steps.csv."""
    counts = [int((step.status == status).sum()) for status in (0, 1, 2)]
    told = (k, parameter, *counts, step.residual, step.iterations, step.seconds)
    return dict(zip(_COLUMNS, told, strict=True))


def _cells(row: dict[str, Any], columns: Sequence[str]) -> list[str]:
    forms = {
        "load": "{:.6g}",
        "residual": "{:.1e}",
        "seconds": "{:.3f}",
        "error": "{:.2%}",
    }
    return [
        "-" if row[name] is None else forms.get(name, "{}").format(row[name])
        for name in columns
    ]


class _Progress:
    """A bar over load steps on a terminal, lines elsewhere; on standard error."""

    def __init__(self, steps: int, *, quiet: bool) -> None:
        self.steps = steps
        self.bar: Any = None
        self.lines = not quiet and not sys.stderr.isatty()

    def __enter__(self) -> _Progress:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                Progress,
                SpinnerColumn,
                TextColumn,
                TimeElapsedColumn,
            )

            self.bar = Progress(
                SpinnerColumn(),
                TextColumn("{task.description:<9}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self.bar.start()
            self.bar.add_task("", total=self.steps)
        return self

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def phase(self, name: str) -> None:
        """Name the phase that begins."""
        if self.bar is not None:
            self.bar.update(0, description=name)

    def skip(self, steps: int) -> None:
        """Begin after load steps that are done already."""
        if self.bar is not None:
            self.bar.advance(0, steps)

    def step(self, row: dict[str, Any]) -> None:
        """Tell that a load step is done."""
        if self.bar is not None:
            self.bar.advance(0)
        if self.lines:
            _tell(
                f"step {row['step'] + 1} of {self.steps}: load {row['load']:.6g}, "
                f"open {row['open']}, slip {row['slip']}, stick {row['stick']}, "
                f"residual {row['residual']:.1e}",
                sys.stderr,
            )


@contextmanager
def _draft(folder: Path) -> Iterator[Path]:
    """Place inside the folder to prepare its files in, gone at the end.

    Made before the work, so that a folder that cannot be written is found then.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _clear(folder)
        for path in map(folder.joinpath, _NAMES):
            if path.is_dir():
                raise IsADirectoryError(f"{path} is a folder")
        draft = tempfile.TemporaryDirectory(prefix=_DRAFT, dir=folder)
    except OSError as error:
        raise OSError(f"cannot write to the folder {folder}: {error}") from error
    # Held as long as this process lives: another run knows by it that it does.
    with draft as name, _locked(Path(name)):
        yield Path(name)


@contextmanager
def _locked(draft: Path) -> Iterator[bool]:
    """Whether the draft could be locked; nobody else locks it meanwhile."""
    handle = os.open(draft, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            # Someone holds it, or the file system knows no locks.
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _clear(folder: Path) -> None:
    """Remove what killed runs were preparing."""
    for draft in folder.glob(f"{_DRAFT}*"):
        with suppress(OSError), _locked(draft) as abandoned:
            if abandoned:
                shutil.rmtree(draft)


def _replace(draft: Path, folder: Path) -> None:
    """Move the files of the draft in, and remove those of an earlier run."""
    new = {path.name for path in draft.iterdir()}
    for name in sorted(new):
        (draft / name).replace(folder / name)
    for old in _ours(folder):
        if old.name not in new:
            old.unlink()


def _loaded(case: Case, done: Result) -> Iterator[Step]:
    """Steps read from a file, which holds no loads, with those of the scene."""
    import numpy as np

    nothing = np.zeros(case.model.n)
    for k, step in enumerate(done):
        load = nothing if case.load is None else case.load[k]
        yield replace(step, load=load, prescribed=case.prescribed[k])


def _ours(folder: Path) -> list[Path]:
    """Files that a run writes; whatever else a folder holds is not ours to touch."""
    series = [p for p in folder.glob("result_*.vtu") if p.stem[7:].isdigit()]
    series += [p for p in folder.glob("problem-*.hdf5") if p.stem[8:].isdigit()]
    return [path for path in map(folder.joinpath, _NAMES) if path.exists()] + series


def _line(**values: Any) -> None:
    _tell(json.dumps(values), sys.stdout)


def complain(message: str) -> None:
    """Say on standard error what went wrong; help that was asked for has no message."""
    if message:
        _tell(f"bipot: {message}", sys.stderr)


def _tell(line: str, stream: TextIO) -> None:
    # Flushed: who reads it through a pipe wants to see progress, not the end.
    stream.write(line + "\n")
    stream.flush()


def _peak_mb() -> float:
    import resource

    # Linux counts in kB, macOS in bytes.
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)
