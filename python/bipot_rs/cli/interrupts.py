"""Ctrl-C and SIGTERM during a command: they raise, or wait until files are written."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType

    # What `signal.signal` takes and returns.
    _Handler: TypeAlias = Callable[[int, FrameType | None], object] | int | None


# Some launchers forward a Ctrl-C that the terminal has already sent to the process: a
# second signal within this time [s] is ignored.
_SAME = 1.0


class Interrupts:
    """Handlers of SIGINT and SIGTERM for the length of a ``with`` block.

    A signal raises ``KeyboardInterrupt`` at once. Between `hold` and `release` it waits, so
    that files are written whole; a second signal raises at once.

    ``last``: the process ends with the block. Signals are then ignored after it, because an
    interpreter that shuts down answers them with a traceback.

    ``came``: number of the first signal, or ``None``.
    ``reported``: whether the command has reported how it ended.
    ``at_once``: called instead of the exception, and does not return: while the process takes
    part in collective calls, from which an exception of one process alone would leave the
    others waiting.
    """

    def __init__(self, *, last: bool = False) -> None:
        self.came: int | None = None
        self.reported = False
        self.at_once: Callable[[], object] | None = None
        self._last = last
        self._held = False
        self._owed = False  # a signal waits, or its exception was lost
        self._at = 0.0
        self._leaving = False
        self._before: dict[int, _Handler] = {}
        self._hook: Callable[[UnraisableHookArgs], object] = sys.unraisablehook

    @property
    def status(self) -> int:
        """Exit status of a command that a signal ended: 130 or 143, as in shells."""
        return 128 + (signal.SIGINT if self.came is None else self.came)

    def renew(self) -> None:
        """Set the handlers again, which a library has replaced."""
        for number in self._before:
            signal.signal(number, self._handle)

    def __enter__(self) -> Interrupts:
        self._hook, sys.unraisablehook = sys.unraisablehook, self._unraisable
        # Python allows signal handlers in the main thread only.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                # A signal that the parent ignores (nohup, `&` in a script) stays ignored.
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        self._leaving = True
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._last else before)
        if not self._last:
            sys.unraisablehook = self._hook

    def hold(self) -> None:
        """Let signals wait from now on."""
        self._held = True

    def release(self) -> None:
        """Let signals raise from now on; one that waits raises now."""
        self._held = False
        self.check()

    def check(self) -> None:
        """Raise a signal that has waited, or whose exception was lost."""
        if self._owed and not self._held:
            self._owed = False
            self._stop()

    @property
    def held(self) -> bool:
        """Whether signals wait."""
        return self._held

    @property
    def due(self) -> int | None:
        """A signal that waits."""
        return self.came if self._owed else None

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Let signals wait in a block; one that waits raises at the next `check`."""
        before, self._held = self._held, True
        try:
            yield
        finally:
            self._held = before

    def take(self, number: int) -> None:
        """Note a signal that another process has received, or that is dealt with."""
        self.came, self._owed = number, False

    def _stop(self) -> None:
        if self.at_once is not None:
            self.at_once()
        raise KeyboardInterrupt

    def _handle(self, number: int, _: object) -> None:
        now = time.monotonic()
        if self.came is None:
            self.came, self._at = number, now
            self._owed = self._held
            if not self._held:
                # The code that handles it must not be interrupted by another.
                self._held = True
                self._stop()
        elif now - self._at > _SAME and not self._leaving:
            self._leaving = True
            raise KeyboardInterrupt

    def _unraisable(self, lost: UnraisableHookArgs) -> None:
        # Python prints an exception in a finaliser or in a callback of C code, and drops
        # it. The next `check` raises it again.
        if self.came is not None and issubclass(lost.exc_type, KeyboardInterrupt):
            self._owed, self._held = True, False
        else:
            self._hook(lost)
