"""The folder of a study: its table, what it is a study of, and results of its rows.

The table is also printed here, with what became of the rows in a sentence.
"""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED, worst
from bipot_rs.cli.progress import line, tell
from bipot_rs.cli.run.output_folder import RESULT, ROWS, SWEEP, SWEEP_RECORD, make
from bipot_rs.cli.study.plan import StudyPart, StudyRecord, part
from bipot_rs.cli.text_table import format_table
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.results.tables import COMPONENTS, FORCES, MOMENTS, TORQUE
from bipot_rs.files import csv_tables

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record

# The process of the row was killed, or no part has solved it. --resume solves such rows.
LOST, MISSING = "lost", "missing"
OUTCOME_OF = {
    SOLVED: "solved",
    NO_ANSWER: "no answer",
    NOT_CONVERGED: "not converged",
    BAD_INPUT: "bad input",
}
OUTCOMES = {outcome: code for code, outcome in OUTCOME_OF.items()}
OUTCOMES |= {LOST: NOT_CONVERGED, MISSING: NOT_CONVERGED}
# Columns of every row, besides settings and figures of the contact surfaces.
FIGURES = ("outcome", "steps", *STATUS_NAMES, "residual", "iterations")
# Figures of each contact surface: "max_pressure of block.bottom".
PRESSURE = "max_pressure"
OF_SURFACES = (*FORCES, *COMPONENTS, *MOMENTS, TORQUE, PRESSURE)
_LAST = ("seconds", "message", "digest")
# The varied settings stand between these two columns.
_FIRST, _THEN = "row", "outcome"


def read(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Read the keys that were varied, and the rows."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file, strict=True)
            names = list(table.fieldnames or ())
            rows = list(table)
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    except OSError as error:
        raise OSError(f"{path} cannot be read: {error.strerror or error}") from error
    if names[:1] != [_FIRST] or _THEN not in names:
        raise ValueError(
            f"{path} is not the table of a sweep, or it is damaged: its first line must "
            f"begin with {_FIRST} and contain {_THEN}"
        )
    for k, row in enumerate(rows):
        # A truncated line lacks columns; two merged lines have too many.
        if None in row or None in row.values():
            raise ValueError(
                f"{path} is damaged: row {k + 1} does not have the {len(names)} columns "
                "of the first line"
            )
    return names[1 : names.index(_THEN)], rows


def earlier(
    path: Path, asked: Sequence[Mapping[str, str]], digests: Sequence[str]
) -> dict[int, dict[str, str]]:
    """Rows that an earlier sweep has finished, by their number in this sweep.

    The entry ``row`` of each is its number in the earlier sweep.
    """
    if not path.exists():
        raise ValueError(f"cannot resume: there is no {path}")
    try:
        _, rows = read(path)
    except ValueError as error:
        raise ValueError(
            f"cannot resume: {error}; run without --resume to solve all rows"
        ) from None
    done = {row.get("digest", ""): row for row in rows}
    finished = OUTCOMES.keys() - {LOST, MISSING}
    return {
        k: {**done[digest], **settings}
        for k, (settings, digest) in enumerate(zip(asked, digests, strict=True))
        if digest and done.get(digest, {}).get("outcome") in finished
    }


def write(
    path: Path, keys: Sequence[str], done: Mapping[int, Mapping[str, object]]
) -> None:
    """Write the table of the finished rows; it replaces an earlier one."""
    forces = {name for row in done.values() for name in row if " of " in name}
    # Not in the order in which rows finish: joined parts give the same columns.
    names = sorted(forces, key=_place)
    columns = [_FIRST, *keys, *FIGURES, *names, *_LAST]
    table = ({**done[k], _FIRST: k} for k in sorted(done))
    csv_tables.write(path, columns, ([row.get(c) for c in columns] for row in table))


def _place(name: str) -> tuple[str, int]:
    kind, _, surface = name.partition(" of ")
    return surface, OF_SURFACES.index(kind) if kind in OF_SURFACES else -1


_FORMAT, _VERSION = "bipot-sweep", 1


def write_record(folder: Path, record: StudyRecord) -> None:
    """Write it into the folder."""
    from bipot_rs.files.drafts import aside

    content = {"format": _FORMAT, "version": _VERSION, **asdict(record)}
    if record.part is None:
        del content["part"], content["rows"]
    with aside(folder / SWEEP_RECORD) as draft:
        draft.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_record(folder: Path) -> StudyRecord:
    """Read the record of a folder."""
    path = folder / SWEEP_RECORD
    if not path.is_file():
        raise ValueError(
            f"{folder} is not the folder of a sweep: it has no {SWEEP_RECORD}"
        )
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        if content.pop("format") != _FORMAT or content.pop("version") != _VERSION:
            raise ValueError("it has another format or version")
        record = StudyRecord(**content)
        if record.part is not None:
            part(record.part)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {error}") from None
    return record


def make_folder(folder: Path) -> None:
    """Make the folder of a study."""
    try:
        make(folder)
    except OSError as error:
        raise OSError(
            f"cannot write to the folder {folder}: {error}; --out DIR names another"
        ) from error


def row_folder(folder: Path, row: int) -> Path:
    """Folder for the result of a row, numbered from 0 as in the table."""
    return folder / ROWS / f"{row:04d}"


def set_aside(folder: Path, kept: Mapping[int, Record]) -> list[Path]:
    """Make room for a study: move files of earlier rows that are not ``kept`` away.

    ``kept`` are rows of `table.earlier`: their results move to their new numbers. Returns
    the paths where other rows are kept now, one generation of each.
    """
    table, results, away = folder / SWEEP, folder / ROWS, []
    # The first line has the names of the columns.
    if table.exists() and table.read_bytes().count(b"\n") > len(kept) + 1:
        away.append(table.with_name(f"{table.stem}-before{table.suffix}"))
        table.replace(away[-1])
    if results.is_dir():
        before = folder / f"{ROWS}-before"
        shutil.rmtree(before, ignore_errors=True)
        results.replace(before)
        for row, row_kept in kept.items():
            old = before / row_folder(folder, int(row_kept["row"])).name
            if old.is_dir():
                results.mkdir(exist_ok=True)
                old.replace(row_folder(folder, row))
        with suppress(OSError):
            before.rmdir()
        if before.exists():
            away.append(before)
    return away


def has_result(folder: Path, row: int) -> bool:
    """Whether the folder has a result of a row."""
    return (row_folder(folder, row) / RESULT).is_file()


# Most row numbers in one sentence.
_SHOWN = 8


def summarise_rows(
    done: Mapping[int, Record],
    folder: Path,
    part: StudyPart | None = None,
) -> str:
    """How many rows are solved, and where the table and the results are."""
    solved = [k for k in done if done[k]["outcome"] == OUTCOME_OF[SOLVED]]
    of = "" if part is None else f" of part {part}"
    text = f"{len(solved)} of {count_noun(len(done), 'row')}{of} solved"
    text += f"; the table is {folder / SWEEP}"
    if any(has_result(folder, k) for k in done.keys() - solved):
        text += f"; the load steps of rows that failed are in {folder / ROWS}"
    return text


def group_rows(reasons: Iterable[tuple[int, str]]) -> str:
    """Rows, numbered from 0, by the reason of each: ``row 1, 2 (lost); row 7 (bad input)``."""
    by_reason: dict[str, list[str]] = {}
    for k, reason in reasons:
        by_reason.setdefault(reason, []).append(str(k + 1))
    return "; ".join(
        f"row {', '.join(rows[:_SHOWN])}{', …' if len(rows) > _SHOWN else ''} ({reason})"
        for reason, rows in by_reason.items()
    )


def print_study(
    scene: str,
    keys: Sequence[str],
    done: Mapping[int, Record],
    message: str,
    *,
    as_json: bool,
) -> int:
    """Print the rows and the message; returns the worst exit status of the rows."""
    outcomes = [row["outcome"] for row in done.values()]
    if as_json:
        solved = outcomes.count(OUTCOME_OF[SOLVED])
        line(scene=scene, rows=len(done), solved=solved, message=message)
    else:
        _print(keys, done, message)
    # A part may have no rows.
    return worst([SOLVED, *(OUTCOMES[outcome] for outcome in outcomes)])


def _print(keys: Sequence[str], done: Mapping[int, Record], message: str) -> None:
    names = [name for row in done.values() for name in row if "friction_used" in name]
    forces = list(dict.fromkeys(names))
    # For a curved surface the ratio is one of sums of sizes, see `report.forces`.
    curved = {n for row in done.values() for n in row if n.startswith("force_x of ")}
    heads_of_forces = [
        (f"{surface}\n" if len(forces) > 1 else "")
        + ("Σ|rt|/(Σμrn)" if f"force_x of {surface}" in curved else "Ft/(μFn)")
        for surface in (name.partition(" of ")[2] for name in forces)
    ]
    first, last = [*keys, "outcome", *STATUS_NAMES], ["residual", "seconds"]
    rows = [
        [str(k + 1), *(_cell(done[k].get(name)) for name in (*first, *forces, *last))]
        for k in sorted(done)
    ]
    lines = [format_table(["row", *first, *heads_of_forces, *last], rows)]
    messages = {k: done[k].get("message") for k in sorted(done)}
    lines += [f"row {k + 1}: {text}" for k, text in messages.items() if text]
    tell("\n".join([*lines, message]), sys.stdout)


def _cell(value: object) -> str:
    if value is None or value == "":
        return "-"
    try:
        return f"{float(str(value)):.4g}"
    except ValueError:
        return str(value)
