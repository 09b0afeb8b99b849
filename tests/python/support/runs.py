"""The command `bipot` in a process of its own, and what it prints."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import children

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


FILES = {"result.h5", "result.pvd", "contact.pvd", "steps.csv"}


def bipot(
    *arguments: str, cwd: Path, status: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run the command in a fork of this process, in which its modules are loaded."""
    run = children.bipot(*arguments, cwd=cwd)
    assert run.returncode == status, run.stderr
    return run


def lines(output: str) -> list[dict[str, Any]]:
    """Every line of standard output is one JSON object."""
    return [json.loads(line) for line in output.splitlines()]
