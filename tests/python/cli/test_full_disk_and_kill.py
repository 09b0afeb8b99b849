"""A full disk, a kill, a read-only folder: earlier files survive, with a message."""

import errno
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs.cli.run import output_folder
from bipot_rs.files import export
from support.bars import bar_problem, pulled
from support.children import bipot, bipot_with, forked, strays

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
def bipot_here(tmp_path: Path) -> Callable[..., int]:
    """The exit status of the command in a child process."""
    return lambda *arguments: bipot(*arguments, cwd=tmp_path).returncode


@pytest.fixture
def earlier(tmp_path: Path) -> dict[str, bytes]:
    """The files of an earlier run."""
    assert bipot(*RUN, "--set", "contact.0.mu=0.2", cwd=tmp_path).returncode == 0
    return files(tmp_path)


def files(cwd: Path) -> dict[str, bytes]:
    here = cwd / "here"
    return {path.name: path.read_bytes() for path in here.iterdir() if path.is_file()}


@pytest.mark.parametrize("size", [2000, 4096, 30_000])
@pytest.mark.slow_variants("30000")
def test_full_disk(size: int, earlier: dict[str, bytes], tmp_path: Path) -> None:
    assert len(earlier["result.h5"]) > 30_000
    run = bipot_with(
        full_after(size), "bipot_rs.fem.paraview:write_bodies", *RUN, cwd=tmp_path
    )
    assert (run.returncode, run.stderr) == (2, "")
    message = json.loads(run.stdout.splitlines()[-1])["message"]
    # The message names the final file, not the draft.
    assert re.match(r"cannot write here/(result\.(pvd|h5)|steps\.csv): ", message)
    assert message.endswith(os.strerror(errno.EFBIG))
    assert files(tmp_path) == earlier
    assert strays(tmp_path / "here") == []


def test_full_disk_behind_standard_output(tmp_path: Path) -> None:
    def fault(*_: object) -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)

    run = bipot_with(fault, "bipot_rs.scene.reading:read", *RUN, cwd=tmp_path)
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

    # The child must end normally: HDF5 aborts the process if it cannot close a file.
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
        "bipot_rs.files.export:_digest",
        "bipot_rs.cli.run.job:replace",
        "bipot_rs.files.series:_three",
    ],
)
@pytest.mark.quick_variants("bipot_rs.files.series:_three")
def test_killed_while_writing(
    before: str, earlier: dict[str, bytes], tmp_path: Path
) -> None:
    run = bipot_with(
        lambda *_: os.kill(os.getpid(), signal.SIGKILL), before, *RUN, cwd=tmp_path
    )
    assert run.returncode == -signal.SIGKILL
    assert files(tmp_path) == earlier
    # The next run removes the draft of the killed one.
    assert len(strays(tmp_path / "here")) == 1
    assert bipot(*RUN, cwd=tmp_path).returncode == 0
    assert strays(tmp_path / "here") == []


def test_drafts_of_killed_runs_are_removed_by_the_next_run(
    tmp_path: Path, bipot_here: Callable[..., int]
) -> None:
    """In its own folder and in its neighbours; drafts of live runs stay."""
    kill = lambda *_: os.kill(os.getpid(), signal.SIGKILL)  # noqa: E731
    for out in ("out/a", "out/b"):
        run = (*RUN, "--out", out)
        bipot_with(kill, "bipot_rs.cli.run.job:replace", *run, cwd=tmp_path)
        assert len(strays(tmp_path / out)) == 1
    alive, stranger = tmp_path / "out" / "c", tmp_path / "out" / "notes"
    alive.mkdir()
    # A folder of someone else, in which a run was killed too.
    shutil.copytree(tmp_path / "out" / "a", stranger)
    (stranger / "notes.txt").touch()
    (tmp_path / "out" / "b" / "result.h5").touch()
    # Folders with such a name that no run made, here and there.
    for folder in ("out/b", "out/d", "out/notes", "out/other"):
        backup = tmp_path / folder / ".bipot-backup"
        backup.mkdir(parents=True)
        (backup / "thesis.txt").touch()
    before = strays(stranger)
    with output_folder.draft_in(alive) as draft:
        assert bipot_here(*RUN, "--out", "out/d") == 0
        assert draft.is_dir()
        assert strays(alive) == [draft.name]
    assert [strays(tmp_path / "out" / name) for name in "ac"] == [[], []]
    for name in ("b", "d", "other"):
        assert strays(tmp_path / "out" / name) == [".bipot-backup"]
    assert strays(stranger) == before
    assert len(list(tmp_path.glob("out/*/.bipot-backup/thesis.txt"))) == 4


@pytest.mark.parametrize("command", ["solve", "sweep"])
@pytest.mark.slow_variants("sweep")
def test_other_commands_remove_drafts_too(
    command: str, tmp_path: Path, bipot_here: Callable[..., int]
) -> None:
    dead = tmp_path / "here" / ".bipot-dead"
    dead.mkdir(parents=True)
    (dead / ".bipot-draft").touch()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    row = tmp_path / "here" / "rows" / "0001"
    row.mkdir(parents=True)
    (tmp_path / "here" / f".sweep.{gone.pid}.csv").touch()
    (row / f".result.{gone.pid}.h5").touch()
    (tmp_path / "here" / f".notes.{gone.pid}.csv").touch()
    (tmp_path / "here" / f".sweep.{os.getpid()}.json").touch()
    if command == "solve":
        mmwrite(tmp_path / "K.mtx", sparse.identity(2, format="coo"))
        (tmp_path / "contacts.csv").write_text("dof_x,dof_y,nx,ny,mu\n0,1,0,1,0\n")
        arguments = ("solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv")
    else:
        arguments = ("sweep", "pressed_block", "--set", "mesh.n=2", "--jobs", "1")
    assert bipot_here(*arguments, "--out", "here") == 0
    assert not list(tmp_path.rglob("*/.result.*"))
    mine = {f".notes.{gone.pid}.csv", f".sweep.{os.getpid()}.json"}
    assert set(strays(tmp_path / "here")) == mine


def test_a_draft_that_another_run_removed_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before it is locked, it looks like the draft of a killed run."""
    taken = []
    made = tempfile.TemporaryDirectory

    def stolen(**options: Any) -> Any:
        draft = made(**options)
        if len(taken) < 2:
            taken.append(draft.name)
            shutil.rmtree(draft.name)
        return draft

    monkeypatch.setattr(output_folder.tempfile, "TemporaryDirectory", stolen)
    with output_folder.draft_in(tmp_path) as draft:
        assert draft.is_dir()
        assert str(draft) not in taken
        output_folder.make(tmp_path)
        assert draft.is_dir()
    assert len(taken) == 2
    assert strays(tmp_path) == []


@pytest.mark.parametrize("before", [False, True])
def test_files_after_a_full_disk(before: bool, tmp_path: Path) -> None:
    """The output names the files that are there, and the run they belong to."""
    if before:
        assert bipot(*RUN, cwd=tmp_path).returncode == 0

    def fault(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    run = bipot_with(
        fault, "bipot_rs.fem.paraview:write_bodies", *RUN[:-1], cwd=tmp_path
    )
    assert run.returncode == 2
    last = run.stdout.splitlines()[-1]
    of = "; its files are from an earlier run" if before else ""
    assert last == f"here: nothing was written{of}"
    assert "bipot: cannot write here/" in run.stderr


def one_contact(folder: Path) -> tuple[str, ...]:
    """Write the files of a small problem for `bipot solve`; returns the command."""
    mmwrite(folder / "K.mtx", sparse.identity(2, format="coo"))
    (folder / "contacts.csv").write_text("dof_x,dof_y,nx,ny,mu\n0,1,0,1,0\n")
    return "solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"


def test_files_of_solve_after_a_full_disk(tmp_path: Path) -> None:
    command = one_contact(tmp_path)
    for name, reason in (
        ("steps.csv", "files written before: result.h5"),
        (
            "displacements.csv",
            "files written before: result.h5, steps.csv, reactions.csv",
        ),
        ("result.h5", "files written before: none"),
    ):

        def fault(path: Any, *_: object, name: str = name) -> None:
            if Path(path).name == name:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

        at = (
            "files.export:write_result"
            if name == "result.h5"
            else "files.csv_tables:write"
        )
        run = bipot_with(fault, f"bipot_rs.{at}", *command, cwd=tmp_path)
        assert run.returncode == 2
        assert run.stderr.splitlines()[-1].endswith(f"; {reason}"), run.stderr
        last = bipot_with(fault, f"bipot_rs.{at}", *command, "--json", cwd=tmp_path)
        assert json.loads(last.stdout.splitlines()[-1])["message"].endswith(reason)


@pytest.mark.parametrize("name", ["run", "solve"])
def test_a_full_disk_after_a_signal_is_reported(name: str, tmp_path: Path) -> None:
    """The status is that of the signal; the message says that files are missing."""
    command = RUN[:-1] if name == "run" else one_contact(tmp_path)

    def fault(path: Any, *_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    run = bipot_with(
        fault, "bipot_rs.files.export:write_result", *command, cwd=tmp_path
    )
    assert run.returncode == 130
    last = run.stderr.splitlines()[-1]
    assert last.startswith("bipot: interrupted; "), run.stderr
    assert os.strerror(errno.ENOSPC) in last


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
    """Only drafts of killed runs are removed."""
    inner = []

    def fault(*_: object) -> None:
        if not inner:
            inner.append(bipot(*RUN, cwd=tmp_path).returncode)

    run = bipot_with(fault, "bipot_rs.fem.paraview:write_bodies", *RUN, cwd=tmp_path)
    assert run.returncode == 0, run.stdout
    assert strays(tmp_path / "here") == []
    assert bp.load(tmp_path / "here" / "result.h5").success


@pytest.mark.parametrize("name", ["result.h5", "result.pvd", "steps.csv"])
def test_a_folder_with_the_name_of_a_file_is_found_before_the_work(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "here" / name).mkdir(parents=True)
    run = bipot(*RUN, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "")
    (last,) = map(json.loads, run.stdout.splitlines())
    assert "cannot write to the folder here" in last["message"]
    assert last["seconds"]["mesh"] == 0
    assert [path.name for path in (tmp_path / "here").iterdir()] == [name]


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    run = bipot(*RUN, "--out", "/proc/here", cwd=tmp_path)
    assert run.returncode == 2
    (last,) = map(json.loads, run.stdout.splitlines())
    assert "cannot write to the folder /proc/here" in last["message"]
    assert last["seconds"]["mesh"] == 0
