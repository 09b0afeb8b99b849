"""What Windows and macOS lack, taken away from this system: the package works without it.

Wheels for those systems are built and tested by .github/workflows/wheels.yml.
"""

import os
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from bipot_rs._lib.memory import installed
from bipot_rs.cli.worker_pool import Workers

# Other libraries first: they look at the system themselves, and are not examined here. Then
# the modules and functions that Python has on Unix alone are gone, and so is /proc.
AS_ON_WINDOWS = """
import ctypes.wintypes, importlib, multiprocessing.connection, os, pathlib, pkgutil, sys
import h5py, matplotlib.pyplot, meshio, numpy, pydantic, rich.console, scipy.sparse.linalg
import scipy.spatial, skfem, typer
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
for name in ("O_DIRECTORY", "fork", "getuid", "sched_getaffinity", "sysconf", "uname"):
    delattr(os, name)
sys.platform = "win32"
read_text = pathlib.Path.read_text
def without_proc(path, *args, **keywords):
    if str(path).startswith("/proc"):
        raise FileNotFoundError(path)
    return read_text(path, *args, **keywords)
pathlib.Path.read_text = without_proc

class Kernel:
    def __init__(self, name, use_last_error):
        self.GetCurrentProcess = lambda: -1
    def K32GetProcessMemoryInfo(self, process, counters, size):
        # Two numbers of four bytes, then nine of the size of a pointer.
        assert size == 8 + 9 * ctypes.sizeof(ctypes.c_size_t)
        counters._obj.peak_working_set = 123 * 2**20
        return 1
# kernel32 of this system that has none.
ctypes.WinDLL = lambda name, use_last_error: Kernel(name, use_last_error)
"""
MODULES = """
import bipot_rs
skipped = ("bipot_rs.petsc", "bipot_rs.frameworks")
for found in pkgutil.walk_packages(bipot_rs.__path__, "bipot_rs."):
    if not found.name.startswith(skipped) and not found.name.endswith("__main__"):
        importlib.import_module(found.name)
assert bipot_rs.versions()["cores"] == str(os.cpu_count())
"""
RUN = """
import json
from bipot_rs.cli.app import app
from bipot_rs.cli.peak_memory import peak_mb
assert peak_mb() == 123
os.makedirs("here/.bipot-in-use")
run = ["run", "sheared_cube", "--set", "mesh.n=2", "--out", "here", "--plot"]
assert not app(run)
# It may be that of another run: without locks nobody knows.
assert os.path.isdir("here/.bipot-in-use")
assert not app(["info", "here"])
assert not app(["check", "sheared_cube"])
"""


def run(code: str, folder: Path, **environment: str) -> Any:
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=folder,
        env=os.environ | environment,
    )


@pytest.mark.parametrize("code", [MODULES, RUN], ids=["imports", "commands"])
def test_without_what_only_unix_has(code: str, tmp_path: Path) -> None:
    done = run(AS_ON_WINDOWS + code, tmp_path)
    assert done.returncode == 0, done.stderr


def test_memory_that_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    known = installed()
    assert known is not None
    assert known > 2**28
    monkeypatch.setattr("sys.platform", "win32")
    assert installed() is None


class Pipe:
    """A connection of another class, as `multiprocessing.Pipe` returns on Windows."""

    def __init__(self, inside: Connection) -> None:
        self.inside = inside

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inside, name)


def test_connections_of_another_class(monkeypatch: pytest.MonkeyPatch) -> None:
    workers = Workers(abs, 2)
    pipe = workers.context.Pipe

    def other() -> tuple[Pipe, Connection]:
        here, there = pipe()
        return Pipe(here), there

    monkeypatch.setattr(workers.context, "Pipe", other)
    with workers:
        answers = dict(workers.map([(-1,), (-2,), (-3,)]))
    assert answers == {0: 1, 1: 2, 2: 3}


def test_output_in_an_encoding_without_greek(tmp_path: Path) -> None:
    """A pipe on Windows has such an encoding: μ of a summary is then written as its code."""
    code = (
        "import sys\nfrom bipot_rs.cli.app import app\n"
        "sys.exit(app(['run', 'sheared_cube', '--set', 'mesh.n=2', '--out', 'here']))"
    )
    done = run(code, tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    assert "\\u03bc" in done.stdout + done.stderr
