"""Solve one row of a study. These functions run in worker processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from bipot_rs.cli.exit_codes import NOT_CONVERGED, SOLVED
from bipot_rs.cli.run import cost_forecast
from bipot_rs.cli.run.output_files import Output, Reached, origin
from bipot_rs.cli.run.output_folder import RESULT
from bipot_rs.cli.run.report import forces
from bipot_rs.cli.run.resume import stamps
from bipot_rs.cli.run.runner import outcome, recover_steps
from bipot_rs.cli.study.folder import OUTCOME_OF, PRESSURE, row_folder
from bipot_rs.cli.study.plan import format_settings, row_digest
from bipot_rs.contact.errors import BipotError
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.results.tables import make_row
from bipot_rs.fem.contact_surface import surface_names
from bipot_rs.scene.build import bodies
from bipot_rs.scene.case import Case, assemble
from bipot_rs.scene.mistakes import SceneError
from bipot_rs.scene.reading import read
from bipot_rs.scene.schema.root import Scene


@dataclass(frozen=True)
class Row:
    """One row of a study."""

    number: int  # its number in the study, from 0
    # scene, settings, method, tol: what to solve.
    scene: str
    settings: Mapping[str, str]
    method: str | None
    tol: float | None
    # The folder of the study. If the row fails, its solved load steps are written there.
    folder: Path
    keep: bool = False  # write the result of a solved row as well


def solve(row: Row) -> dict[str, object]:
    """Solve a row; returns its entries in the table.

    A row that fails has the figures of its last solved load step.
    """
    return _Attempt(row).run()


def solve_as(row: Row, digest: str) -> dict[str, object] | str:
    """`solve` on another machine; a message if its scene differs from ``digest``.

    A row without a digest has mistakes, which `solve` reports.
    """
    try:
        here = read(row.scene, format_settings(row.settings))
    except SceneError as error:
        if digest:
            return f"its worker cannot read the scene: {error}"
    else:
        if row_digest(here, row.method, row.tol) != digest:
            return (
                f"its worker reads another scene {row.scene!r}, or has another version of "
                "bipot_rs"
            )
    return solve(row)


def peak(scene: str, settings: Mapping[str, str]) -> float:
    """Most bytes that solving a row takes, without solving it."""
    scene_of_row = read(scene, format_settings(settings))
    return cost_forecast.peak(assemble(scene_of_row, bodies(scene_of_row)))


class _Attempt:
    """The solution of one row, as far as it gets."""

    def __init__(self, row: Row) -> None:
        self.row = row
        self.scene: Scene | None = None
        self.case: Case | None = None
        self.problem: ContactProblem | None = None
        self.reached: list[Reached] = []

    def run(self) -> dict[str, object]:

        started = perf_counter()
        try:
            self._solve()
            code, message = SOLVED, ""
        except (BipotError, ValueError, MemoryError) as error:
            code, message = outcome(error)
        if self.reached and (code != SOLVED or self.row.keep):
            code, message = self._write(code, message)
        figures = self._figures()
        return {
            "outcome": OUTCOME_OF[code],
            **figures,
            "seconds": round(perf_counter() - started, 6),
            "message": message,
        }

    def _solve(self) -> None:

        row = self.row
        self.scene = scene = read(row.scene, format_settings(row.settings))
        tolerance = scene.solver.tol if row.tol is None else row.tol
        if isinstance(tolerance, str):
            raise ValueError(f"tol is {tolerance!r}, expected a number in a sweep")
        cost_forecast.fits(scene)
        self.case = case = assemble(scene, bodies(scene))
        self.problem = case.problem()

        def on_step(k: int, step: Step) -> None:
            parameter = case.step_parameter(k, step)
            self.reached.append((make_row(k, parameter, step), step))

        case.solve(self.problem, method=row.method, tol=tolerance, on_step=on_step)

    def _figures(self) -> dict[str, object]:
        """Figures of the last load step that is solved, and of all steps."""
        if self.case is None:
            return {}
        if not self.reached:
            return {"steps": 0}

        last, step = self.reached[-1]
        return {
            "steps": len(self.reached),
            **{name: last[name] for name in STATUS_NAMES},
            "residual": max(float(row["residual"]) for row, _ in self.reached),
            "iterations": sum(int(row["iterations"]) for row, _ in self.reached),
            **forces(self.case.model, step),
            **_pressures(self.case, step),
        }

    def _write(self, code: int, message: str) -> tuple[int, str]:
        """Write result.h5; returns how the row ends after that."""
        row, scene, case = self.row, self.scene, self.case
        if scene is None or case is None:
            return code, message

        if not row.folder.is_dir():
            # Another machine: a folder made there would be lost.
            return code, _and(
                message, f"no {RESULT}: its worker has no folder {row.folder}"
            )
        here = row_folder(row.folder, row.number)
        try:
            lost = recover_steps(self.reached)
            if lost:
                code, message = NOT_CONVERGED, lost
            here.mkdir(parents=True, exist_ok=True)
            made = origin(
                row.scene, format_settings(row.settings), scene, self.problem, message
            )
            made |= stamps(scene, row.method, row.tol) | {"complete": code == SOLVED}
            Output(here, here, scene, case, self.reached, ()).result(lambda: made)
        except (OSError, MemoryError) as error:
            return code, _and(message, f"no {RESULT}: {outcome(error)[1]}")
        return code, message


def _and(message: str, more: str) -> str:
    return f"{message}; {more}" if message else more


def _pressures(case: Case, step: Step) -> dict[str, float]:
    """Largest contact pressure of each surface [force per area]."""
    model, largest = case.model, {}
    for k, name in enumerate(surface_names(model)):
        on_surface = (model.group == k) & (model.area > 0)
        pressure = step.reaction[on_surface, 0] / model.area[on_surface]
        largest[f"{PRESSURE} of {name}"] = float(np.max(pressure, initial=0.0))
    return largest
