"""What other systems answer differently; .github/workflows/wheels.yml tests on them."""

import os
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from bipot_rs._lib.machine import installed
from bipot_rs.cli.study.workers import Workers


def test_memory_that_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    bytes_installed = installed()
    assert bytes_installed is not None
    assert bytes_installed > 2**28
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
        "import sys\nfrom bipot_rs.cli.entry import call\n"
        "sys.exit(call(['run', 'sheared_cube', '--set', 'mesh.n=2', '--out', 'here']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "cp1252"},
    )
    assert done.returncode == 0, done.stderr
    assert "\\u03bc" in done.stdout + done.stderr
