"""The table of the files of a collection, ``MANIFEST.csv``."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, get_type_hints

from bipot_rs.files.drafts import aside

NAME = "MANIFEST.csv"


class Row(NamedTuple):
    """One file of the collection.

    Attributes
    ----------
    file, path, family
        Name of the file, of its load path, and of its group.
    step
        Number of the load step, from 0.
    form, dim, contacts
        ``local`` or ``global``; 2 or 3; number of contacts.
    answers
        Number of known answers; 0 if it is proved that there is none.
    complete
        ``yes`` if it is proved that there are no other answers.
    determined
        ``r and u``, or ``u`` if reactions are not unique.
    open, slip, stick
        Numbers of contacts in the first answer.
    margin
        Distance of the first answer from a change of status, `Reference`.
    """

    file: str
    path: str
    family: str
    step: int
    form: str
    dim: int
    contacts: int
    answers: int
    complete: str
    determined: str
    open: int
    slip: int
    stick: int
    margin: float


def write(folder: Path, rows: Sequence[Row]) -> None:
    """Write the table of a folder."""
    with (
        aside(folder / NAME) as draft,
        draft.open("w", newline="", encoding="utf-8") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(Row._fields)
        for row in rows:
            small = (f"{x:.1e}" if isinstance(x, float) else x for x in row)
            table.writerow(small)


def read(folder: Path) -> list[Row]:
    """Read the table of a folder.

    Raises
    ------
    FileNotFoundError
        The folder has no table.
    ValueError
        The table has other columns, or a number cannot be read.
    """
    path = folder / NAME
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} is not a file: write the collection with "
            f"`python -m collection {folder}`"
        )
    with path.open(newline="", encoding="utf-8-sig") as file:
        table = csv.reader(file)
        head = tuple(next(table, ()))
        if head != Row._fields:
            raise ValueError(f"{path} has the columns {head}, expected {Row._fields}")
        return [_row(path, cells) for cells in table]


def _row(path: Path, cells: list[str]) -> Row:
    if len(cells) != len(Row._fields):
        raise ValueError(f"{path}: {len(cells)} cells, expected {len(Row._fields)}")
    kinds = get_type_hints(Row).values()
    try:
        return Row(*(kind(cell) for kind, cell in zip(kinds, cells, strict=True)))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
