"""One call of the command `bipot`: signals, errors and the exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper

from bipot_rs.cli.app import carry_out
from bipot_rs.cli.exit_codes import (
    BAD_INPUT,
    INTERRUPTED,
    SOLVED,
    Ended,
    describe_fault,
)
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import OutputLost, complain, line
from bipot_rs.cli.run.runner import MISTAKES, PETSC, outcome
from bipot_rs.contact.errors import BipotError
from bipot_rs.petsc.run.ranks import discard_output, read_launcher


def call(arguments: Sequence[str], *, last: bool = False) -> int:
    """Run the command with these arguments, and return its exit status.

    ``arguments``: the words after ``bipot``.
    ``last``: whether the process ends after it.
    """
    _open_streams()
    with Interrupts(last=last) as interrupts:
        try:
            return _call(arguments, interrupts)
        except OutputLost as error:
            return _end_without_output(error.__cause__)


def _call(arguments: Sequence[str], interrupts: Interrupts) -> int:
    """As `call`; an `OutputLost` passes through."""
    if list(arguments[:1]) == ["run"]:
        if (PETSC in arguments or f"--engine={PETSC}" in arguments) and read_launcher()[
            0
        ]:
            # Rank 0 reports for all.
            discard_output()
        # The runner releases the signals when the imports are done.
        interrupts.hold()
    status = INTERRUPTED
    try:
        status = carry_out(arguments, interrupts)
    except Ended as error:
        return _report(arguments, interrupts, error.status, str(error))
    except OutputLost:
        raise
    except SystemExit as left:
        # 1: libraries exit so when the reader of the output has gone (`| head`), but here
        # 1 means that no answer exists.
        return BAD_INPUT if left.code else SOLVED
    except KeyboardInterrupt:
        pass
    except MISTAKES as error:
        # Libraries turn an interrupt into errors of their own.
        if interrupts.came is None:
            return _report(arguments, interrupts, *outcome(error))
    except BipotError as error:
        return _report(arguments, interrupts, *outcome(error))
    except Exception as error:
        if os.environ.get("BIPOT_TRACEBACK"):
            raise
        return _report(arguments, interrupts, *describe_fault(error))
    if interrupts.came is not None and not interrupts.reported:
        return _report(arguments, interrupts, interrupts.status, "interrupted")
    return status


def _report(
    arguments: Sequence[str], interrupts: Interrupts, status: int, message: str
) -> int:
    """Print how a command has ended that did not report it itself."""
    interrupts.reported = True
    if "--json" not in arguments:
        complain(message)
        return status
    if arguments[0] == "run":
        from bipot_rs.cli.run.job import Job, RunOptions

        return Job(RunOptions(), as_json=True).runner.end(status, message)
    line(command=arguments[0], ok=False, success=False, message=message)
    if arguments[0] == "fclib":
        # Its lines on standard output belong to files: an error of the command itself also
        # goes to standard error.
        complain(message)
    return status


def _open_streams() -> None:
    """Make standard streams fit for all output.

    Streams that the caller has closed (`>&-`) are replaced by the null device. Otherwise the
    next file that is opened would get the number of a standard stream, and output of libraries
    would go into it. A character that the encoding of a stream lacks (the letter μ in that of
    a pipe on Windows) is written as its code; otherwise it would end the command.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
        elif isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _end_without_output(error: BaseException | None) -> int:
    """End when a standard stream cannot be written; what is buffered is discarded.

    Nothing is said if nobody reads the output (`| head`).
    """
    gone = isinstance(error, BrokenPipeError)
    null = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr) if gone else (sys.stdout,):
        # A stream of a test has no number.
        with suppress(OSError, ValueError):
            os.dup2(null, stream.fileno())
    if not gone:
        with suppress(OutputLost):
            complain(f"cannot write to standard output: {error}")
    return BAD_INPUT
