"""The processes of one run (ranks of MPI): what one of them finds, all of them do.

Each phase of a run ends with an agreement. A rank that fails waits there for the others, and
all of them raise the same error. Between two agreements a phase may use collective calls of
PETSc, in which the other ranks wait for ever for one that has failed alone. Therefore a rank
that fails waits for a few seconds only. Then it reports its error and ends all ranks; load
steps that were complete are in the result file already.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from types import ModuleType
from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from bipot_rs._lib.types import Communicator

T = TypeVar("T")
# Exit status and message of a command.
Outcome = tuple[int, str]
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


class OtherRankError(Exception):
    """Another rank has failed, with this exit status and message."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


class Signals(Protocol):
    """The handlers of SIGINT and SIGTERM of a process, as agreements use them."""

    # Number of the first signal that came.
    came: int | None

    @property
    def held(self) -> bool:
        """Whether signals wait."""

    @property
    def due(self) -> int | None:
        """A signal that waits."""

    def waiting(self) -> AbstractContextManager[None]:
        """Let signals wait in a block."""

    def take(self, number: int, /) -> None:
        """Note a signal that another process has received."""


def read_launcher() -> tuple[int, int]:
    """Number of this process and of all processes, as the launcher gives them."""
    for rank, size in _LAUNCHERS:
        numbers = os.environ.get(rank, ""), os.environ.get(size, "")
        if all(value.isdigit() for value in numbers):
            return int(numbers[0]), int(numbers[1])
    return 0, 1


def discard_output() -> None:
    """Discard all output of this process; `World.end_all` still reports an error."""
    for name in ("stdout", "stderr"):
        getattr(sys, name).flush()
        setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123


class Ranks:
    """One process alone.

    ``number, count``: number of this rank, from 0, and of all ranks.
    ``neighbours``: number of ranks on this machine.
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

        ``held``: whether signals wait until the end of this part.
        """
        return nullcontext()

    def broadcast(self, value: T) -> T:
        """The value of rank 0."""
        return value

    def gather(self, value: T) -> list[T]:
        """The values of all ranks, on all ranks."""
        return [value]

    def check_same(self, value: object, message: str) -> None:
        """Raise ``message`` with the number of a rank whose value is not that of rank 0."""

    def end_all(self, outcome: Outcome) -> None:
        """End all other ranks; this one alone has none."""

    def leave(self, outcome: Outcome) -> None:
        """Wait until all ranks are done."""


class World(Ranks):
    """The ranks of MPI.

    ``MPI``: the module of mpi4py.
    ``signals``: signals; those that arrive during an agreement wait.
    ``describe``: exit status and message of an exception.
    ``report``: called with status and message by a rank that ends all ranks by itself.
    """

    def __init__(
        self,
        MPI: ModuleType,
        signals: Signals,
        describe: Callable[[BaseException], Outcome],
        report: Callable[[int, str], object],
    ) -> None:
        # For this class and PETSc's set-up alone.
        self.comm: Communicator = MPI.COMM_WORLD.Dup()
        # A rank that leaves early must not meet the others at another agreement.
        self._last = self.comm.Dup()
        self.neighbours = self.comm.Split_type(MPI.COMM_TYPE_SHARED).size
        self.number, self.count = self.comm.rank, self.comm.size
        self._signals = signals
        self._describe = describe
        self._report = report
        # Parts of the work are nested. A rank that fails may meet the others, which are in an
        # inner part, at the agreement of an outer one: they have then agreed on the outer.
        self._depth = 0
        self._settled: int | None = None

    @contextmanager
    def together(self, *, held: bool = False) -> Iterator[None]:
        """As `Ranks.together`.

        Raises `OtherRankError`: another rank failed, with its status and message.
        """
        failure: BaseException | None = None
        # Signals that wait for a longer time, until files are written, wait here too.
        raises = not self._signals.held
        self._depth += 1
        try:
            with self._signals.waiting() if held else nullcontext():
                try:
                    yield
                except BaseException as error:  # noqa: BLE001 - raised again
                    failure = error
                if failure is not None:
                    self._pass_on(failure)
                self._agree(failure, raises)
        finally:
            self._depth -= 1

    def _pass_on(self, failure: BaseException) -> None:
        """Raise an error that all ranks have agreed on, on its way out of inner parts."""
        if self._settled is None or self._settled > self._depth:
            return
        if self._settled == self._depth:
            self._settled = None
        raise failure

    def broadcast(self, value: T) -> T:
        """The value of rank 0, pickled."""
        return self.comm.bcast(value, root=0)

    def gather(self, value: T) -> list[T]:
        """As `Ranks.gather`."""
        return self.comm.allgather(value)

    def check_same(self, value: object, message: str) -> None:
        """As `Ranks.check_same`, on all ranks alike.

        Raises `ValueError`: the value of a rank differs.
        """
        values = self.comm.allgather(value)
        for rank, other in enumerate(values):
            if other != values[0]:
                raise ValueError(f"rank {rank} of {self.count} {message}")

    def leave(self, outcome: Outcome) -> None:
        """As `Ranks.leave`; a rank that has failed alone ends the others."""
        self._wait(self._last, outcome if outcome[0] else None)

    def end_all(self, outcome: Outcome) -> None:
        """Report an error that this rank alone knows, and end all ranks."""
        if self.count == 1:
            return
        # `discard_output` has replaced the streams of most ranks.
        sys.stdout, sys.stderr = (
            sys.__stdout__ or sys.stdout,
            sys.__stderr__ or sys.stderr,
        )
        status, message = outcome
        self._report(status, f"rank {self.number} of {self.count}: {message}")
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self.comm.Abort(status)
        # Abort of some libraries returns before the process is killed.
        os._exit(status)

    def _agree(self, failure: BaseException | None, raises: bool) -> None:
        """Wait for all ranks; raise if one of them failed or was interrupted."""
        with self._signals.waiting():
            outcome = None if failure is None else self._describe(failure)
            self._wait(self.comm, outcome, raises=raises)
            kind = None if failure is None else type(failure).__name__
            came = (
                self._signals.came if isinstance(failure, KeyboardInterrupt) else None
            )
            if raises:
                came = came or self._signals.due
            every = self.comm.allgather((outcome, kind, came, self._depth))
        outer = min(depth for *_, depth in every)
        if outer < self._depth:
            self._settled = outer
        signals = [signal for _, _, signal, _ in every if signal is not None]
        if signals:
            self._signals.take(signals[0])
            raise KeyboardInterrupt
        ends = {(kind, depth) for _, kind, _, depth in every}
        if ends == {(None, self._depth)}:
            return
        if failure is not None and len(ends) == 1:
            # All ranks have found the same.
            raise failure
        apart = self._describe(
            RuntimeError("the ranks are in different parts of the work")
        )
        outcomes = [(rank, end[0]) for rank, end in enumerate(every) if end[0]]
        rank, (status, message) = next(iter(outcomes), (self.number, apart))
        raise OtherRankError(
            status, f"rank {rank} of {self.count}: {message}"
        ) from failure

    def _wait(
        self, comm: Communicator, outcome: Outcome | None, *, raises: bool = False
    ) -> None:
        """Wait for all ranks, for ever only if there is nothing to report."""
        arrived = comm.Ibarrier()
        began = time.monotonic()
        while not arrived.Test():
            if outcome is None and raises and self._signals.due is not None:
                outcome = self._describe(KeyboardInterrupt())
            if outcome is None:
                began = time.monotonic()
            elif time.monotonic() - began > PATIENCE:
                self.end_all(outcome)
            time.sleep(_LOOK)
