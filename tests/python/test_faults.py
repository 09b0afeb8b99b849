"""A full disk, a kill, a folder that is closed: nothing lost, and said in a sentence."""

import errno
import json
import os
import re
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from bars import bar_problem, pulled
from bipot_rs import export
from children import bipot, bipot_with, forked, strays

RUN = (
    *("run", "cyclic_cube", "--set", "mesh.n=2", "--set", "path.steps=4"),
    *("--out", "here", "--json"),
)


def full_after(size: int) -> Callable[..., None]:
    """A fault: no file of this process may grow beyond ``size`` bytes."""

    def fault(*_: object) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return fault


@pytest.fixture
def earlier(tmp_path: Path) -> dict[str, bytes]:
    """The files of an earlier run."""
    assert bipot(*RUN, "--set", "contact.0.mu=0.2", cwd=tmp_path).returncode == 0
    return files(tmp_path)


def files(cwd: Path) -> dict[str, bytes]:
    here = cwd / "here"
    return {path.name: path.read_bytes() for path in here.iterdir() if path.is_file()}


@pytest.mark.parametrize("size", [1000, 4096, 30_000])
def test_full_disk(size: int, earlier: dict[str, bytes], tmp_path: Path) -> None:
    assert len(earlier["result.h5"]) > 30_000
    run = bipot_with(
        full_after(size), "bipot_rs.paraview:write_bodies", *RUN, cwd=tmp_path
    )
    assert (run.returncode, run.stderr) == (2, "")
    message = json.loads(run.stdout.splitlines()[-1])["message"]
    # The name that was asked for, not that of the draft.
    assert re.match(r"cannot write here/(result\.(pvd|h5)|steps\.csv): ", message)
    assert message.endswith(os.strerror(errno.EFBIG))
    assert files(tmp_path) == earlier
    assert strays(tmp_path / "here") == []


def test_full_disk_behind_standard_output(tmp_path: Path) -> None:
    def fault(*_: object) -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)

    run = bipot_with(fault, "bipot_rs.scene:read", *RUN, cwd=tmp_path)
    assert run.returncode == 2
    assert os.strerror(errno.ENOSPC) in run.stderr
    assert run.stderr.count("\n") == 1


def test_full_disk_under_result_save(tmp_path: Path) -> None:
    problem, load = bar_problem()
    result = problem.solve(pulled(load, np.linspace(0, 30, 5)))
    path = tmp_path / "a.h5"
    result.save(path)
    before = path.read_bytes()

    def save() -> None:
        full_after(len(before) // 2)()
        words = f"^cannot write {path}: {os.strerror(errno.EFBIG)}$"
        with pytest.raises(OSError, match=words):
            result.save(path)

    # The child must come to its end: HDF5 left with a file that it can neither write
    # nor close brings the process down.
    assert forked(save).returncode == 0
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_full_disk_under_a_problem(tmp_path: Path) -> None:
    problem = bp.ReducedProblem(np.eye(300), np.ones((100, 3)), 0.3)
    path = tmp_path / "a.hdf5"
    bp.fclib.write(path, problem)
    before = path.read_bytes()

    def write() -> None:
        full_after(len(before) // 2)()
        words = f"^cannot write {path}: {os.strerror(errno.EFBIG)}$"
        with pytest.raises(OSError, match=words):
            bp.fclib.write(path, problem)

    assert forked(write).returncode == 0
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.hdf5"]


@pytest.mark.parametrize(
    "before",
    [
        "bipot_rs.export:_digest",
        "bipot_rs.running.job:replace",
        "bipot_rs.export:_three",
    ],
)
def test_killed_while_writing(
    before: str, earlier: dict[str, bytes], tmp_path: Path
) -> None:
    run = bipot_with(
        lambda *_: os.kill(os.getpid(), signal.SIGKILL), before, *RUN, cwd=tmp_path
    )
    assert run.returncode == -signal.SIGKILL
    assert files(tmp_path) == earlier
    # What the dead run was preparing goes when the next one comes.
    assert len(strays(tmp_path / "here")) == 1
    assert bipot(*RUN, cwd=tmp_path).returncode == 0
    assert strays(tmp_path / "here") == []


def test_killed_under_result_save(tmp_path: Path) -> None:
    problem, load = bar_problem()
    path = tmp_path / "a.h5"
    problem.solve(load).save(path)
    before = path.read_bytes()

    def save() -> None:
        export.os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)
        problem.solve(load / 2).save(path)

    assert forked(save).returncode == -signal.SIGKILL
    assert path.read_bytes() == before
    assert bp.load(path).success


def test_two_runs_at_once_leave_each_other_alone(tmp_path: Path) -> None:
    """Only the drafts of the dead are cleared away."""
    inner = []

    def fault(*_: object) -> None:
        if not inner:
            inner.append(bipot(*RUN, cwd=tmp_path).returncode)

    run = bipot_with(fault, "bipot_rs.paraview:write_bodies", *RUN, cwd=tmp_path)
    assert run.returncode == 0, run.stdout
    assert strays(tmp_path / "here") == []
    assert bp.load(tmp_path / "here" / "result.h5").success


@pytest.mark.parametrize("name", ["result.h5", "result.pvd", "steps.csv"])
def test_a_folder_in_the_way_is_found_before_the_work(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "here" / name).mkdir(parents=True)
    run = bipot(*RUN, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "")
    (last,) = map(json.loads, run.stdout.splitlines())
    assert "cannot write to the folder here" in last["message"]
    assert last["seconds"]["mesh"] == 0
    assert [path.name for path in (tmp_path / "here").iterdir()] == [name]


def test_a_place_where_nobody_writes(tmp_path: Path) -> None:
    run = bipot(*RUN, "--out", "/proc/here", cwd=tmp_path)
    assert run.returncode == 2
    (last,) = map(json.loads, run.stdout.splitlines())
    assert "cannot write to the folder /proc/here" in last["message"]
    assert last["seconds"]["mesh"] == 0
