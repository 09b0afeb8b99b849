"""The life of a command that solves: where signals stop it, how it ends, what it reports."""

from __future__ import annotations

import errno
from abc import ABC, abstractmethod
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING

from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, NOT_CONVERGED, SOLVED, Ended
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import Progress, complain, line
from bipot_rs.cli.run.output_files import Reached
from bipot_rs.contact.path.choice import ENGINES as OF_ARRAYS
from bipot_rs.petsc.run.ranks import OtherRankError

if TYPE_CHECKING:
    from bipot_rs.contact.errors import BipotError
    from bipot_rs.contact.results.solution import Step


# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
# The engine that runs on several processes.
PETSC = "petsc"
# The engines of a scene.
ENGINES = (*OF_ARRAYS, PETSC)


# Mistakes of the caller. Any other exception is a fault of the program.
MISTAKES = (ImportError, ValueError, OSError, MemoryError, Ended, OtherRankError)


def outcome(error: BaseException) -> tuple[int, str]:
    """Exit status and message of an exception that ends a command."""
    from bipot_rs.contact.errors import BipotError, NotConvergedError

    if isinstance(error, Ended | OtherRankError):
        return error.status, str(error)
    if isinstance(error, NotConvergedError):
        return NOT_CONVERGED, str(error)
    if isinstance(error, BipotError):
        return NO_ANSWER, str(error)
    if isinstance(error, OSError) and error.strerror and error.filename:
        return BAD_INPUT, f"{error.filename}: {error.strerror}"
    return BAD_INPUT, str(error) or type(error).__name__


def _of_the_system(error: BaseException | None) -> bool:
    """Whether the system refused a call, such as a write to a full disk."""
    if not isinstance(error, OSError):
        return False
    has_number = error.errno is not None and error.errno != errno.EINTR
    return has_number or _of_the_system(error.__cause__)


def recover_steps(reached: list[Reached]) -> str:
    """Find the displacements; drop the load steps from the first one that has none.

    Returns the message of that step, or "".
    """
    from bipot_rs.contact.errors import NotConvergedError
    from bipot_rs.contact.results.solution import recover_displacements

    steps = [step for _, step in reached]
    try:
        recover_displacements(steps)
    except NotConvergedError:
        # A block that fails has none: find them one by one, up to the first failure.
        for k, step in enumerate(steps):
            try:
                recover_displacements([step])
            except NotConvergedError as error:
                del reached[k:]
                return f"load step {k + 1}: {error}"
    return ""


class Runner(ABC):
    """One run of a command. The command defines `work`, `show` and `last_line`.

    ``started``: when the run began, `perf_counter`.
    ``reached``: the row and the `Step` of each load step that is solved. They are stored as
    pairs, so that an interrupt cannot separate them.
    ``progress``: bar or lines on standard error.
    """

    mistakes: tuple[type[Exception], ...] = MISTAKES  # exceptions that mean bad input

    def __init__(self, *, as_json: bool, interrupts: Interrupts | None = None) -> None:
        self.as_json = as_json
        self.interrupts = Interrupts() if interrupts is None else interrupts
        self.started = perf_counter()
        self.reached: list[Reached] = []
        self.progress = Progress(0, 0, quiet=True)

    @property
    def interrupted(self) -> tuple[int, str]:
        """Exit status and message of a run that a signal ended."""
        return self.interrupts.status, "interrupted"

    @abstractmethod
    def work(self) -> tuple[int, str]:
        """Do everything, files included; returns the exit status and a message."""

    @abstractmethod
    def show(self, code: int) -> None:
        """Print the results for a person, before the message of an error."""

    def last_line(self, code: int, message: str) -> dict[str, object]:
        """Keys of the last line of --json."""
        return {"success": code == SOLVED, "message": message}

    def step_line(self, row: dict[str, object], step: Step) -> dict[str, object]:  # noqa: ARG002
        """Keys of the line of a load step of --json."""
        return row

    def run(self) -> int:
        """Work, report, and return the exit status."""
        try:
            code, message = self.work()
        except KeyboardInterrupt:
            code, message = self.interrupted
        except self.mistakes as error:
            code, message = outcome(error)
            if self.interrupts.came is not None:
                # Libraries turn an interrupt into errors of their own. A full disk is not
                # one of these: the user must know that files are missing.
                lost = message if _of_the_system(error) else None
                code, message = self.interrupted
                message += "" if lost is None else f"; {lost}"
        if not self.as_json:
            self.show(code)
        return self.end(code, message)

    def end(self, code: int, message: str) -> int:
        """Report the outcome: the last line of --json, or the message of an error."""
        self.interrupts.reported = True
        if self.as_json:
            line(**self.last_line(code, message))
        elif code != SOLVED:
            complain(message)
        return code

    def attempt(self, solve: Callable[[], object]) -> tuple[int, str]:
        """Solve; the load steps solved before an error or a signal stay in `reached`.

        Signals raise within ``solve`` and wait after it, so that files are written whole.
        """
        from bipot_rs.contact.errors import BipotError

        try:
            try:
                self.release()
                solve()
            finally:
                self.interrupts.hold()
        except KeyboardInterrupt:
            return self.interrupted
        except BipotError as error:
            return self.failed(error)
        return SOLVED, "solved"

    def release(self) -> None:
        """Let signals raise from now on."""
        self.interrupts.release()

    def failed(self, error: BipotError) -> tuple[int, str]:
        """Exit status and message of a load path that ended in an error."""
        return outcome(error)

    def reach(self, row: dict[str, object], step: Step) -> None:
        """Keep and report a solved load step; a signal that was lost raises here."""
        self.reached.append((row, step))
        if self.as_json:
            line(**self.step_line(row, step))
        self.progress.step(row)
        self.interrupts.check()

    def recover(self, code: int, message: str) -> tuple[int, str]:
        """As `recover_steps`; returns how the run ends after that."""
        lost = recover_steps(self.reached)
        return (NOT_CONVERGED, lost) if lost else (code, message)
