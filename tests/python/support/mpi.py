"""Run `petsc_program.py` under mpirun, in a Python that has petsc4py."""

import functools
import json
import os
import shutil
import subprocess
import sys
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
# Open MPI wants these to be root in a container, and for more ranks than cores.
OPEN_MPI = {
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
    import tempfile

    folder = Path(tempfile.mkdtemp(prefix="bipot-petsc-"))
    (folder / "bipot_rs").symlink_to(Path(str(bp.__file__)).parent)
    return folder


def environment() -> dict[str, str]:
    environment_kept = {
        name: value for name, value in os.environ.items() if name != "PYTHONPATH"
    }
    environment_kept.pop("VIRTUAL_ENV", None)
    return environment_kept | OPEN_MPI | {"PYTHONPATH": str(_alone())}


def parts(name: str, matrix: Any) -> dict[str, Any]:
    """A sparse matrix as entries of an npz file."""
    matrix_copy = sparse.csr_array(matrix)
    return {
        f"{name}_data": matrix_copy.data,
        f"{name}_indices": matrix_copy.indices,
        f"{name}_indptr": matrix_copy.indptr,
        f"{name}_shape": np.array(matrix_copy.shape),
    }


def run(
    folder: Path,
    task: str,
    ranks: int,
    *,
    options: str = "",
    timeout: float = 240,
    **given: Any,
) -> dict[str, Any]:
    """What rank 0 of the program wrote; K and B may be sparse. Skips without PETSc."""
    if missing():
        pytest.skip(f"needs PETSc: {missing()}")
    arrays: dict[str, Any] = {}
    for name, value in given.items():
        if sparse.issparse(value):
            arrays |= parts(name, value)
        elif value is not None:
            arrays[name] = np.asarray(value)
    source, target = folder / f"{task}-given.npz", folder / f"{task}-{ranks}.npz"
    np.savez(source, **arrays)
    target.unlink(missing_ok=True)
    done = subprocess.run(
        [
            *("mpirun", "-n", str(ranks), python(), "-m", "mpi4py"),
            *(str(PROGRAM), task, str(source), str(target)),
        ],
        env=environment() | {"PETSC_OPTIONS": options},
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with np.load(target, allow_pickle=False) as file:
        return dict(file)


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
