"""Join the tables and results of the parts of a study: ``bipot sweep --join``."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.progress import complain
from bipot_rs.cli.run.output_folder import RESULT, SWEEP, SWEEP_RECORD
from bipot_rs.cli.study.folder import (
    MISSING,
    group_rows,
    make_folder,
    print_study,
    read,
    read_record,
    row_folder,
    set_aside,
    summarise_rows,
    write,
    write_record,
)
from bipot_rs.cli.study.plan import FOLDERS, StudyPart, StudyRecord, list_rows, part

_NO_PART = "its part was not joined"


def join_into(given: Sequence[Path], out: Path | None, *, as_json: bool) -> int:
    """Join the parts and print the table; returns the worst exit status of the rows.

    ``given``: folders of parts, or folders that hold such folders.
    ``out``: folder to write; None: the one that the parts are in.
    """
    parts = _parts(given)
    record = _same_study(parts)
    asked = list_rows(record.settings, record.ranges)
    owner = {number: path for path, part in parts.items() for number in part.rows}
    finished = {
        number: row
        for path, part in parts.items()
        for number, row in _rows_of(path, part, asked).items()
    }
    rows = {
        number: finished.get(number) or _make_missing_row(settings, owner.get(number))
        for number, settings in enumerate(asked)
    }
    homes = {path.parent for path in parts}
    if out is None and len(homes) > 1:
        raise ValueError("--out DIR is missing: the parts are in different folders")
    folder = homes.pop() if out is None else out
    if any(folder.resolve() == path.resolve() for path in parts):
        raise ValueError(f"--out {folder} is the folder of a part, expected another")
    make_folder(folder)
    for before in set_aside(folder, {}):
        if not as_json:
            complain(f"an earlier table and its results are kept in {before}")
    for number in finished:
        _copy_result(row_folder(owner[number], number), row_folder(folder, number))
    write_record(folder, replace(record, part=None, rows=[]))
    keys = list(asked[0])
    write(folder / SWEEP, keys, rows)
    message = summarise_rows(rows, folder)
    if len(finished) < len(rows):
        message += f"; {_list_missing(rows, list(parts.values()))}"
    return print_study(record.scene, keys, rows, message, as_json=as_json)


def _make_missing_row(settings: dict[str, str], owner: Path | None) -> dict[str, str]:
    """The row of the table for one that no part has solved."""
    why = _NO_PART if owner is None else f"{owner} does not have it yet"
    return {**settings, "outcome": MISSING, "message": why}


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


def _same_study(parts: dict[Path, StudyRecord]) -> StudyRecord:
    """The record of the first part; refuses others that do not belong to it, or are twice."""
    (first, record), *_ = parts.items()
    by_number: dict[StudyPart, Path] = {}
    for folder, other in parts.items():
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
        this, that = part(str(record.part)), part(str(other.part))
        if this.count != that.count:
            raise ValueError(
                f"{folder} is part {that}, but {first} is part {this}: name the parts of one "
                "division"
            )
        if by_number.setdefault(that, folder) != folder:
            raise ValueError(
                f"part {that} is both in {by_number[that]} and in {folder}: name one"
            )
    return record


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


def _copy_result(source: Path, target: Path) -> None:
    """Copy the result of a row; on one file system, without its bytes.

    A file of results is replaced as a whole, so that copies may share its bytes.
    """
    result, copy = source / RESULT, target / RESULT
    if result.is_file():
        target.mkdir(parents=True, exist_ok=True)
        copy.unlink(missing_ok=True)
        try:
            os.link(result, copy)
        except OSError:
            shutil.copy2(result, copy)


def _list_missing(rows: dict[int, dict[str, str]], parts: Sequence[StudyRecord]) -> str:
    """A sentence about rows that no part has solved."""
    given = {str(joined.part) for joined in parts}
    count = part(str(parts[0].part)).count
    every = [str(StudyPart(number + 1, count)) for number in range(count)]
    names = ", ".join(name for name in every if name not in given)
    absent = [(k, r["message"]) for k, r in rows.items() if r["outcome"] == MISSING]
    told = group_rows(
        (k, f"part {names} was not joined" if why == _NO_PART else why)
        for k, why in absent
    )
    return f"{count_noun(len(absent), 'row')} missing: {told}"
