"""`bipot fclib`: a line per file, a summary, and the worst exit status."""

import json
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fclib
from bipot_rs.cli.commands import fclib as command
from bipot_rs.cli.interrupts import Interrupts
from support import children, pressed
from support.collection import FILES, path

BIPOT = [sys.executable, "-m", "bipot_rs", "fclib"]
GOOD = str(path("rods_2_3c__local"))


def bipot(*arguments: str, status: int) -> subprocess.CompletedProcess[str]:
    run = children.bipot("fclib", *arguments, cwd=Path.cwd())
    assert run.returncode == status, run.stderr
    return run


def rows(output: str) -> list[dict[str, Any]]:
    """Parse the lines; every line is an object of standard JSON."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return [json.loads(line, parse_constant=refuse) for line in output.splitlines()]


@pytest.fixture
def stuck(tmp_path: Path) -> str:
    """A file without a solution: a fixed body penetrates."""
    problem = bp.ReducedProblem(np.diag([1.0, 1.0, 0.0, 0.0]), [[-1.0, 0.0]] * 2, 0.3)
    fclib.write(tmp_path / "stuck.hdf5", problem)
    return str(tmp_path / "stuck.hdf5")


@pytest.fixture
def floating(tmp_path: Path) -> str:
    """A file whose second unknown is not held."""
    problem = fclib.GlobalProblem(
        np.diag([1.0, 0.0]), [[1.0, 0.0], [0.0, 0.0]], [0.0, 1.0], [[1.0, 0.0]], 0.3
    )
    fclib.write(tmp_path / "floating.hdf5", problem)
    return str(tmp_path / "floating.hdf5")


KEYS = [
    "file",
    "contacts",
    "dim",
    "outcome",
    "residual",
    "iterations",
    "work",
    "seconds",
]


def test_all_files_are_solved_and_reported() -> None:
    files = [str(path(name)) for name in FILES]
    run = bipot(*files, "--json", status=0)
    assert run.stderr == ""
    told = rows(run.stdout)
    assert [row["file"] for row in told] == files
    for row, facts in zip(told, FILES.values(), strict=True):
        assert list(row)[: len(KEYS)] == KEYS
        assert (row["contacts"], row["dim"]) == (facts.contacts, facts.d)
        assert row["outcome"] == "converged"
        # The default of tol; the rounding floor of these files is below it.
        assert 0 <= row["residual"] <= 1e-10
        assert row["work"] > 0
        assert row["seconds"] > 0


def test_output_without_json_is_lines_and_a_summary() -> None:
    names = ("rods_2_3c__local", "d2_fcp00031", "fe_cube_h8_9c", "fe_cube_h8_9c__local")
    run = bipot(*(str(path(name)) for name in names), status=0)
    lines = run.stdout.splitlines()
    assert lines[0].startswith(GOOD)
    for line, words in zip(
        lines,
        (
            "3 × 3D",
            "11 × 2D",
            "M asymmetric by 0.22 of √|M_ii M_jj|",
            "W asymmetric by 0.16 of its largest entry",
        ),
        strict=False,
    ):
        assert words in line
        assert "converged" in line
    assert "asymmetric" not in lines[0] + lines[1]
    summary = "\n".join(lines[4:])
    for word in ("outcome", "files", "worst residual", "median work", "all"):
        assert word in summary


def test_each_unsolved_file_has_a_message(tmp_path: Path, stuck: str) -> None:
    """One message per file, besides its line; a line of JSON contains it."""
    slow = str(tmp_path / "slow.hdf5")
    fclib.write(slow, pressed.cube())
    short = ("--method", "uzawa", "--tol", "1e-12", "--max-seconds", "1e-9")
    run = bipot(GOOD, stuck, slow, *short, status=3)
    messages = [line for line in run.stderr.splitlines() if GOOD not in line]
    for message, file, reason in zip(
        messages, (stuck, slow), ("no solution exists", "max_seconds"), strict=True
    ):
        assert message.startswith(f"bipot: {file}: ")
        assert reason in message
    assert bipot("--json", stuck, slow, *short, status=3).stderr == ""


def test_a_raised_tolerance_is_reported() -> None:
    """Rounding of η may exceed the given tolerance."""
    tight = bipot("--tol", "1e-20", GOOD, status=0).stdout.splitlines()[0]
    (row,) = rows(bipot("--tol", "1e-20", "--json", GOOD, status=0).stdout)
    assert row["tolerance"] > 1e-20
    assert f"tolerance raised to {row['tolerance']:.1e} by rounding" in tight
    loose = bipot("--tol", "1e-6", GOOD, status=0).stdout.splitlines()[0]
    assert "held to" not in loose


def test_a_name_is_one_line(tmp_path: Path) -> None:
    """File names may contain newlines, and bytes that are not text."""
    odd = tmp_path / "a\nb\udcff.hdf5"
    odd.write_bytes(Path(GOOD).read_bytes())
    run = bipot(str(odd), str(tmp_path / "no\nfile"), status=2)
    first, second, *_ = run.stdout.splitlines()
    assert "a\\nb\\udcff.hdf5 " in first
    assert "converged" in first
    assert "no\\nfile " in second
    assert run.stderr.count("\n") == 1


def test_a_bad_file_does_not_stop_the_others(tmp_path: Path, stuck: str) -> None:
    broken, indefinite = tmp_path / "broken.hdf5", tmp_path / "indefinite.hdf5"
    broken.write_bytes(b"not HDF5")
    problem = fclib.GlobalProblem(
        np.diag([1.0, -1.0]), np.eye(2), [0.0, 0.0], [[1.0, 0.0]], 0.3
    )
    fclib.write(indefinite, problem)
    files = [str(broken), str(tmp_path / "missing.hdf5"), str(indefinite), stuck, GOOD]
    run = bipot("--json", *files, status=2)
    told = rows(run.stdout)
    outcomes = [*["unreadable"] * 3, "no_equilibrium", "converged"]
    assert [row["outcome"] for row in told] == outcomes
    assert all(told[0][key] is None for key in KEYS[1:3] + KEYS[4:7])
    assert "HDF5" in told[0]["message"]
    assert "indefinite" in told[2]["message"]
    assert "broken.hdf5" in run.stderr
    assert "missing.hdf5" in run.stderr
    table = bipot(str(broken), GOOD, status=2).stdout
    assert "unreadable" in table
    assert GOOD in table


def test_exit_status_is_the_worst(
    tmp_path: Path, stuck: str, floating: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 before 3 before 1 before 0, in any order of the files."""
    slow, missing = (str(tmp_path / f"{name}.hdf5") for name in ("slow", "missing"))
    fclib.write(slow, pressed.cube())

    def status(*files: str) -> int:
        # No method finishes within a nanosecond.
        asked = {"files": files, "method": "uzawa", "tol": 1e-12, "max_seconds": 1e-9}
        return command.run(Namespace(**asked, json=True), Interrupts())

    # The geometry is refused before the time limit is checked.
    assert status(stuck) == status(floating) == 1
    assert status(slow) == status(stuck, slow) == status(slow, stuck) == 3
    assert status(missing, slow, stuck) == status(stuck, missing) == 2
    outcomes = {row["outcome"] for row in rows(capsys.readouterr().out)}
    assert outcomes == {"no_equilibrium", "time_limit", "unreadable"}


@pytest.mark.parametrize(
    ("number", "as_json"), [(signal.SIGTERM, True), (signal.SIGINT, False)]
)
@pytest.mark.slow
def test_interrupt(number: signal.Signals, as_json: bool, tmp_path: Path) -> None:
    # Each takes some milliseconds: the signal comes long before the last.
    process = subprocess.Popen(
        [*BIPOT, *["--json"] * as_json, *[GOOD] * 5000],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number, errors
    assert errors == "bipot: interrupted\n"
    if as_json:
        *told, last = rows(output)
        assert all(row["outcome"] == "converged" for row in told)
        assert last["message"] == "interrupted"
    else:
        assert "worst residual" in output


@pytest.mark.slow
def test_scene_is_written_as_fclib_files(tmp_path: Path) -> None:
    """Each load step can be solved from its file alone."""
    run = ("run", "sheared_cube", "--set=mesh.n=3")
    assert children.bipot(*run, "--fclib", cwd=tmp_path).returncode == 0
    out = tmp_path / "out" / "sheared_cube"
    written = sorted(out.glob("*.hdf5"))
    assert [p.name for p in written] == ["problem-0000.hdf5", "problem-0001.hdf5"]
    told = rows(bipot("--json", "--tol", "1e-12", *map(str, written), status=0).stdout)
    result = bp.load(out / "result.h5")
    for step, row, file in zip(result, told, written, strict=True):
        assert row["contacts"] == len(step.reaction)
        answer = fclib.read(file).solve(tol=1e-12)
        # The scene is solved to 1e-10; the condition of W is some tens.
        size = np.abs(step.reaction).max()
        assert np.abs(answer.reaction - step.reaction).max() <= 1e-7 * size
        info = fclib.read_info(file)
        assert "sheared_cube" in info["description"]
        assert "mm" in info["description"]
    # A run without --fclib removes the files of an earlier run.
    assert children.bipot(*run, cwd=tmp_path).returncode == 0
    assert list(out.glob("*.hdf5")) == []
