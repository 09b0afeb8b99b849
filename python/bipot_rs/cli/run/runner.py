"""The life of a command that solves: where signals stop it, how it ends, what it reports.

Several processes may share a run: here they agree, and here all of them end.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import perf_counter, sleep
from typing import TYPE_CHECKING, Protocol

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import (
    BAD_INPUT,
    NO_ANSWER,
    NOT_CONVERGED,
    SOLVED,
    Ended,
    describe_fault,
)
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import Progress, complain, line
from bipot_rs.cli.run.output_files import Reached
from bipot_rs.cli.run.output_folder import draft_in
from bipot_rs.contact.errors import BipotError, NotConvergedError
from bipot_rs.contact.path.choice import ENGINES as OF_ARRAYS
from bipot_rs.petsc.run.ranks import (
    PATIENCE,
    OtherRankError,
    Ranks,
    World,
    discard_output,
    read_launcher,
)

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record
    from bipot_rs.contact.results.solution import Step


PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write", "total")
# In these phases the ranks wait for each other in PETSc.
_COLLECTIVE = ("condense", "solve")
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
    if isinstance(error, Ended | OtherRankError):
        return error.status, str(error)
    if isinstance(error, NotConvergedError):
        return NOT_CONVERGED, str(error)
    if isinstance(error, BipotError):
        return NO_ANSWER, str(error)
    if isinstance(error, OSError) and error.strerror and error.filename:
        return BAD_INPUT, f"{error.filename}: {error.strerror}"
    return BAD_INPUT, str(error) or type(error).__name__


def _is_system_error(error: BaseException | None) -> bool:
    """Whether the system refused a call, such as a write to a full disk."""
    if not isinstance(error, OSError):
        return False
    has_number = error.errno is not None and error.errno != errno.EINTR
    return has_number or _is_system_error(error.__cause__)


def recover_steps(reached: list[Reached]) -> str:
    """Find the displacements; drop the load steps from the first one that has none.

    Returns the message of that step, or "".
    """
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


class Work(Protocol):
    """What a `Runner` carries out."""

    def work(self) -> tuple[int, str]:
        """Do everything, files included; returns the exit status and a message."""

    def show(self, code: int) -> None:
        """Print the results for a person, before the message of an error."""

    def last_line(self, code: int, message: str) -> dict[str, object]:
        """The last line of --json."""

    def failed(self, error: BipotError) -> tuple[int, str]:
        """Exit status and message of a load path that ended in an error."""


class Runner:
    """One run of a command, whose work the ranks of MPI may share.

    All ranks do the same work; rank 0 writes and reports. Without MPI this is one process.

    ``mistakes``: exceptions that mean bad input.
    ``save``: keeps the load steps reached, before a rank ends all others.
    ``started``: when the run began, `perf_counter`. ``seconds``: time of each phase.
    ``reached``: the row and the `Step` of each load step that is solved. They are stored as
    pairs, so that an interrupt cannot separate them.
    ``progress``: bar or lines on standard error.
    ``ranks``: the processes of this run. ``shared``: whether they are those of MPI, which may be
    a single one.
    ``message``: how the run has ended.
    """

    def __init__(
        self,
        command: Work,
        *,
        as_json: bool,
        interrupts: Interrupts | None = None,
        mistakes: tuple[type[Exception], ...] = MISTAKES,
        save: Callable[[], object] = lambda: None,
    ) -> None:
        self.as_json = as_json
        self.interrupts = Interrupts() if interrupts is None else interrupts
        self.started = perf_counter()
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.reached: list[Reached] = []
        self.progress = Progress(0, 0, quiet=True)
        self.ranks = Ranks()
        self.shared = False
        self.message = ""
        self._command, self._mistakes, self._save = command, mistakes, save

    @property
    def interrupted(self) -> tuple[int, str]:
        """Exit status and message of a run that a signal ended."""
        return self.interrupts.status, "interrupted"

    def join(self) -> None:
        """Become one of the processes of mpirun, or the only one without it."""
        import bipot_rs._core as _core
        from bipot_rs.petsc.library import load

        if read_launcher()[0]:
            discard_output()
        # Ranks that share the cores must not each start a thread for every core.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        library = load()
        # PETSc has set handlers of its own.
        self.interrupts.renew()
        self.ranks = World(
            library.MPI, self.interrupts, self._explain, self._last_words
        )
        if not {"BIPOT_NUM_THREADS", "RAYON_NUM_THREADS"} & set(os.environ):
            cores_of_rank = _core.threads() // self.ranks.neighbours
            os.environ["BIPOT_NUM_THREADS"] = str(max(cores_of_rank, 1))
        self.shared = True
        if not self.ranks.first:
            discard_output()

    @contextmanager
    def draft(self, folder: Path) -> Iterator[Path]:
        """The draft of the folder, which all ranks write into."""
        with ExitStack() as stack:
            made = None
            with self.ranks.together():
                if self.ranks.first:
                    made = stack.enter_context(draft_in(folder)).absolute()
            draft = self.ranks.broadcast(made)
            with self.ranks.together():
                if draft is None or not draft.is_dir():
                    raise OSError(
                        f"the folder {folder} of rank 0 is not there: give a folder on a "
                        "file system that all ranks share with --out DIR"
                    )
            yield draft

    def run(self) -> int:
        """Run the command, and return the exit status, which all ranks share."""
        try:
            code = self._work_and_report()
        except BaseException as error:
            self.ranks.end_all(self._explain(error))
            raise
        self.ranks.leave((code, self.message))
        return code

    def _work_and_report(self) -> int:
        try:
            code, message = self._command.work()
        except KeyboardInterrupt:
            code, message = self.interrupted
        except self._mistakes as error:
            code, message = outcome(error)
            if self.interrupts.came is not None:
                # Libraries turn an interrupt into errors of their own. A full disk is not
                # one of these: the user must know that files are missing.
                lost = message if _is_system_error(error) else None
                code, message = self.interrupted
                message += "" if lost is None else f"; {lost}"
        if not self.as_json:
            self._command.show(code)
        return self.end(code, message)

    def end(self, code: int, message: str) -> int:
        """Report the outcome: the last line of --json, or the message of an error."""
        self.message = message
        self.interrupts.reported = True
        if self.as_json:
            line(**self._command.last_line(code, message))
        elif code != SOLVED:
            complain(message)
        return code

    def attempt(self, solve: Callable[[], object]) -> tuple[int, str]:
        """Solve; the load steps solved before an error or a signal stay in `reached`.

        Signals raise within ``solve`` and wait after it, so that files are written whole.
        """
        try:
            try:
                # A signal that waited stops all ranks.
                with self.ranks.together():
                    self.interrupts.release()
                solve()
            finally:
                self.interrupts.hold()
        except KeyboardInterrupt:
            return self.interrupted
        except BipotError as error:
            return self._command.failed(error)
        return SOLVED, "solved"

    def reach(
        self,
        row: dict[str, object],
        step: Step,
        more: Callable[[], Record] = dict,
    ) -> None:
        """Keep and report a solved load step; a signal that was lost raises here.

        ``more``: further keys of its line of --json.
        """
        self.reached.append((row, step))
        if self.as_json:
            line(**row, **more())
        self.progress.step(row)
        self.interrupts.check()

    def recover(self, code: int, message: str) -> tuple[int, str]:
        """As `recover_steps`; returns how the run ends after that."""
        lost = recover_steps(self.reached)
        return (NOT_CONVERGED, lost) if lost else (code, message)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """A phase of all ranks; a signal ends them at once while they wait in PETSc."""
        self.progress.phase(name)
        start = perf_counter()
        with self.ranks.together():
            if self.ranks.count > 1 and name in _COLLECTIVE:
                self.interrupts.at_once = self._stop
            try:
                self.interrupts.check()
                yield
            except Exception as error:
                if self.shared and self.interrupts.came is not None:
                    # PETSc turns an interrupt into an error of its own.
                    raise KeyboardInterrupt from error
                raise
            finally:
                self.seconds[name] += perf_counter() - start
                self.interrupts.at_once = None

    def _explain(self, error: BaseException) -> tuple[int, str]:
        """Exit status and message of any exception."""
        if isinstance(error, KeyboardInterrupt):
            return self.interrupted
        if isinstance(error, BipotError):
            return self._command.failed(error)
        if isinstance(error, self._mistakes):
            return outcome(error)
        return describe_fault(error)

    def _last_words(self, code: int, message: str) -> None:
        """Report an error that this rank alone knows, before it ends all ranks."""
        with suppress(OSError):
            self._save()
        if self.reached:
            kept = count_noun(len(self.reached), "load step")
            message += f" ({kept} complete; --resume continues from there)"
        self.end(code, message)

    def _stop(self) -> None:
        """End all ranks after a signal: any of them may be waiting in PETSc."""
        if not self.ranks.first:
            # Rank 0 ends the others, after it has kept its load steps.
            sleep(PATIENCE)
        self.ranks.end_all(self.interrupted)
