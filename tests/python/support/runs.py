"""The command `bipot` in its own process, and its output."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from support import children

BIPOT = [sys.executable, "-m", "bipot_rs"]


LAST_LINE = {
    "scene",
    "dofs",
    "contacts",
    "steps",
    "success",
    "seconds",
    "peak_mb",
    "message",
}


FILES = {"result.h5", "result.vtkhdf", "result.pvd", "contact.pvd", "steps.csv"}


def bipot(
    *arguments: str, cwd: Path, status: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run the command in a fork of this process, which has loaded its modules."""
    run = children.bipot(*arguments, cwd=cwd)
    assert run.returncode == status, run.stderr
    return run


def lines(output: str) -> list[dict[str, Any]]:
    """Standard output as JSON objects, one per line."""
    return [json.loads(line) for line in output.splitlines()]
