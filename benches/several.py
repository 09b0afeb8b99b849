"""Whole jobs under mpirun: the block of `scale.py` with engine petsc on 1 and 2 ranks.

    python benches/several.py
    python benches/several.py --quick
    python benches/several.py 36x36x36 70x70x19 --ranks 1 2 4

Each run goes from the scene to the written result, with a residual of 1e-10 asked for. The
log of PETSc (``-log_view``) counts the messages between ranks and their bytes. ``--petsc``,
or PETSC_PYTHON, names the Python that has petsc4py, mpi4py and this package; the default is
that of `make mpi-test`. Rewrites a table of `benches/README.md` and `results/several.csv`.
"""

import argparse
import json
import os
import re
import subprocess
import tempfile
import time
from pathlib import Path
from shutil import which

import tables
from beside_petsc import MPI
from scale import SCENE

import bipot_rs as bp

SHEET = "several.csv"
# Two of them have equally many unknowns for each rank: 29x29x29 on one, 29x29x59 on two.
SIZES = ["24x24x24", "29x29x29", "36x36x36", "29x29x59", "70x70x19", "100x100x18"]
SIZES += ["70x70x70"]
QUICK = ["6x6x6", "9x9x9"]
HERE = Path(__file__).resolve().parent
HEAD = tables.columns(
    "cells | unknowns | contacts | ranks | s | assemble s | condense s | solve s | write s | "
    "peak MB a rank | Newton | Krylov | messages | MB sent | residual | speed-up"
)
PHASES = ("assemble", "condense", "solve", "write")
# Lines of the summary of -log_view: maximum, ratio, average and total over the ranks.
_COUNTED = {
    "messages": re.compile(r"^MPI Msg Count:\s+\S+\s+\S+\s+\S+\s+(\S+)", re.MULTILINE),
    "bytes_sent": re.compile(
        r"^MPI Msg Len \(bytes\):\s+\S+\s+\S+\s+\S+\s+(\S+)", re.MULTILINE
    ),
    "reductions": re.compile(r"^MPI Reductions:\s+(\S+)", re.MULTILINE),
}
# The same lines before PETSc 3.19.
_EARLIER = {
    "messages": re.compile(r"^MPI Messages:\s+\S+\s+\S+\s+\S+\s+(\S+)", re.MULTILINE),
    "bytes_sent": re.compile(
        r"^MPI Message Lengths:\s+\S+\s+\S+\s+\S+\s+(\S+)", re.MULTILINE
    ),
}


def petsc(wanted):
    """The Python of the runs, or the reason why there is none."""
    if which("mpirun") is None:
        return None, "there is no mpirun"
    python = wanted or str(HERE.parent / ".venv-mpi" / "bin" / "python")
    look = "import bipot_rs.cli.app, bipot_rs.petsc.library as it; it.load()"
    try:
        done = subprocess.run(
            [python, "-c", look], env=environment(), capture_output=True, text=True
        )
    except OSError as error:
        return None, f"{error} (make mpi-test makes it)"
    if done.returncode:
        return None, f"{python}: {(done.stderr.splitlines() or ['no answer'])[-1]}"
    return python, ""


def environment(**more):
    """Variables of a run."""
    paths = {"PYTHONPATH": str(HERE.parent / "python"), "OMP_NUM_THREADS": "1"}
    return os.environ | MPI | paths | {"BIPOT_NUM_THREADS": "1"} | more


def counted(log):
    """Messages, bytes and reductions of a log of PETSc; 0 if the log lacks them."""
    counts = {}
    for name, line in _COUNTED.items():
        match = line.search(log) or _EARLIER.get(name, line).search(log)
        counts[name] = float(match[1]) if match else 0.0
    return counts


def job(cells, ranks, python):
    """One run: a row of the CSV file."""
    height = cells[2]
    with tempfile.TemporaryDirectory() as folder:
        scene, log = Path(folder) / "block.toml", Path(folder) / "petsc.log"
        text = SCENE.format(*cells, 2.5e-4 * height, -5e-4 * height)
        scene.write_text(text, encoding="utf-8")
        command = ["mpirun", "-n", str(ranks), python, "-m", "bipot_rs", "run"]
        command += [str(scene), "--engine", "petsc", "--json", "--tol", "1e-10"]
        command += ["--out", str(Path(folder) / "out")]
        started = time.perf_counter()
        ran = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment(PETSC_OPTIONS=f"-log_view :{log}"),
        )
        wall = time.perf_counter() - started
        if ran.returncode:
            raise SystemExit(f"{' '.join(command)}: {ran.stdout}{ran.stderr}")
        last = json.loads(ran.stdout.splitlines()[-1])
        result = bp.load(Path(folder) / "out" / "result.h5")
        counts = counted(log.read_text(encoding="utf-8") if log.exists() else "")
    stats = [step.stats for step in result]
    return {
        "cells": "×".join(map(str, cells)),
        "unknowns": last["dofs"],
        "contacts": last["contacts"],
        "ranks": ranks,
        "seconds": round(wall, 3),
        **{f"{phase}_s": round(last["seconds"][phase], 3) for phase in PHASES},
        "peak_mb": last["peak_mb"],
        "newton": sum(step_stats.get("newton", 0) for step_stats in stats),
        "krylov": sum(step_stats.get("krylov", 0) for step_stats in stats),
        **{name: int(value) for name, value in counts.items()},
        "residual": max(step.residual for step in result),
        "machine": tables.processor(),
    }


def written(rows):
    """The table."""
    lines = []
    for cells in dict.fromkeys(row["cells"] for row in rows):
        rows_of_size = [row for row in rows if row["cells"] == cells]
        fewest = min(rows_of_size, key=lambda row: int(row["ranks"]))
        for ranks in dict.fromkeys(row["ranks"] for row in rows_of_size):
            same = [row for row in rows_of_size if row["ranks"] == ranks]
            best = min(same, key=lambda row: float(row["seconds"]))
            ratio = ""
            if int(ranks) > int(fewest["ranks"]):
                few = [row for row in rows_of_size if row["ranks"] == fewest["ranks"]]
                least = min(float(row["seconds"]) for row in few)
                ratio = f"{least / float(best['seconds']):.2f}"
            lines.append(
                (
                    cells,
                    f"{int(best['unknowns']):,}",
                    f"{int(best['contacts']):,}",
                    str(ranks),
                    tables.figures(float(best["seconds"])),
                    *(tables.figures(float(best[f"{name}_s"])) for name in PHASES),
                    f"{max(float(row['peak_mb']) for row in same):.0f}",
                    str(best["newton"]),
                    str(best["krylov"]),
                    f"{int(best['messages']):,}",
                    f"{float(best['bytes_sent']) / 1e6:.3g}",
                    f"{float(best['residual']):.0e}",
                    ratio,
                )
            )
    return f"{tables.table(HEAD, lines)}\n\n{tables.machines(rows)}."


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", help="cells along x, y and z: 70x70x19")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--petsc", default=os.environ.get("PETSC_PYTHON"))
    parser.add_argument("--print", action="store_true", help="write no files")
    args = parser.parse_args()
    python, why = petsc(args.petsc)
    if python is None:
        print(f"Nothing measured with PETSc: {why}.")
        return
    rows = []
    for name in args.sizes or (QUICK if args.quick else SIZES):
        cells = tuple(map(int, name.split("x")))
        for round_ in range(args.rounds):
            for ranks in args.ranks:
                rows.append(job(cells, ranks, python) | {"round": round_})
                print(rows[-1], flush=True)
    text = written(rows)
    print(text)
    if not args.print:
        folder = tables.folder(args.quick)
        tables.write_rows(folder / "results" / SHEET, rows)
        tables.rewrite(folder / "README.md", "several", text)


if __name__ == "__main__":
    main()
