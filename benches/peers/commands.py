"""Run bipot_rs and the peers as commands: find them, run them once, read their results."""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from shutil import which
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from bipot_rs.files.export import read_saved

PEERS = Path(__file__).resolve().parent
PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write")


class Failed(Exception):
    """A run without a result; the message is the last line it printed."""


@dataclass(eq=False)
class Run:
    """Result of one run: seconds, contact forces and relative displacements."""

    dofs: int
    phases: dict[str, float]
    job: float  # mesh to written result [s]
    process: float  # wall clock of the process, imports included [s]
    later: float | None  # median of the load steps after the first [s]
    peak_mb: float
    x: np.ndarray  # (n_c, d) [mm]
    area: np.ndarray  # (n_c,) [mm²], a length in the plane
    mu: np.ndarray | None
    R: np.ndarray  # (steps, n_c, d) [N]
    v: np.ndarray  # (steps, n_c, d) [mm], slip of the step
    settings: str = ""
    more: dict[str, Any] = field(default_factory=dict)


def as_installed(folder):
    """Environment in which Python stores its compiled modules.

    If the caller forbids that, every process would compile its sources again.
    """
    kept = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(folder / "pyc")}
    return os.environ | kept


# The first round fills this folder.
_COMPILED = tempfile.TemporaryDirectory()


def lines_of(command, threads, limit):
    """Seconds of a command, and the JSON lines that it printed.

    ``threads`` is the number for BLAS and for bipot_rs. Libraries print on both streams,
    so lines that are not JSON objects are ignored.
    """
    environment = as_installed(Path(_COMPILED.name)) | {
        "OPENBLAS_NUM_THREADS": str(threads),
        "OMP_NUM_THREADS": str(threads),
        "BIPOT_NUM_THREADS": str(threads),
    }
    if Path(command[0]).resolve() != Path(sys.executable).resolve():
        # Another Python must not import the packages of this one.
        environment.pop("PYTHONPATH", None)
    start = perf_counter()
    try:
        run = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"stopped after {limit:.0f} s") from None
    seconds = perf_counter() - start
    if run.returncode:
        output = run.stderr.strip() or run.stdout.strip() or "no output"
        raise Failed(output.splitlines()[-1][:200])
    return seconds, [
        json.loads(line) for line in run.stdout.splitlines() if line.startswith("{")
    ]


def pythons():
    """Interpreters to try: this one, then those of the path and of the system."""
    candidates = (sys.executable, which("python3"), "/usr/bin/python3")
    return tuple(dict.fromkeys(p for p in candidates if p and Path(p).exists()))


def python_with(modules):
    """The first interpreter that can import the modules, or ``None``."""
    for python in pythons():
        try:
            lines_of([python, "-c", f"import {modules}"], 1, 60)
        except Failed:
            continue
        return python
    return None


class Bipot:
    """`bipot run`, which writes HDF5, VTU and PVD files."""

    name = "bipot_rs"
    threads = (os.cpu_count() or 1,)

    def version(self):
        """Name and version."""
        return f"bipot-rs {version('bipot-rs')}"

    def run(self, scene, n, threads, tol=None, limit=None):
        """Solve a scene."""
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "bipot_rs", "run", scene, "--json"]
            command += ["--set", f"mesh.n={n}", "--out", folder]
            if tol is not None:
                command += ["--set", f"solver.tol={tol}"]
            process, (*steps, last) = lines_of(command, threads, limit)
            contacts, records, *_ = read_saved(Path(folder) / "result.h5")
        phases = {phase: last["seconds"][phase] for phase in PHASES}
        solving = [step["seconds"] for step in steps]
        # Loads and recovery, which the solver does not count, are shared by the steps.
        rest = phases["solve"] + phases["recover"] - sum(solving)
        later = median(solving[1:]) + rest / len(steps) if solving[1:] else None
        slip = np.array([record["slip"] for record in records])
        normal = np.array([record["relative_displacement"] for record in records])
        return Run(
            dofs=last["dofs"],
            phases=phases,
            job=sum(phases.values()),
            process=process,
            later=later,
            peak_mb=last["peak_mb"],
            x=contacts["x"],
            area=contacts["area"],
            mu=contacts["mu"],
            R=np.array([record["reaction"] for record in records]),
            v=np.concatenate([normal[..., :1], slip], axis=2),
        )


@dataclass(eq=False)
class Peer:
    """A script of this folder, run by the first Python that has what it imports."""

    name: str
    script: str
    needs: str
    tol: float  # in its own measure, for a traction error of 1e-8 or less
    package: str  # of Debian
    reads_matrices: bool = False
    python: str | None = None
    missing: str = ""

    @property
    def threads(self):
        """One thread and all: one is often faster for BLAS on the small blocks of a factor."""
        return tuple(dict.fromkeys((1, os.cpu_count() or 1)))

    def find(self):
        """Find a Python that has the peer, or set ``missing`` to the reason."""
        self.python = python_with(self.needs)
        if self.python is None:
            self.missing = f"no Python here has {self.needs.replace(', ', ' and ')}"
        return self

    def version(self):
        """Name and version of the peer."""
        if str(self.python).startswith("/usr/bin"):
            return self.name + debian(self.package)
        module = self.needs.split(",")[0]
        ask = "import json, importlib.metadata as m; "
        ask += f"print(json.dumps({{'version': m.version('{module}')}}))"
        try:
            _, (line,) = lines_of([self.python, "-c", ask], 1, 60)
        except Failed:
            return self.name
        return f"{self.name} {line['version']}"

    def run(self, scene, n, threads, tol=None, limit=None):
        """Solve a scene."""
        with tempfile.TemporaryDirectory() as folder:
            answer, matrices = Path(folder) / "answer.npz", Path(folder) / "system.npz"
            command = [self.python, str(PEERS / self.script), scene, str(n)]
            command += ["--save", str(answer), "--tol", str(tol or self.tol)]
            if self.reads_matrices:
                make = [sys.executable, str(PEERS / "system.py"), scene, str(n)]
                lines_of([*make, "--save", str(matrices)], threads, limit)
                command += ["--matrices", str(matrices)]
            process, lines = lines_of(command, threads, limit)
            with np.load(answer) as file:
                arrays_of_run = dict(file)
        line = lines[-1]
        steps = line["steps"]
        if self.reads_matrices:
            process += line["seconds"]["assemble"]
        return Run(
            dofs=line["dofs"],
            phases=line["seconds"],
            job=line["seconds"]["total"],
            process=process,
            later=median(steps[1:]) if steps[1:] else None,
            peak_mb=line["peak_mb"],
            x=arrays_of_run["x"],
            area=arrays_of_run["area"],
            mu=None,
            R=arrays_of_run["R"],
            v=arrays_of_run["v"],
            settings=line["settings"],
        )


def debian(package):
    """Version of a Debian package with a space before it; empty if not installed."""
    try:
        command = ["dpkg-query", "-W", "-f", "${Version}", package]
        listing = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return " " + listing.stdout


def peers():
    """All peers, installed or not."""
    return [
        Peer("GetFEM", "with_getfem.py", "getfem", 1e-8, "python3-getfem++").find(),
        Peer(
            "Siconos",
            "with_siconos.py",
            "siconos.numerics, scipy",
            1e-9,
            "python3-siconos",
            reads_matrices=True,
        ).find(),
        Peer("SciPy", "with_scipy.py", "scipy, skfem", 1e-9, "python3-scipy").find(),
    ]
