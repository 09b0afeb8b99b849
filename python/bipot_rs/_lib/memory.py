"""Memory of this machine, and of this process."""

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


def peak_mb() -> float:
    """Largest resident memory of this process so far, in units of 2**20 bytes.

    On Linux it is ``VmHWM``, not ``getrusage``: ``ru_maxrss`` of a new process starts
    from what its parent held, so that a run started by a large program would report
    the memory of that program.
    """
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text(encoding="ascii")
        (peak,) = (row for row in status.splitlines() if row.startswith("VmHWM:"))
        mb = int(peak.split()[1]) / 2**10  # in kB
    elif sys.platform == "win32":
        mb = _peak_working_set() / 2**20
    else:
        import resource

        mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # in bytes
    return round(mb, 1)


if sys.platform == "win32":

    def _peak_working_set() -> int:
        """``PeakWorkingSetSize`` of PROCESS_MEMORY_COUNTERS, in bytes."""
        import ctypes
        from ctypes import wintypes

        class Counters(ctypes.Structure):
            _fields_ = (
                ("cb", wintypes.DWORD),
                ("page_faults", wintypes.DWORD),
                ("peak_working_set", ctypes.c_size_t),
                # Seven more sizes, which nobody reads here.
                ("others", ctypes.c_size_t * 7),
            )

        counters = Counters(cb=ctypes.sizeof(Counters))
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.GetCurrentProcess.restype = wintypes.HANDLE
        succeeded = kernel.K32GetProcessMemoryInfo(
            wintypes.HANDLE(kernel.GetCurrentProcess()),
            ctypes.byref(counters),
            counters.cb,
        )
        if not succeeded:
            raise ctypes.WinError(ctypes.get_last_error())
        return int(counters.peak_working_set)
