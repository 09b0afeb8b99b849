"""One run of a scene: solve it, tell its progress, write its files."""

from __future__ import annotations

import csv
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from bipot_rs.problem import ContactProblem
    from bipot_rs.result import Step
    from bipot_rs.scene import Case
    from bipot_rs.schema import Scene

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write", "total")


class Job:
    """One run: its clock, what it has reached, and what it tells."""

    def __init__(self, name: str | None, *, as_json: bool) -> None:
        self.name = name
        self.as_json = as_json
        self.started = perf_counter()
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        # Load steps reached: what is told of each, and the step. Pairs, so that an
        # interrupt between the two cannot tear them apart.
        self.reached: list[tuple[dict[str, Any], Step]] = []

    def run(
        self,
        settings: list[str],
        folder: Path,
        method: str | None,
        tol: float | None,
        *,
        plot: bool,
        fclib: bool = False,
    ) -> int:
        """Go from the scene to the files; returns the exit status."""
        try:
            from bipot_rs.export import require
            from bipot_rs.scene import read

            require()
            self.scene = read(self.name or "", settings)
            with _draft(folder) as draft:
                code, message = self._attempt(self.scene, method, tol)
                if self.case is not None:
                    self._write(
                        self.case, draft, message, complete=code == SOLVED, plot=plot
                    )
                    if fclib:
                        self._write_problems(draft, message)
                    _replace(draft, folder)
                    if code != SOLVED:
                        message += f" (load steps in {folder}: {len(self.reached)})"
        except KeyboardInterrupt:
            code, message = INTERRUPTED, "interrupted"
        except (ImportError, ValueError, OSError, MemoryError) as error:
            code, message = BAD_INPUT, str(error) or type(error).__name__
        if code == SOLVED and not self.as_json:
            self._print_table(folder)
        return self.end(code, message)

    def end(self, code: int, message: str) -> int:
        """Tell the outcome: the last line of --json, or a complaint if there is one."""
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
        self, scene: Scene, method: str | None, tol: float | None
    ) -> tuple[int, str]:
        """Mesh, assemble, solve; the steps reached stay in `reached`."""
        from bipot_rs.errors import (
            FloatingBodyError,
            NoEquilibriumError,
            NotConvergedError,
        )
        from bipot_rs.scene import assemble, bodies

        try:
            with _Progress(scene.path.count(), quiet=self.as_json) as progress:
                with self._phase("mesh", progress):
                    meshed = bodies(scene)
                with self._phase("assemble", progress):
                    self.case = case = assemble(scene, meshed)
                with self._phase("condense", progress):
                    self.problem = problem = case.model.problem()

                def on_step(k: int, step: Step) -> None:
                    row = _row(k, float(case.parameter[k]), step)
                    self.reached.append((row, step))
                    if self.as_json:
                        _line(**row)
                    progress.step(row)

                with self._phase("solve", progress):
                    problem.solve(
                        case.load,
                        case.prescribed,
                        method=scene.solver.method if method is None else method,
                        tol=scene.solver.tol if tol is None else tol,
                        max_iterations=scene.solver.max_iterations,
                        on_step=on_step,
                    )
        except (NoEquilibriumError, FloatingBodyError) as error:
            return NO_ANSWER, str(error)
        except NotConvergedError as error:
            return NOT_CONVERGED, str(error)
        except KeyboardInterrupt:
            return INTERRUPTED, "interrupted"
        return SOLVED, "solved"

    @contextmanager
    def _phase(self, name: str, progress: _Progress | None = None) -> Iterator[None]:
        if progress is not None:
            progress.phase(name)
        start = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += perf_counter() - start

    def _write(
        self, case: Case, folder: Path, message: str, *, complete: bool, plot: bool
    ) -> None:
        from bipot_rs.export import write_result, write_series

        model = case.model
        with self._phase("recover"):
            for _, step in self.reached:
                _ = step.displacement  # computed here, kept by the step
        with self._phase("write"):
            # Fields of a step under their own names: `bipot_rs.load` takes them.
            steps = [
                {name: getattr(step, name) for name in _FIELDS}
                | {
                    "load": row["load"],
                    "outcome": str(step.outcome),
                    "displacement": step.displacement,
                }
                for row, step in self.reached
            ]
            contacts = {
                "x": model.points,
                "normal": model.frame[:, 0],
                "area": model.area,
                "gap": model.gap,
                "mu": model.mu,
                "frame": model.frame,
            }
            write_result(
                folder / "result.h5",
                contacts,
                steps,
                complete=complete,
                attributes={"scene": self.name or "", "message": message},
            )
            write_series(
                folder / "result.pvd",
                model.nodes,
                model.cells,
                (
                    model.fields(step.displacement, step.reaction, step.status)
                    for _, step in self.reached
                ),
            )
            with (folder / "steps.csv").open("w", newline="", encoding="utf-8") as file:
                table = csv.DictWriter(file, _COLUMNS)
                table.writeheader()
                table.writerows(row for row, _ in self.reached)
            if plot and steps and self.scene is not None:
                from bipot_rs.plot import tractions

                title, units = self.scene.title, self.scene.units.model_dump()
                tractions(
                    folder / "tractions.png", contacts, steps, title=title, units=units
                )

    def _write_problems(self, folder: Path, message: str) -> None:
        """Write the problem of each step for other solvers."""
        from importlib.metadata import version

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
        with self._phase("write"):
            write_path(folder / "problem", self.problem, result, info=info)

    def _print_table(self, folder: Path) -> None:
        from rich.console import Console
        from rich.table import Table

        console = Console()
        title = self.scene.title if self.scene else None
        table = Table(title=title, title_justify="left")
        for column in _COLUMNS:
            table.add_column(column, justify="right")
        for row, _ in self.reached:
            table.add_row(*_cells(row))
        console.print(table)
        times = ", ".join(
            f"{phase} {self.seconds[phase]:.2f} s" for phase in PHASES[:-1]
        )
        model = self.case.model if self.case else None
        size = (
            f"{model.n} degrees of freedom, {len(model.gap)} contacts: "
            if model
            else ""
        )
        console.print(size + times, highlight=False, soft_wrap=True)
        names = sorted(
            path.name for path in _ours(folder) if path.suffix not in (".vtu", ".hdf5")
        )
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


def _row(k: int, parameter: float, step: Step) -> dict[str, Any]:
    """Collect what is told of a load step: a line of --json, of the table, of steps.csv."""
    counts = [int((step.status == status).sum()) for status in (0, 1, 2)]
    told = (k, parameter, *counts, step.residual, step.iterations, step.seconds)
    return dict(zip(_COLUMNS, told, strict=True))


def _cells(row: dict[str, Any]) -> list[str]:
    forms = {"load": "{:.6g}", "residual": "{:.1e}", "seconds": "{:.3f}"}
    return [forms.get(name, "{}").format(row[name]) for name in _COLUMNS]


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
        draft = tempfile.TemporaryDirectory(prefix=".bipot-", dir=folder)
    except OSError as error:
        raise OSError(f"cannot write to the folder {folder}: {error}") from error
    with draft as name:
        yield Path(name)


def _replace(draft: Path, folder: Path) -> None:
    """Move the files of the draft in, and remove those of an earlier run."""
    new = {path.name for path in draft.iterdir()}
    for name in sorted(new):
        (draft / name).replace(folder / name)
    for old in _ours(folder):
        if old.name not in new:
            old.unlink()


def _ours(folder: Path) -> list[Path]:
    """Files that a run writes; whatever else a folder holds is not ours to touch."""
    named = ("result.h5", "result.pvd", "steps.csv", "tractions.png")
    series = [p for p in folder.glob("result_*.vtu") if p.stem[7:].isdigit()]
    series += [p for p in folder.glob("problem-*.hdf5") if p.stem[8:].isdigit()]
    return [path for path in map(folder.joinpath, named) if path.exists()] + series


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
