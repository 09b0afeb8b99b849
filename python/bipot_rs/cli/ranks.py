"""The processes of one run (ranks of MPI): what one of them finds, all of them do.

Each phase of a run ends with an agreement. A rank that fails waits there for the others, and
all of them raise the same error. Between two agreements a phase may use collective calls of
PETSc, in which the other ranks wait for ever for one that has failed alone. Therefore a rank
that fails waits for a few seconds only. Then it reports its error and ends all ranks; load
steps that were complete are in the result file already (`checkpoint`).
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, TypeVar

from bipot_rs.cli.exit_codes import BAD_INPUT, FAULT, SOLVED, Ended

if TYPE_CHECKING:
    from bipot_rs.cli.interrupts import Interrupts

T = TypeVar("T")
# A rank that fails waits so long for the others [s]: less than the 10 s in which a run must
# end, and longer than ranks differ in the time of an error that all of them find.
PATIENCE = 3.0
# Ranks that wait look for the others at these intervals [s].
_LOOK = 0.002
# How launchers name the number of a rank, and of all ranks.
_LAUNCHERS = (
    ("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"),
    ("PMI_RANK", "PMI_SIZE"),
    ("SLURM_PROCID", "SLURM_STEP_NUM_TASKS"),
)


def launched() -> tuple[int, int]:
    """Number of this process and of all processes, as the launcher gives them."""
    for rank, size in _LAUNCHERS:
        found = os.environ.get(rank, ""), os.environ.get(size, "")
        if all(value.isdigit() for value in found):
            return int(found[0]), int(found[1])
    return 0, 1


def hush() -> None:
    """Discard all output of this process; `World.end_all` still reports an error."""
    for name in ("stdout", "stderr"):
        getattr(sys, name).flush()
        setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123


class Ranks:
    """One process alone.

    Attributes
    ----------
    number, count
        Number of this rank, from 0, and of all ranks.
    neighbours
        Number of ranks on this machine.
    """

    number = 0
    count = 1
    neighbours = 1

    @property
    def first(self) -> bool:
        """Whether this is the rank that writes and reports."""
        return self.number == 0

    @property
    def share(self) -> float:
        """The part of the work that the ranks of this machine do."""
        return self.neighbours / self.count

    def together(self, *, held: bool = False) -> AbstractContextManager[None]:  # noqa: ARG002
        """A part of the work after which all ranks agree on how it ended.

        Parameters
        ----------
        held
            Whether signals wait until the end of this part.
        """
        return nullcontext()

    def broadcast(self, value: T) -> T:
        """The value of rank 0."""
        return value

    def gather(self, value: T) -> list[T]:
        """The values of all ranks, on all ranks."""
        return [value]

    def same(self, value: Any, message: str) -> None:
        """Raise ``message`` with the number of a rank whose value is not that of rank 0."""

    def end_all(self, status: int, message: str) -> None:
        """End all other ranks; this one alone has none."""

    def leave(self, status: int, message: str) -> None:
        """Wait until all ranks are done."""


class World(Ranks):
    """The ranks of MPI.

    Parameters
    ----------
    MPI
        The module of mpi4py.
    interrupts
        Signals; those that arrive during an agreement wait.
    said
        Exit status and message of an exception.
    last_words
        Called by a rank that ends all ranks by itself, with status and message.
    """

    def __init__(
        self,
        MPI: Any,
        interrupts: Interrupts,
        said: Callable[[BaseException], tuple[int, str]],
        last_words: Callable[[int, str], object],
    ) -> None:
        # For this class and PETSc's set-up alone.
        self.comm = comm = MPI.COMM_WORLD.Dup()
        # A rank that leaves early must not meet the others at another agreement.
        self._last = comm.Dup()
        self.neighbours = comm.Split_type(MPI.COMM_TYPE_SHARED).size
        self.number, self.count = comm.rank, comm.size
        self._interrupts = interrupts
        self._said = said
        self._last_words = last_words
        # Parts of the work are nested. A rank that fails may meet the others, which are in an
        # inner part, at the agreement of an outer one: they have then agreed on the outer.
        self._depth = 0
        self._settled: int | None = None

    @contextmanager
    def together(self, *, held: bool = False) -> Iterator[None]:
        """As `Ranks.together`.

        Raises
        ------
        Ended
            Another rank failed, with its status and message.
        """
        own: BaseException | None = None
        # Signals that wait for a longer time, until files are written, wait here too.
        raises = not self._interrupts.held
        self._depth += 1
        try:
            with self._interrupts.waiting() if held else nullcontext():
                try:
                    yield
                except BaseException as error:  # noqa: BLE001 - raised again
                    own = error
                if own is None or not self._agreed(own):
                    self._agree(own, raises)
        finally:
            self._depth -= 1

    def _agreed(self, own: BaseException) -> bool:
        """Raise an error that all ranks have agreed on, on its way out of inner parts."""
        if self._settled is None or self._settled > self._depth:
            return False
        if self._settled == self._depth:
            self._settled = None
        raise own

    def broadcast(self, value: T) -> T:
        """The value of rank 0, pickled."""
        found: T = self.comm.bcast(value, root=0)
        return found

    def gather(self, value: T) -> list[T]:
        """As `Ranks.gather`."""
        found: list[T] = self.comm.allgather(value)
        return found

    def same(self, value: Any, message: str) -> None:
        """As `Ranks.same`, on all ranks alike."""
        values = self.comm.allgather(value)
        other = next((k for k, one in enumerate(values) if one != values[0]), None)
        if other is not None:
            raise Ended(BAD_INPUT, f"rank {other} of {self.count} {message}")

    def leave(self, status: int, message: str) -> None:
        """As `Ranks.leave`; a rank that has failed alone ends the others."""
        failed = None if status == SOLVED else Ended(status, message)
        self._wait(failed, self._last)

    def end_all(self, status: int, message: str) -> None:
        """Report an error that this rank alone knows, and end all ranks."""
        if self.count == 1:
            return
        # `hush` has replaced the streams of most ranks.
        sys.stdout, sys.stderr = (
            sys.__stdout__ or sys.stdout,
            sys.__stderr__ or sys.stderr,
        )
        self._last_words(status, f"rank {self.number} of {self.count}: {message}")
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self.comm.Abort(status)
        # Abort of some libraries returns before the process is killed.
        os._exit(status)

    def _agree(self, own: BaseException | None, raises: bool) -> None:
        """Wait for all ranks; raise if one of them failed or was interrupted."""
        with self._interrupts.waiting():
            self._wait(own, self.comm, raises)
            said = None if own is None else self._said(own)
            kind = None if own is None else type(own).__name__
            stops = isinstance(own, KeyboardInterrupt)
            came = self._interrupts.came if stops else None
            if raises:
                came = came or self._interrupts.due
            every = self.comm.allgather((said, kind, came, self._depth))
        outer = min(depth for *_, depth in every)
        if outer < self._depth:
            self._settled = outer
        signals = [signal for _, _, signal, _ in every if signal is not None]
        if signals:
            self._interrupts.take(signals[0])
            raise KeyboardInterrupt
        found = {(kind, depth) for _, kind, _, depth in every}
        if found == {(None, self._depth)}:
            return
        if own is not None and len(found) == 1:
            # All ranks have found the same.
            raise own
        failed = ((k, one) for k, (one, *_) in enumerate(every) if one is not None)
        apart = FAULT, "the ranks are in different parts of the work"
        rank, (status, message) = next(failed, (self.number, apart))
        raise Ended(status, f"rank {rank} of {self.count}: {message}") from own

    def _wait(self, own: BaseException | None, comm: Any, raises: bool = False) -> None:
        """Wait for all ranks, for ever only if there is nothing to report."""
        arrived = comm.Ibarrier()
        began = time.monotonic()
        while not arrived.Test():
            due = raises and self._interrupts.due is not None
            failed = own is not None or due
            if not failed:
                began = time.monotonic()
            elif time.monotonic() - began > PATIENCE:
                if own is None:
                    own = KeyboardInterrupt()
                self.end_all(*self._said(own))
            time.sleep(_LOOK)


def fault(error: BaseException) -> tuple[int, str]:
    """Status and message of an exception that no command expects."""
    text = " ".join(str(error).split())
    return FAULT, (
        f"internal error of bipot, {type(error).__name__}{': ' if text else ''}{text}; "
        "please report it with the traceback that BIPOT_TRACEBACK=1 prints"
    )
