"""One solution of a problem in files, from the files to the results."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import Progress, tell
from bipot_rs.cli.run.output_folder import RESULT, make
from bipot_rs.cli.run.report import format_steps, list_closing
from bipot_rs.cli.run.runner import MISTAKES, Runner, outcome
from bipot_rs.cli.text_table import terminal_width
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.tables import COLUMNS, list_surface_forces, make_row
from bipot_rs.files import csv_tables
from bipot_rs.files.series import write_series

if TYPE_CHECKING:
    from bipot_rs.cli.run.matrix_files import MatrixProblem
    from bipot_rs.contact.errors import BipotError
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.results.solution import Step
    from bipot_rs.files.result_mesh import ResultMesh


@dataclass(frozen=True)
class MatrixOptions:
    """Arguments of the command; the files and ``order`` are those of `matrix_files.read`.

    ``stiffness_rtol`` is the relative error of the entries of the stiffness, as
    `ContactProblem` takes it.
    """

    stiffness: Path
    contacts: Path
    nodes: Path | None
    load: Path | None
    fixed: Path | None
    order: str | None
    folder: Path
    method: str
    tol: float
    stiffness_rtol: float | None
    engine: str = "auto"


class SolveMatrix:
    """One solution of a problem in files, which `runner` carries out."""

    def __init__(
        self, request: MatrixOptions, *, as_json: bool, interrupts: Interrupts
    ) -> None:
        self.runner = Runner(
            self,
            as_json=as_json,
            interrupts=interrupts,
            mistakes=(*MISTAKES, TypeError),
        )
        self.request = request
        self.given: MatrixProblem | None = None
        self.problem: ContactProblem | None = None
        self.result: Result | None = None
        self.written: list[str] = []

    def work(self) -> tuple[int, str]:
        """Read, solve and write."""
        runner = self.runner
        from bipot_rs.cli.run.matrix_files import read
        from bipot_rs.files.export import require

        require()
        asked = self.request
        self.given = model = read(
            asked.stiffness,
            asked.contacts,
            asked.nodes,
            asked.load,
            asked.fixed,
            order=asked.order,
        )
        # Before the work, so that a folder that cannot be made is found then.
        make(asked.folder)
        with Progress(1, _count(model), quiet=runner.as_json) as runner.progress:
            code, message = runner.attempt(lambda: self._solve(model))
        if self.result is None and self.problem is not None and runner.reached:
            self.result = self._make_unfinished(self.problem, message)
        if self.result is not None:
            before = len(runner.reached)
            code, message = runner.recover(code, message)
            if self.problem is not None and len(runner.reached) < before:
                self.result = self._make_unfinished(self.problem, message)
            self._write(model, self.result)
        if code == SOLVED and runner.interrupts.came is not None:
            code, message = runner.interrupted
        return code, message

    def _solve(self, given: MatrixProblem) -> None:
        asked = self.request
        with warnings.catch_warnings():
            # The remarks of the result say the same.
            warnings.simplefilter("ignore", UserWarning)
            problem = self.problem = given.problem(
                stiffness_rtol=asked.stiffness_rtol, engine=asked.engine
            )
        group = np.zeros(len(given.gap), dtype=np.int64)

        def on_step(k: int, step: Step) -> None:
            forces = list_surface_forces(
                step,
                given.frame,
                given.mu,
                group,
                ["contacts"],
                x=given.points,
                area=given.area,
            )
            self.runner.reach({**make_row(k, None, step), **forces}, step)

        self.result = problem.solve(
            given.load,
            given.prescribed,
            method=asked.method,
            tol=asked.tol,
            on_step=on_step,
        )

    def failed(self, error: BipotError) -> tuple[int, str]:
        """Exit status and message of an error, with the node of its degree of freedom."""
        self.result = error.result
        code, message = outcome(error)
        if self.given is not None and error.dof is not None:
            node, component = self.given.labels[error.dof]
            if component:
                message += (
                    f" (degree of freedom {error.dof} is {component} of node {node})"
                )
        return code, message

    def _make_unfinished(self, problem: ContactProblem, message: str) -> Result:
        """The result of the load steps reached."""
        return Result(
            [step for _, step in self.runner.reached],
            contacts=problem.contacts.arrays(),
            shape=problem.contacts.shape,
            success=False,
            message=message,
        )

    def _write(self, given: MatrixProblem, result: Result) -> None:
        """Write result.h5, the tables and, where places are known, files for ParaView."""
        result.mesh = mesh = given.mesh()
        rows = [row for row, _ in self.runner.reached]
        columns = list(rows[0]) if rows else [c for c in COLUMNS if c != "load"]
        displacements = (
            (k, dof, node if name else "", name, float(u))
            for k, step in enumerate(result)
            for dof, ((node, name), u) in enumerate(
                zip(given.labels, step.displacement, strict=True)
            )
        )
        header = ("step", "dof", "node", "component", "displacement")
        writers: dict[str, Callable[[Path], None]] = {
            RESULT: result.save,
            "steps.csv": lambda path: csv_tables.write(
                path, columns, (list(row_of_table.values()) for row_of_table in rows)
            ),
            "reactions.csv": lambda path: csv_tables.write(
                path, _header(given), _reactions(given, result)
            ),
            "displacements.csv": lambda path: csv_tables.write(
                path, header, displacements
            ),
        }
        if given.points is not None:
            writers["contact.pvd"] = result.write
        if mesh is not None:
            writers["result.pvd"] = lambda path: _write_nodes(path, mesh, result)
        for name, writer in writers.items():
            try:
                writer(self.request.folder / name)
            except OSError as error:
                written = ", ".join(self.written) or "none"
                raise OSError(f"{error}; files written before: {written}") from error
            self.written.append(name)

    def show(self, code: int) -> None:
        """Print the table of load steps, remarks, sizes and the names of the files."""
        model, folder = self.given, self.request.folder
        if model is None:
            return
        rows = [row for row, _ in self.runner.reached]
        if rows:
            tell(format_steps(rows, width=terminal_width()), sys.stdout)
        if code != SOLVED:
            return
        remarks = () if self.result is None else self.result.remarks
        drawn = None if model.points is None else folder
        # The bodies are points only, and there are none if some nodes are not listed.
        lines = list_closing(rows, self.request.tol, drawn, remarks, "contact.pvd")
        contacts = count_noun(len(model.gap), "contact")
        seconds = perf_counter() - self.runner.started
        lines.append(
            f"{model.K.shape[0]} degrees of freedom, {contacts}, {seconds:.2f} s"
        )
        lines.append(f"{folder}: {', '.join(sorted(self.written))}")
        tell("\n".join(lines), sys.stdout)

    def last_line(self, code: int, message: str) -> dict[str, object]:
        """Keys of the last line of --json."""
        model, result = self.given, self.result
        last: dict[str, object] = {
            "stiffness": str(self.request.stiffness),
            "dofs": None if model is None else model.K.shape[0],
            "contacts": None if model is None else len(model.gap),
            "steps": len(self.runner.reached),
            "success": code == SOLVED,
            "seconds": round(perf_counter() - self.runner.started, 6),
            "message": message,
            "remarks": [] if result is None else list(result.remarks),
        }
        if result is not None and result.rigid_motions_off is not None:
            last["rigid_motions_off"] = result.rigid_motions_off
        return last


def _count(given: MatrixProblem) -> int:
    """Load steps: of loads and prescribed displacements one row may serve all steps."""
    loads = 1 if given.load is None else len(given.load)
    return max(loads, len(given.prescribed))


def _write_nodes(path: Path, mesh: ResultMesh, result: Result) -> None:
    """Write the nodes of the bodies as points; the cells are not known."""
    steps = (
        {"displacement": mesh.of_nodes(step.displacement), **instant}
        for step, instant in zip(result, result.instants(), strict=True)
    )
    write_series(path, mesh.nodes, None, steps, units=result.units)


def _header(given: MatrixProblem) -> list[str]:
    dim = given.frame.shape[1]
    local = ("n", "t1", "t2")[:dim]
    return [
        *("step", "contact", "node", "status"),
        *(f"r_{c}" for c in local),
        *(f"f_{a}" for a in "xyz"[:dim]),
        *(f"v_{c}" for c in local),
        *(f"slip_{c}" for c in local[1:]),
    ]


def _reactions(given: MatrixProblem, result: Result) -> Iterator[list[object]]:
    """The rows of reactions.csv: forces in the frame of the contact and in global axes."""
    for k, step in enumerate(result):
        force = (step.reaction[:, :, None] * given.frame).sum(axis=1)
        for c in range(len(given.gap)):
            yield [
                k,
                c,
                "" if given.nodes is None else int(given.nodes[c]),
                STATUS_NAMES[step.status[c]],
                *step.reaction[c].tolist(),
                *force[c].tolist(),
                *step.relative_displacement[c].tolist(),
                *step.slip[c].tolist(),
            ]
