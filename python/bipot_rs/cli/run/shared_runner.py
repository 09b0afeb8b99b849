"""A run that several processes may share: where they agree, and how all of them end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import perf_counter, sleep

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.exit_codes import describe_fault
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.run.output_folder import draft_in
from bipot_rs.cli.run.runner import Runner, outcome
from bipot_rs.petsc.run.ranks import (
    PATIENCE,
    Ranks,
    World,
    discard_output,
    read_launcher,
)

PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write", "total")
# In these phases the ranks wait for each other in PETSc.
_COLLECTIVE = ("condense", "solve")


class SharedRunner(Runner):
    """A `Runner` whose work the ranks of MPI may share.

    All ranks do the same work; rank 0 writes and reports. Without MPI this is one process.

    ``ranks``: the processes of this run.
    ``shared``: whether they are those of MPI, which may be a single one.
    ``seconds``: time of each phase.
    ``message``: how the run has ended.
    """

    def __init__(self, *, as_json: bool, interrupts: Interrupts | None = None) -> None:
        super().__init__(as_json=as_json, interrupts=interrupts)
        self.ranks = Ranks()
        self.shared = False
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.message = ""

    def _save(self, *, always: bool = False) -> None:
        """Keep the load steps reached, on rank 0 of several."""

    def _join(self) -> None:
        """Become one of the processes of mpirun, or the only one without it."""
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
    def _draft(self, folder: Path) -> Iterator[Path]:
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

    def release(self) -> None:
        """Handle signals at once again; one that waited stops all ranks."""
        with self.ranks.together():
            super().release()

    def run(self) -> int:
        """Run the command, so that all ranks end with the same status."""
        try:
            code = super().run()
        except BaseException as error:
            self.ranks.end_all(self._explain(error))
            raise
        self.ranks.leave((code, self.message))
        return code

    def end(self, code: int, message: str) -> int:
        """Report the end of the command, and keep its message for all ranks."""
        self.message = message
        return super().end(code, message)

    def _explain(self, error: BaseException) -> tuple[int, str]:
        """Exit status and message of any exception."""
        from bipot_rs.contact.errors import BipotError

        if isinstance(error, KeyboardInterrupt):
            return self.interrupted
        if isinstance(error, BipotError):
            return self.failed(error)
        if isinstance(error, self.mistakes):
            return outcome(error)
        return describe_fault(error)

    def _last_words(self, code: int, message: str) -> None:
        """Report an error that this rank alone knows, before it ends all ranks."""
        with suppress(OSError):
            self._save(always=True)
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

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        self.progress.phase(name)
        start = perf_counter()
        with self._together(name):
            self.interrupts.check()
            try:
                yield
            finally:
                self.seconds[name] += perf_counter() - start

    @contextmanager
    def _together(self, name: str) -> Iterator[None]:
        """A phase of all ranks; a signal ends them at once while they wait in PETSc."""
        with self.ranks.together():
            if self.ranks.count > 1 and name in _COLLECTIVE:
                self.interrupts.at_once = self._stop
            try:
                yield
            except Exception as error:
                if self.shared and self.interrupts.came is not None:
                    # PETSc turns an interrupt into an error of its own.
                    raise KeyboardInterrupt from error
                raise
            finally:
                self.interrupts.at_once = None
