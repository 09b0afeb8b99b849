"""Python code in a new interpreter. The tests of `lib` need no optional library here."""

import os
import subprocess
import sys
from pathlib import Path

# Before other code: Python does not find these modules, whatever this machine has.
_WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {libraries!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
"""


def child(
    code: str,
    *arguments: str,
    cwd: Path,
    seconds: float = 60,
    **environment: str,
) -> subprocess.CompletedProcess[str]:
    """Python code in a new interpreter, without a traceback on standard error."""
    run = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=seconds,
        env=os.environ | environment,
    )
    assert "Traceback" not in run.stderr, run.stderr
    return run


def child_without(
    libraries: tuple[str, ...], code: str, *arguments: str, cwd: Path
) -> subprocess.CompletedProcess[str]:
    """Python code in a new interpreter that does not find some libraries."""
    code = _WITHOUT.format(libraries=libraries) + code
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True)
