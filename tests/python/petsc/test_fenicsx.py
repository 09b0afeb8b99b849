"""The recipe for a stiffness that DOLFINx distributes."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi, places

RECIPE = places.ROOT / "examples" / "with_fenicsx_parallel.py"
PYTHON = "/usr/bin/python3"


def test_a_block_of_dolfinx(tmp_path: Path) -> None:
    """A cube of hexahedra, which is also a scene."""
    if mpi.missing():
        pytest.skip(f"needs PETSc: {mpi.missing()}")
    variables = mpi.environment()

    def run(*command: str) -> subprocess.CompletedProcess[str]:
        told = {"capture_output": True, "text": True, "timeout": 240}
        return subprocess.run(command, env=variables, cwd=tmp_path, **told)

    load = "from bipot_rs.petsc.library import load; import os; load(); "
    if run(PYTHON, "-c", f"{load} import dolfinx.fem, ufl").returncode:
        pytest.skip("needs DOLFINx (Debian: python3-dolfinx)")
    # DOLFINx itself looks for petsc4py, where `library` has found it.
    where = f"{load} import petsc4py; print(os.path.dirname(petsc4py.__path__[0]), "
    where += "os.environ.get('PETSC_DIR', ''))"
    folder, *petsc = run(PYTHON, "-c", where).stdout.split()
    variables["PYTHONPATH"] += os.pathsep + folder
    variables |= {"PETSC_DIR": petsc[0]} if petsc else {}
    target = tmp_path / "found.npz"
    ranks = ("mpirun", "-n", "2", PYTHON, "-m", "mpi4py")
    done = run(*ranks, str(RECIPE), str(target))
    assert done.returncode == 0, done.stderr
    assert "step 1" in done.stdout
    with np.load(target) as file:
        points, reaction = file["x"], file["reaction"]
    case = bp.Model.from_toml("sheared_cube").with_(**{"mesh.n": 6}).assemble()
    expected = case.solve(tol=1e-12).reaction
    ours, theirs = (np.lexsort(np.round(x, 9).T) for x in (case.model.points, points))
    # Two assemblies of one element with exact quadrature, η of 1e-12, and the condition of
    # W, some hundreds.
    assert mpi.changed(reaction[:, theirs], expected[:, ours]) <= 1e-10
