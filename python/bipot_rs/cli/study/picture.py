"""The picture of a study: one column of its table over another."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.messages import count_noun, meant
from bipot_rs._lib.text_files import real
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.run.output_folder import SWEEP, SWEEP_RECORD
from bipot_rs.cli.study.folder import (
    OUTCOME_OF,
    PRESSURE,
    group_rows,
    read,
    read_record,
)
from bipot_rs.contact.results.tables import COMPONENTS, FORCES, MOMENTS, TORQUE
from bipot_rs.files.fields import unit
from bipot_rs.plots import mpl, style

if TYPE_CHECKING:
    from bipot_rs._lib.types import Bools, Floats

# Marks of series; with more of them, a colour bar shows their numbers.
_MARKS = ("o", "s", "^", "D", "v", "P")
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
    across, up = (
        _find_column(n, t, keys, columns) for n, t in (("--x", x), ("--y", y))
    )
    drawn = [row for row in rows if row[across] and row[up]]
    absent = [row for row in rows if not (row[across] and row[up])]
    if not drawn:
        raise ValueError(f"{folder / SWEEP} has no row with both {across} and {up}")
    others = [key for key in keys if key not in (across, up)]
    varied = [key for key in others if len({row[key] for row in drawn}) > 1]
    if across not in keys and varied:
        # Rows of one series must differ in something.
        varied.remove(max(varied, key=lambda key: len({row[key] for row in drawn})))
    series: dict[str, list[Mapping[str, str]]] = {}
    for row in drawn:
        series.setdefault(", ".join(row[key] for key in varied), []).append(row)
    title, units = "", {}
    # Tables of earlier versions have no record.
    if (folder / SWEEP_RECORD).exists():
        record = read_record(folder)
        title, units = record.title, record.units
    ax = style.axes_of(None)
    columns_drawn = _read_columns(folder / SWEEP, series, (across, up))
    # Without a key along the axis, the rows of a series have no order.
    _draw_series(columns_drawn, ", ".join(varied), ax, joined=across in keys)
    style.name_axis(ax.xaxis, _words(across, columns), _unit(across, units))
    style.name_axis(ax.yaxis, _words(up, columns), _unit(up, units))
    if absent:
        many = f"{len(absent)} of {count_noun(len(rows), 'row')} without value"
        title = f"{title}\n{many}" if title else many
    style.figure_of(ax).suptitle(title, fontsize="medium")
    name = re.sub(r"\W+", "_", f"{y}_over_{x}")
    target = folder / f"{name}.png" if out is None else out
    try:
        with writing(target):
            style.figure_of(ax).savefig(target, dpi=150, bbox_inches="tight")
    except ValueError as error:
        raise ValueError(f"cannot draw {target}: {error}") from error
    rows_left = group_rows((int(row["row"]), row["outcome"]) for row in absent)
    said = f"left out, without {across} or {up}: {rows_left}" if absent else ""
    return target, said


def _read_columns(
    path: Path,
    series: Mapping[str, Sequence[Mapping[str, str]]],
    columns: tuple[str, str],
) -> dict[str, tuple[Floats, Bools]]:
    """Points ``(m, 2)`` of each series, and which of them are solved to the end."""
    return {
        name: (
            np.array([[_number(path, row, c) for c in columns] for row in rows]),
            np.array([row["outcome"] == OUTCOME_OF[SOLVED] for row in rows]),
        )
        for name, rows in series.items()
    }


def _draw_series(
    series: Mapping[str, tuple[Floats, Bools]],
    parameter: str,
    ax: mpl.Axes,
    *,
    joined: bool,
) -> None:
    """Draw the series with one colour each; crosses are rows not solved to the end."""
    few = len(series) <= len(_MARKS)
    colours: list[Any] = [style.cycle(k) for k in range(len(series))]
    if not few:
        try:
            numbers = np.array([real(name) for name in series])
            scale = style.scale_of(style.shades(), numbers.min(), numbers.max())
            style.colour_bar(scale, ax, parameter, None)
            parameter = ""
        except ValueError:
            numbers = np.arange(len(series))
            scale = style.scale_of(style.shades(), 0, len(series) - 1)
            parameter = f"{len(series)} combinations of {parameter}"
        colours = list(scale.to_rgba(numbers))
    handles = []
    for k, (name, (points, solved)) in enumerate(series.items()):
        order = np.flatnonzero(solved)[np.argsort(points[solved, 0], kind="stable")]
        look: style.LineStyle = {"color": colours[k], "lw": 1.4, "ms": 4}
        look |= {"marker": _MARKS[k] if few else "o", "ls": "-" if joined else "none"}
        handles += ax.plot(*points[order].T, label=name, **look)
        ax.plot(*points[~solved].T, "x", ms=7, mew=1.6, color=colours[k])
    if not few or len(series) == 1:
        handles = []
    if not all(solved.all() for _, solved in series.values()):
        label = "not solved to the end: last solved load step"
        cross: style.LineStyle = {"color": style.QUIET, "ls": "none", "marker": "x"}
        handles.append(mpl.Line2D([], [], label=label, **cross))
    style.bare(ax)
    if handles or parameter:
        # The entry of the crosses is as wide as three others.
        style.legend_above(ax, title=parameter, handles=handles, ncols=2)


def _find_column(
    option: str, text: str, keys: Sequence[str], columns: Sequence[str]
) -> str:
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


def _words(name: str, columns: Sequence[str]) -> str:
    """Label of an axis; a surface is named if there are several."""
    kind, of, surface = name.partition(" of ")
    if not of:
        return "time" if name == "seconds" else name
    words = kind.replace("_", " ")
    several = sum(other.startswith(kind + of) for other in columns) > 1
    return f"{words}{of}{surface}" if several else words


def _unit(name: str, units: Mapping[str, str]) -> str | None:
    kind = name.partition(" of ")[0]
    if kind == PRESSURE:
        return unit("stress", units)
    if kind in (*FORCES[:2], *COMPONENTS):
        return units.get("force")
    if kind in (*MOMENTS, TORQUE):
        return " ".join(units[name] for name in ("force", "length") if name in units)
    return "s" if kind == "seconds" else None
