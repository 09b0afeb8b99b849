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

import bipot_rs as bp
from bipot_rs.cli.run import output_folder
from bipot_rs.files import export
from support.bars import bar_problem, pulled
from support.children import bipot, bipot_with, forked, strays
from support.matrix_and_tables import of_dofs

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


@pytest.mark.parametrize("size", [2000, 4096, 30_000])
@pytest.mark.quick_variants("4096")
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


def write_result(path: Path, times: float) -> None:
    problem, load = bar_problem()
    problem.solve(pulled(load, times * np.linspace(0, 30, 5))).save(path)


def write_problem(path: Path, times: float) -> None:
    problem = bp.ReducedProblem(np.eye(300), times * np.ones((100, 3)), 0.3)
    bp.fclib.write(path, problem)


@pytest.mark.parametrize("write", [write_result, write_problem])
def test_full_disk_or_kill_in_python(
    write: Callable[[Path, float], None], tmp_path: Path
) -> None:
    path = tmp_path / "a.hdf5"
    write(path, 1.0)
    before = path.read_bytes()

    def full() -> None:
        full_after(len(before) // 2)()
        words = f"^cannot write {path}: {os.strerror(errno.EFBIG)}$"
        with pytest.raises(OSError, match=words):
            write(path, 0.5)

    def killed() -> None:
        export.os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)
        write(path, 0.5)

    # The child must end normally: HDF5 aborts the process if it cannot close a file.
    assert forked(full).returncode == 0
    assert [p.name for p in tmp_path.iterdir()] == ["a.hdf5"]
    if write is write_result:
        assert forked(killed).returncode == -signal.SIGKILL
    assert path.read_bytes() == before


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


def test_drafts_of_killed_runs_are_removed_by_the_next_run(tmp_path: Path) -> None:
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
        assert bipot(*RUN, "--out", "out/d", cwd=tmp_path).returncode == 0
        assert draft.is_dir()
        assert strays(alive) == [draft.name]
    assert [strays(tmp_path / "out" / name) for name in "ac"] == [[], []]
    for name in ("b", "d", "other"):
        assert strays(tmp_path / "out" / name) == [".bipot-backup"]
    assert strays(stranger) == before
    assert len(list(tmp_path.glob("out/*/.bipot-backup/thesis.txt"))) == 4


@pytest.mark.parametrize("command", ["solve", "sweep"])
@pytest.mark.slow_variants("sweep")
def test_other_commands_remove_drafts_too(command: str, tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    here = tmp_path / "here"
    mine = {f".notes.{gone.pid}.csv", f".sweep.{os.getpid()}.json"}
    (here / ".bipot-dead").mkdir(parents=True)
    (here / "rows" / "0001").mkdir(parents=True)
    dead = f".sweep.{gone.pid}.csv", f"rows/0001/.result.{gone.pid}.h5"
    for name in (".bipot-dead/.bipot-draft", *dead, *mine):
        (here / name).touch()
    if command == "solve":
        arguments = of_dofs(tmp_path, np.eye(2), ONE_CONTACT)
    else:
        arguments = ["sweep", "pressed_block", "--set", "mesh.n=2", "--jobs", "1"]
    assert bipot(*arguments, "--out", "here", cwd=tmp_path).returncode == 0
    assert not list(tmp_path.rglob("*/.result.*"))
    assert set(strays(here)) == mine


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
    at = "bipot_rs.fem.paraview:write_bodies"
    run = bipot_with(disk_is_full, at, *RUN[:-1], cwd=tmp_path)
    assert run.returncode == 2
    last = run.stdout.splitlines()[-1]
    of = "; its files are from an earlier run" if before else ""
    assert last == f"here: nothing was written{of}"
    assert "bipot: cannot write here/" in run.stderr


def disk_is_full(path: Any, *_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


ONE_CONTACT = "dof_x,dof_y,nx,ny,mu\n0,1,0,1,0\n"


@pytest.mark.parametrize(
    ("name", "at", "earlier"),
    [
        ("steps.csv", "csv_tables:write", "result.h5"),
        (
            "displacements.csv",
            "csv_tables:write",
            "result.h5, steps.csv, reactions.csv",
        ),
        ("result.h5", "export:write_result", "none"),
    ],
)
def test_files_of_solve_after_a_full_disk(
    name: str, at: str, earlier: str, tmp_path: Path
) -> None:
    command = of_dofs(tmp_path, np.eye(2), ONE_CONTACT)

    def fault(path: Any, *_: object) -> None:
        if Path(path).name == name:
            disk_is_full(path)

    run = bipot_with(fault, f"bipot_rs.files.{at}", *command, "--json", cwd=tmp_path)
    assert run.returncode == 2
    message = json.loads(run.stdout.splitlines()[-1])["message"]
    assert message.endswith(f"; files written before: {earlier}")


@pytest.mark.parametrize("name", ["run", "solve"])
def test_a_full_disk_after_a_signal_is_reported(name: str, tmp_path: Path) -> None:
    """The status is that of the signal; the message says that files are missing."""
    solve = of_dofs(tmp_path, np.eye(2), ONE_CONTACT)
    command = RUN[:-1] if name == "run" else solve

    def fault(path: Any, *_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        disk_is_full(path)

    at = "bipot_rs.files.export:write_result"
    run = bipot_with(fault, at, *command, cwd=tmp_path)
    assert run.returncode == 130
    last = run.stderr.splitlines()[-1]
    assert last.startswith("bipot: interrupted; "), run.stderr
    assert os.strerror(errno.ENOSPC) in last


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


@pytest.mark.parametrize("name", ["result.h5", "result.pvd", "steps.csv", "/proc/here"])
def test_a_folder_that_cannot_be_written_is_found_before_the_work(
    name: str, tmp_path: Path
) -> None:
    """A folder has the name of a file, or the system refuses it."""
    folder = "here"
    if name.startswith("/"):
        folder = name
    else:
        (tmp_path / "here" / name).mkdir(parents=True)
    run = bipot(*RUN, "--out", folder, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "")
    (last,) = map(json.loads, run.stdout.splitlines())
    assert f"cannot write to the folder {folder}" in last["message"]
    assert last["seconds"]["mesh"] == 0
    assert [path.name for path in tmp_path.glob("here/*")] == [name][: folder == "here"]
