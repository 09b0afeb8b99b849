"""The versions that a bug report needs."""

import importlib.metadata
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import scipy

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs._lib import machine


def test_versions_are_those_that_run() -> None:
    told = bp.versions()
    assert told["numpy"] == np.__version__
    assert told["scipy"] == scipy.__version__
    assert told["python"].startswith(".".join(map(str, sys.version_info[:3])))
    assert told["core"].startswith(_core.version)
    assert _core.build_profile in told["core"]
    # The version of the compiled crate shows an old core with newer Python files.
    assert _core.version == importlib.metadata.version("bipot-rs")
    assert bp.__version__ == _core.version


def test_versions_are_one_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    bp.show_versions()
    lines = capsys.readouterr().out.splitlines()
    told = dict(re.split(r" {2,}", line, maxsplit=1) for line in lines)
    assert told == bp.versions()


def test_missing_libraries_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_OPTIONAL", ("no-such-distribution",))
    assert bp.versions()["no-such-distribution"] == "not installed"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"BIPOT_NUM_THREADS": "3"}, r"3 \(BIPOT_NUM_THREADS=3\)"),
        ({"RAYON_NUM_THREADS": "2"}, r"2 \(RAYON_NUM_THREADS=2\)"),
        ({"BIPOT_NUM_THREADS": "many"}, "BIPOT_NUM_THREADS is .many.*"),
        ({}, r"\d+"),
    ],
)
def test_threads(
    given: dict[str, str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("BIPOT_NUM_THREADS", "RAYON_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert re.fullmatch(expected, bp.versions()["threads"])


def test_versions_imports_no_library() -> None:
    script = """
import sys
import bipot_rs
bipot_rs.versions()
heavy = {"h5py", "matplotlib", "meshio", "pydantic", "rich", "scipy", "skfem"}
print(sorted(heavy & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_cores_are_those_of_this_process() -> None:
    if hasattr(os, "sched_getaffinity"):
        assert bp.versions()["cores"] == str(len(os.sched_getaffinity(0)))
