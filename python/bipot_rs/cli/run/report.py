"""The table of load steps as text, and the closing remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.progress import drop_rounding
from bipot_rs.cli.text_table import format_table, table_width
from bipot_rs.contact.messages.remarks import NEVER_CLOSED
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.results.tables import (
    BOLTS,
    COMPONENTS,
    FORCES,
    MOMENTS,
    TORQUE,
    WEAR,
    list_bolts,
    list_columns,
    list_surface_forces,
)
from bipot_rs.fem.contact_surface import surface_names

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record
    from bipot_rs.fem.assembly.assembly import Assembly

_FORMS = {
    "load": "{:.6g}",
    "residual": "{:.1e}",
    "seconds": "{:.3f}",
    "error": "{:.2%}",
    **dict.fromkeys(WEAR[1:], "{:.4g}"),
    "normal_force": "{:.5g}",
    "tangential_force": "{:.5g}",
    "friction_used": "{:.4f}",
    **dict.fromkeys((*COMPONENTS, *BOLTS, *MOMENTS, TORQUE), "{:.5g}"),
}
# Columns that the table of load steps leaves out.
_IN_FILES = (*MOMENTS, TORQUE)
# Most surfaces, and most bolts, with columns in the table of load steps.
_MOST_NAMES = 2
# Columns that a narrow terminal drops, in this order.
_LEAST = ("seconds", "iterations", "load")
# Rounding of a sum of forces that cancel, relative to these forces.
_ROUNDING = 1e-13
# Most rows that are all shown; of a longer table only the first and the last are.
_MOST_ROWS = 60


def forces(model: Assembly, step: Step) -> dict[str, float | None]:
    """`list_surface_forces` of a model, with keys such as ``"normal_force of block.bottom"``."""
    names = surface_names(model)
    cohesion = model.cohesion if model.cohesion.any() else None
    points = None if model.numbered.axisymmetric else model.points
    law = model.mu, model.group, names, cohesion
    bolts = [bolt.name for bolt in model.bolts]
    return list_surface_forces(
        step, model.frame, *law, points, model.area
    ) | list_bolts(step, bolts)


def by_surface(
    forces: Mapping[str, float | None],
) -> dict[str, dict[str, float | None]]:
    """`forces` by the names of the surfaces.

    >>> by_surface({"normal_force of block.bottom": 2.0})
    {'block.bottom': {'normal_force': 2.0}}
    """
    forces_by_surface: dict[str, dict[str, float | None]] = {}
    for key, value in forces.items():
        name, _, surface = key.partition(" of ")
        forces_by_surface.setdefault(surface, {})[name] = value
    return forces_by_surface


def format_steps(
    rows: Sequence[Record],
    *,
    title: str = "",
    unit: str = "",
    more: Sequence[str] = (),
    width: int | None = None,
) -> str:
    """The table of load steps, without the columns that the width has no place for.

    Of more than two surfaces or bolts, tables below it have a row for each, at the end.

    ``rows``: rows of `contact.tables.row` with those of `forces` and the columns ``more``.
    ``unit``: unit of force.
    ``more``: further columns.
    ``width``: largest number of characters of a line; None: no limit.
    """
    every = list_columns(rows, more)
    kinds: dict[str, list[str]] = {}
    for column in every:
        kind, of, name = column.partition(" of ")
        if of:
            kinds.setdefault(name, []).append(kind)
    # Names with the same columns, such as all flat surfaces.
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, columns in kinds.items():
        alike.setdefault(tuple(columns), []).append(name)
    bolts = [name for name, columns in kinds.items() if columns[0] in BOLTS]
    below = [
        keys
        for keys in alike
        if len(bolts if keys[0] in BOLTS else kinds.keys() - bolts) > _MOST_NAMES
    ]
    last = {
        f"{kind} of {name}" for keys in below for kind in keys for name in alike[keys]
    }
    names = [c for c in every if c not in last and not c.startswith(_IN_FILES)]
    largest = max((abs(row.get("load", 0.0)) for row in rows), default=0.0)
    # For people, steps count from 1; in files and --json from 0.
    shown: list[Record | None] = [
        {
            **row,
            "step": row["step"] + 1,
            "load": drop_rounding(row.get("load", 0.0), largest),
        }
        for row in rows
    ]
    if len(rows) > _MOST_ROWS:
        third = _MOST_ROWS // 3
        shown = [*shown[:third], None, *shown[-third:]]
    components = [name for name in names if name.startswith(COMPONENTS)]
    for name in filter(names.__contains__, (*_LEAST, *components)):
        heads, cells = _heads(names, shown, unit), _cells(names, shown)
        if width is None or table_width(heads, cells) <= width:
            break
        names.remove(name)
    text = format_table(_heads(names, shown, unit), _cells(names, shown), title=title)
    if len(shown) < len(rows):
        text += f"\nall {len(rows)} load steps are in steps.csv"
    for keys in below:
        curved = COMPONENTS[0] in keys
        heads = ["at the end", *(_head(kind, unit, curved=curved) for kind in keys)]
        cells = [
            [name, *(_cell(rows[-1], f"{kind} of {name}") for kind in keys)]
            for name in alike[keys]
        ]
        text += format_table(heads, cells)
    return text


def _heads(
    columns: Sequence[str], rows: Sequence[Record | None], unit: str
) -> list[str]:
    """Heads of the columns, with the names of the surfaces if there are several."""
    surfaces = {key.partition(" of ")[2] for key in columns if " of " in key}
    columns_of_run = (rows[0] if rows else None) or {}
    heads = []
    for column in columns:
        kind, _, surface = column.partition(" of ")
        head = _head(
            kind, unit, curved=f"{COMPONENTS[0]} of {surface}" in columns_of_run
        )
        several = len(surfaces) > 1 and surface
        heads.append(f"{surface}\n{head}" if several else head)
    return heads


def _cells(columns: Sequence[str], rows: Sequence[Record | None]) -> list[list[str]]:
    """Texts of the cells; a row None stands for rows that are left out."""
    return [
        ["…" if row is None else _cell(row, column) for column in columns]
        for row in rows
    ]


def _head(kind: str, unit: str, *, curved: bool) -> str:
    force = f" [{unit}]" if unit else ""
    heads = {name: name.replace("_", " ") for name in WEAR} | {
        "normal_force": f"Fn{force}",
        "tangential_force": f"Ft{force}",
        "friction_used": "Ft/(μFn)",
        "bolt_force": f"tension{force}",
        **{name: f"M{name[-1]}" for name in MOMENTS},
    }
    if curved:
        heads |= {
            "normal_force": f"Σrn{force}",
            "tangential_force": f"Σ|rt|{force}",
            "friction_used": "Σ|rt|/(Σμrn)",
            **{name: f"F{name[-1]}{force}" for name in COMPONENTS},
        }
    return heads.get(kind, kind)


def _cell(row: Record, column: str) -> str:
    value = row.get(column)
    if value is None:
        return "-"
    kind, _, surface = column.partition(" of ")
    normal = row.get(f"{FORCES[0]} of {surface}")
    summed = kind in (FORCES[1], *COMPONENTS)
    if summed and normal is not None and abs(value) < _ROUNDING * abs(normal):
        value = 0.0
    return _FORMS.get(kind, "{}").format(value)


def list_closing(
    rows: Sequence[Record],
    tol: float,
    folder: Path | None,
    remarks: Sequence[str] = (),
    index: str = "result.pvd",
) -> list[str]:
    """Closing lines of a solved path: summary, remarks, and next commands on ``folder``.

    ``index`` is the series for ParaView to open.
    """
    if not rows:
        return []
    last = rows[-1]
    contacts = last["open"] + last["slip"] + last["stick"]
    worst = max(row["residual"] for row in rows)
    residual = f"every residual at most {worst:.1e} (asked for {tol:.1e})"
    done = count_noun(len(rows), "load step")
    if WEAR[0] in last:
        done = f"{count_noun(last[WEAR[0]], 'cycle')}, {len(rows)} of them solved"
    lines = [f"solved: {done}, {residual}. At the end " + _state(last, contacts)]
    if all(row["open"] == contacts for row in rows):
        lines.append(f"remark: {NEVER_CLOSED}")
    else:
        held = any(key.startswith("friction_used") and last[key] for key in last)
        slipping = [row["step"] + 1 for row in rows if row["slip"] and not row["stick"]]
        if held and slipping:
            also = f" and {len(slipping) - 1} more" if len(slipping) > 1 else ""
            lines.append(
                f"remark: all closed contacts slip in load step {slipping[0]} of "
                f"{len(rows)}{also}: no friction is left to resist a larger load."
            )
    lines += [f"remark: {remark}." for remark in remarks if remark != NEVER_CLOSED]
    if folder is not None:
        lines.append(
            f"next: paraview {folder}/{index}, bipot plot {folder}, bipot info {folder}"
        )
    return lines


def _state(last: Record, contacts: int) -> str:
    verbs = {"stick": "stick", "slip": "slip", "open": "are open"}
    first, *others = [(last[name], verb) for name, verb in verbs.items() if last[name]]
    if not others:
        return f"all {count_noun(contacts, 'contact')} {first[1]}."
    rest = ", ".join(f"{count} {verb}" for count, verb in others)
    return f"{first[0]} of {count_noun(contacts, 'contact')} {first[1]}, {rest}."
