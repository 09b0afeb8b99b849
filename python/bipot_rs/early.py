"""Ctrl-C while the command `bipot` is still loading: gone without a traceback.

Imported before NumPy, which takes most of that time. Where the package is a library,
nothing happens here.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import PurePath

_INTERRUPTED = 130


def is_command() -> bool:
    """Whether this process is `bipot`, or ``python -m bipot_rs``."""
    # "-m" stands there until Python has found the module to run.
    started = sys.argv[0] if sys.argv else ""
    return PurePath(started).name == "bipot" or (
        started == "-m" and "bipot_rs" in sys.orig_argv
    )


def leave(*_: object) -> None:
    """End the process: nothing is begun yet that would have to be finished."""
    os._exit(_INTERRUPTED)


if is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave)
