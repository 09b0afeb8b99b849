"""The recipe for a stiffness that DOLFINx distributes."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bipot_rs.scene import assemble, bodies, read
from support import mpi, places

RECIPE = places.ROOT / "examples" / "with_fenicsx_parallel.py"
PYTHON = "/usr/bin/python3"


def test_a_block_of_dolfinx(tmp_path: Path) -> None:
    """A cube of hexahedra, which is also a scene."""
    if mpi.missing():
        pytest.skip(f"needs PETSc: {mpi.missing()}")
    modules = "from bipot_rs.petsc.library import load; load(); import dolfinx.fem, ufl"
    variables = mpi.environment()
    tried = subprocess.run(
        [PYTHON, "-c", modules],
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    if tried.returncode:
        pytest.skip("needs DOLFINx (Debian: python3-dolfinx)")
    # DOLFINx itself looks for petsc4py, where `library` has found it.
    where = (
        "from bipot_rs.petsc.library import load; import os; load(); import petsc4py; "
    )
    where += (
        "print(os.path.dirname(petsc4py.__path__[0]), os.environ.get('PETSC_DIR', ''))"
    )
    lines_printed = subprocess.check_output(
        [PYTHON, "-c", where], env=variables, text=True
    ).split()
    variables["PYTHONPATH"] += os.pathsep + lines_printed[0]
    variables |= {"PETSC_DIR": lines_printed[1]} if len(lines_printed) > 1 else {}
    target = tmp_path / "found.npz"
    done = subprocess.run(
        ["mpirun", "-n", "2", PYTHON, "-m", "mpi4py", str(RECIPE), str(target)],
        env=variables,
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    assert "step 1" in done.stdout
    with np.load(target) as file:
        points, reaction = file["x"], file["reaction"]
    scene = read("sheared_cube", ["mesh.n=6"])
    case = assemble(scene, bodies(scene))
    expected = case.solve(tol=1e-12).reaction
    ours, theirs = (np.lexsort(np.round(x, 9).T) for x in (case.model.points, points))
    # Two assemblies of one element with exact quadrature, η of 1e-12, and the condition of
    # W, some hundreds.
    assert mpi.changed(reaction[:, theirs], expected[:, ours]) <= 1e-10
