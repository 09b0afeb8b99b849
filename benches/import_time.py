"""Time to start whole processes, in turn.

    python benches/import_time.py                # the table of the README, 9 rounds
    python benches/import_time.py --rounds 21

Each round runs every command once, so that all meet the same load of the machine. The
first round fills the caches of the disk and of Python and is not counted. The minimum
is the cost of the command, the median its time on this machine. The ratio is that to the
import of NumPy and SciPy's sparse matrices in the same round, its median over the rounds: a
run should take at most 2, the help at most 1.
"""

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import tables
from peers.commands import as_installed

PYTHON = sys.executable
# The least that a program with sparse matrices imports.
LEAST = "import numpy, scipy.sparse"
COMMANDS = {
    'python -c "pass"': [PYTHON, "-c", "pass"],
    'python -c "import numpy"': [PYTHON, "-c", "import numpy"],
    'python -c "import bipot_rs"': [PYTHON, "-c", "import bipot_rs"],
    'python -c "import numpy, scipy.sparse"': [PYTHON, "-c", LEAST],
    'python -c "import skfem"': [PYTHON, "-c", "import skfem"],
    "bipot --help": [PYTHON, "-m", "bipot_rs", "--help"],
    "bipot scenes": [PYTHON, "-m", "bipot_rs", "scenes"],
    "bipot run pressed_block": [PYTHON, "-m", "bipot_rs", "run", "pressed_block"],
}


def milliseconds(command, folder):
    """Wall-clock time of one process."""
    environment = as_installed(folder)
    start = perf_counter()
    subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, check=True
    )
    return 1e3 * (perf_counter() - start)


def ratio(column, least):
    """Median over the rounds of the time relative to that of ``least``."""
    return statistics.median(a / b for a, b in zip(column, least, strict=True))


def main():
    """Measure, and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        times = [
            [milliseconds(command, folder) for command in COMMANDS.values()]
            for _ in range(args.rounds + 1)
        ]
    columns = dict(zip(COMMANDS, zip(*times[1:], strict=True), strict=True))
    least = next(column for name, column in columns.items() if LEAST in name)
    rows = [
        (
            f"`{name}`",
            f"{min(column):.0f} ms",
            f"{statistics.median(column):.0f} ms",
            f"{ratio(column, least):.2f}",
        )
        for name, column in columns.items()
    ]
    text = tables.table(("process", "minimum", "median", "ratio"), rows)
    tables.publish("import time", text, write=not args.print)


if __name__ == "__main__":
    main()
