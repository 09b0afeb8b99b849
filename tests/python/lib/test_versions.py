"""The versions that a bug report needs."""

import importlib.metadata
import json
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy

import bipot_rs as bp
from bipot_rs import _core
from support.programs import child


def test_versions_are_those_that_run(capsys: pytest.CaptureFixture[str]) -> None:
    told = bp.versions()
    assert told["numpy"] == np.__version__
    assert told["scipy"] == scipy.__version__
    assert told["python"].startswith(".".join(map(str, sys.version_info[:3])))
    assert told["core"].startswith(_core.version)
    assert _core.build_profile in told["core"]
    # The version of the compiled crate shows an old core with newer Python files.
    assert _core.version == importlib.metadata.version("bipot-rs") == bp.__version__
    if hasattr(os, "sched_getaffinity"):
        assert told["cores"] == str(len(os.sched_getaffinity(0)))
    bp.show_versions()
    lines = capsys.readouterr().out.splitlines()
    assert told == dict(re.split(r" {2,}", line, maxsplit=1) for line in lines)


def test_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    for given, expected in (
        ({"BIPOT_NUM_THREADS": "3"}, r"3 \(BIPOT_NUM_THREADS=3\)"),
        ({"RAYON_NUM_THREADS": "2"}, r"2 \(RAYON_NUM_THREADS=2\)"),
        ({"BIPOT_NUM_THREADS": "many"}, "BIPOT_NUM_THREADS is .many.*"),
        ({}, r"\d+"),
    ):
        for name in ("BIPOT_NUM_THREADS", "RAYON_NUM_THREADS"):
            monkeypatch.delenv(name, raising=False)
        for name, value in given.items():
            monkeypatch.setenv(name, value)
        assert re.fullmatch(expected, bp.versions()["threads"])


MEMORY = """
import json
from bipot_rs._lib.machine import peak_mb
before = peak_mb()
held = bytearray({size})
held[::4096] = b"x" * len(held[::4096])
between = peak_mb()
{then}
print(json.dumps([before, between, peak_mb()]))
"""
# On Linux, `ru_maxrss` of a process is at least the memory of its parent.
IN_A_CHILD = """
import subprocess, sys
code = "from bipot_rs._lib.machine import peak_mb; print(peak_mb())"
before = between = float(subprocess.check_output([sys.executable, "-c", code]))
"""


@pytest.mark.slow
def test_peak_of_memory(tmp_path: Path) -> None:
    """What was freed counts; what the parent process holds does not."""
    program = MEMORY.format(size=300_000_000, then="del held")
    before, between, after = json.loads(child(program, cwd=tmp_path).stdout)
    # The kernel updates its page counters with a delay: some 0.2 MB are uncertain.
    assert between - before == pytest.approx(300e6 / 2**20, rel=0.05)
    assert after == pytest.approx(between, rel=0.05)
    program = MEMORY.format(size=1_500_000_000, then=IN_A_CHILD)
    of_child, *_ = json.loads(child(program, cwd=tmp_path).stdout)
    assert 10 < of_child < 1000  # Python with NumPy takes some 100 MB
