"""Ctrl-C and SIGTERM during a command: where they stop it, and where they wait."""

from __future__ import annotations

import signal
import sys
import threading
import time
from typing import Any

# Launchers pass a Ctrl-C on to children that have had it from the terminal already:
# a second signal this soon [s] is the first one again.
_SAME = 1.0


class Interrupts:
    """Handlers of SIGINT and SIGTERM for the length of a ``with`` block.

    A signal raises ``KeyboardInterrupt`` at once, except between `hold` and `release`,
    where it is only noted: files are then finished. A second signal does not wait.

    Parameters
    ----------
    last
        The process ends with the block: signals are ignored after it, instead of
        handled as before, since an interpreter that is shutting down answers them with
        a traceback.

    Attributes
    ----------
    came
        Number of the first signal; ``None`` while there was none.
    told
        Whether the command has said how it ended.
    """

    def __init__(self, *, last: bool = False) -> None:
        self.came: int | None = None
        self.told = False
        self._last = last
        self._held = False
        self._owed = False  # noted, or lost on the way, and not yet raised
        self._at = 0.0
        self._leaving = False
        self._before: dict[int, Any] = {}
        self._hook: Any = None

    @property
    def status(self) -> int:
        """Exit status of a command that a signal ended, as shells count: 130 or 143."""
        return 128 + (signal.SIGINT if self.came is None else self.came)

    def __enter__(self) -> Interrupts:
        self._hook, sys.unraisablehook = sys.unraisablehook, self._unraisable
        # Elsewhere Python allows no handlers, and delivers no signals.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                # What the parent has switched off (nohup, `&` in a script) stays off.
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
        """From here on signals wait."""
        self._held = True

    def release(self) -> None:
        """From here on signals raise; one that has waited raises now."""
        self._held = False
        self.check()

    def check(self) -> None:
        """Raise a signal that is owed: one whose exception somebody swallowed."""
        if self._owed and not self._held:
            self._owed = False
            raise KeyboardInterrupt

    def _handle(self, number: int, _: object) -> None:
        now = time.monotonic()
        if self.came is None:
            self.came, self._at = number, now
            self._owed = self._held
            if not self._held:
                # Whoever handles it is not to be interrupted in turn.
                self._held = True
                raise KeyboardInterrupt
        elif now - self._at > _SAME and not self._leaving:
            self._leaving = True
            raise KeyboardInterrupt

    def _unraisable(self, lost: Any) -> None:
        # Raised within a finaliser or a callback of C code, which Python reports as a
        # traceback and forgets: raised anew at the next `check`.
        if self.came is not None and issubclass(lost.exc_type, KeyboardInterrupt):
            self._owed, self._held = True, False
        else:
            self._hook(lost)
