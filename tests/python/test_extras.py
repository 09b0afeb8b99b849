"""An environment that lacks a library: the rest works, and the extra is named."""

import subprocess
import sys
from pathlib import Path

import pytest

from bipot_rs.extras import missing

# Nothing but arrays, in a process that finds none of the optional libraries.
OPTIONAL = (
    "gmsh",
    "h5py",
    "matplotlib",
    "meshio",
    "pydantic",
    "pyvista",
    "rich",
    "skfem",
    "typer",
)
WITHOUT = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {lacking!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
SOLVE = """
import pickle
import numpy as np
import bipot_rs as bp
K, B = 1000.0 * np.eye(2), np.eye(2)
problem = bp.ContactProblem(K, B, gap=[0.0], mu=0.3)
result = problem.solve([[-10.0, 2.0], [-10.0, 5.0]])
assert result.reaction[:, 0].tolist() == [[10.0, -2.0], [10.0, -3.0]]
assert result[-1].error_estimate[0] < 1e-12
assert problem.reduced([-10.0, 5.0]).solve().unique == "proved"
assert pickle.loads(pickle.dumps(result)).success
assert bp.project([[1.0, 3.0]], 0.5)[0].tolist() == [[2.0, 1.0]]
from bipot_rs import analytic, theory
bp.show_versions()
"""


def run(
    code: str, lacking: tuple[str, ...], folder: Path
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT.format(lacking=lacking) + code],
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )


def test_arrays_need_none_of_them(tmp_path: Path) -> None:
    done = run(SOLVE, OPTIONAL, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "numpy" in done.stdout


@pytest.mark.parametrize(
    ("library", "code", "told"),
    [
        ("h5py", "import bipot_rs; bipot_rs.load('x.h5')", "files need h5py"),
        ("h5py", "import bipot_rs; bipot_rs.fclib.read('x')", "files need h5py"),
        ("skfem", "import bipot_rs.fem", "finite elements need scikit-fem"),
        ("typer", "import bipot_rs.cli", "commands need typer"),
        ("typer", "import runpy; runpy.run_module('bipot_rs')", "commands need typer"),
    ],
)
def test_what_to_install_is_said(
    library: str, code: str, told: str, tmp_path: Path
) -> None:
    done = run(code, (library,), tmp_path)
    last = done.stderr.strip().splitlines()[-1]
    extra = {"h5py": "io", "skfem": "fem", "typer": "cli"}[library]
    assert last == (
        f"ModuleNotFoundError: {told}, which is not installed: it comes with the extra "
        f"{extra}, as in pip install 'bipot-rs[{extra}]'"
    )


def test_a_fault_within_a_library_is_not_hidden() -> None:
    within = ModuleNotFoundError("No module named 'zlib'", name="zlib")
    assert missing(within, "files", "h5py", "io") is within
    without = ModuleNotFoundError("No module named 'h5py'", name="h5py")
    assert missing(without, "files", "h5py", "io") is not without
