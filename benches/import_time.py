"""Time to start whole processes, in turn.

    python benches/import_time.py                # the table of the README, 9 rounds
    python benches/import_time.py --rounds 21

Each round runs every command once, so that all meet the same load of the machine. The
first round fills the caches of the disk and of Python and is not counted. The minimum
is the cost of the command, the median its time on this machine.
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
COMMANDS = {
    'python -c "pass"': [PYTHON, "-c", "pass"],
    'python -c "import numpy"': [PYTHON, "-c", "import numpy"],
    'python -c "import bipot_rs"': [PYTHON, "-c", "import bipot_rs"],
    'python -c "import scipy.sparse"': [PYTHON, "-c", "import scipy.sparse"],
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
    rows = [
        (f"`{name}`", f"{min(column):.0f} ms", f"{statistics.median(column):.0f} ms")
        for name, column in zip(COMMANDS, zip(*times[1:], strict=True), strict=True)
    ]
    text = tables.table(("process", "minimum", "median"), rows)
    tables.publish("import time", text, write=not args.print)


if __name__ == "__main__":
    main()
