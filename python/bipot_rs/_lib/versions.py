"""What an answer was computed with: versions, machine and threads."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

from bipot_rs import _core

__version__ = _core.version

# What an extra brings, by the name of its distribution.
_NEEDED = ("numpy", "scipy")
_OPTIONAL = (
    "scikit-fem",
    "meshio",
    "h5py",
    "pydantic",
    "typer",
    "rich",
    "matplotlib",
    "pyvista",
    "gmsh",
)
_THREADS = ("BIPOT_NUM_THREADS", "RAYON_NUM_THREADS")
# Instructions that the dense kernels have code of their own for.
_VECTORS = ("avx", "avx2", "fma", "avx512f", "asimd")


def versions() -> dict[str, str]:
    """Everything a report of a fault needs, each as a line of words.

    Nothing is imported for it: an optional library is asked for the version that was
    installed, so that this is quick, and works where one of them does not.

    Returns
    -------
    dict
        ``bipot-rs``, ``core`` (version and build of the compiled part), ``python``,
        ``system``, ``processor``, ``vector instructions``, ``cores``, ``threads``
        (how many a solve uses, and what says so), ``ordering``, and a version or ``not
        installed`` for each library.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> list(bp.versions())[:3]
    ['bipot-rs', 'core', 'python']
    """
    known = {
        "bipot-rs": _version("bipot-rs"),
        "core": f"{_core.version}, {_core.build_profile} build",
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "system": platform.platform(),
    }
    model, flags = _processor()
    known["processor"] = model
    found = [name for name in _VECTORS if name in flags]
    known["vector instructions"] = ", ".join(found) or "unknown"
    known["cores"] = str(_cores())
    known["threads"] = _threads()
    known["ordering"] = "METIS, coordinate bisection (both compiled in)"
    return known | {name: _version(name) for name in (*_NEEDED, *_OPTIONAL)}


def show_versions() -> None:
    """Print `versions`, a line each: to be pasted into a report of a fault."""
    told = versions()
    width = max(map(len, told))
    lines = [f"{name:{width}}  {value}" for name, value in told.items()]
    sys.stdout.write("\n".join(lines) + "\n")


def _version(name: str) -> str:
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _processor() -> tuple[str, set[str]]:
    """Its name and instructions where the system tells; of Linux alone the latter."""
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
    """Those that this process may run on, where the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _threads() -> str:
    try:
        number = str(_core.threads())
    except ValueError as error:
        # What is wrong with a variable is what a report should say.
        return str(error)
    given = [f"{name}={os.environ[name]}" for name in _THREADS if name in os.environ]
    return f"{number} ({', '.join(given)})" if given else number
