"""The console command `bipot`, and ``python -m bipot_rs``."""

from __future__ import annotations

import os
import signal
import sys

_INTERRUPTED = 130


def main() -> int:
    """Run the command; Ctrl-C while NumPy and others load leaves no traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # Nothing is begun yet that would have to be finished.
        signal.signal(signal.SIGINT, lambda *_: os._exit(_INTERRUPTED))
    from bipot_rs.cli.app import app

    return int(app() or 0)


if __name__ == "__main__":
    sys.exit(main())
