"""``bipot fclib``: solve FCLIB files one after the other; a line each, and a summary."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun, printable
from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED, worst
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line, tell
from bipot_rs.cli.text_table import format_table
from bipot_rs.contact.errors import FloatingBodyError, NoEquilibriumError

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record

SUMMARY = "Solve files of the FCLIB collection. Prints one line per file and a summary."
DETAILS = "The line also shows the asymmetry of the matrix if it is above 1e-11."

UNREADABLE = "unreadable"
_STATUS = {
    "converged": SOLVED,
    "no_equilibrium": NO_ANSWER,
    "stalled": NOT_CONVERGED,
    "iteration_limit": NOT_CONVERGED,
    "time_limit": NOT_CONVERGED,
    UNREADABLE: BAD_INPUT,
}
# The matrix of each form, and the size that its asymmetry is relative to.
_MATRICES = {"local": ("W", "its largest entry"), "global": ("M", "√|M_ii M_jj|")}


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("files", metavar="FILE", nargs="+", help="FCLIB files (HDF5).")
    shared.add_method(parser, of_scene=False)
    shared.add_tol(parser)
    parser.add_argument(
        "--max-seconds",
        type=shared.read_number,
        metavar="S",
        help="Time limit of the solver for each file, in seconds.",
    )
    shared.add_json(parser)


def run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    """Solve the files, each reported as it ends; returns the worst exit status of all."""
    _check(arguments)
    rows: list[Record] = []
    width = max(len(printable(name)) for name in arguments.files)
    try:
        for name in arguments.files:
            row = _solve(name, arguments)
            if interrupts.came is not None:
                # HDF5 has swallowed the exception of the signal.
                raise KeyboardInterrupt
            rows.append(row)
            if arguments.json:
                line(**row)
            else:
                tell(_format_line(row, width, arguments.tol), sys.stdout)
            # With --json the row has the message.
            solved = _STATUS[row["outcome"]] == SOLVED
            if row["outcome"] == UNREADABLE or not (arguments.json or solved):
                complain(_sentence(row))
    finally:
        if rows and not arguments.json:
            tell(_summary(rows), sys.stdout)
    return worst(_STATUS[row["outcome"]] for row in rows)


def _check(arguments: argparse.Namespace) -> None:
    """Let the core refuse wrong settings before any file is read: one open contact."""
    from bipot_rs.contact.reduced import ReducedProblem
    from bipot_rs.fclib import require

    require()  # else the seconds of the first file would include imports
    ReducedProblem([[1, 0], [0, 1]], [[1, 0]], 0).solve(
        arguments.method, arguments.tol, max_seconds=arguments.max_seconds
    )


def _solve(name: str, arguments: argparse.Namespace) -> Record:
    """The row of a file."""
    from bipot_rs import fclib

    row = {"file": name} | dict.fromkeys(
        ("contacts", "dim", "outcome", "residual", "iterations", "work")
    )
    form = tolerance = asymmetry = problem = None
    began = perf_counter()
    try:
        problem = fclib.read(name)
        if isinstance(problem, fclib.GlobalProblem):
            form, (contacts, dim) = "global", problem.w.shape
        else:
            form, (contacts, dim) = "local", problem.q.shape
        row |= {"contacts": contacts, "dim": dim}
        asymmetry = _finite(problem.asymmetry)
        answer = problem.solve(
            arguments.method, arguments.tol, max_seconds=arguments.max_seconds
        )
        row |= {
            "outcome": str(answer.outcome),
            "residual": _finite(answer.residual),
            "iterations": answer.iterations,
            "work": _finite(answer.work),
        }
        tolerance = _finite(answer.tolerance)
        message = answer.message
    except (NoEquilibriumError, FloatingBodyError) as error:
        row["outcome"], message = "no_equilibrium", str(error)
    except (OSError, ValueError, MemoryError) as error:
        message = str(error) or type(error).__name__
        # `fclib.read` names the file in its own errors.
        if problem is not None or isinstance(error, MemoryError):
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
    """The number, or None where JSON has no such number."""
    return number if math.isfinite(number) else None


def _sentence(row: Record) -> str:
    """The message of a file on a line of its own, with its name."""
    name, message = row["file"], row["message"]
    named = row["outcome"] == UNREADABLE
    return printable(message if named else f"{name}: {message}")


def _format_line(row: Record, width: int, tol: float) -> str:
    """The row of a file as text; unknown numbers are left blank."""
    from bipot_rs.contact.global_problem import SYMMETRIC

    size = "" if row["contacts"] is None else f"{row['contacts']} × {row['dim']}D"
    columns: dict[str, tuple[Callable[..., str], int]] = {
        "residual": ("{:.1e}".format, 8),
        "iterations": (lambda n: count_noun(n, "iteration"), 18),
        "work": ("work {:.0f}".format, 12),
    }
    cells = [
        ("" if row[key] is None else form(row[key])).rjust(space)
        for key, (form, space) in columns.items()
    ]
    start = f"{printable(row['file']):<{width}} {size:>10}  {row['outcome']:<15}"
    line = " ".join([start, *cells, f"{row['seconds']:9.3f} s"])
    if row["tolerance"] is not None and row["tolerance"] > tol:
        line += f", tolerance raised to {row['tolerance']:.1e} by rounding"
    if (row["asymmetry"] or 0.0) > SYMMETRIC:
        matrix, size = _MATRICES[row["form"]]
        line += f", {matrix} asymmetric by {row['asymmetry']:.2g} of {size}"
    return line


def _summary(rows: list[Record]) -> str:
    """Counts by outcome, worst residual, median work and seconds."""
    from statistics import median

    def cells(name: str, some: list[Record]) -> list[str]:
        residuals = [row["residual"] for row in some if row["residual"] is not None]
        work = [row["work"] for row in some if row["work"] is not None]
        return [
            name,
            str(len(some)),
            f"{max(residuals):.1e}" if residuals else "",
            f"{median(work):.0f}" if work else "",
            f"{sum(row['seconds'] for row in some):.2f}",
        ]

    by_outcome = {
        outcome: [row for row in rows if row["outcome"] == outcome]
        for outcome in _STATUS
    }
    lines = [cells(outcome, some) for outcome, some in by_outcome.items() if some]
    heads = ("outcome", "files", "worst residual", "median work", "seconds")
    return format_table(heads, [*lines, cells("all", rows)])
