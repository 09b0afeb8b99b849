"""``bipot sweep``: solve one scene with many settings in parallel, into one table.

A row holds its settings, its outcome, and numbers of the last load step. The table is
written after each row, so that an interrupted sweep can continue.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import counted
from bipot_rs.cli.commands.info_sweep import read as table_of
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED, worst
from bipot_rs.cli.output_folder import SWEEP, make
from bipot_rs.cli.progress import Progress, complain, line
from bipot_rs.cli.runner import outcome
from bipot_rs.contact.status import STATUS_NAMES
from bipot_rs.files import csv_tables

# More rows are probably a mistake in a range.
MOST = 100_000
OUTCOMES = {
    "solved": SOLVED,
    "no answer": NO_ANSWER,
    "not converged": NOT_CONVERGED,
    "bad input": BAD_INPUT,
    "lost": NOT_CONVERGED,
}
# The process of the row was killed. --resume tries only these rows again.
_LOST = "lost"
_OUTCOME_OF = {code: name for name, code in OUTCOMES.items() if name != _LOST}
# Columns of every row, besides settings and forces of the contact surfaces.
FIGURES = ("outcome", "steps", *STATUS_NAMES, "residual", "iterations")
_LAST = ("seconds", "message", "digest")
# Modules that each row needs.
_NEEDED = (
    "bipot_rs.cli.cost_forecast",
    "bipot_rs.cli.report",
    "bipot_rs.scene.reading",
)


def values(setting: str) -> tuple[str, list[str]]:
    """Split ``KEY=V1,V2,…`` into key and values, not at commas in brackets or quotes.

    Raises
    ------
    ValueError
        It is not of this form.
    """
    key, equals, text = setting.partition("=")
    found, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "," and not depth and not quote:
            found.append("")
        else:
            found[-1] += c
    if not equals or not key.strip() or not all(value.strip() for value in found):
        raise ValueError(
            f"--set {setting}: expected KEY=V1,V2,…, as in contact.0.mu=0.1,0.2"
        )
    return key.strip(), [value.strip() for value in found]


def spaced(setting: str) -> tuple[str, list[str]]:
    """Split ``KEY=FROM:TO:COUNT`` into the key and COUNT equally spaced values.

    The values are integers if the ends are and the spacing allows it.

    Raises
    ------
    ValueError
        It is not of this form.
    """
    key, equals, text = setting.partition("=")
    parts = text.split(":")

    def problem(why: str) -> ValueError:
        return ValueError(
            f"--range {setting}: {why}; expected KEY=FROM:TO:COUNT, as in "
            "contact.0.mu=0.1:0.5:3, which is 0.1, 0.3, 0.5"
        )

    if not equals or not key.strip():
        raise problem("KEY is missing")
    if len(parts) != 3:
        raise problem(f"has {counted(len(parts), 'part')} instead of three")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise problem("FROM and TO must be numbers, COUNT an integer") from None
    if not (abs(low) < 1e300 and abs(high) < 1e300):
        raise problem("a value is beyond 1e300")
    if not 1 <= count <= MOST:
        raise problem(f"COUNT is {count}, not between 1 and {MOST}")
    if count == 1 and low != high:
        raise ValueError(
            f"--range {setting}: COUNT is 1, but FROM {low} and TO {high} differ"
        )
    step = (high - low) / max(count - 1, 1)
    # The last value is TO itself, without rounding.
    found = [low + k * step for k in range(count - 1)] + [high]
    whole = all("." not in part and "e" not in part.lower() for part in parts[:2])
    if whole and all(value == round(value) for value in found):
        return key.strip(), [str(round(value)) for value in found]
    # 0.30000000000000004 should be 0.3.
    return key.strip(), [repr(float(f"{value:.15g}")) for value in found]


def rows(settings: Sequence[str], ranges: Sequence[str]) -> list[dict[str, str]]:
    """All combinations of the values; the last key changes fastest.

    Raises
    ------
    ValueError
        A setting of the wrong form, a key twice, or too many rows.
    """
    axes = [values(s) for s in settings] + [spaced(s) for s in ranges]
    names = [key for key, _ in axes]
    for key in names:
        if names.count(key) > 1:
            raise ValueError(f"{key} is given {names.count(key)} times, expected once")
    if not axes:
        raise ValueError(
            "nothing varies: give --set KEY=V1,V2,… or --range KEY=FROM:TO:COUNT"
        )
    count = 1
    for _, found in axes:
        count *= len(found)
    if count > MOST:
        raise ValueError(
            f"the settings have {count} combinations, expected at most {MOST}"
        )
    product = itertools.product(*(found for _, found in axes))
    return [dict(zip(names, one, strict=True)) for one in product]


def solve(
    scene: str, settings: Mapping[str, str], method: str | None, tol: float | None
) -> dict[str, Any]:
    """Solve one row. No files are written."""
    from importlib import import_module
    from time import perf_counter

    from bipot_rs.contact.errors import BipotError

    # Before the clock starts, so that the first row of a process is not slower.
    for needed in _NEEDED:
        import_module(needed)
    started = perf_counter()
    found: dict[str, Any] = {}
    try:
        found = _solved(scene, settings, method, tol)
        code, message = SOLVED, ""
    except (BipotError, ValueError, MemoryError) as error:
        code, message = outcome(error)
    seconds = round(perf_counter() - started, 6)
    return {
        "outcome": _OUTCOME_OF[code],
        **found,
        "seconds": seconds,
        "message": message,
    }


def _solved(
    name: str, settings: Mapping[str, str], method: str | None, tol: float | None
) -> dict[str, Any]:
    from bipot_rs.cli import cost_forecast
    from bipot_rs.cli.report import forces
    from bipot_rs.cli.report import row as of_step
    from bipot_rs.scene.build import bodies
    from bipot_rs.scene.reading import assemble, read

    scene = read(name, [f"{key}={value}" for key, value in settings.items()])
    asked = scene.solver
    tolerance = asked.tol if tol is None else tol
    if isinstance(tolerance, str):
        raise ValueError(f"tol is {tolerance!r}, expected a number in a sweep")
    cost_forecast.fits(scene)
    case = assemble(scene, bodies(scene))
    result = case.solve(method=method, tol=tolerance)
    end = len(result) - 1
    last = of_step(end, case.step_parameter(end, result[-1]), result[-1])
    return {
        "steps": len(result),
        **{name: last[name] for name in STATUS_NAMES},
        "residual": float(result.residual.max()),
        "iterations": int(result.iterations.sum()),
        **forces(case.model, result[-1]),
    }


def digests(
    scene: str,
    asked: Sequence[Mapping[str, str]],
    method: str | None,
    tol: float | None,
    ranges: Sequence[str] = (),
) -> list[str]:
    """A digest of everything that determines a row; empty where the scene has mistakes.

    Raises
    ------
    SceneError
        The scene of every row has mistakes; the error is that of the first row.
    ValueError
        One of ``ranges`` has fractions, but its key takes integers.
    """
    from bipot_rs.cli.resume import stamps
    from bipot_rs.scene.library import SceneError
    from bipot_rs.scene.reading import read

    found, first = [], None
    for settings in asked:
        try:
            whole = read(scene, [f"{k}={v}" for k, v in settings.items()])
        except SceneError as error:
            _whole(ranges, error.problems)
            first = error if first is None else first
            found.append("")
            continue
        known = stamps(
            whole,
            whole.solver.method if method is None else method,
            whole.solver.tol if tol is None else tol,
        )
        text = json.dumps(known, sort_keys=True)
        found.append(hashlib.sha256(text.encode()).hexdigest()[:16])
    if first is not None and not any(found):
        raise first
    return found


def _whole(ranges: Sequence[str], problems: Sequence[str]) -> None:
    """Refuse a range with fractions for a key that takes integers."""
    for setting in ranges:
        key, found = spaced(setting)
        if any(p.startswith(f"{key}: ") and "integer" in p for p in problems):
            shown = [f"{float(v):.6g}" for v in found[:4]]
            shown += ["…"] if len(found) > len(shown) else []
            raise ValueError(
                f"--range {setting}: {key} takes integers, but this is "
                f"{counted(len(found), 'value')}, {', '.join(shown)}: the third number is "
                "the number of values, not their spacing"
            )


def earlier(
    path: Path, asked: Sequence[Mapping[str, str]], known: Sequence[str]
) -> dict[int, dict[str, Any]]:
    """Rows that an earlier sweep has solved, by their number in this sweep."""
    if not path.exists():
        raise ValueError(f"cannot resume: there is no {path}")
    try:
        _, rows = table_of(path)
    except ValueError as error:
        raise ValueError(
            f"cannot resume: {error}; run without --resume to solve all rows"
        ) from None
    done = {row.get("digest", ""): row for row in rows}
    return {
        k: {**done[digest], **settings}
        for k, (settings, digest) in enumerate(zip(asked, known, strict=True))
        if digest and done.get(digest, {}).get("outcome") in OUTCOMES.keys() - {_LOST}
    }


def write(
    path: Path, keys: Sequence[str], done: Mapping[int, Mapping[str, Any]]
) -> None:
    """Write the table of the finished rows; it replaces an earlier one."""
    names = [name for row in done.values() for name in row if " of " in name]
    columns = ["row", *keys, *FIGURES, *dict.fromkeys(names), *_LAST]
    table = ({**done[k], "row": k} for k in sorted(done))
    csv_tables.write(path, columns, ([row.get(c) for c in columns] for row in table))


def run(
    scene: str,
    settings: Sequence[str],
    ranges: Sequence[str],
    folder: Path,
    method: str | None,
    tol: float | None,
    *,
    jobs: int | None,
    resume: bool,
    as_json: bool,
) -> int:
    """Solve all combinations and write the table; returns the worst exit status.

    ``KeyboardInterrupt`` passes through; the finished rows are in the table.
    """
    from bipot_rs.cli.cost_forecast import cores
    from bipot_rs.cli.worker_pool import Workers
    from bipot_rs.contact.reduced import refuse_settings

    asked = rows(settings, ranges)
    keys = list(asked[0])
    known = digests(scene, asked, method, tol, ranges)
    refuse_settings(method or "auto", 1e-10 if tol is None else tol)
    try:
        make(folder)
    except OSError as error:
        raise OSError(
            f"cannot write to the folder {folder}: {error}; --out DIR names another"
        ) from error
    path = folder / SWEEP
    done: dict[int, dict[str, Any]] = earlier(path, asked, known) if resume else {}
    left = [k for k in range(len(asked)) if k not in done]
    if path.exists() and path.read_bytes().count(b"\n") > len(done) + 1:
        # Rows of another sweep may be valuable.
        before = path.with_name(f"{path.stem}-before{path.suffix}")
        path.replace(before)
        if not as_json:
            complain(f"rows that are not part of this sweep are kept in {before}")
    write(path, keys, done)
    if done and not as_json:
        complain(f"{len(done)} of {counted(len(asked), 'row')} are already finished")
    several = min(cores() if jobs is None else jobs, max(len(left), 1))
    arguments = [(scene, asked[k], method, tol) for k in left]
    with (
        Workers(solve, several) as workers,
        Progress(1, len(left), quiet=as_json, noun="rows") as progress,
    ):
        for place, found in workers.map(arguments):
            k = left[place]
            if isinstance(found, str):
                found = {"outcome": _LOST, "message": found}
            done[k] = {**asked[k], **found, "digest": known[k]}
            write(path, keys, done)
            if as_json:
                line(row=k, set=asked[k], **found)
            text = ", ".join(f"{key}={value}" for key, value in asked[k].items())
            text += f": {found['outcome']}"
            progress.advance(text, f"row {k + 1} of {len(asked)}: {text}")
    outcomes = [done[k]["outcome"] for k in sorted(done)]
    solved = outcomes.count("solved")
    message = f"{solved} of {counted(len(done), 'row')} solved; the table is {path}"
    if as_json:
        line(scene=scene, rows=len(done), solved=solved, message=message)
    else:
        _print(keys, done, message)
    return worst(OUTCOMES[outcome] for outcome in outcomes)


def _print(
    keys: Sequence[str], done: Mapping[int, Mapping[str, Any]], message: str
) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 1000
    names = [name for row in done.values() for name in row if "friction_used" in name]
    forces = list(dict.fromkeys(names))
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    # For a curved surface the ratio is one of sums of sizes, see `report.forces`.
    curved = {n for row in done.values() for n in row if n.startswith("force_x of ")}
    heads = [
        ("Σ|rt|/(Σμrn)" if f"force_x of {surface}" in curved else "Ft/(μFn)")
        + (f"\n{surface}" if len(forces) > 1 else "")
        for surface in (name.partition(" of ")[2] for name in forces)
    ]
    shown = [*keys, "outcome", *STATUS_NAMES, "residual", "seconds"]
    for name in ("row", *shown[: len(keys) + 4], *heads, *shown[len(keys) + 4 :]):
        table.add_column(name.replace("[", r"\["), justify="right")
    for k in sorted(done):
        cells = [*shown[: len(keys) + 4], *forces, *shown[len(keys) + 4 :]]
        table.add_row(str(k + 1), *(_cell(done[k].get(name)) for name in cells))
    console.print(table)
    for k in sorted(done):
        if done[k].get("message"):
            text = f"row {k + 1}: {done[k]['message']}"
            console.print(text, markup=False, soft_wrap=True)
    console.print(message, markup=False, soft_wrap=True)


def _cell(value: Any) -> str:
    if value is None or value == "":
        return "-"
    try:
        number = float(value)
    except ValueError:
        return str(value).replace("[", r"\[")
    return f"{number:.4g}"
