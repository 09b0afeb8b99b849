"""The files of a run, written into a draft folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, TypeAlias

from bipot_rs.cli.run.output_folder import RESULT

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray, Floats, OpenRecord
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.results.result import Result
    from bipot_rs.contact.results.solution import Step
    from bipot_rs.discretisation.estimator import DiscretisationError
    from bipot_rs.fem.paraview import BodySeries, Part
    from bipot_rs.petsc.run.distributed import DistributedProblem
    from bipot_rs.scene.case import Case
    from bipot_rs.scene.schema.root import Scene

# The row of a load step, and the step.
Reached: TypeAlias = "tuple[OpenRecord, Step]"


def contacts(case: Case) -> dict[str, AnyArray]:
    """Arrays of ``/contacts``."""
    model = case.model
    arrays: dict[str, AnyArray] = {
        "x": model.points,
        "normal": model.frame[:, 0],
        "area": model.area,
        "gap": model.gap,
        "frame": model.frame,
    }
    rest = {name: value for name, value in model.law.items() if value.any()}
    return arrays | {"mu": model.mu} | rest


# Statistics of a problem that the file keeps.
_OF_ENGINE = ("engine", "engine_reason", "preconditioner", "ranks", "partition")


def origin(
    name: str,
    settings: Sequence[str],
    scene: Scene | None,
    problem: ContactProblem | DistributedProblem | None,
    message: str,
) -> dict[str, object]:
    """Attributes of a result file: the scene, its settings, the engine, how it ended."""
    record: dict[str, object] = {
        "scene": name,
        "message": message,
        "settings": json.dumps(settings),
    }
    if scene is not None and scene.wear is not None:
        record["cycles"] = scene.wear.cycles
    elif scene is not None and not scene.path.increments:
        record["planned"] = scene.path.count()
    if problem is not None:
        solved = problem.stats
        record |= {key: solved[key] for key in _OF_ENGINE if key in solved}
    return record


@dataclass(frozen=True)
class Output:
    """Where the files of a run go, and what they hold."""

    # draft, folder: the folder to write into, and where the files will be: errors name the
    # latter.
    draft: Path
    folder: Path
    # scene, case: None if the run ended before.
    scene: Scene | None
    case: Case | None
    # reached, errors: the load steps, and their discretisation errors if known.
    reached: Sequence[Reached]
    errors: Sequence[DiscretisationError | None]

    @contextmanager
    def _file(self, name: str) -> Iterator[Path]:
        from bipot_rs.files.drafts import writing

        with writing(self.folder / name):
            yield self.draft / name

    def parts(self, case: Case, part: Part) -> BodySeries:
        """Begin the series of the bodies, of which this rank writes a part."""
        from bipot_rs.fem.paraview import BodySeries

        with self._file("result.pvd") as path:
            return BodySeries(path, case.model, part, units=self._units())

    def part(self, series: BodySeries, case: Case, k: int, step: Step) -> None:
        """Write the part of load step ``k``."""
        instant = self._instants(k, k + 1)[0]
        with self._file(f"result_{k:04d}.pvtu and its parts"):
            series.add(step, case.rest_of(k, step), instant=instant)

    def contact_series(self, case: Case) -> None:
        """Write the series of the contacts."""
        from bipot_rs.fem.paraview import write_contact

        with self._file("contact.pvd") as path:
            write_contact(
                path,
                case.model,
                [step for _, step in self.reached],
                instants=self._instants(),
                units=self._units(),
            )

    def bodies(self, case: Case) -> Iterator[dict[str, AnyArray]]:
        """Write the series of the bodies step by step; yields the fields of their cells."""
        from bipot_rs.fem.paraview import write_bodies

        steps = [step for _, step in self.reached]
        with self._file("result.pvd") as path:
            yield from write_bodies(
                path,
                case.model,
                steps,
                (
                    {"error": estimate.cells, "error_density": estimate.density}
                    if estimate
                    else {}
                    for estimate in map(self._error, range(len(steps)))
                ),
                at_rest=lambda k: case.rest_of(k, steps[k]),
                instants=self._instants(),
                units=self._units(),
            )

    def stresses(self, case: Case) -> Iterator[dict[str, Floats]]:
        """The stress of all cells in each step, where each rank writes a part of them."""
        from bipot_rs.fem.bodies.stress_recovery import MeanStress
        from bipot_rs.fem.paraview import cell_fields

        means = [MeanStress(body) for body in case.model.bodies]
        for k, (_, step) in enumerate(self.reached):
            rest = case.rest_of(k, step)
            yield cell_fields(case.model, step.displacement, rest, means)

    def table(
        self, columns: Sequence[str], rows: Sequence[Mapping[str, object]]
    ) -> None:
        """Write steps.csv, one line per load step."""
        from bipot_rs.files import csv_tables

        with self._file("steps.csv") as path:
            lines = ([row.get(column) for column in columns] for row in rows)
            csv_tables.write(path, columns, lines)

    def pictures(self, scene: Scene, case: Case) -> None:
        """Write tractions.png and, if its error is known, error.png of the last step."""
        from bipot_rs.plots.run_figure import write_figure

        title, units = scene.title, scene.units.model_dump()
        result = self._path(case, self._contacts())
        with self._file("tractions.png") as path:
            write_figure(path, result, title=title, units=units)
        last = self.errors[-1] if self.errors else None
        if last is not None and last.total > 0:
            from bipot_rs.plots.run_figure import error_map

            with self._file("error.png") as path:
                error_map(
                    path,
                    case.model.nodes,
                    case.model.cells,
                    last.cells,
                    contacts=case.model.points,
                    title=f"{title}: {last.kind} {last.relative:.1%}",
                    unit=units["length"],
                )

    def problems(
        self, name: str, scene: Scene, case: Case, problem: ContactProblem, message: str
    ) -> None:
        """Write the problem of each load step as an FCLIB file."""
        from importlib.metadata import version

        from bipot_rs.fclib import write_path
        from bipot_rs.files.drafts import writing

        result = self._path(case, {}, message)
        units = scene.units.model_dump().items()
        info = {
            "title": scene.title,
            "description": f"scene {name} of bipot_rs {version('bipot-rs')}; "
            + ", ".join(f"{quantity} in {unit}" for quantity, unit in units),
        }
        with writing(self.folder / "problem-….hdf5"):
            write_path(self.draft / "problem", problem, result, info=info)

    def result(
        self,
        attributes: Callable[[], Mapping[str, object]],
        of_cells: Iterable[Mapping[str, AnyArray]] = (),
    ) -> None:
        """Write result.h5."""
        from bipot_rs.contact.results.contact_fields import make_path_fields
        from bipot_rs.fem.contact_surface import result_mesh
        from bipot_rs.files.export import write_result

        mesh = None if self.case is None else result_mesh(self.case.model)
        steps = [step for _, step in self.reached]
        labels: dict[str, str] = {}
        if self.scene is not None:
            units = json.dumps(self.scene.units.model_dump())
            labels = {"title": self.scene.title, "units": units}
        with self._file(RESULT) as path:
            write_result(
                path,
                self._contacts(),
                self._steps(),
                complete=False,
                attributes=lambda: {**labels, **attributes()},
                fields=make_path_fields(
                    steps, self._contacts(), self._instants(), mesh
                ),
                mesh=mesh,
                of_cells=of_cells,
                units=self._units(),
            )

    def _path(
        self, case: Case, contacts: Mapping[str, AnyArray], message: str = ""
    ) -> Result:
        """The load steps as a `Result`."""
        from bipot_rs.contact.results.result import Result

        return Result(
            [step for _, step in self.reached],
            contacts=contacts,
            shape=case.model.points.shape,
            success=True,
            message=message,
        )

    def _units(self) -> dict[str, str]:
        """Names of units that the scene gives."""
        return {} if self.scene is None else self.scene.units.model_dump()

    def _instants(
        self, start: int = 0, end: int | None = None
    ) -> list[dict[str, float]]:
        """Path parameter of the scene and time of the steps from ``start`` to ``end``."""
        from bipot_rs.contact.results.contact_fields import list_instants

        some = self.reached[start:end]
        loads = [row["load"] for row, _ in some]
        return list_instants([step for _, step in some], loads, start)

    def _contacts(self) -> dict[str, AnyArray]:
        from bipot_rs.fem.contact_surface import surface_labels

        if self.case is None:
            return {}
        return contacts(self.case) | surface_labels(self.case.model)

    def _steps(self) -> list[dict[str, object]]:
        """The fields of each step, as `bipot_rs.load` reads them."""
        from bipot_rs.contact.results.step_record import make_record

        # The history would be larger than all the rest.
        return [
            make_record(step, row["load"])
            | {"history": None}
            | _of_step(self._error(k))
            for k, (row, step) in enumerate(self.reached)
        ]

    def _error(self, k: int) -> DiscretisationError | None:
        return self.errors[k] if k < len(self.errors) else None


def _of_step(estimate: DiscretisationError | None) -> dict[str, object]:
    """The discretisation error of a step, for the result file."""
    if estimate is None:
        return {}
    return {
        "error_cells": estimate.cells,
        "error_contacts": estimate.contacts,
        "error_total": estimate.total,
        "error_relative": estimate.relative,
        "error_kind": estimate.kind,
    }


# The file has all load steps and is written anew after each, unless that has taken this
# share of the time of the run so far; these first seconds are always granted.
_SHARE, _GRANTED = 0.05, 1.0


class Checkpoint:
    """A result file that is replaced after each load step of a run on several ranks.

    A rank that is killed takes the others with it, at any time: the launcher leaves them a
    second or none. The complete load steps must therefore be in a file already.

    ``draft``: folder in which the file is prepared.
    ``path``: the file.
    ``attributes``: attributes of the file.
    """

    def __init__(
        self, draft: Path, path: Path, attributes: Mapping[str, object]
    ) -> None:
        self.draft, self.path = draft, path
        self._attributes = attributes
        self._began = perf_counter()
        self._spent = 0.0
        # Load steps in the file.
        self.steps = 0

    def save(self, out: Output, *, always: bool = False) -> None:
        """Write the load steps reached, if that does not take too much of the time."""
        began = perf_counter()
        limit = _GRANTED + _SHARE * (began - self._began)
        if len(out.reached) == self.steps or (self._spent > limit and not always):
            return
        out.result(lambda: self._attributes)
        (self.draft / RESULT).replace(self.path)
        self.steps = len(out.reached)
        self._spent += perf_counter() - began
