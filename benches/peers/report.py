"""What every peer is asked and answers: arguments, phases, one JSON line, tractions."""

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
        """The phase that ends here."""
        now = perf_counter()
        self.phases[name] = self.phases.get(name, 0.0) + now - self.last
        self.last = now

    def step(self):
        """The load step that ends here."""
        now = perf_counter()
        self.steps.append(now - self.last)
        self.lap("contact")

    def discount(self, seconds):
        """Leave out what just passed: a try that does not count."""
        self.last += seconds
        self.begin += seconds


def arguments(doc):
    """Scene, size, tolerance and files."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("n", type=int)
    parser.add_argument("--save", help="tractions, as npz")
    parser.add_argument("--tol", type=float, default=1e-8)
    parser.add_argument("--matrices", help="K, B and loads of matrices.py, as npz")
    parser.add_argument(
        "--solver", help="which of its solvers, where there are several"
    )
    return parser.parse_args()


def installed(package):
    """Version of a package, or a question mark."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "?"


def peak_mb():
    """Most memory that this process held.

    Not getrusage's figure, which may be that of the process that started this one.
    """
    with Path("/proc/self/status").open(encoding="ascii") as file:
        for line in file:
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024
    return float("nan")


def write(asked, clock, program, x, area, reactions, displacements, **more):
    """Save tractions and print the line.

    ``reactions`` and ``displacements`` are lists over the load steps of arrays
    ``(n_c, d)``, normal first: forces [N], and gaps with increments of slip [mm].
    """
    total = clock.last - clock.begin
    if asked.save:
        np.savez(
            asked.save,
            x=x,
            area=area,
            R=np.array(reactions),
            v=np.array(displacements),
        )
    line = {
        "program": program,
        "scene": asked.scene,
        "n": asked.n,
        "contacts": len(x),
        "seconds": clock.phases | {"total": total},
        "steps": clock.steps,
        "peak_mb": peak_mb(),
        "python": platform.python_version(),
        "versions": {p: installed(p) for p in ("numpy", "scipy", "scikit-fem")},
        "threads": os.environ.get("OPENBLAS_NUM_THREADS", "free"),
    }
    print(json.dumps(line | more))
