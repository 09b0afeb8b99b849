"""The picture of a study: one column of its table over another."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.messages import count_noun, meant
from bipot_rs._lib.text_files import real
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.run.output_folder import SWEEP, SWEEP_RECORD
from bipot_rs.cli.study.folder import OUTCOME_OF, PRESSURE, read, read_record
from bipot_rs.cli.study.report import group_rows
from bipot_rs.contact.results.tables import COMPONENTS, FORCES, MOMENTS, TORQUE

if TYPE_CHECKING:
    from bipot_rs.plots.study import StudySeries

# Columns that are no numbers.
_TEXTS = ("outcome", "message", "digest")


def draw(
    path: Path, x: str | None, y: str | None, out: Path | None
) -> tuple[Path, str]:
    """Draw column ``y`` of the table of a sweep over column ``x``.

    Returns ``target, said``: the file written, by default ``Y_over_X.png`` in the folder of the
    sweep, and a sentence about rows without values, or "".
    """
    from bipot_rs.files.drafts import writing
    from bipot_rs.plots.study import study
    from bipot_rs.plots.style import figure_of

    folder = path if path.is_dir() else path.parent
    keys, rows = read(folder / SWEEP)
    columns = [name for name in (rows[0] if rows else ()) if name not in _TEXTS]
    if not rows:
        raise ValueError(f"{folder / SWEEP} has no rows to draw")
    if x is None or y is None:
        raise ValueError(
            f"{path} is the folder of a sweep: choose what to draw with --x and --y, of "
            f"{', '.join(columns)}; {folder}/rows holds results of single rows, if any"
        )
    across, up = (_column(n, t, keys, columns) for n, t in (("--x", x), ("--y", y)))
    drawn = [row for row in rows if row[across] and row[up]]
    absent = [row for row in rows if not (row[across] and row[up])]
    if not drawn:
        raise ValueError(f"{folder / SWEEP} has no row with both {across} and {up}")
    others = [key for key in keys if key not in (across, up)]
    varied = [key for key in others if len({row[key] for row in drawn}) > 1]
    if across not in keys and varied:
        # Rows of one series must differ in something.
        varied.remove(max(varied, key=lambda key: len({row[key] for row in drawn})))
    title, units = "", {}
    # Tables of earlier versions have no record.
    if (folder / SWEEP_RECORD).exists():
        record = read_record(folder)
        title, units = record.title, record.units
    ax = study(
        _series(folder / SWEEP, drawn, across, up, varied),
        *((_words(name, columns), _unit(name, units)) for name in (across, up)),
        parameter=", ".join(varied),
        # Otherwise the rows of a series have no order.
        lines=across in keys,
    )
    if absent:
        many = f"{len(absent)} of {count_noun(len(rows), 'row')} without value"
        title = f"{title}\n{many}" if title else many
    figure_of(ax).suptitle(title, fontsize="medium")
    name = re.sub(r"\W+", "_", f"{y}_over_{x}")
    target = folder / f"{name}.png" if out is None else out
    try:
        with writing(target):
            figure_of(ax).savefig(target, dpi=150, bbox_inches="tight")
    except ValueError as error:
        raise ValueError(f"cannot draw {target}: {error}") from error
    rows_left = group_rows((int(row["row"]), row["outcome"]) for row in absent)
    said = f"left out, without {across} or {up}: {rows_left}" if absent else ""
    return target, said


def _column(option: str, text: str, keys: Sequence[str], columns: Sequence[str]) -> str:
    """The column that is named, or whose last key or first word is."""
    if text in columns:
        return text
    short = {key: key.rpartition(".")[2] for key in keys}
    short |= {name: name.partition(" of ")[0] for name in columns if " of " in name}
    matching = [name for name, short_name in short.items() if short_name == text]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise ValueError(f"{option} is {text!r}, expected one of {', '.join(matching)}")
    if text in _TEXTS:
        raise ValueError(f"{option} is {text!r}, which is a column without numbers")
    raise ValueError(
        f"{option} is {text!r}, expected one of {', '.join(columns)}"
        + meant(text, [*columns, *short.values()])
    )


def _number(path: Path, row: Mapping[str, str], name: str) -> float:
    try:
        return real(row[name])
    except ValueError:
        raise ValueError(
            f"{path} row {int(row['row']) + 1}: {name} is {row[name]!r}, expected a number"
        ) from None


def _series(
    path: Path,
    rows: Sequence[Mapping[str, str]],
    x: str,
    y: str,
    varied: Sequence[str],
) -> list[StudySeries]:
    """The rows, one series for each combination of the other varied keys."""
    from bipot_rs.plots.study import StudySeries

    groups: dict[tuple[str, ...], list[Mapping[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in varied), []).append(row)
    series = []
    for values, members in groups.items():
        number = None
        if len(values) == 1:
            with suppress(ValueError):
                number = real(values[0])
        series.append(
            StudySeries(
                ", ".join(values),
                np.array([_number(path, row, x) for row in members]),
                np.array([_number(path, row, y) for row in members]),
                np.array([row["outcome"] != OUTCOME_OF[SOLVED] for row in members]),
                number,
            )
        )
    return series


def _words(name: str, columns: Sequence[str]) -> str:
    """Label of an axis; a surface is named if there are several."""
    kind, of, surface = name.partition(" of ")
    if not of:
        return "time" if name == "seconds" else name
    words = kind.replace("_", " ")
    several = sum(other.startswith(kind + of) for other in columns) > 1
    return f"{words}{of}{surface}" if several else words


def _unit(name: str, units: Mapping[str, str]) -> str | None:
    from bipot_rs.plots.style import stress_unit

    kind = name.partition(" of ")[0]
    if kind == PRESSURE:
        return stress_unit(units)
    if kind in (*FORCES[:2], *COMPONENTS):
        return units.get("force")
    if kind in (*MOMENTS, TORQUE):
        return " ".join(units[name] for name in ("force", "length") if name in units)
    return "s" if kind == "seconds" else None
