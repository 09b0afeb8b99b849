"""The command `bipot solve`: files of another program in, tables and result.h5 out."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.messages import counted
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.output_files import recoverable
from bipot_rs.cli.output_folder import RESULT, make
from bipot_rs.cli.progress import complain, tell
from bipot_rs.cli.report import closing, console, of_surfaces, print_table
from bipot_rs.contact.status import STATUS_NAMES

if TYPE_CHECKING:
    from bipot_rs.cli.matrix_files import Given
    from bipot_rs.contact.result import Result
    from bipot_rs.contact.solution import Step

_STEPS = ("step", *STATUS_NAMES, "residual", "iterations", "seconds")


def run(
    files: dict[str, Path | None],
    folder: Path,
    method: str,
    tol: float,
    interrupts: Interrupts,
    *,
    order: str | None = None,
    as_json: bool,
    stiffness_rtol: float | None = None,
) -> int:
    """Read, solve, write; returns the exit status.

    Parameters
    ----------
    files
        ``stiffness``, ``contacts``, ``nodes``, ``load``, ``fixed``, as
        `stiffness_files.read` takes them.
    order
        That of the degrees of freedom, likewise.
    stiffness_rtol
        Relative error of the entries of the stiffness, as `ContactProblem` takes it.
    """
    began = perf_counter()
    given: Given | None = None
    result: Result | None = None
    reached: list[dict[str, Any]] = []
    steps: list[Step] = []

    def on_step(k: int, step: Any) -> None:
        row = _row(k, step)
        if given is not None:
            every = np.zeros(len(given.gap), dtype=np.int64)
            row |= of_surfaces(step, given.frame, given.mu, every, ["contacts"])
        reached.append(row)
        steps.append(step)
        if as_json:
            _print(json.dumps(row))
        else:
            counts = ", ".join(f"{name} {row[name]}" for name in STATUS_NAMES)
            of = "" if given is None else f" of {_count(given)}"
            said = f"load step {k + 1}{of}: {counts}, residual {row['residual']:.1e}"
            tell(said, sys.stderr)
        interrupts.check()

    code, message = SOLVED, "solved"
    try:
        from bipot_rs.cli.matrix_files import read
        from bipot_rs.contact.errors import BipotError, NotConvergedError
        from bipot_rs.files.export import require

        require()
        given = read(**files, order=order)  # type: ignore[arg-type]
        # Before the work: one that cannot be made is found then.
        make(folder)
        try:
            with warnings.catch_warnings():
                # Remarks say the same.
                warnings.simplefilter("ignore", UserWarning)
                problem = given.problem(stiffness_rtol=stiffness_rtol)
            result = problem.solve(
                given.load, given.prescribed, method=method, tol=tol, on_step=on_step
            )
        except BipotError as error:
            result, message = error.result, str(error) + _labelled(given, error.dof)
            code = NOT_CONVERGED if isinstance(error, NotConvergedError) else NO_ANSWER
        except KeyboardInterrupt:
            interrupts.hold()
            code, message = interrupts.status, "interrupted"
            if steps:
                result = _of(given, steps, message)
        if result is not None:
            found, ended = recoverable(result.steps)
            if ended is not None:
                code, message = NOT_CONVERGED, f"load step {found + 1}: {ended}"
                del reached[found:]
                result = _of(given, result.steps[:found], message)
            _write(folder, given, result, reached)
    except KeyboardInterrupt:
        code, message = interrupts.status, "interrupted"
    except OSError as error:
        code, message = BAD_INPUT, str(error)
        if error.strerror and error.filename:
            message = f"{error.filename}: {error.strerror}"
    except (ImportError, ValueError, TypeError, MemoryError) as error:
        code, message = BAD_INPUT, str(error) or type(error).__name__
    interrupts.told = True
    if as_json:
        last = {
            "stiffness": str(files["stiffness"]),
            "dofs": None if given is None else given.K.shape[0],
            "contacts": None if given is None else len(given.gap),
            "steps": len(reached),
            "success": code == SOLVED,
            "seconds": round(perf_counter() - began, 6),
            "message": message,
            "remarks": [] if result is None else list(result.remarks),
        }
        if result is not None and result.rigid_motions_off is not None:
            last["rigid_motions_off"] = result.rigid_motions_off
        _print(json.dumps(last))
        return code
    said = () if result is None else result.remarks
    if given is not None and reached:
        _tell(given, reached, tol, folder, said, solved=code == SOLVED)
    if code != SOLVED:
        complain(message)
    elif given is not None:
        size = f"{given.K.shape[0]} degrees of freedom, {counted(len(given.gap), 'contact')}"
        names = ", ".join(sorted(path.name for path in _ours(folder, given)))
        _print(f"{size}, {perf_counter() - began:.2f} s\n{folder}: {names}")
    return code


def _count(given: Given) -> int:
    """Load steps: rows of the one are repeated where the other has more."""
    loads = 1 if given.load is None else len(given.load)
    return max(loads, len(given.prescribed))


def _labelled(given: Given, dof: int | None) -> str:
    """What a degree of freedom is called in the files, which know nodes."""
    if dof is None or not given.labels[dof][1]:
        return ""
    node, component = given.labels[dof]
    return f" (degree of freedom {dof} is {component} of node {node})"


def _row(k: int, step: Any) -> dict[str, Any]:
    counts = [int((step.status == number).sum()) for number in range(len(STATUS_NAMES))]
    told = (k, *counts, step.residual, step.iterations, step.seconds)
    return dict(zip(_STEPS, told, strict=True))


def _tell(
    given: Given,
    reached: Sequence[dict[str, Any]],
    tol: float,
    folder: Path,
    remarks: Sequence[str],
    *,
    solved: bool,
) -> None:
    """The table of load steps, and what it comes to."""
    print_table(console(), reached)
    if solved:
        drawn = None if given.points is None else folder
        _print("\n".join(closing(reached, tol, drawn, remarks)))


def _of(given: Given, steps: Sequence[Step], message: str) -> Result:
    """What was reached before an interrupt."""
    from bipot_rs.contact.result import Result

    contacts = {
        "x": given.points,
        "normal": given.frame[:, 0].copy(),
        "frame": given.frame,
        "area": given.area,
        "gap": given.gap,
        "mu": given.mu,
    }
    return Result(
        steps,
        contacts=contacts,
        shape=(len(given.gap), given.frame.shape[1]),
        success=False,
        message=message,
    )


def _write(
    folder: Path, given: Given, result: Result, reached: Sequence[dict[str, Any]]
) -> None:
    """The result file, tables, and the contacts for ParaView where places are known."""
    from bipot_rs.files.csv_tables import write

    columns = list(reached[0]) if reached else _STEPS
    rows = (
        (k, dof, node if name else "", name, float(u))
        for k, step in enumerate(result)
        for dof, ((node, name), u) in enumerate(
            zip(given.labels, step.displacement, strict=True)
        )
    )
    header = ("step", "dof", "node", "component", "displacement")
    works: dict[str, Callable[[Path], None]] = {
        RESULT: result.save,
        "steps.csv": lambda path: write(
            path, columns, (list(row.values()) for row in reached)
        ),
        "reactions.csv": lambda path: write(
            path, _header(given), _reactions(given, result)
        ),
        "displacements.csv": lambda path: write(path, header, rows),
    }
    if given.points is not None:
        works["result.pvd"] = result.write
    done: list[str] = []
    for name, work in works.items():
        try:
            work(folder / name)
        except OSError as error:
            of_this = f"of this run there {'are' if len(done) > 1 else 'is'} {', '.join(done)}"
            said = of_this if done else "nothing else was written"
            raise OSError(f"{error}; {said}") from error
        done.append(name)


def _ours(folder: Path, given: Given) -> Iterator[Path]:
    names = [RESULT, "steps.csv", "reactions.csv", "displacements.csv"]
    if given.points is not None:
        names.append("result.pvd")
    return map(folder.joinpath, names)


def _header(given: Given) -> list[str]:
    dim = given.frame.shape[1]
    local = ("n", "t1", "t2")[:dim]
    return [
        *("step", "contact", "node", "status"),
        *(f"r_{c}" for c in local),
        *(f"f_{a}" for a in "xyz"[:dim]),
        *(f"v_{c}" for c in local),
        *(f"slip_{c}" for c in local[1:]),
    ]


def _reactions(given: Given, result: Result) -> Iterator[list[Any]]:
    """Of each step and contact: force in its frame and in global axes, displacement."""
    for k, step in enumerate(result):
        force = (step.reaction[:, :, None] * given.frame).sum(axis=1)
        for c in range(len(given.gap)):
            yield [
                *(k, c, "" if given.nodes is None else int(given.nodes[c])),
                STATUS_NAMES[step.status[c]],
                *step.reaction[c].tolist(),
                *force[c].tolist(),
                *step.relative_displacement[c].tolist(),
                *step.slip[c].tolist(),
            ]


def _print(line: str) -> None:
    # Flushed: who reads it through a pipe wants to see progress.
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
