"""The console command `bipot`, and ``python -m bipot_rs``."""

from __future__ import annotations

import gc
import os
import signal
import sys

from bipot_rs.cli.exit_codes import INTERRUPTED


def main() -> int:
    """Run the command. Ctrl-C while libraries are imported leaves no traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # No work has begun: there is nothing to write or to close.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from bipot_rs.cli.entry import call

    status = call(sys.argv[1:], last=True)
    # The end of the process frees all memory: to look for garbage before it takes as long as
    # a third of the imports of NumPy and SciPy.
    gc.freeze()
    return status


if __name__ == "__main__":
    sys.exit(main())
