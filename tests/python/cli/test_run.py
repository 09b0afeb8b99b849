"""`bipot run` in a subprocess: output, files and exit status."""

import csv
import json
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.files import export
from support.runs import BIPOT, FILES, LAST_LINE, bipot, lines


def scene_file(folder: Path, changes: Sequence[tuple[str, str]] = ()) -> Path:
    """The pressed block, coarse, with some of its text replaced."""
    text = subprocess.run(
        [*BIPOT, "scenes", "pressed_block"], capture_output=True, text=True, check=True
    ).stdout
    for old, new in (("n = 32", "n = 4"), *changes):
        assert old in text
        text = text.replace(old, new)
    path = folder / "block.toml"
    path.write_text(text)
    return path


def test_run_writes_table_and_files(tmp_path: Path) -> None:
    run = bipot("run", "sheared_cube", "--set", "mesh.n=3", "--plot", cwd=tmp_path)
    out = tmp_path / "out" / "sheared_cube"
    series = {f"{s}_000{k}.vtu" for s in ("result", "contact") for k in (0, 1)}
    assert {p.name for p in out.iterdir()} == FILES | series | {"tractions.png"}
    assert (out / "tractions.png").read_bytes().startswith(b"\x89PNG")
    for word in ("stick", "slip", "open", "residual", "result.h5", "192 degrees"):
        assert word in run.stdout
    # Without a terminal there is a line for each load step instead of a bar.
    assert re.findall(r"^load step (\d) of 2: load", run.stderr, re.M) == ["1", "2"]


def test_a_sine_that_returns_to_zero_is_shown_as_zero(tmp_path: Path) -> None:
    run = bipot("run", "cyclic_cube", "--set", "mesh.n=3", cwd=tmp_path)
    loads = re.findall(r"^load step \d+ of 41: load ([^,]+),", run.stderr, re.M)
    assert [loads[k] for k in (0, 10, 20, 30, 40)] == ["0"] * 5
    assert loads[5] == "1"


def test_json_lines(tmp_path: Path) -> None:
    run = bipot("run", "sheared_cube", "--set=mesh.n=3", "--json", cwd=tmp_path)
    *steps, last = lines(run.stdout)
    assert run.stderr == ""
    assert [step["step"] for step in steps] == [0, 1]
    assert [step["load"] for step in steps] == [0.0, 1.0]
    assert steps[0].keys() == {
        *("step", "load", "open", "slip", "stick"),
        *("residual", "iterations", "seconds", "forces"),
    }
    # The same numbers as in the table of the run.
    with (tmp_path / "out/sheared_cube/steps.csv").open(newline="") as file:
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


def test_result_file_is_a_result(tmp_path: Path) -> None:
    bipot("run", "sheared_cube", "--set", "mesh.n=3", "--out", "here", cwd=tmp_path)
    with h5py.File(tmp_path / "here" / "result.h5") as file:
        assert file.attrs["format"] == "bipot-result"
        assert file.attrs["complete"]
        shapes = {name: data.shape for name, data in file["contacts"].items()}
        assert shapes == {
            "x": (16, 3),
            "normal": (16, 3),
            "frame": (16, 3, 3),
            "area": (16,),
            "gap": (16,),
            "mu": (16,),
            "surface": (16,),
            "surface_names": (1,),
            "facets": (9, 4),
        }
        assert {"reaction", "relative_displacement", "slip", "status"} <= set(
            file["steps/0001"]
        )
        assert file["steps/0001/load"][()] == 1.0
    result = bp.load(tmp_path / "here" / "result.h5")
    assert result.success
    assert result.reaction.shape == (2, 16, 3)
    assert result.displacement.shape == (2, 192)
    assert result[1].converged
    # A cube pressed by 0.05 % and dragged along x is pushed back along -x.
    total = result.reaction[1].sum(axis=0)
    assert total[0] > 0 > total[1]


@pytest.mark.slow
def test_a_later_run_replaces_the_files_of_an_earlier_one(tmp_path: Path) -> None:
    arguments = ("run", "cyclic_cube", "--set", "mesh.n=2", "--out", "here")
    bipot(*arguments, "--plot", cwd=tmp_path)
    mine = tmp_path / "here" / "notes.txt"
    mine.write_text("mine")
    (tmp_path / "here" / "result_old.vtu").write_text("mine too")
    one_step = ["--set", "path.steps=1", "--set", "path.amplitude.shear=[0.0]"]
    bipot(*arguments, *one_step, cwd=tmp_path)
    left = {path.name for path in (tmp_path / "here").iterdir()}
    assert left == FILES | {
        "result_0000.vtu",
        "contact_0000.vtu",
        "notes.txt",
        "result_old.vtu",
    }


def test_method_and_tolerance(tmp_path: Path) -> None:
    arguments = ("run", "sheared_cube", "--set", "mesh.n=3", "--json")
    tight = bipot(*arguments, cwd=tmp_path)
    loose = bipot(*arguments, "--tol", "1e-4", "--method", "uzawa", cwd=tmp_path)
    # A loose tolerance has an effect: the run stops there.
    residual = max(step["residual"] for step in lines(loose.stdout)[:-1])
    assert 1e-12 < residual <= 1e-4
    assert lines(tight.stdout)[:-1] != lines(loose.stdout)[:-1]


def test_version(tmp_path: Path) -> None:
    told = bipot("--version", cwd=tmp_path)
    assert (told.stdout, told.stderr) == (f"bipot-rs {bp.__version__}\n", "")


def test_forgotten_supports_are_named(tmp_path: Path) -> None:
    """The message names the body, not a degree of freedom."""
    bipot("new", "two", "--template", "two_bodies", cwd=tmp_path)
    text = (tmp_path / "two.toml").read_text()
    held, _, rest = text.partition("[[support]]")
    _, contact, path = rest.partition("[[contact]]")
    pull = '[[traction]]\non = "upper.top"\ny = { value = 1.0, amplitude = "press" }\n'
    pull += 'x = { value = 1.0, amplitude = "drag" }\n'
    (tmp_path / "two.toml").write_text(held + pull + contact + path)
    run = bipot("run", "two.toml", cwd=tmp_path, status=1)
    message = (
        "bodies 'upper' and 'lower' can move freely and have no support and no spring"
    )
    assert f"bipot: {message}" in run.stderr
    assert "degree of freedom" not in run.stderr


def test_no_answer(tmp_path: Path) -> None:
    """A block without support that touches the plane in one node: it can roll."""
    path = scene_file(
        tmp_path,
        [
            (
                'on = "block.left"\nx = 0.0',
                'on = "block.left"\nx = 0.0\nwithin = { x = [0.0, 0.0], y = [0.0, 0.0] }',
            ),
            ("mu = 1.0", "mu = 1.0\nwithin = { x = [0.0, 0.0] }"),
        ],
    )
    run = bipot("run", str(path), "--json", cwd=tmp_path, status=1)
    (last,) = lines(run.stdout)
    assert last.keys() == LAST_LINE
    assert last["success"] is False
    assert (
        "can move freely by rotation about the point (0, 0): add a support"
        in last["message"]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "two_blocks", "--set", "mesh.n=9"], "not a whole number of cells"),
        (["run", "sheared_cube", "--set", "mesh.n=2", "--method", "magic"], "magic"),
        (["run", "sheared_cube", "--set", "mesh.n=2", "--tol", "-1"], "tol"),
        (["run", "sheared_cube", "--out", "file/below"], "cannot write to the folder"),
        (["run"], "SCENE"),
        (["walk"], "walk"),
    ],
)
def test_bad_input(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    plain = bipot(*arguments, cwd=tmp_path, status=2)
    assert message in plain.stderr
    assert plain.stdout == ""
    if arguments[0] == "run":
        json_run = bipot(*arguments, "--json", cwd=tmp_path, status=2)
        (last,) = lines(json_run.stdout)
        assert last.keys() == LAST_LINE
        assert last["success"] is False
        assert message in last["message"]
        assert json_run.stderr == ""


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


def test_interrupt_keeps_the_complete_steps(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*BIPOT, "run", "cyclic_cube", "--set", "mesh.n=7", "--json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    first = json.loads(process.stdout.readline())
    assert process.stderr is not None
    process.send_signal(signal.SIGINT)
    # `communicate` would lose lines that arrived together with the first.
    with process.stdout, process.stderr:
        output, errors = process.stdout.read(), process.stderr.read()
    assert process.wait(timeout=60) == 130, errors
    assert "Traceback" not in errors
    *more, last = lines(output)
    assert last["success"] is False
    assert last["message"].startswith("interrupted")
    assert last["steps"] < 41
    path = tmp_path / "out" / "cyclic_cube" / "result.h5"
    _, written, attributes, _ = export.read_saved(path)
    assert attributes["complete"] is False
    told = [step["load"] for step in (first, *more)]
    # The signal may come after a step is stored and before it is printed.
    assert [step["load"] for step in written][: len(told)] == told
    assert len(written) - len(told) <= 1
    assert np.isfinite(written[0]["reaction"]).all()


def test_help_is_quick_to_import(tmp_path: Path) -> None:
    """No large library is imported to print a help text."""
    code = (
        "import sys; from bipot_rs.cli.entry import call; call(['--help']); "
        "print(sorted({'scipy', 'skfem', 'matplotlib', 'h5py', 'meshio', 'pydantic'}"
        " & set(sys.modules)), file=sys.stderr)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert run.returncode == 0
    assert "run" in run.stdout
    assert run.stderr.strip() == "[]"


@pytest.mark.slow
def test_a_run_imports_everything_before_its_phases(tmp_path: Path) -> None:
    """A signal cannot leave half a module, and no phase is charged for imports."""
    code = """
import sys
from contextlib import contextmanager
from bipot_rs.cli.entry import call
from bipot_rs.cli.run.job import Job
phase, ours = Job._phase, ("bipot_rs", "skfem", "scipy", "h5py")
@contextmanager
def watched(self, name):
    before = set(sys.modules)
    with phase(self, name):
        yield
    new = [m for m in set(sys.modules) - before if m.partition(".")[0] in ours]
    print("imported by", name, sorted(new), file=sys.stderr)
Job._phase = watched
call(["run", "pressed_block", "--set", "mesh.n=4", "--json", "--out", "out"])
"""
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    told = run.stderr.splitlines()
    assert len(told) >= 6, run.stderr
    assert all(line.endswith(" []") for line in told), run.stderr


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


SOLVE = ("run", "pressed_block", "--set", "mesh.n=4")


@pytest.mark.parametrize(
    ("arguments", "closed", "status"),
    [
        (("scenes",), ">&-", 0),
        ((*SOLVE,), ">&-", 0),
        ((*SOLVE,), "2>&-", 0),
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
@pytest.mark.quick_variants("arguments5-*", "arguments6-*")
def test_closed_or_full_standard_streams(
    arguments: tuple[str, ...], closed: str, status: int, tmp_path: Path
) -> None:
    """The exit status is correct with and without a place for messages."""
    wait = "sleep 0.2; " if "true" in closed else ""
    run = subprocess.run(
        ["bash", "-c", f'{{ {wait}exec "$@"; }} {closed}', "bash", *BIPOT, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
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
