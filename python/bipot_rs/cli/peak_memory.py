"""The peak memory of this process."""

import sys
from pathlib import Path


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
    else:
        import resource

        mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # in bytes
    return round(mb, 1)
