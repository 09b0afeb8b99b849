"""A study whose rows fail at different load steps, and its table."""

import csv
import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

# The tangential force grows to 0.4 of the normal force in five load steps: with mu = 0.1
# the second has no equilibrium, with 0.3 the fourth.
PUSHED = """
title = "A block pressed and pushed"

[units]
length = "mm"
force = "N"
stress = "MPa"

[material.steel]
young = 210e3
poisson = 0.3

[mesh]
n = 6

[body.block]
material = "steel"
cell = "quadrilateral"
x = { from = 0, to = 100, cells = "n" }
y = { from = 0, to = 50, cells = 4 }

[[contact]]
on = "block.bottom"
plane = { point = [0, 0], normal = [0, 1] }
mu = 0.3

[path]
steps = 5
amplitude.push = { wave = "ramp" }

[[pressure]]
on = "block.top"
value = 10

[[traction]]
on = "block.top"
x = { value = 4, amplitude = "push" }
"""


def table(folder: Path | str) -> list[dict[str, str]]:
    """The rows of a table of a study, without times."""
    with (Path(folder) / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [{k: v for k, v in row.items() if k != "seconds"} for row in rows]


def interrupt_sweep(command: list[str], folder: Path) -> list[dict[str, Any]]:
    """Press Ctrl-C after the first row; the rows that were reported."""
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    first = json.loads(process.stdout.readline())
    # To all processes of the group, as a terminal does.
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "")
    *more, last = map(json.loads, output.splitlines())
    assert last["message"].startswith("interrupted")
    return [first, *more]
