"""``bipot info`` of the table of a sweep, and reading the table."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import counted

# The varied settings stand between these two columns.
_FIRST, _THEN = "row", "outcome"
# Most values of a setting that are listed.
_VALUES = 6


def read(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Read the keys that were varied, and the rows.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is not the table of a sweep, or damaged.
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


def sweep(path: Path) -> dict[str, Any]:
    """Summarise a sweep; raises as `read`."""
    keys, rows = read(path)
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row[_THEN]] = outcomes.get(row[_THEN], 0) + 1
    varied = {key: list(dict.fromkeys(row[key] for row in rows)) for key in keys}
    found: dict[str, Any] = {
        "kind": "sweep",
        "file": str(path),
        "rows": len(rows),
        "outcomes": outcomes,
        "varied": varied,
    }
    ended = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
    lines = [
        f"{path}: a sweep of {counted(len(rows), 'row')}",
        f"  ended     {ended or 'none yet'}",
    ]
    for key, values in varied.items():
        many = len(values) > _VALUES
        shown = [*values[:2], "…", values[-1]] if many else values
        count = f" ({counted(len(values), 'value')})" if many else ""
        lines.append(f"  varied    {key} = {', '.join(shown)}{count}")
    bad = next((k for k, row in enumerate(rows) if row.get("message")), None)
    if bad is not None:
        lines.append(f"  row {bad + 1:<5} {rows[bad]['message']}")
    return found | {"lines": lines}
