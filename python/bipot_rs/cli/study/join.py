"""Join the tables and results of the parts of a study: ``bipot sweep --join``."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.progress import complain
from bipot_rs.cli.run.output_folder import RESULT, SWEEP, SWEEP_RECORD
from bipot_rs.cli.study.folder import (
    MISSING,
    make_folder,
    read,
    read_record,
    row_folder,
    set_aside,
    write,
    write_record,
)
from bipot_rs.cli.study.plan import FOLDERS, StudyPart, StudyRecord, list_rows, part
from bipot_rs.cli.study.report import group_rows, print_study, summarise_rows

_NO_PART = "its part was not joined"


@dataclass(frozen=True)
class JoinedStudy:
    """Parts of one study as a whole."""

    record: StudyRecord  # that of the whole study
    keys: list[str]  # the keys that vary
    # All rows of the study by number; those that no part has solved are `MISSING`.
    rows: dict[int, dict[str, str]]
    folders: dict[int, Path]  # the folder that each solved row comes from
    absent: list[str]  # parts that were not given, `"I/N"`
    home: Path | None  # the folder that all parts are in; None if they are in several


def join_into(given: Sequence[Path], out: Path | None, *, as_json: bool) -> int:
    """Join the parts and print the table; returns the worst exit status of the rows.

    ``given``: folders of parts, or folders that hold such folders.
    ``out``: folder to write; None: the one that the parts are in.
    """
    joined = join(given)
    folder = joined.home if out is None else out
    if folder is None:
        raise ValueError("--out DIR is missing: the parts are in different folders")
    if any(
        folder.resolve() == part_folder.resolve()
        for part_folder in joined.folders.values()
    ):
        raise ValueError(f"--out {folder} is the folder of a part, expected another")
    make_folder(folder)
    for before in set_aside(folder, {}):
        if not as_json:
            complain(f"an earlier table and its results are kept in {before}")
    copy_results(joined, folder)
    write_record(folder, joined.record)
    write(folder / SWEEP, joined.keys, joined.rows)
    message = summarise_rows(joined.rows, folder)
    if absent := missing(joined):
        message += f"; {absent}"
    return print_study(
        joined.record.scene, joined.keys, joined.rows, message, as_json=as_json
    )


def join(given: Sequence[Path]) -> JoinedStudy:
    """Read the parts of a study.

    ``given``: folders of parts, or folders that hold such folders.
    """
    parts = _parts(given)
    first, record = next(iter(parts.items()))
    for folder, other in parts.items():
        _same_study(first, record, folder, other)
    by_number: dict[str, Path] = {}
    for folder, other in parts.items():
        part_text = str(other.part)
        if part_text in by_number:
            raise ValueError(
                f"part {part_text} is both in {by_number[part_text]} and in {folder}: name one"
            )
        by_number[part_text] = folder
    asked = list_rows(record.settings, record.ranges)
    rows: dict[int, dict[str, str]] = {}
    folders: dict[int, Path] = {}
    for folder, other in parts.items():
        for number, row in _rows_of(folder, other, asked).items():
            if number in rows:
                raise ValueError(
                    f"row {number + 1} is both in {folders[number]} and in {folder}"
                )
            rows[number], folders[number] = row, folder
    owner = {k: f for f, other in parts.items() for k in other.rows}
    for number, settings in enumerate(asked):
        if number not in rows:
            where = owner.get(number)
            why = _NO_PART if where is None else f"{where} does not have it yet"
            rows[number] = {**settings, "outcome": MISSING, "message": why}
    count = part(str(record.part)).count
    every = (str(StudyPart(number + 1, count)) for number in range(count))
    homes = {folder.parent for folder in parts}
    return JoinedStudy(
        replace(record, part=None, rows=[]),
        list(asked[0]),
        rows,
        folders,
        [wanted for wanted in every if wanted not in by_number],
        homes.pop() if len(homes) == 1 else None,
    )


def _parts(given: Sequence[Path]) -> dict[Path, StudyRecord]:
    """The record of each folder of a part."""
    records: dict[Path, StudyRecord] = {}
    for folder in given:
        inside = sorted(
            inside_folder
            for inside_folder in folder.glob(FOLDERS)
            if (inside_folder / SWEEP_RECORD).exists()
        )
        for inside_folder in inside or [folder]:
            if not inside_folder.is_dir():
                raise OSError(f"there is no folder {inside_folder}")
            record = read_record(inside_folder)
            if record.part is None:
                raise ValueError(
                    f"{inside_folder} is the folder of a whole sweep, expected one of a part "
                    "(bipot sweep --part I/N)"
                )
            if any(inside_folder.resolve() == other.resolve() for other in records):
                raise ValueError(f"{inside_folder} is named twice")
            records[inside_folder] = record
    return records


def _same_study(
    first: Path, record: StudyRecord, folder: Path, other: StudyRecord
) -> None:
    """Refuse a part of another study, or of another division of the same study."""
    if record.study != other.study:
        names = ("scene", "settings", "ranges", "method", "tol", "count")
        differing = [
            f"{name} {getattr(other, name)!r} instead of {getattr(record, name)!r}"
            for name in names
            if getattr(other, name) != getattr(record, name)
        ]
        why = "; ".join(differing) or (
            "the scene file, one of its meshes or the version of bipot_rs was another"
        )
        raise ValueError(f"{folder} belongs to another study than {first}: {why}")
    this_part, others = (
        part(str(record_of_part.part)) for record_of_part in (record, other)
    )
    if this_part.count != others.count:
        raise ValueError(
            f"{folder} is part {others}, but {first} is part {this_part}: name the parts of one "
            "division"
        )


def _rows_of(
    folder: Path, record: StudyRecord, asked: Sequence[dict[str, str]]
) -> dict[int, dict[str, str]]:
    """The finished rows of a part; an error if one is not of this part."""
    path = folder / SWEEP
    if not path.exists():
        return {}
    keys, rows = read(path)
    if keys != list(asked[0]):
        raise ValueError(f"{path} is not the table of this part: it varies {keys}")
    rows_by_number: dict[int, dict[str, str]] = {}
    for row in rows:
        text = row.pop("row")
        # The file counts from 0, messages from 1.
        number = int(text) if text.isdecimal() else -1
        if number not in record.rows:
            raise ValueError(f"{path}: row {number + 1} is not in part {record.part}")
        if number in rows_by_number:
            raise ValueError(f"{path}: row {number + 1} is there twice")
        if any(row[key] != asked[number][key] for key in keys):
            raise ValueError(
                f"{path}: row {number + 1} has other settings than in the study"
            )
        rows_by_number[number] = dict(row)
    return rows_by_number


def copy_results(joined: JoinedStudy, folder: Path) -> None:
    """Copy the results of the rows; on one file system, without their bytes.

    A file of results is replaced as a whole, so that copies may share its bytes.
    """
    for number, source in joined.folders.items():
        result = row_folder(source, number) / RESULT
        if result.is_file():
            target = row_folder(folder, number) / RESULT
            target.parent.mkdir(parents=True, exist_ok=True)
            target.unlink(missing_ok=True)
            try:
                os.link(result, target)
            except OSError:
                shutil.copy2(result, target)


def missing(joined: JoinedStudy) -> str:
    """A sentence about rows that no part has solved; "" if there is none."""
    absent = [(k, row["message"]) for k, row in sorted(joined.rows.items())]
    absent = [(k, why) for k, why in absent if joined.rows[k]["outcome"] == MISSING]
    if not absent:
        return ""
    parts = f"part {', '.join(joined.absent)} was not joined"
    told = group_rows((k, parts if why == _NO_PART else why) for k, why in absent)
    return f"{count_noun(len(absent), 'row')} missing: {told}"
