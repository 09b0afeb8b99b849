"""The command `bipot` under mpirun, with a fault on one of its ranks."""

import functools
import json
import os
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from support.mpi import OPEN_MPI, OWN

REPOSITORY = Path(__file__).resolve().parents[3]
# The lines that Open MPI prints otherwise in a container.
QUIET = {"OMPI_MCA_btl_vader_single_copy_mechanism": "none"}
# The scenes of tests are small, and would be factored on one rank.
LARGE = {"PETSC_OPTIONS": "-bipot_pc_type gamg"}
# Runs code on one rank, then the command on all.
_PROGRAM = """
import os, sys
rank = int(os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")))
fault, at = {fault!r}, {at}
if rank == at:
    exec(fault, {{"rank": rank}})
sys.argv = ["bipot", *sys.argv[1:]]
from bipot_rs.__main__ import main
sys.exit(main())
"""


@functools.cache
def missing() -> str:
    """Why the command cannot run under mpirun; empty if it can."""
    if shutil.which("mpirun") is None:
        return "mpirun is not installed: make mpi-test installs it"
    if not Path(python()).exists():
        return f"there is no {python()}: make mpi-test makes it"
    done = subprocess.run(
        [python(), "-c", "from bipot_rs.petsc.library import load; load()"],
        env=environment(),
        capture_output=True,
        text=True,
    )
    lines_of_error = done.stderr.strip().splitlines()
    return (
        ""
        if done.returncode == 0
        else f"no petsc4py: {lines_of_error[-1] if lines_of_error else ''}"
    )


def python() -> str:
    """A Python with petsc4py, mpi4py and what the command needs."""
    return os.environ.get("BIPOT_MPI_PYTHON", str(OWN))


def environment() -> dict[str, str]:
    environment_kept = {
        name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"
    }
    return (
        LARGE
        | environment_kept
        | OPEN_MPI
        | QUIET
        | {"PYTHONPATH": str(REPOSITORY / "python")}
    )


@dataclass
class Run:
    """How a run has ended, and after how many seconds."""

    status: int
    output: str
    errors: str
    seconds: float

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Standard output of --json."""
        return [json.loads(line) for line in self.output.splitlines()]


def started(
    count: int, *arguments: str, cwd: Path, fault: str = "", at: int = 1
) -> subprocess.Popen[str]:
    """`bipot` on some ranks; ``fault`` is code that rank ``at`` runs first."""
    if missing():
        pytest.skip(f"needs PETSc: {missing()}")
    program = _PROGRAM.format(fault=fault, at=at)
    launcher = ["mpirun", "-n", str(count)] if count else []
    return subprocess.Popen(
        [*launcher, python(), "-c", program, *arguments],
        cwd=cwd,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process: subprocess.Popen[str], seconds: float = 120) -> Run:
    """Wait for a run; one that hangs is a failure, and leaves no processes."""
    began = time.monotonic()
    try:
        output, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate()
        raise AssertionError(f"the run hangs\n{output}\n{errors}") from None
    return Run(process.returncode, output, errors, time.monotonic() - began)


def bipot(count: int, *arguments: str, cwd: Path, fault: str = "", at: int = 1) -> Run:
    """Run `bipot` on some ranks; none is one process without mpirun."""
    return ended(started(count, *arguments, cwd=cwd, fault=fault, at=at))
