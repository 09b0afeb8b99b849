"""The machine and the installation: versions, processor, threads and memory."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

import bipot_rs._core as _core

__version__ = _core.version

# Distributions that the package needs, and those that its extras install.
_NEEDED = ("numpy", "scipy")
_OPTIONAL = (
    "scikit-fem",
    "meshio",
    "h5py",
    "pydantic",
    "argcomplete",
    "rich",
    "matplotlib",
    "pyvista",
    "gmsh",
)
_THREADS = ("BIPOT_NUM_THREADS", "RAYON_NUM_THREADS")
# Instruction sets for which the dense kernels have special code.
_VECTORS = ("avx", "avx2", "fma", "avx512f", "asimd")


def versions() -> dict[str, str]:
    """Everything that a bug report needs, as text by name.

    No library is imported: the versions come from the metadata of the installation. This
    is quick, and works if a library is broken.

    Returns
    -------
    dict
        ``bipot-rs``, ``core`` (version and build of the compiled part), ``python``,
        ``system``, ``processor``, ``vector instructions``, ``cores``, ``threads``
        (number used by a solve, and the variable that sets it), ``ordering``, and for
        each library its version or ``not installed``.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> list(bp.versions())[:3]
    ['bipot-rs', 'core', 'python']
    """
    facts = {
        "bipot-rs": _version("bipot-rs"),
        "core": f"{_core.version}, {_core.build_profile} build",
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "system": platform.platform(),
    }
    model, flags = _describe_processor()
    facts["processor"] = model
    supported = [name for name in _VECTORS if name in flags]
    facts["vector instructions"] = ", ".join(supported) or "unknown"
    facts["cores"] = str(_cores())
    facts["threads"] = _threads()
    facts["ordering"] = "METIS, coordinate bisection (both compiled in)"
    return facts | {name: _version(name) for name in (*_NEEDED, *_OPTIONAL)}


def show_versions() -> None:
    """Print `versions`, one line each, for a bug report."""
    facts = versions()
    width = max(map(len, facts))
    lines = [f"{name:{width}}  {value}" for name, value in facts.items()]
    sys.stdout.write("\n".join(lines) + "\n")


def _version(name: str) -> str:
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _describe_processor() -> tuple[str, set[str]]:
    """Name and instruction sets of the processor; the latter on Linux only."""
    model, flags = platform.processor() or platform.machine() or "unknown", set[str]()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return model, flags
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            model = value.strip()
        elif key.strip() in ("flags", "Features"):
            flags.update(value.split())
    return model, flags


def _cores() -> int:
    """Number of cores; on Linux only those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _threads() -> str:
    try:
        number = str(_core.threads())
    except ValueError as error:
        # An invalid environment variable belongs into the report.
        return str(error)
    limits = [f"{name}={os.environ[name]}" for name in _THREADS if name in os.environ]
    return f"{number} ({', '.join(limits)})" if limits else number


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
        mb = _read_status("VmHWM") / 2**10
    elif sys.platform == "win32":
        mb = _peak_working_set() / 2**20
    else:
        import resource

        mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # in bytes
    return round(mb, 1)


def resident() -> float:
    """Bytes of memory that this process holds; on other systems than Linux the most so far."""
    return (
        1024.0 * _read_status("VmRSS") if sys.platform == "linux" else 2**20 * peak_mb()
    )


def _read_status(name: str) -> int:
    """A size [kB] that Linux tells of this process."""
    rows = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(row.split()[1]) for row in rows if row.startswith(f"{name}:"))


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
