"""Many FCLIB files, one after the other: a line each as it ends, and a summary."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

from bipot_rs._lib.messages import counted, printable
from bipot_rs.cli.exit_codes import (
    BAD_INPUT,
    INTERRUPTED,
    NO_ANSWER,
    NOT_CONVERGED,
    SOLVED,
)
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line

UNREADABLE = "unreadable"
_STATUS = {
    "converged": SOLVED,
    "no_equilibrium": NO_ANSWER,
    "stalled": NOT_CONVERGED,
    "iteration_limit": NOT_CONVERGED,
    "time_limit": NOT_CONVERGED,
    UNREADABLE: BAD_INPUT,
}
# The matrix of a form, and what its asymmetry is relative to.
_SIZES = {
    "local": ("W", "its largest entry"),
    "global": ("M", "√|M_ii M_jj|"),
}
# From the best to the worst.
_ORDER = (SOLVED, NO_ANSWER, NOT_CONVERGED, BAD_INPUT)


def run(
    files: Sequence[str],
    method: str,
    tol: float,
    max_seconds: float | None,
    interrupts: Interrupts,
    *,
    as_json: bool,
) -> int:
    """Solve every file, and tell; returns the exit status, the worst of all."""
    rows: list[dict[str, Any]] = []
    try:
        _check(method, tol, max_seconds)
        width = max(len(printable(name)) for name in files)
        for name in files:
            row = _solve(name, method, tol, max_seconds)
            if interrupts.came is not None:
                # The exception was raised within HDF5, which forgets it.
                raise KeyboardInterrupt
            rows.append(row)
            _print(
                json.dumps(row, allow_nan=False) if as_json else _line(row, width, tol)
            )
            # Lines of JSON have the sentence themselves.
            if row["outcome"] == UNREADABLE or not (as_json or _solved(row)):
                complain(_sentence(row))
        status = max((_STATUS[row["outcome"]] for row in rows), key=_ORDER.index)
    except KeyboardInterrupt:
        # What interrupts a command says so.
        status = INTERRUPTED
    except (ImportError, ValueError, TypeError) as error:
        if as_json:
            line(command="fclib", ok=False, success=False, message=str(error))
        complain(str(error))
        status = BAD_INPUT
    if rows and not as_json:
        _summary(rows)
    return status


def _check(method: str, tol: float, max_seconds: float | None) -> None:
    """Let the core refuse settings before any file is read: one open contact."""
    from bipot_rs.contact.reduced import ReducedProblem
    from bipot_rs.fclib import require

    require()  # so that the seconds of the first file are its own
    ReducedProblem([[1, 0], [0, 1]], [[1, 0]], 0).solve(
        method, tol, max_seconds=max_seconds
    )


def _solve(
    name: str, method: str, tol: float, max_seconds: float | None
) -> dict[str, Any]:
    """What is told of a file."""
    from bipot_rs import fclib
    from bipot_rs.contact.errors import FloatingBodyError, NoEquilibriumError

    row = {"file": name} | dict.fromkeys(
        ("contacts", "dim", "outcome", "residual", "iterations", "work")
    )
    form = tolerance = asymmetry = None
    began = perf_counter()
    try:
        problem = fclib.read(name)
        if isinstance(problem, fclib.GlobalProblem):
            form, (contacts, dim) = "global", problem.w.shape
        else:
            form, (contacts, dim) = "local", problem.q.shape
        row |= {"contacts": contacts, "dim": dim}
        asymmetry = _finite(problem.asymmetry)
        answer = problem.solve(method, tol, max_seconds=max_seconds)
        row |= {
            "outcome": str(answer.outcome),
            "residual": _finite(answer.residual),
            "iterations": answer.iterations,
            "work": _finite(answer.work),
        }
        tolerance = _finite(answer.tolerance)
        message = answer.message
    except (NoEquilibriumError, FloatingBodyError) as error:
        row["outcome"], message = "no_equilibrium", f"{name}: {error}"
    except (OSError, ValueError, MemoryError) as error:
        message = str(error) or type(error).__name__
        if name not in message:
            message = f"{name}: {message}"
        row["outcome"] = UNREADABLE
    row["seconds"] = round(perf_counter() - began, 6)
    return row | {
        "tolerance": tolerance,
        "form": form,
        "asymmetry": asymmetry,
        "message": message,
    }


def _finite(number: float) -> float | None:
    """A number that JSON has."""
    return number if math.isfinite(number) else None


def _solved(row: dict[str, Any]) -> bool:
    return _STATUS[row["outcome"]] == SOLVED


def _sentence(row: dict[str, Any]) -> str:
    """What is said of a file on a line of its own."""
    name, message = row["file"], row["message"]
    return printable(message if name in message else f"{name}: {message}")


def _line(row: dict[str, Any], width: int, tol: float) -> str:
    """A row for people; what is not known is left blank."""
    from bipot_rs.contact.global_problem import SYMMETRIC

    size = "" if row["contacts"] is None else f"{row['contacts']} × {row['dim']}D"
    known: dict[str, tuple[Callable[[Any], str], int]] = {
        "residual": ("{:.1e}".format, 8),
        "iterations": (lambda n: counted(n, "iteration"), 18),
        "work": ("work {:.0f}".format, 12),
    }
    cells = [
        ("" if row[key] is None else form(row[key])).rjust(space)
        for key, (form, space) in known.items()
    ]
    start = f"{printable(row['file']):<{width}} {size:>10}  {row['outcome']:<15}"
    line = " ".join([start, *cells, f"{row['seconds']:9.3f} s"])
    if row["tolerance"] is not None and row["tolerance"] > tol:
        line += f", held to {row['tolerance']:.1e} by rounding"
    if (row["asymmetry"] or 0.0) > SYMMETRIC:
        matrix, size = _SIZES[row["form"]]
        line += f", {matrix} asymmetric by {row['asymmetry']:.2g} of {size}"
    return line


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
