"""Time the numeric phase of the condensation, compared with CHOLMOD and MKL PARDISO.

    python benches/condensation_peers.py             # 9k and 51k in 3D, 200k in 2D
    python benches/condensation_peers.py --large     # also the cube of 148k
    python benches/condensation_peers.py --quick

All compute S of the same matrix, contact unknowns last. They run in turn, in another order
each round, each run in its own process, on one thread and on two. The minimum of a
program counts; ratios are medians of the ratios within a round. CHOLMOD is compiled with
``cc`` if its header is found. PARDISO is used if a Python has the MKL runtime (``--mkl``
names it). Rewrites the table of `benches/README.md`.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import which
from statistics import median

import matrix_file
import numpy as np
import tables
from peers.commands import PEERS, Failed, lines_of, pythons

HERE = Path(__file__).resolve().parent
CASES = {"cube 14": (3, 14), "cube 25": (3, 25), "square 316": (2, 316)}
LARGE = {"cube 36": (3, 36)}
QUICK = {"cube 9": (3, 9), "square 60": (2, 60)}
HEAD = tables.columns(
    "body | unknowns | contact unknowns | program | 1 thread, s | Gflop | "
    "share of product | 2 threads, s | speed-up | bipot_rs / program | "
    "bipot_rs / program, 2 threads | difference of S | ordering"
)


def compiled(folder):
    """Command of the CHOLMOD program, or the reason why there is none."""
    if which("cc") is None:
        return None, "no C compiler"
    target = Path(folder) / "cholmod"
    flags = ["-O2", "-march=native", "-I/usr/include/suitesparse"]
    command = ["cc", *flags, str(PEERS / "cholmod.c"), "-o", str(target)]
    run = subprocess.run([*command, "-lcholmod", "-lm"], capture_output=True, text=True)
    if run.returncode:
        return None, "its header or library is not installed"
    return [str(target)], ""


def pardiso(wanted):
    """Command of the PARDISO program, or the reason why there is none."""
    for python in filter(None, (wanted, *pythons())):
        command = [python, str(PEERS / "with_pardiso.py")]
        look = "import sys; sys.argv[1:] = []; sys.path.insert(0, %r); "
        look += "import with_pardiso; with_pardiso.library()"
        try:
            lines_of([python, "-c", look % str(PEERS)], 1, 60)
        except Failed:
            continue
        return command, ""
    return None, "no Python here has the MKL runtime"


def difference(path, m, W):
    """Largest entry of S - W⁻¹, relative to that of S."""
    S = np.fromfile(f"{path}.s").reshape(m, m)
    S = np.where(np.tri(m, dtype=bool).T, S, S.T)  # PARDISO fills the upper triangle
    return np.abs(S - np.linalg.inv(W)).max() / np.abs(S).max()


def turned(programs, turn):
    """Order of the programs in a round; bipot_rs is first in the first, to give W."""
    k = turn % len(programs)
    return programs[k:] + programs[:k]


def touch(gigabytes):
    """Write to memory, and free it.

    A virtual machine asks its host for a page when it is first written to, which takes
    seconds per gigabyte: the first program would pay for all.
    """
    write = f"import numpy; numpy.ones({gigabytes} << 27)"
    subprocess.run([sys.executable, "-c", write], check=False)


def case(name, shape, commands, args):
    """Rows of one matrix, one for each program."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "matrix"
        n, m = matrix_file.write(path, *shape)
        repeat = "3" if n < 100_000 else "2"
        lines_of_run = {(p, t): [] for p in commands for t in (1, 2)}
        gap = {}
        for turn in range(args.rounds):
            for threads in (1, 2):
                for program in turned(list(commands), turn):
                    command = commands[program]
                    _, (line,) = lines_of([*command, str(path), repeat], threads, None)
                    lines_of_run[program, threads].append(line)
                    if program == "bipot_rs":
                        W = np.fromfile(f"{path}.s").reshape(m, m)
                    elif turn == 0 and threads == 1:
                        gap[program] = difference(path, m, W)
    for program in commands:
        first_run, two = (
            [line["numeric"] for line in lines_of_run[program, threads]]
            for threads in (1, 2)
        )
        line = lines_of_run[program, 1][0]
        rate = max(line["rate"] for line in lines_of_run["bipot_rs", 1])
        times_of_slopes = [
            [line["numeric"] for line in lines_of_run["bipot_rs", threads]]
            for threads in (1, 2)
        ]
        ratios = [
            f"{median(a / b for a, b in zip(a_times, b_times, strict=True)):.2f}"
            for a_times, b_times in zip(times_of_slopes, (first_run, two), strict=True)
        ]
        first = program == "bipot_rs"
        # PARDISO does not count the operations of its two-level form.
        counted = line["flops"] > 0
        yield (
            name if first else "",
            f"{n:,}" if first else "",
            f"{m:,}" if first else "",
            program,
            tables.figures(min(first_run)),
            tables.figures(line["flops"] / 1e9) if counted else "",
            f"{100 * line['flops'] / min(first_run) / rate:.0f} %" if counted else "",
            tables.figures(min(two)),
            f"{min(first_run) / min(two):.2f}",
            "" if first else ratios[0],
            "" if first else ratios[1],
            "" if first else f"{gap[program]:.0e}",
            line["ordering"],
        )


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--mkl", help="the Python that has MKL", default=os.environ.get("MKL_PYTHON")
    )
    parser.add_argument("--print", action="store_true", help="write no files")
    args = parser.parse_args()
    cases = QUICK if args.quick else CASES | (LARGE if args.large else {})
    with tempfile.TemporaryDirectory() as folder:
        wanted = {"CHOLMOD": compiled(folder), "MKL PARDISO": pardiso(args.mkl)}
        commands = {"bipot_rs": [sys.executable, str(HERE / "condense_file.py")]}
        commands |= {name: command for name, (command, _) in wanted.items() if command}
        absent = [
            f"{name}: {why}" for name, (command, why) in wanted.items() if not command
        ]
        rows = []
        touch(8 if args.large else 2)
        for name, shape in cases.items():
            for row in case(name, shape, commands, args):
                print("| " + " | ".join(row) + " |", flush=True)
                rows.append(row)
            if not args.print:
                page = tables.folder(args.quick) / "README.md"
                tables.rewrite(page, "condensation", written(rows, absent))


def written(rows, absent):
    """Text between the markers of the page."""
    text = tables.table(HEAD, rows)
    text += f"\n\n{tables.machine()} {conclusion(rows)}"
    if absent:
        text += f" Not run: {'; '.join(absent)}."
    return text


def conclusion(rows):
    """Smallest and largest ratio to each peer, and the speed-up of two threads."""
    words, body = [], ""
    rows_of_program = {}
    for row in rows:
        body = row[0] or body
        if row[9]:
            rows_of_program.setdefault(row[3], []).append((float(row[9]), body))
    for peer, ratios in rows_of_program.items():
        low, high = min(ratios), max(ratios)
        words.append(
            f"bipot_rs takes {low[0]:.2f} ({low[1]}) to {high[0]:.2f} ({high[1]}) of the "
            f"time of {peer} on one thread"
        )
    gains = [float(row[8]) for row in rows if row[3] == "bipot_rs"]
    if math.isfinite(max(gains)):
        words.append(f"two threads are up to {max(gains):.2f} times as fast as one")
    return "; ".join(words) + "."


if __name__ == "__main__":
    main()
