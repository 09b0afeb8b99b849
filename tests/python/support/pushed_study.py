"""A study whose rows fail at different load steps, and its table."""

import csv
from pathlib import Path

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
