"""One call of the command `bipot`: signals, errors and the exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import TextIOWrapper

from bipot_rs.cli import run_arguments
from bipot_rs.cli.commands.names import PETSC
from bipot_rs.cli.exit_codes import (
    BAD_INPUT,
    INTERRUPTED,
    SOLVED,
    Ended,
    describe_fault,
)
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line
from bipot_rs.petsc.run.ranks import discard_output, read_launcher

# Reads all arguments and carries out their command, as `app.by_typer`.
Reader = Callable[[Sequence[str], Interrupts], int]


def call(
    arguments: Sequence[str], *, last: bool, by_typer: Callable[[], Reader]
) -> int:
    """Run the command with these arguments, and return its exit status.

    Parameters
    ----------
    arguments
        The words after ``bipot``.
    last
        Whether the process ends after it.
    by_typer
        Returns `app.by_typer`; called only for arguments that need Typer.
    """
    _open_streams()
    work = _work(arguments, by_typer)
    with Interrupts(last=last) as interrupts:

        def end(status: int, message: str) -> int:
            if "--json" in arguments and arguments[0] != "run":
                interrupts.reported = True
                line(command=arguments[0], ok=False, success=False, message=message)
                if arguments[0] == "fclib":
                    # Its lines on standard output belong to files: an error of the
                    # command itself also goes to standard error.
                    complain(message)
                return status
            from bipot_rs.cli.commands.run import Job, Request

            job = Job(Request(), as_json="--json" in arguments)
            return job.end(status, message)

        status = INTERRUPTED
        if list(arguments[:1]) == ["run"]:
            asked = PETSC in arguments or f"--engine={PETSC}" in arguments
            if asked and read_launcher()[0]:
                # Rank 0 reports for all.
                discard_output()
            # The runner releases the signals when the imports are done.
            interrupts.hold()
        try:
            status = work(interrupts)
        except Ended as error:
            return end(error.status, str(error))
        except BrokenPipeError:
            return _reader_gone()
        except OSError as error:
            return _output_gone(error)
        except SystemExit as left:
            # 0: shell completion is done. 1: libraries exit so when the reader of the
            # output has gone (`| head`), but here 1 means that no answer exists.
            return BAD_INPUT if left.code else SOLVED
        except KeyboardInterrupt:
            pass
        except Exception as error:
            if os.environ.get("BIPOT_TRACEBACK"):
                raise
            return end(*describe_fault(error))
        if interrupts.came is not None and not interrupts.reported:
            return end(interrupts.status, "interrupted")
        return status


def _work(
    arguments: Sequence[str], by_typer: Callable[[], Reader]
) -> Callable[[Interrupts], int]:
    """What carries out the command; it raises `Ended` with the message of a wrong argument."""
    plain = run_arguments.plain(arguments)
    if plain is not None:
        return lambda interrupts: run_arguments.run(**plain, interrupts=interrupts)
    read = by_typer()
    return lambda interrupts: read(arguments, interrupts)


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


def _reader_gone() -> int:
    """End quietly when nobody reads the output (`| head`); what is buffered is discarded."""
    null = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        # A stream of a test has no number.
        with suppress(OSError, ValueError):
            os.dup2(null, stream.fileno())
    return BAD_INPUT


def _output_gone(error: OSError) -> int:
    """Report a full disk behind `> file`; what is still buffered is discarded."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    with suppress(OSError):
        complain(f"cannot write to standard output: {error}")
    return BAD_INPUT
