"""The rows of a study on standard output, and what became of them in a sentence."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import SOLVED, worst
from bipot_rs.cli.progress import line, tell
from bipot_rs.cli.run.output_folder import ROWS, SWEEP
from bipot_rs.cli.study.folder import OUTCOME_OF, OUTCOMES, has_result
from bipot_rs.cli.study.plan import StudyPart
from bipot_rs.cli.text_table import format_table
from bipot_rs.contact.law.status import STATUS_NAMES

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record

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
