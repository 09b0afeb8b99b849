"""`bipot run` in a subprocess: output, files and exit status."""

import csv
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from bipot_rs.files import export
from support.children import child
from support.runs import BIPOT, FILES, LAST_LINE, bipot, lines

CUBE = ("run", "sheared_cube", "--set", "mesh.n=3")


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict[str, Any]], Path]:
    """What a run prints with --json, and its files."""
    cwd = tmp_path_factory.mktemp("cube")
    run = bipot(*CUBE, "--out", "here", "--json", cwd=cwd)
    assert run.stderr == ""
    return lines(run.stdout), cwd / "here"


def test_run_writes_table_and_files(tmp_path: Path) -> None:
    run = bipot(*CUBE, "--plot", cwd=tmp_path)
    out = tmp_path / "out" / "sheared_cube"
    series = {f"{s}_000{k}.vtu" for s in ("result", "contact") for k in (0, 1)}
    assert {p.name for p in out.iterdir()} == FILES | series | {"tractions.png"}
    assert (out / "tractions.png").read_bytes().startswith(b"\x89PNG")
    for word in ("stick", "slip", "open", "residual", "result.h5", "192 degrees"):
        assert word in run.stdout
    # Without a terminal there is a line for each load step instead of a bar.
    assert re.findall(r"^load step (\d) of 2: load", run.stderr, re.M) == ["1", "2"]


def test_a_sine_that_returns_to_zero_is_shown_as_zero(tmp_path: Path) -> None:
    run = bipot("run", "cyclic_cube", "--set", "mesh.n=1", cwd=tmp_path)
    loads = re.findall(r"^load step \d+ of 41: load ([^,]+),", run.stderr, re.M)
    assert [loads[k] for k in (0, 10, 20, 30, 40)] == ["0"] * 5
    assert loads[5] == "1"


def test_json_lines(cube: Any, tmp_path: Path) -> None:
    (*steps, last), folder = cube
    assert [step["step"] for step in steps] == [0, 1]
    assert [step["load"] for step in steps] == [0.0, 1.0]
    keys = "step load open slip stick residual iterations seconds forces"
    assert steps[0].keys() == set(keys.split())
    # The same numbers as in the table of the run.
    with (folder / "steps.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for step, row in zip(steps, rows, strict=True):
        assert list(step["forces"]) == ["cube.bottom"]
        for name, force in step["forces"]["cube.bottom"].items():
            assert force == float(row[f"{name} of cube.bottom"])
    assert all(s["open"] + s["slip"] + s["stick"] == 16 for s in steps)
    # The tolerance of the shipped scenes.
    assert all(0 < s["residual"] <= 1e-12 for s in steps)
    assert last.keys() == LAST_LINE
    assert last["scene"] == "sheared_cube"
    assert (last["dofs"], last["contacts"], last["steps"]) == (192, 16, 2)
    assert last["success"] is True
    phases = ["mesh", "assemble", "condense", "solve", "recover", "write", "total"]
    assert list(last["seconds"]) == phases
    parts = sum(last["seconds"][phase] for phase in phases[:-1])
    assert 0 < parts <= last["seconds"]["total"]
    assert last["peak_mb"] > 10
    # A loose tolerance and another method have an effect: the run stops there.
    other = ("--tol", "1e-4", "--method", "uzawa", "--json")
    *loose, _ = lines(bipot(*CUBE, *other, cwd=tmp_path).stdout)
    assert 1e-12 < max(step["residual"] for step in loose) <= 1e-4


@pytest.mark.slow
def test_a_later_run_replaces_the_files_of_an_earlier_one(tmp_path: Path) -> None:
    arguments = ("run", "cyclic_cube", "--set", "mesh.n=2", "--out", "here")
    bipot(*arguments, "--plot", cwd=tmp_path)
    mine = {"notes.txt", "result_old.vtu"}
    for name in mine:
        (tmp_path / "here" / name).write_text("mine")
    one_step = ["--set", "path.steps=1", "--set", "path.amplitude.shear=[0.0]"]
    bipot(*arguments, *one_step, cwd=tmp_path)
    left = {path.name for path in (tmp_path / "here").iterdir()}
    assert left == FILES | {"result_0000.vtu", "contact_0000.vtu"} | mine


@pytest.mark.slow
def test_output_in_an_encoding_without_greek(tmp_path: Path) -> None:
    """A pipe on Windows has such an encoding: μ of a summary is then written as its code."""
    code = f"from bipot_rs.cli.entry import call; call({['run', 'pressed_block', *N4]})"
    done = child(code, cwd=tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    assert "\\u03bc" in done.stdout + done.stderr


def test_not_converged_keeps_the_earlier_steps(tmp_path: Path) -> None:
    # Nothing moves in the first step, without iterations; the second needs several.
    run = bipot(
        *("run", "sheared_cube", "--set=mesh.n=3", "--json"),
        *("--set", "solver.max_iterations=1"),
        *("--set", "path.amplitude.press=[0.0, 1.0]"),
        *("--set", "support.0.z={ value = -0.05, amplitude = 'press' }"),
        cwd=tmp_path,
        status=3,
    )
    *done, last = lines(run.stdout)
    assert last["success"] is False
    assert "max_iterations" in last["message"]
    folder = tmp_path / "out" / "sheared_cube"
    _, written, attributes, _ = export.read_saved(folder / "result.h5")
    assert attributes["complete"] is False
    assert len(written) == len(done) == last["steps"] == 1


@pytest.mark.slow
def test_a_run_imports_everything_before_its_phases(tmp_path: Path) -> None:
    """A signal cannot leave half a module, and no phase is charged for imports."""
    code = """
import sys
from contextlib import contextmanager
from bipot_rs.cli.entry import call
from bipot_rs.cli.run.runner import Runner
phase, ours = Runner.phase, ("bipot_rs", "skfem", "scipy", "h5py")
@contextmanager
def watched(self, name):
    before = set(sys.modules)
    with phase(self, name):
        yield
    new = [m for m in set(sys.modules) - before if m.partition(".")[0] in ours]
    print("imported by", name, sorted(new), file=sys.stderr)
Runner.phase = watched
call(["run", "pressed_block", "--set", "mesh.n=4", "--json", "--out", "out"])
"""
    told = child(code, cwd=tmp_path).stderr.splitlines()
    assert len(told) >= 6
    assert all(line.endswith(" []") for line in told), told


@pytest.mark.slow
def test_a_reader_that_closes_the_pipe(tmp_path: Path) -> None:
    with subprocess.Popen(
        [*BIPOT, "run", "cyclic_cube", "--set", "mesh.n=4", "--json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(timeout=60) == 2
        assert process.stderr.read() == ""


N4 = ("--set", "mesh.n=4")
SOLVE = ("run", "pressed_block", *N4)


@pytest.mark.parametrize(
    ("arguments", "closed", "status"),
    [
        (("scenes",), ">&-", 0),
        (SOLVE, ">&-", 0),
        (SOLVE, "2>&-", 0),
        (("run", "nothing"), "2>&-", 2),
        (("fclib", "nothing.hdf5"), ">&- 2>&-", 2),
        (("--help",), ">/dev/full", 2),
        (("scenes",), ">/dev/full", 2),
        ((*SOLVE, "--json"), ">/dev/full", 2),
        (("fclib", "nothing.hdf5"), ">/dev/full", 2),
        # Through a shell, so that the reader has gone before the first byte.
        (("--help",), "> >(exec true)", 2),
    ],
)
@pytest.mark.quick_variants("arguments5-*")
def test_closed_or_full_standard_streams(
    arguments: tuple[str, ...], closed: str, status: int, tmp_path: Path
) -> None:
    """The exit status is correct with and without a place for messages."""
    wait = "sleep 0.2; " if "true" in closed else ""
    shell = ["bash", "-c", f'{{ {wait}exec "$@"; }} {closed}', "bash"]
    words = [*shell, *BIPOT, *arguments]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == status, run.stderr
    assert "Traceback" not in run.stderr
    if "/dev/full" in closed and arguments[0] != "fclib":
        assert "cannot write to standard output" in run.stderr


def test_fclib_files_are_listed_in_the_output(tmp_path: Path) -> None:
    run = bipot("run", "sheared_cube", "--set=mesh.n=2", "--fclib", cwd=tmp_path)
    last = run.stdout.splitlines()[-1]
    assert "problem-0000.hdf5, problem-0001.hdf5, result.h5" in last
    short = ("run", "cyclic_cube", "--set=mesh.n=2", "--set=path.steps=4", "--fclib")
    last = bipot(*short, cwd=tmp_path).stdout.splitlines()[-1]
    assert "problem-0000.hdf5, …, problem-0003.hdf5, result.h5" in last
