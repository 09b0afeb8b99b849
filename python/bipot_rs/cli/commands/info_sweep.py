"""``bipot info`` of the table of a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import counted
from bipot_rs.cli.study.table import read

# Most values of a setting that are listed.
_VALUES = 6


def sweep(path: Path) -> dict[str, Any]:
    """Summarise a sweep; raises as `read`."""
    keys, rows = read(path)
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
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
    bad = next((row for row in rows if row.get("message")), None)
    if bad is not None:
        lines.append(f"  row {int(bad['row']) + 1:<5} {bad['message']}")
    return found | {"lines": lines}
