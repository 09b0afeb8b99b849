"""The command `bipot` under mpirun, with a fault on one of its ranks."""

import functools
import json
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from support import mpi

# The scenes of tests are small, and would be factored on one rank.
LARGE = "-bipot_pc_type gamg"
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
    if mpi.missing():
        return mpi.missing()
    look = "import argcomplete, h5py, meshio, pydantic, rich, skfem, tomli_w"
    done = subprocess.run(
        [mpi.python(), "-c", look],
        env=mpi.environment(),
        capture_output=True,
        text=True,
    )
    return done.stderr and f"{mpi.python()}: {done.stderr.splitlines()[-1]}"


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
        [*launcher, mpi.python(), "-c", program, *arguments],
        cwd=cwd,
        env=mpi.environment() | {"PETSC_OPTIONS": LARGE},
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


def bipot_with(
    count: int, *arguments: str, cwd: Path, fault: str = "", at: int = 1
) -> Run:
    """Run `bipot` on some ranks of its own; none is one process without mpirun."""
    return ended(started(count, *arguments, cwd=cwd, fault=fault, at=at))


def bipot(count: int, *arguments: str, cwd: Path, options: str = LARGE) -> Run:
    """Run `bipot` on ranks that other tests use too; ``options`` are those of PETSc."""
    if missing():
        pytest.skip(f"needs PETSc: {missing()}")
    began = time.monotonic()
    words = {"words": [*arguments], "cwd": str(cwd), "options": options}
    told = mpi.run(count, "command", **words)
    seconds = time.monotonic() - began
    return Run(int(told["status"]), str(told["output"]), str(told["errors"]), seconds)
