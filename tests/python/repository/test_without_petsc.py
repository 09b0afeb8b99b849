"""The package without PETSc: nothing imports it, and who asks for it learns what to do."""

from pathlib import Path
from typing import Any

import pytest

from bipot_rs.scene import assemble, bodies, read
from support.programs import child_without

PETSC = ("petsc4py", "mpi4py")
MAIN = "from bipot_rs.__main__ import main; sys.exit(main())"


RUN = ("run", "sheared_cube", "--set", "mesh.n=2", "--out", "here")


def test_the_engine_without_petsc_says_what_to_install(tmp_path: Path) -> None:
    done = child_without(PETSC, MAIN, *RUN, "--engine", "petsc", cwd=tmp_path)
    assert done.returncode == 2
    for words in ("is not installed", "apt-get install", "conda"):
        assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_scene_with_the_engine_in_python(bipot: Any) -> None:
    """The object of a scene solves on one process."""
    scene = read("sheared_cube", ["mesh.n=2", "solver.engine=petsc"])
    with pytest.raises(ValueError, match="solves scenes by bipot run, under mpirun"):
        assemble(scene, bodies(scene)).solve()
    asked = ("check", "sheared_cube", "--set", "solver.engine=petsc")
    status, out, err = bipot(*asked)
    assert status == 0, err
    assert "petsc" in out
    # Other commands do not take the engine.
    for command in (("solve", "--stiffness", "K"), ("sweep", "x")):
        assert bipot(*command, "--engine", "petsc")[0] == 2
