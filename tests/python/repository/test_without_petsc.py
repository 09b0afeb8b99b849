"""The package without PETSc: nothing imports it, and who asks for it learns what to do."""

import subprocess
import sys
from pathlib import Path

import pytest

from support.children import bipot, child

# A machine without PETSc, whatever this one has.
_WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("petsc4py", "mpi4py"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
sys.argv = ["bipot", *sys.argv[1:]]
from bipot_rs.__main__ import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    "work",
    [
        "import bipot_rs; [getattr(bipot_rs, name) for name in dir(bipot_rs)]",
        "from bipot_rs.cli import app",
        "import bipot_rs.cli.run.job, bipot_rs.scene, bipot_rs.fem",
    ],
)
@pytest.mark.slow_variants(
    "import bipot_rs; [[]getattr(bipot_rs, name) for name in dir(bipot_rs)]"
)
def test_the_ordinary_package_never_imports_petsc(work: str) -> None:
    script = (
        f"import sys\n{work}\nnames = {{name.partition('.')[0] for name in sys.modules}}\n"
        "assert not names & {'petsc4py', 'mpi4py'}\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_run_with_another_engine_does_not_import_it(tmp_path: Path) -> None:
    run = ("run", "sheared_cube", "--set", "mesh.n=2", "--out", "here")
    assert child(_WITHOUT, *run, cwd=tmp_path).returncode == 0


def test_the_engine_without_petsc_says_what_to_install(tmp_path: Path) -> None:
    run = ("run", "sheared_cube", "--set", "mesh.n=2", "--out", "here")
    done = child(_WITHOUT, *run, "--engine", "petsc", cwd=tmp_path)
    assert done.returncode == 2
    assert "is not installed" in done.stderr
    assert "apt-get install" in done.stderr
    assert "conda" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", [("solve", "--stiffness", "K"), ("sweep", "x")])
def test_other_commands_do_not_take_the_engine(
    command: tuple[str, ...], tmp_path: Path
) -> None:
    assert bipot(*command, "--engine", "petsc", cwd=tmp_path).returncode == 2


def test_a_scene_with_the_engine_in_python(tmp_path: Path) -> None:
    """The object of a scene solves on one process."""
    from bipot_rs.scene.build import bodies
    from bipot_rs.scene.case import assemble
    from bipot_rs.scene.reading import read

    scene = read("sheared_cube", ["mesh.n=2", "solver.engine=petsc"])
    with pytest.raises(ValueError, match="solves scenes by bipot run, under mpirun"):
        assemble(scene, bodies(scene)).solve()
    checked = bipot(
        "check", "sheared_cube", "--set", "solver.engine=petsc", cwd=tmp_path
    )
    assert checked.returncode == 0, checked.stderr
    assert "petsc" in checked.stdout
