"""Memory of this machine."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def installed() -> int | None:
    """Memory of this machine in bytes; None if unknown (Windows)."""
    size: int | None = None
    if sys.platform != "win32":
        size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return size


def available() -> int | None:
    """Free memory of this machine in bytes; None if unknown (not Linux)."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        return 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, LookupError, ValueError):
        return None
