"""The console command `bipot`, and ``python -m bipot_rs``."""

from __future__ import annotations

import gc
import os
import signal
import sys
from typing import TYPE_CHECKING

from bipot_rs.cli.exit_codes import INTERRUPTED

if TYPE_CHECKING:
    from bipot_rs.cli.entry import Reader


def _by_typer() -> Reader:
    """Import the commands of Typer, which most runs do without."""
    from bipot_rs.cli.app import by_typer

    return by_typer


def main() -> int:
    """Run the command. Ctrl-C while libraries are imported leaves no traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # No work has begun: there is nothing to write or to close.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    # Imports make some hundred thousand objects, which all stay. To look for garbage among
    # them every 700 objects takes a twentieth of the start.
    gc.set_threshold(200_000)
    # pydantic would read the metadata of all installed packages to find its plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from bipot_rs.cli.entry import call

    status = call(sys.argv[1:], last=True, by_typer=_by_typer)
    # The end of the process frees all memory: no search for garbage before it.
    gc.freeze()
    return status


if __name__ == "__main__":
    sys.exit(main())
