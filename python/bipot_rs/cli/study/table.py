"""The table of a study, sweep.csv: a row holds its settings, its outcome and figures."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.results.tables import COMPONENTS, FORCES, MOMENTS, TORQUE
from bipot_rs.files import csv_tables

# The process of the row was killed, or no part has solved it. --resume solves such rows.
LOST, MISSING = "lost", "missing"
OUTCOMES = {
    "solved": SOLVED,
    "no answer": NO_ANSWER,
    "not converged": NOT_CONVERGED,
    "bad input": BAD_INPUT,
    LOST: NOT_CONVERGED,
    MISSING: NOT_CONVERGED,
}
OUTCOME_OF = {
    SOLVED: "solved",
    NO_ANSWER: "no answer",
    NOT_CONVERGED: "not converged",
    BAD_INPUT: "bad input",
}
# Columns of every row, besides settings and figures of the contact surfaces.
FIGURES = ("outcome", "steps", *STATUS_NAMES, "residual", "iterations")
# Figures of each contact surface: "max_pressure of block.bottom".
PRESSURE = "max_pressure"
OF_SURFACES = (*FORCES, *COMPONENTS, *MOMENTS, TORQUE, PRESSURE)
_LAST = ("seconds", "message", "digest")
# The varied settings stand between these two columns.
_FIRST, _THEN = "row", "outcome"


def read(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Read the keys that were varied, and the rows.

    Raises `OSError`: it cannot be read.
    Raises `ValueError`: it is not the table of a sweep, or damaged.
    """
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

    Raises `OSError` or `ValueError`: there is no table, or it cannot be read.
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
