"""Ranks of mpirun that do the tasks of `petsc_program.py`, in a Python that has petsc4py."""

import atexit
import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.models_and_arrays import arguments

# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
TOL, CLOSE = 1e-12, 1e-10
# Between numbers of ranks only the order of sums and the aggregates differ.
SAME = 1e-11
PROGRAM = Path(__file__).with_name("petsc_program.py")
# Open MPI wants these to be root in a container, without lines about it, for more ranks than
# cores, and for cores that others use too.
OPEN_MPI = {
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMP_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
}
# The Python that `make mpi-test` makes, that of the tests, or that of a distribution.
OWN = Path(__file__).resolve().parents[3] / ".venv-mpi" / "bin" / "python"
PYTHONS = (
    os.environ.get("BIPOT_MPI_PYTHON", str(OWN)),
    sys.executable,
    "/usr/bin/python3",
)


@functools.cache
def missing() -> str:
    """Why tests with PETSc cannot run; empty if they can."""
    if shutil.which("mpirun") is None:
        return "mpirun is not installed"
    try:
        python()
    except LookupError as error:
        return str(error)
    return ""


@functools.cache
def python() -> str:
    """A Python in which `bipot_rs.petsc.library` finds PETSc."""
    reason = ""
    for path in PYTHONS:
        if shutil.which(path) is None:
            continue
        look = "from bipot_rs.petsc.library import load; import scipy.sparse; load()"
        tried = subprocess.run(
            [path, "-c", look], env=environment(), capture_output=True, text=True
        )
        if tried.returncode == 0:
            return path
        reason = (tried.stderr.strip().splitlines() or [""])[-1]
    raise LookupError(f"petsc4py cannot be imported: {reason}")


@functools.cache
def _alone() -> Path:
    """A folder with this package and no other: that of the tests has another NumPy."""
    folder = Path(tempfile.mkdtemp(prefix="bipot-petsc-"))
    atexit.register(shutil.rmtree, folder)
    (folder / "bipot_rs").symlink_to(Path(str(bp.__file__)).parent)
    return folder


def environment() -> dict[str, str]:
    """Without what another Python, or the user of PETSc, has set."""
    of_others = ("PYTHONPATH", "VIRTUAL_ENV", "PETSC_OPTIONS")
    kept = {name: value for name, value in os.environ.items() if name not in of_others}
    return kept | OPEN_MPI | {"PYTHONPATH": str(_alone())}


class Ranks:
    """Ranks that do one task after another: to start them takes longer than most tasks."""

    def __init__(self, count: int) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="bipot-ranks-"))
        self.asked = 0
        with self.output.open("w") as output:
            self.process = subprocess.Popen(
                [
                    *("mpirun", "-n", str(count), python(), "-m", "mpi4py"),
                    *(str(PROGRAM), str(self.folder), str(os.getpid())),
                ],
                env=environment(),
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        atexit.register(self.stop)

    @property
    def output(self) -> Path:
        """What the ranks print."""
        return self.folder / "output"

    def ask(self, seconds: float, **given: Any) -> dict[str, Any]:
        """The answer of rank 0; ranks that fail or hang end, and are a failure."""
        self.asked += 1
        number = f"{self.asked:04d}"
        np.savez(self.folder / "draft.npz", **given)
        (self.folder / "draft.npz").rename(self.folder / f"{number}-given.npz")
        answer = self.folder / f"{number}-answer.npz"
        deadline = time.monotonic() + seconds
        while not answer.exists():
            ended = self.process.poll() is not None
            if ended or time.monotonic() > deadline:
                ranks.cache_clear()
                output = self.output.read_text()
                self.process.terminate()
                self.stop()
                raise AssertionError(f"{'' if ended else 'the ranks hang'}\n{output}")
            time.sleep(0.002)
        with np.load(answer, allow_pickle=False) as file:
            return dict(file)

    def stop(self) -> None:
        """End the ranks."""
        atexit.unregister(self.stop)
        (self.folder / "end").touch()
        self.process.wait(20)
        shutil.rmtree(self.folder)


@functools.cache
def ranks(count: int) -> Ranks:
    """Ranks for all tests of this process."""
    return Ranks(count)


def parts(name: str, matrix: Any) -> dict[str, Any]:
    """A sparse matrix as entries of an npz file."""
    matrix_copy = sparse.csr_array(matrix)
    return {
        f"{name}_data": matrix_copy.data,
        f"{name}_indices": matrix_copy.indices,
        f"{name}_indptr": matrix_copy.indptr,
        f"{name}_shape": np.array(matrix_copy.shape),
    }


def run(count: int, task: str, *, options: str = "", **given: Any) -> dict[str, Any]:
    """What rank 0 of a task answers; K and B may be sparse. Skips without PETSc.

    ``options``: those of PETSc.
    """
    if missing():
        pytest.skip(f"needs PETSc: {missing()}")
    arrays: dict[str, Any] = {}
    for name, value in given.items():
        if sparse.issparse(value):
            arrays |= parts(name, value)
        elif value is not None:
            arrays[name] = np.asarray(value)
    return ranks(count).ask(240, task=task, options=options, **arrays)


def changed(found: Any, expected: Any) -> float:
    """Largest difference, relative to the largest expected value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def read_stats(found: dict[str, Any]) -> dict[str, Any]:
    """`ContactProblem.stats` of an answer."""
    return dict(json.loads(str(found["stats"])))


def of_model(model: bp.Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the problem, and of its load path."""
    case = model.assemble()
    return arguments(case.model), {"load": case.load, "prescribed": case.prescribed}


def solve_directly(known: dict[str, Any], **path: Any) -> bp.Result:
    """The answer of the direct engine."""
    return bp.ContactProblem(**known, engine="direct").solve(**path, tol=TOL)


def compare(found: dict[str, Any], expected: bp.Result) -> None:
    """The answer of several ranks is that of the direct engine."""
    assert changed(found["reaction"], expected.reaction) <= CLOSE
    assert np.array_equal(found["status"], expected.status)
    assert changed(found["displacement"], expected.displacement) <= CLOSE
    assert (found["residual"] <= 10 * TOL).all()
