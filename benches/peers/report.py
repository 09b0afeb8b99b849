"""Arguments of a peer, its clock, and its report: one JSON line and a file of tractions."""

import argparse
import json
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter

import numpy as np


class Clock:
    """Seconds of named phases and of load steps."""

    def __init__(self):
        self.begin = self.last = perf_counter()
        self.phases, self.steps = {}, []

    def lap(self, name):
        """End a phase."""
        now = perf_counter()
        self.phases[name] = self.phases.get(name, 0.0) + now - self.last
        self.last = now

    def step(self):
        """End a load step."""
        now = perf_counter()
        self.steps.append(now - self.last)
        self.lap("contact")

    def discount(self, seconds):
        """Subtract the seconds of an attempt that does not count."""
        self.last += seconds
        self.begin += seconds


def arguments(doc):
    """Command line of a peer: scene, size, tolerance and files."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("n", type=int)
    parser.add_argument("--save", help="tractions, as npz")
    parser.add_argument("--tol", type=float, default=1e-8)
    parser.add_argument(
        "--matrices", help="K, B and loads written by system.py, as npz"
    )
    parser.add_argument("--solver", help="solver of the peer, if it has several")
    return parser.parse_args()


def installed(package):
    """Version of a package; a question mark if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "?"


def peak_mb():
    """Peak memory of this process.

    Not getrusage's figure, which may be that of the process that started this one.
    """
    with Path("/proc/self/status").open(encoding="ascii") as file:
        for line in file:
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024
    return float("nan")


def write(args, clock, program, x, area, reactions, displacements, **more):
    """Save the tractions and print the JSON line.

    ``reactions`` and ``displacements`` are lists over the load steps of arrays
    ``(n_c, d)``, normal first: forces [N], and gaps with increments of slip [mm].
    """
    total = clock.last - clock.begin
    if args.save:
        np.savez(
            args.save,
            x=x,
            area=area,
            R=np.array(reactions),
            v=np.array(displacements),
        )
    line = {
        "program": program,
        "scene": args.scene,
        "n": args.n,
        "contacts": len(x),
        "seconds": clock.phases | {"total": total},
        "steps": clock.steps,
        "peak_mb": peak_mb(),
        "python": platform.python_version(),
        "versions": {p: installed(p) for p in ("numpy", "scipy", "scikit-fem")},
        "threads": os.environ.get("OPENBLAS_NUM_THREADS", "free"),
    }
    print(json.dumps(line | more))
