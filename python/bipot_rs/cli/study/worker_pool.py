"""Call a function with many arguments in parallel processes of one thread each.

When a worker is killed (out of memory, for example), the pools of the standard library
hang or drop the remaining work. Here its argument is reported as lost, and a new process
continues.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

# Number of threads of every library that has its own.
_THREADS = (
    "BIPOT_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)


def _serve(connection: Connection, work: Callable[..., object]) -> None:
    """Answer arguments until None arrives."""
    # A Ctrl-C reaches all processes of a terminal; the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
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
            target=_serve, args=(there, self.work), daemon=True
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
