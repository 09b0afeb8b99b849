"""Many FCLIB files, one after the other: a line each as it ends, and a summary."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from time import perf_counter
from typing import Any

from bipot_rs.job import (
    BAD_INPUT,
    INTERRUPTED,
    NO_ANSWER,
    NOT_CONVERGED,
    SOLVED,
    complain,
)

UNREADABLE = "unreadable"
_STATUS = {
    "converged": SOLVED,
    "no_equilibrium": NO_ANSWER,
    "stalled": NOT_CONVERGED,
    "iteration_limit": NOT_CONVERGED,
    "time_limit": NOT_CONVERGED,
    UNREADABLE: BAD_INPUT,
}
# From the best to the worst.
_ORDER = (SOLVED, NO_ANSWER, NOT_CONVERGED, BAD_INPUT)


def run(
    files: Sequence[str],
    method: str,
    tol: float,
    max_seconds: float | None,
    *,
    as_json: bool,
) -> int:
    """Solve every file, and tell; returns the exit status, the worst of all."""
    rows: list[dict[str, Any]] = []
    try:
        _check(method, tol, max_seconds)
        width = max(len(name) for name in files)
        for name in files:
            row = _solve(name, method, tol, max_seconds)
            rows.append(row)
            _print(json.dumps(row, allow_nan=False) if as_json else _line(row, width))
            if row["outcome"] == UNREADABLE:
                complain(row["message"])
        status = max((_STATUS[row["outcome"]] for row in rows), key=_ORDER.index)
    except KeyboardInterrupt:
        complain("interrupted")
        status = INTERRUPTED
    except (ImportError, ValueError) as error:
        complain(str(error))
        status = BAD_INPUT
    if rows and not as_json:
        _summary(rows)
    return status


def _check(method: str, tol: float, max_seconds: float | None) -> None:
    """Let the core refuse settings before any file is read: one open contact."""
    from bipot_rs.fclib import require
    from bipot_rs.reduced import ReducedProblem

    require()  # so that the seconds of the first file are its own
    ReducedProblem([[1, 0], [0, 1]], [[1, 0]], 0).solve(
        method, tol, max_seconds=max_seconds
    )


def _solve(
    name: str, method: str, tol: float, max_seconds: float | None
) -> dict[str, Any]:
    """What is told of a file."""
    from bipot_rs import fclib
    from bipot_rs.errors import FloatingBodyError, NoEquilibriumError

    row = {"file": name} | dict.fromkeys(
        ("contacts", "dim", "outcome", "residual", "iterations", "work")
    )
    asymmetry = None
    began = perf_counter()
    try:
        problem = fclib.read(name)
        contacts, dim = (
            problem.w if isinstance(problem, fclib.GlobalProblem) else problem.q
        ).shape
        row |= {"contacts": contacts, "dim": dim}
        asymmetry = _finite(problem.asymmetry)
        answer = problem.solve(method, tol, max_seconds=max_seconds)
        row |= {
            "outcome": str(answer.outcome),
            "residual": _finite(answer.residual),
            "iterations": answer.iterations,
            "work": _finite(answer.work),
        }
        message = answer.message
    except (NoEquilibriumError, FloatingBodyError) as error:
        row["outcome"], message = "no_equilibrium", f"{name}: {error}"
    except (OSError, ValueError, MemoryError) as error:
        message = str(error) or type(error).__name__
        if name not in message:
            message = f"{name}: {message}"
        row["outcome"] = UNREADABLE
    row["seconds"] = round(perf_counter() - began, 6)
    return row | {"asymmetry": asymmetry, "message": message}


def _finite(number: float) -> float | None:
    """A number that JSON has."""
    return number if math.isfinite(number) else None


def _line(row: dict[str, Any], width: int) -> str:
    """A row for people; what is not known is left blank."""
    size = "" if row["contacts"] is None else f"{row['contacts']} × {row['dim']}D"
    known = {
        "residual": ("{:.1e}", 8),
        "iterations": ("{} iterations", 18),
        "work": ("work {:.0f}", 12),
    }
    cells = [
        ("" if row[key] is None else form.format(row[key])).rjust(space)
        for key, (form, space) in known.items()
    ]
    start = f"{row['file']:<{width}} {size:>10}  {row['outcome']:<15}"
    line = " ".join([start, *cells, f"{row['seconds']:9.3f} s"])
    # Measured matrices lack up to 1e-3; beyond that it is another kind of problem.
    uneven = (row["asymmetry"] or 0.0) > 1e-2
    return line + (f", asymmetric by {row['asymmetry']:.2g}" if uneven else "")


def _summary(rows: list[dict[str, Any]]) -> None:
    """Counts by outcome, worst residual, median work and seconds."""
    from statistics import median

    from rich.console import Console
    from rich.table import Table

    table = Table()
    for column in ("outcome", "files", "worst residual", "median work", "seconds"):
        table.add_column(column, justify="left" if column == "outcome" else "right")

    def add(name: str, some: list[dict[str, Any]]) -> None:
        residuals = [row["residual"] for row in some if row["residual"] is not None]
        work = [row["work"] for row in some if row["work"] is not None]
        table.add_row(
            name,
            str(len(some)),
            f"{max(residuals):.1e}" if residuals else "",
            f"{median(work):.0f}" if work else "",
            f"{sum(row['seconds'] for row in some):.2f}",
        )

    for outcome in _STATUS:
        some = [row for row in rows if row["outcome"] == outcome]
        if some:
            add(outcome, some)
    add("all", rows)
    Console().print(table)


def _print(line: str) -> None:
    # Flushed: who reads it through a pipe wants a line as its file ends.
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
