"""The iterative engine beside PETSc: the block of `scale.py` with K given, and one load on K.

    python benches/beside_petsc.py
    python benches/beside_petsc.py --quick
    python benches/beside_petsc.py 24x24x24 70x70x19 --rounds 3

K is assembled once a size and written to files. The programs run in turn, each run in its
own process, and the clock starts with K in memory: bipot_rs on ``--ranks`` threads, PETSc
on as many ranks. ``--petsc``, or PETSC_PYTHON, names the Python that has petsc4py and
mpi4py; the petsc4py of Debian also needs PETSC_DIR. Rewrites a table of
`benches/README.md` and `results/beside_petsc.csv`.
"""

import argparse
import os
import sys
import tempfile
from itertools import product
from pathlib import Path
from shutil import which
from statistics import median

import iterative_file
import numpy as np
import tables
from condensation_peers import touch
from peers.commands import PEERS, Failed, lines_of, pythons

SHEET = "beside_petsc.csv"
SIZES = ["24x24x24", "36x36x36", "40x40x40", "70x70x19", "70x70x70"]
QUICK = ["6x6x6", "9x9x9"]
HERE = Path(__file__).resolve().parent
TOL = {"newton": "1e-10", "linear": "1e-12"}
HEAD = tables.columns(
    "cells | unknowns | contacts | problem | program | s | median s | set-up s | peak GB | "
    "Newton | Krylov | residual | difference | PETSc / bipot_rs"
)
# Containers run as root; a core may have one slot for two hardware threads.
MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}


def petsc(wanted):
    """A Python that has PETSc, or the reason why there is none."""
    if which("mpirun") is None:
        return None, "there is no mpirun"
    for python in filter(None, (wanted, *pythons())):
        try:
            lines_of([python, "-c", "import mpi4py.MPI, petsc4py.PETSc"], 1, 60)
        except Failed:
            continue
        return python, ""
    return None, "no Python here has petsc4py and mpi4py (with PETSC_DIR set)"


def compared(cells, python, args):
    """Rows of one size: both problems and programs, all rounds in turn."""
    case, load = iterative_file.assembled(cells)
    size = {"unknowns": case.model.n, "contacts": len(case.model.gap)}
    with tempfile.TemporaryDirectory() as folder:
        file, slabs, answer = (
            str(Path(folder) / name) for name in ("ours.npz", "slabs.npz", "answer.npz")
        )
        iterative_file.write(file, case, load)
        dofs = iterative_file.write_slabs(slabs, case, load, args.ranks)
        del case
        # The first run would wait for memory that a virtual machine asks its host for.
        touch(1 + size["unknowns"] // 100_000)
        ranks = ["mpirun", "-n", str(args.ranks), python, "-m", "mpi4py"]
        runs = {
            "bipot_rs": [sys.executable, str(HERE / "iterative_file.py"), file],
            "PETSc": [*ranks, str(PEERS / "with_petsc.py"), slabs],
        }
        for round_, mode in product(range(args.rounds), TOL):
            answers_of = {}
            for program in list(runs)[:: -1 if round_ % 2 else 1]:
                asked = [mode, "--save", answer, "--tol", TOL[mode]]
                threads = args.ranks if program == "bipot_rs" else 1
                _, lines = lines_of([*runs[program], *asked], threads, args.limit)
                with np.load(answer) as data:
                    answers_of[program] = lines[-1], data["answer"]
            other_answer, other = (answers_of[program][1] for program in runs)
            other_answer = other_answer[dofs] if mode == "linear" else other_answer
            gap = float(np.abs(other - other_answer).max() / np.abs(other_answer).max())
            for program in runs:
                line = answers_of[program][0]
                row = {"cells": "×".join(map(str, cells))} | size
                row |= {"problem": mode, "program": program, "round": round_}
                row |= {key: round(s, 4) for key, s in line.pop("seconds").items()}
                row |= line | {"difference": gap, "ranks": args.ranks}
                print(row, flush=True)
                yield row | {"machine": tables.processor()}


def written(rows, failed=()):
    """The table, with the machine and the versions below it."""
    groups, lines = {}, []
    for row in rows:
        groups.setdefault((row["cells"], row["problem"]), []).append(row)
    for (cells, problem), group in groups.items():
        by = {}
        for row in group:
            by.setdefault(row["program"], []).append(row)
        seconds = {
            program: [float(row["total"]) for row in rows_of_program]
            for program, rows_of_program in by.items()
        }
        pairs = zip(seconds["PETSc"], seconds["bipot_rs"], strict=True)
        ratio = median(theirs / ours for theirs, ours in pairs)
        for program, rows_of_program in by.items():
            best, first = (
                min(rows_of_program, key=lambda row: float(row["total"])),
                program == "PETSc",
            )
            lines.append(
                (
                    cells,
                    f"{int(best['unknowns']):,}",
                    f"{int(best['contacts']):,}",
                    problem,
                    program,
                    tables.figures(min(seconds[program])),
                    tables.figures(median(seconds[program])),
                    tables.figures(float(best["set-up"])),
                    tables.figures(
                        max(float(row["peak_mb"]) for row in rows_of_program) / 1e3
                    ),
                    str(best["newton"]),
                    str(best["krylov"]),
                    f"{max(float(row['residual']) for row in rows_of_program):.0e}",
                    f"{max(float(row['difference']) for row in rows_of_program):.0e}"
                    if first
                    else "",
                    f"{ratio:.2f}" if first else "",
                )
            )
    versions = dict.fromkeys(f"{row['program']} {row['version']}" for row in rows)
    text = f"{tables.table(HEAD, lines)}\n\n{tables.machines(rows)}; {', '.join(versions)}; "
    text += (
        f"bipot_rs on {rows[0]['ranks']} threads, PETSc on {rows[0]['ranks']} ranks."
    )
    return text + "".join(f" {failed_program} failed." for failed_program in failed)


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", help="cells along x, y and z: 70x70x19")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--limit", type=float, default=1800, help="seconds of a run")
    parser.add_argument("--petsc", default=os.environ.get("PETSC_PYTHON"))
    parser.add_argument("--print", action="store_true", help="write no files")
    args = parser.parse_args()
    python, why = petsc(args.petsc)
    if python is None:
        print(f"Not compared with PETSc: {why}.")
        return
    os.environ.update(MPI)
    rows, failed = [], []
    for name in args.sizes or (QUICK if args.quick else SIZES):
        try:
            rows += list(compared(tuple(map(int, name.split("x"))), python, args))
        except Failed as error:
            print(f"{name}: {error}", flush=True)
            failed.append(name)
        if rows and not args.print:
            folder = tables.folder(args.quick)
            tables.write_rows(folder / "results" / SHEET, rows)
            tables.rewrite(folder / "README.md", "petsc", written(rows, failed))
    if not rows:
        raise SystemExit("no size was solved by both programs")
    print(written(rows, failed))


if __name__ == "__main__":
    main()
