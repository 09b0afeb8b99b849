"""Solve the rows of a study in parallel, into one table.

The table is written after each row, so that an interrupted sweep can continue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.progress import Progress, complain, line
from bipot_rs.cli.run.output_folder import SWEEP
from bipot_rs.cli.study.folder import (
    LOST,
    OUTCOME_OF,
    earlier,
    has_result,
    make_folder,
    print_study,
    set_aside,
    summarise_rows,
    write,
    write_record,
)
from bipot_rs.cli.study.plan import Study, StudyPart, deal, format_settings, plan
from bipot_rs.cli.study.row import Row, peak, solve, solve_as
from bipot_rs.cli.study.workers import Workers
from bipot_rs.scene.library import shipped

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record
    from bipot_rs.cli.study.workers import Cluster

# The number of a row, and its entries or why it was lost.
Answers = Iterator[tuple[int, dict[str, object] | str]]


@dataclass(frozen=True)
class StudyOptions:
    """Arguments of the command. ``method`` and ``tol`` None: those of the scene."""

    scene: str
    settings: Sequence[str]
    ranges: Sequence[str]
    folder: Path  # the folder of the study; that of a part is in it
    method: str | None = None
    tol: float | None = None
    part: StudyPart | None = None
    results: bool = False  # write the result of every row, not only of those that fail
    jobs: int | None = None  # number of processes on this machine
    # Address of a dask scheduler, whose workers solve the rows.
    scheduler: str | None = None
    resume: bool = False
    as_json: bool = False


def solve_rows(request: StudyOptions) -> int:
    """Solve the rows and write the table; returns the worst exit status.

    ``KeyboardInterrupt`` passes through; the finished rows are in the table.
    """
    from bipot_rs._lib import validation

    if request.jobs is not None and request.scheduler is not None:
        raise ValueError(
            "--jobs cannot be used with --scheduler, which has workers of its own: remove "
            "--jobs"
        )
    say: Callable[[str], object] = (lambda _: None) if request.as_json else complain
    tol = 1e-10 if request.tol is None else request.tol
    study = plan(
        request.scene, request.settings, request.ranges, request.method, request.tol
    )
    validation.settings(request.method or "auto", tol, None, None)
    mine, folder = list(range(len(study.rows))), request.folder
    if request.part is not None:
        mine = deal(study.costs, request.part.count)[request.part.number - 1]
        folder /= request.part.folder
    with _pool(request, say) as pool:
        make_folder(folder)
        done = _take_finished_rows(request, study, folder, mine, say)
        for before in set_aside(folder, done):
            say(f"rows that are not part of this sweep are kept in {before}")
        path = folder / SWEEP
        record = study.record
        if request.part is not None:
            record = replace(record, part=str(request.part), rows=mine)
        write_record(folder, record)
        write(path, study.keys, done)
        if done:
            say(f"{len(done)} of {count_noun(len(mine), 'row')} are already finished")
        left = [k for k in mine if k not in done]
        asked = [_row(request, study, k, folder) for k in left]
        with Progress(1, len(left), quiet=request.as_json, noun="rows") as progress:
            for place, answer in _answers(pool, study, asked, say):
                k, settings = left[place], study.rows[left[place]]
                if isinstance(answer, str):
                    answer = {"outcome": LOST, "message": answer}
                done[k] = {**settings, **answer, "digest": study.digests[k]}
                write(path, study.keys, done)
                if request.as_json:
                    line(row=k, set=settings, **answer)
                text = f"{', '.join(format_settings(settings))}: {answer['outcome']}"
                progress.advance(text, f"row {k + 1} of {len(study.rows)}: {text}")
    message = summarise_rows(done, folder, request.part)
    if request.part is not None:
        message += f"; bipot sweep --join {request.folder} joins the parts"
    return print_study(
        request.scene, study.keys, done, message, as_json=request.as_json
    )


def _take_finished_rows(
    request: StudyOptions,
    study: Study,
    folder: Path,
    mine: Sequence[int],
    say: Callable[[str], object],
) -> dict[int, Record]:
    """Rows of an earlier sweep that need not be solved again."""
    if not request.resume:
        return {}
    path = folder / SWEEP
    if request.part is not None and not path.exists():
        # One script serves all parts of a job array, also those that never began.
        say(f"there is no {path} to resume: all rows are solved")
        return {}
    stored = earlier(path, study.rows, study.digests)
    return {
        k: row
        for k, row in stored.items()
        if k in mine
        and not (
            request.results
            and row["outcome"] == OUTCOME_OF[SOLVED]
            and not has_result(folder, int(row["row"]))
        )
    }


def _row(request: StudyOptions, study: Study, number: int, folder: Path) -> Row:
    scene = request.scene
    if request.scheduler is not None and scene not in shipped():
        # Workers run in folders of their own.
        scene = str(Path(scene).absolute())
    return Row(
        number,
        scene,
        study.rows[number],
        request.method,
        request.tol,
        folder.absolute(),
        request.results,
    )


def _pool(request: StudyOptions, say: Callable[[str], object]) -> Workers | Cluster:
    """What solves the rows: processes of this machine, or a cluster."""
    if request.scheduler is None:
        return Workers(solve, _core.threads() if request.jobs is None else request.jobs)
    from bipot_rs.cli.study.workers import Cluster

    return Cluster(request.scheduler, say)


def _answers(
    pool: Workers | Cluster,
    study: Study,
    asked: Sequence[Row],
    say: Callable[[str], object],
) -> Answers:
    if isinstance(pool, Workers):
        return pool.map([(row,) for row in asked])
    if not asked:
        return iter(())
    needs = None
    if pool.declares_memory():
        needs = _memory(pool, study, asked)
    else:
        say(
            "no worker declares its memory, so that rows are not distributed by memory: "
            'start workers with --resources "memory=BYTES"'
        )
    return pool.map(
        solve_as, [(row, study.digests[row.number]) for row in asked], needs
    )


def _memory(cluster: Cluster, study: Study, asked: Sequence[Row]) -> list[float]:
    """Bytes that each row takes, forecast by the cluster once for rows of equal sizes."""
    first: dict[str, Row] = {}
    for row in asked:
        first.setdefault(study.shapes[row.number], row)
    first.pop("", None)
    # The forecast assembles the stiffness.
    least = {shape: study.costs[row.number][0] for shape, row in first.items()}
    needs: dict[str, float] = {"": 0.0, **least}
    shapes, rows = list(first), list(first.values())
    arguments = [(row.scene, row.settings) for row in rows]
    for place, bytes_needed in cluster.map(peak, arguments, list(least.values())):
        # If the forecast fails, so does the row, and reports why.
        if not isinstance(bytes_needed, str):
            needs[shapes[place]] = bytes_needed
    return [needs[study.shapes[row.number]] for row in asked]
