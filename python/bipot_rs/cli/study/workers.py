"""What solves the rows of a study: processes of this machine, or workers of a dask scheduler.

When a process of this machine is killed (out of memory, for example), the pools of the standard
library hang or drop the remaining work. Here its row is reported as lost, and a new process
continues. When a worker dies, dask blames every task that the worker had. Here a row whose
worker died is solved again with no other row on its worker, and is lost only if that worker
dies too.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import pickle
import re
import signal
import uuid
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Protocol

from bipot_rs._lib.messages import size
from bipot_rs._lib.optional import load_library

if TYPE_CHECKING:
    from bipot_rs._lib.types import T

    class _Future(Protocol):
        """A row that dask solves."""

        status: str

        def done(self) -> bool: ...
        def exception(self) -> BaseException: ...
        def result(self, timeout: float) -> object: ...

    from multiprocessing.process import BaseProcess


# Number of threads of every library that has its own.
_THREADS = (
    "BIPOT_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)


def _serve(connection: Connection, pickled: bytes) -> None:
    """Answer arguments until None arrives."""
    # A Ctrl-C reaches all processes of a terminal; the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    work = pickle.loads(pickled)  # noqa: S301 - only now: it imports for long
    with suppress(EOFError, OSError):
        while (asked := connection.recv()) is not None:
            try:
                answer = work(*asked)
            except Exception as error:  # noqa: BLE001 — the parent reports it
                answer = f"{type(error).__name__}: {error}"
            connection.send(answer)


class Workers:
    """Processes that serve many arguments; they are terminated at the end of the block.

    ``work``: a function of a module, whose arguments and answers can be pickled. A text as
    answer is an error message.
    ``count``: number of processes.
    """

    def __init__(self, work: Callable[..., object], count: int) -> None:
        self.work, self.count = work, max(count, 1)
        # A fork would copy locks of threads that do not exist in the child.
        self.context = multiprocessing.get_context("spawn")
        self.processes: dict[Connection, BaseProcess] = {}

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for connection, process in self.processes.items():
            connection.close()
            process.terminate()
        for process in self.processes.values():
            process.join()
        self.processes.clear()

    def map(self, arguments: Sequence[tuple[object, ...]]) -> Iterator[tuple[int, Any]]:
        """Yield the index and the answer of each argument, in the order of the answers."""
        left = list(range(len(arguments)))[::-1]
        busy: dict[Connection, int] = {}
        while left or busy:
            while left and len(busy) < self.count:
                connection = self._idle(busy)
                busy[connection] = left.pop()
                connection.send(arguments[busy[connection]])
            answered = wait(list(busy))
            # On Windows a connection of `Pipe` is of another class than `Connection`.
            for ready in [connection for connection in busy if connection in answered]:
                number = busy.pop(ready)
                try:
                    yield number, ready.recv()
                except (EOFError, OSError):
                    process = self.processes.pop(ready)
                    process.join()
                    ready.close()
                    yield number, _death(process.exitcode)

    def _idle(self, busy: dict[Connection, int]) -> Connection:
        for connection in self.processes:
            if connection not in busy:
                return connection
        here, there = self.context.Pipe()
        process = self.context.Process(
            target=_serve, args=(there, pickle.dumps(self.work)), daemon=True
        )
        before = {name: os.environ.get(name) for name in _THREADS}
        os.environ.update(dict.fromkeys(_THREADS, "1"))
        try:
            process.start()
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
        # Otherwise the connection stays open when the process ends.
        there.close()
        self.processes[here] = process
        return here


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = ", probably because memory ran out" if name == "SIGKILL" else ""
        return f"its process was killed by {name}{hint}"
    return f"its process ended with status {code}"


# Time to connect [s]: a name server or a firewall may take seconds, and a person waits.
_CONNECT = 10.0
# The list of workers is read again after this time [s]: it is long on a large cluster.
_LOOK = 2.0
# Rows handed over for each thread of the workers: one to solve, and the next one.
_AHEAD = 2
# Name of the resource of a worker, in bytes: --resources "memory=BYTES".
_MEMORY = "memory"


def _read_address(address: str) -> str:
    """``HOST:PORT``, perhaps with a protocol, or the address in a scheduler file."""
    place, file = address, Path(address)
    if file.is_file():
        try:
            place = json.loads(file.read_text(encoding="utf-8-sig"))["address"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(
                f"--scheduler {address} is not a scheduler file of dask"
            ) from None
    # Checked here: a client of dask with a wrong address takes 20 s to end.
    if not re.fullmatch(r"([a-z]+://)?[^\s/]+:[0-9]{1,5}", place):
        raise ValueError(
            f"--scheduler {address}: expected an address as tcp://HOST:8786, or a "
            "scheduler file"
        )
    return place


@dataclass(frozen=True)
class _Work:
    """A function, its arguments for each row, and the bytes that each row needs."""

    function: Callable[..., object]
    arguments: Sequence[tuple[object, ...]]
    needs: Sequence[float] | None
    # dask keeps results by key: another map must not find those of this one.
    name: str = field(default_factory=lambda: f"bipot-{uuid.uuid4().hex}")


class Cluster:
    """The workers of a dask scheduler; rows not finished at the end are cancelled.

    ``address``: address of the scheduler, or its ``--scheduler-file``.
    ``say``: called with sentences for the user.
    """

    def __init__(self, address: str, say: Callable[[str], object]) -> None:
        self._dask = load_library("distributed", extra="cluster", need="dask clusters")
        # What it logs is reported here in other words.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self.address, self.say = address, say
        try:
            self._client = self._dask.Client(_read_address(address), timeout=_CONNECT)
        except OSError as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise OSError(
                f"--scheduler {address}: no dask scheduler answers within {_CONNECT:g} s "
                f"({why})"
            ) from None
        self._running: dict[_Future, int] = {}
        # Threads and declared bytes of each worker.
        self._workers: dict[str, tuple[int, float | None]] = {}
        self._seen = -_LOOK
        self._waited = False

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        if self._client.status == "running":
            self._client.cancel(list(self._running), force=True)
        self._client.close(timeout=_CONNECT)

    def declares_memory(self) -> bool:
        """Whether a worker declares its memory. Waits for the first worker."""
        while not self._look():
            self._wait()
        return any(memory is not None for _, memory in self._workers.values())

    def map(
        self,
        function: Callable[..., T],
        arguments: Sequence[tuple[object, ...]],
        needs: Sequence[float] | None = None,
    ) -> Iterator[tuple[int, T | str]]:
        """Yield the index and the answer of each argument, in the order of the answers.

        A text as answer is an error message.

        ``function``: a function of a module that the workers can import.
        ``needs``: bytes of memory that each argument takes. None: the memory of the workers is
        not considered.
        """
        work = _Work(function, arguments, needs)
        left = deque((yield from self._round(work, range(len(arguments)))))
        many = max(len(self._workers), 1)
        while left:
            now = [left.popleft() for _ in range(min(many, len(left)))]
            killed = yield from self._round(work, now)
            together = Counter(worker for worker, _ in killed.values())
            for number, (worker, tries) in killed.items():
                # Before the last of several tries, another row may have killed the worker.
                if len(now) == 1 or (tries == 1 and together[worker] == 1):
                    yield number, "its worker died, probably because memory ran out"
                else:
                    left.append(number)
                    many = max(len(now) // 2, 1)

    def _round(
        self, work: _Work, numbers: Sequence[int]
    ) -> Generator[tuple[int, Any], None, dict[int, tuple[str, int]]]:
        """Solve rows once; returns the last worker, and the tries, of each killed row."""
        waiting, killed = deque(numbers), {}
        while waiting or self._running:
            self._look()
            self._submit(work, waiting)
            if not self._running and self._workers:
                for number in waiting:
                    yield number, self._too_large(work, number)
                break
            if not self._workers:
                self._wait()
            ended = self._take_finished() if self._running else []
            if not ended:
                self._take_back(work, waiting)
            for future in ended:
                answer = self._answer(future)
                if answer is None:
                    continue
                number = self._running.pop(future)
                if isinstance(answer, self._dask.scheduler.KilledWorker):
                    tries = answer.allowed_failures + 1
                    killed[number] = (answer.last_worker.address, tries)
                elif isinstance(answer, BaseException):
                    yield number, f"{type(answer).__name__}: {answer}"
                else:
                    yield number, answer
        return killed

    def _look(self) -> bool:
        """Read the list of workers again if it is old; returns whether there are any."""
        if monotonic() - self._seen >= _LOOK:
            self._check()
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
            self._workers = {
                address: (int(worker["nthreads"]), worker["resources"].get(_MEMORY))
                for address, worker in workers.items()
            }
            self._seen = monotonic()
            self._waited = self._waited and not self._workers
        return bool(self._workers)

    def _wait(self) -> None:
        if not self._waited:
            self.say(f"the scheduler {self.address} has no workers; waiting for one")
        self._waited = True
        sleep(_LOOK)

    def _check(self) -> None:
        if self._client.status != "running":
            raise OSError(
                f"--scheduler {self.address}: the scheduler has gone; finished rows are in "
                "the table, --resume solves the others"
            )

    def _submit(self, work: _Work, waiting: deque[int]) -> None:
        """Hand over rows that fit, not many more than are solved at a time.

        When a worker dies, only the rows that it had are solved again.
        """
        most = _AHEAD * sum(threads for threads, _ in self._workers.values())
        for _ in range(len(waiting)):
            if len(self._running) >= most:
                break
            number = waiting.popleft()
            if not self._fits(work, number):
                waiting.append(number)
                continue
            needed = {} if work.needs is None else {_MEMORY: work.needs[number]}
            future = self._client.submit(
                work.function,
                *work.arguments[number],
                key=f"{work.name}-{number}-{uuid.uuid4().hex}",
                pure=False,
                retries=0,
                resources=needed,
            )
            self._running[future] = number

    def _take_back(self, work: _Work, waiting: deque[int]) -> None:
        """Cancel rows that were handed to a worker that has left, and fit no other."""
        for future, number in list(self._running.items()):
            if self._workers and not future.done() and not self._fits(work, number):
                self._client.cancel([future], force=True)
                del self._running[future]
                waiting.append(number)

    def _fits(self, work: _Work, number: int) -> bool:
        if work.needs is None:
            return True
        return any(
            memory is not None and work.needs[number] <= memory
            for _, memory in self._workers.values()
        )

    def _too_large(self, work: _Work, number: int) -> str:
        largest = max(memory or 0 for _, memory in self._workers.values())
        needed = 0.0 if work.needs is None else work.needs[number]
        return (
            f"it needs {size(needed)} of memory, but no worker declares more than "
            f"{size(largest)}"
        )

    def _take_finished(self) -> list[_Future]:
        """Rows that have ended, after at most the time between two looks."""
        try:
            self._dask.wait(
                list(self._running), timeout=_LOOK, return_when="FIRST_COMPLETED"
            )
        except TimeoutError:
            pass
        except self._dask.CancelledError:
            self._check()
        return [future for future in self._running if future.done()]

    def _answer(self, future: _Future) -> object:
        """The result of a row that has ended, or its exception.

        None: its worker died before it sent the result, and dask solves the row again.
        """
        if future.status == "error":
            return future.exception()
        try:
            return future.result(timeout=_CONNECT)
        except TimeoutError:
            return None
        except self._dask.scheduler.KilledWorker as error:
            return error
        except self._dask.CancelledError as error:
            self._check()
            return error
