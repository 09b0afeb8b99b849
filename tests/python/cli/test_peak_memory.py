"""The peak memory of a run does not include that of its parent process."""

import json
import subprocess
import sys

import pytest

# On Linux, `ru_maxrss` of a process is at least the memory of its parent.
LARGE = """
import subprocess, sys
held = bytearray(1_500_000_000)
held[::4096] = b"x" * len(held[::4096])
code = "from bipot_rs._lib.machine import peak_mb; print(peak_mb())"
command = [sys.executable, "-c", code]
sys.stdout.write(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
"""
LARGER = """
from bipot_rs._lib.machine import peak_mb
before = peak_mb()
held = bytearray(300_000_000)
held[::4096] = b"x" * len(held[::4096])
between = peak_mb()
del held
print([before, between, peak_mb()])
"""


def printed(program: str) -> object:
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)


@pytest.mark.slow
def test_a_large_parent_is_not_counted() -> None:
    peak = printed(LARGE)
    assert isinstance(peak, float)
    assert 10 < peak < 1000  # Python with NumPy takes some 100 MB


def test_freed_memory_counts() -> None:
    figures = printed(LARGER)
    assert isinstance(figures, list)
    before, between, after = figures
    # The kernel updates its page counters with a delay: some 0.2 MB are uncertain.
    assert between - before == pytest.approx(300e6 / 2**20, rel=0.05)
    assert after == pytest.approx(between, rel=0.05)
