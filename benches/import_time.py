"""Time to start whole processes, in turn, and of one call with few contacts.

    python benches/import_time.py                # the table of the README, 9 rounds
    python benches/import_time.py --rounds 21

Each round runs every command once, so that all meet the same load of the machine. The
first round fills the caches of the disk and of Python and is not counted. The minimum
is the cost of the command, the median its time on this machine. The ratio is that to the
import of NumPy and SciPy's sparse matrices in the same round, its median over the rounds: a
run should take at most 2, the help at most 1. The call makes and solves a problem of three
contacts: its minimum should be at most 40 µs, its median 60.
"""

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
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


def few_contacts(calls=3000):
    """Minimum and median microseconds of ``ReducedProblem(W, q, mu).solve()``."""
    import bipot_rs as bp

    root, q = np.random.default_rng(3).normal(size=(2, 9, 9))
    W, q = root @ root.T / 9 + np.eye(9), q[:3, :3] - [0.5, 0.0, 0.0]
    taken = []
    for _ in range(calls):
        start = perf_counter()
        solution = bp.ReducedProblem(W, q, 0.3).solve()
        taken.append(1e6 * (perf_counter() - start))
        assert solution.converged
    return min(taken), statistics.median(taken)


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
    least_call, median_call = few_contacts()
    text += (
        f"\n\nMaking and solving a problem of three contacts takes {least_call:.0f} µs at "
        f"least and {median_call:.0f} µs in the median."
    )
    tables.publish("import time", text, write=not args.print)


if __name__ == "__main__":
    main()
