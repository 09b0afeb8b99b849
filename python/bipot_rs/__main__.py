"""The console command `bipot`, and ``python -m bipot_rs``."""

from __future__ import annotations

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

    return call(sys.argv[1:], last=True)


if __name__ == "__main__":
    sys.exit(main())
