"""The files of a run, written into a draft folder.

``draft`` is where a function writes, ``folder`` where the files will be: errors name it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bipot_rs.cli.output_folder import RESULT

if TYPE_CHECKING:
    from bipot_rs.contact.errors import NotConvergedError
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.result import Step
    from bipot_rs.discretisation.estimator import DiscretisationError
    from bipot_rs.scene.case import Case
    from bipot_rs.scene.schema.root import Scene

# The row of a load step, and the step.
Reached = tuple[dict[str, Any], "Step"]
Errors = Sequence["DiscretisationError | None"]

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
    "gap",
    "seconds",
    "s",
    "ahead",
    "working_set",
    "working_motion",
)


def recoverable(steps: Sequence[Step]) -> tuple[int, NotConvergedError | None]:
    """Find displacements; returns for how many steps, and the error of the next one."""
    from bipot_rs.contact.errors import NotConvergedError
    from bipot_rs.contact.result import recover

    try:
        recover(steps)
    except NotConvergedError:
        # A block that fails has none: find them one by one, up to the first failure.
        for k, step in enumerate(steps):
            try:
                recover([step])
            except NotConvergedError as error:
                return k, error
    return len(steps), None


def labels(scene: Scene | None) -> dict[str, str]:
    """Title and units of the scene, as attributes of the result file."""
    if scene is None:
        return {}
    return {"title": scene.title, "units": json.dumps(scene.units.model_dump())}


def contacts(case: Case) -> dict[str, Any]:
    """Arrays of ``/contacts``."""
    model = case.model
    return {
        "x": model.points,
        "normal": model.frame[:, 0],
        "area": model.area,
        "gap": model.gap,
        "mu": model.mu,
        "frame": model.frame,
    }


def write_series(
    draft: Path, folder: Path, case: Case, reached: Sequence[Reached], errors: Errors
) -> None:
    """Write the series for ParaView."""
    from bipot_rs.fem.paraview import write_bodies, write_contact
    from bipot_rs.files.export import writing

    model, steps = case.model, [step for _, step in reached]
    with writing(folder / "result.pvd"):
        of_cells = [_of_cells(_found(errors, k)) for k in range(len(steps))]
        write_bodies(
            draft / "result.pvd",
            model,
            steps,
            of_cells,
            at_rest=lambda k: case.stress_at_rest(
                k if steps[k].s is None else steps[k]
            ),
        )
    with writing(folder / "contact.pvd"):
        write_contact(draft / "contact.pvd", model, steps)


def write_table(
    draft: Path, folder: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write steps.csv, one line per load step."""
    from bipot_rs.files import csv_tables
    from bipot_rs.files.export import writing

    with writing(folder / "steps.csv"):
        lines = ([row.get(column) for column in columns] for row in rows)
        csv_tables.write(draft / "steps.csv", columns, lines)


def write_pictures(
    draft: Path,
    folder: Path,
    scene: Scene,
    case: Case,
    reached: Sequence[Reached],
    errors: Errors,
) -> None:
    """Write tractions.png and, if the error is known, error.png of the last load step."""
    from bipot_rs.fem.contact_surface import surface_labels
    from bipot_rs.files.export import writing
    from bipot_rs.plots.run_figure import tractions

    title, units = scene.title, scene.units.model_dump()
    with writing(folder / "tractions.png"):
        tractions(
            draft / "tractions.png",
            contacts(case) | surface_labels(case.model),
            steps(reached, errors),
            title=title,
            units=units,
        )
    last = errors[-1] if errors else None
    if last is not None and last.total > 0:
        from bipot_rs.plots.error_map import error_map

        with writing(folder / "error.png"):
            error_map(
                draft / "error.png",
                case.model.nodes,
                case.model.cells,
                last.cells,
                contacts=case.model.points,
                title=f"{title}: {last.kind} {last.relative:.1%}",
                unit=units["length"],
            )


def write_problems(
    draft: Path,
    folder: Path,
    name: str,
    scene: Scene,
    case: Case,
    problem: ContactProblem,
    reached: Sequence[Reached],
    message: str,
) -> None:
    """Write the problem of each load step as an FCLIB file."""
    from importlib.metadata import version

    from bipot_rs.contact.result import Result
    from bipot_rs.fclib import write_path
    from bipot_rs.files.export import writing

    result = Result(
        [step for _, step in reached],
        contacts={},
        shape=case.model.points.shape,
        success=True,
        message=message,
    )
    units = scene.units.model_dump().items()
    info = {
        "title": scene.title,
        "description": f"scene {name} of bipot_rs {version('bipot-rs')}; "
        + ", ".join(f"{quantity} in {unit}" for quantity, unit in units),
    }
    with writing(folder / "problem-….hdf5"):
        write_path(draft / "problem", problem, result, info=info)


def write_result(
    draft: Path,
    folder: Path,
    case: Case | None,
    reached: Sequence[Reached],
    errors: Errors,
    *,
    complete: bool,
    attributes: Mapping[str, Any],
) -> None:
    """Write result.h5."""
    from bipot_rs.fem.contact_surface import surface_labels
    from bipot_rs.files.export import write_result, writing

    with writing(folder / RESULT):
        write_result(
            draft / RESULT,
            {} if case is None else contacts(case) | surface_labels(case.model),
            steps(reached, errors),
            complete=complete,
            attributes=attributes,
        )


def steps(reached: Sequence[Reached], errors: Errors) -> list[dict[str, Any]]:
    """The fields of each step, as `bipot_rs.load` reads them."""
    return [
        {name: getattr(step, name) for name in _FIELDS}
        | {
            "load": row["load"],
            "outcome": str(step.outcome),
            "displacement": step.displacement,
        }
        | dict(step.stats)
        | _of_step(_found(errors, k))
        for k, (row, step) in enumerate(reached)
    ]


def _found(errors: Errors, k: int) -> DiscretisationError | None:
    return errors[k] if k < len(errors) else None


def _of_cells(found: DiscretisationError | None) -> dict[str, Any]:
    """Element fields of a step for ParaView."""
    if found is None:
        return {}
    return {"error": found.cells, "error_density": found.density}


def _of_step(found: DiscretisationError | None) -> dict[str, Any]:
    """The discretisation error of a step, for the result file."""
    if found is None:
        return {}
    return {
        "error_cells": found.cells,
        "error_contacts": found.contacts,
        "error_total": found.total,
        "error_relative": found.relative,
        "error_kind": found.kind,
    }
