"""The folder of a study: its table, what it is a study of, and results of its rows."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bipot_rs.cli.run.output_folder import RESULT, ROWS, SWEEP, SWEEP_RECORD, make
from bipot_rs.cli.study.axes import part
from bipot_rs.cli.study.plan import StudyRecord

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record

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
    """Read the record of a folder.

    Raises `ValueError`: there is none, or it is damaged.
    """
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
    """Make the folder of a study.

    Raises `OSError`: it cannot be written.
    """
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
