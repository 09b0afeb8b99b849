"""Whole jobs of the two engines, by size: seconds, memory, iterations, and the crossover.

    python benches/scale.py
    python benches/scale.py --quick

A block is pressed on a rigid plane and sheared: two load steps, from the scene to the
written result, each in its own process. The engines run in turn. The iterative engine has
the larger sizes alone. Rewrites the tables of `benches/README.md` and `results/scale.csv`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tables
from peers.commands import as_installed

SHEET = "scale.csv"
# Cells along x, y and z.
SMALL = [(n, n, n) for n in (12, 15, 18, 21, 24, 28, 31, 36)]
LARGE = [(40, 40, 40), (70, 70, 19), (100, 100, 18), (70, 70, 70), (100, 100, 100)]
QUICK = [(6, 6, 6), (9, 9, 9)]
# The direct engine above this number of unknowns takes minutes.
MOST_DIRECT = 220_000
ROUNDS = 3
HEAD = tables.columns(
    "cells | unknowns | contacts | engine | s | median s | peak GB | steps | Krylov | "
    "residual | direct / iterative | auto chooses"
)

SCENE = """
[material.steel]
young = 210000.0
poisson = 0.3

[body.block]
material = "steel"
cell = "hexahedron"
x = {{ from = 0.0, to = {0}.0, cells = {0} }}
y = {{ from = 0.0, to = {1}.0, cells = {1} }}
z = {{ from = 0.0, to = {2}.0, cells = {2} }}

[[support]]
on = "block.top"
x = {{ value = {3}, amplitude = "shear" }}
y = 0.0
z = {4}

[[contact]]
on = "block.bottom"
plane = {{ point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }}
mu = 0.3

[path]
parameter = "shear"

[path.amplitude]
shear = [0.0, 1.0]
"""


def job(cells, engine, threads, environment):
    """One run in its own process: a row of the CSV file."""
    import bipot_rs as bp

    height = cells[2]
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "block.toml"
        # The strains of `sheared_cube`.
        text = SCENE.format(*cells, 2.5e-4 * height, -5e-4 * height)
        scene.write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "bipot_rs", "run", str(scene)]
        command += ["--engine", engine, "--json", "--tol", "1e-10"]
        command += ["--out", str(Path(folder) / "out")]
        started = time.perf_counter()
        ran = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=True,
            env=environment | {"BIPOT_NUM_THREADS": str(threads)},
        )
        wall = time.perf_counter() - started
        last = json.loads(ran.stdout.splitlines()[-1])
        result = bp.load(Path(folder) / "out" / "result.h5")
    stats = [step.stats for step in result]
    return {
        "cells": "×".join(map(str, cells)),
        "unknowns": last["dofs"],
        "contacts": last["contacts"],
        "engine": engine,
        "used": "iterative" if "krylov" in stats[-1] else "direct",
        "seconds": round(wall, 3),
        "peak_mb": last["peak_mb"],
        "newton": sum(step_stats.get("newton", 0) for step_stats in stats),
        "krylov": sum(step_stats.get("krylov", 0) for step_stats in stats),
        "residual": max(step.residual for step in result),
        "threads": threads,
        "machine": tables.processor(),
    }


def measured(sizes, rounds, threads, environment):
    """Rows of all sizes, engines and rounds; engines run in turn."""
    job(QUICK[0], "iterative", threads, environment)  # stores the compiled modules
    for cells in sizes:
        unknowns = 3 * np.prod([n + 1 for n in cells])
        engines = ["iterative"]
        if unknowns <= MOST_DIRECT:
            engines += ["direct", "auto"]
        for round_ in range(rounds if unknowns < 150_000 else 1):
            for engine in engines:
                row = job(cells, engine, threads, environment) | {"round": round_}
                print(row, flush=True)
                yield row


def exponent(n, values):
    """Least-squares slope of log(values) against log(n)."""
    return float(np.polyfit(np.log(n), np.log(values), 1)[0])


def written(rows):
    """The table and the sentence about slopes."""
    lines, sizes, least, memory = [], [], [], []
    for cells in dict.fromkeys(row["cells"] for row in rows):
        rows_of_size = [row for row in rows if row["cells"] == cells]
        by = {
            engine: [row for row in rows_of_size if row["engine"] == engine]
            for engine in ("iterative", "direct", "auto")
        }
        seconds = {
            engine: [float(row["seconds"]) for row in rows_of_engine]
            for engine, rows_of_engine in by.items()
        }
        ratio = ""
        if seconds["direct"]:
            pairs = zip(seconds["direct"], seconds["iterative"], strict=True)
            ratio = f"{np.median([a / b for a, b in pairs]):.2f}"
        for engine in ("iterative", "direct"):
            rows_of_engine = by[engine]
            if not rows_of_engine:
                continue
            first_row = rows_of_engine[0]
            peak = max(float(row["peak_mb"]) for row in rows_of_engine) / 1e3
            lines.append(
                (
                    cells,
                    f"{int(first_row['unknowns']):,}",
                    f"{int(first_row['contacts']):,}",
                    engine,
                    f"{min(seconds[engine]):.3g}",
                    f"{np.median(seconds[engine]):.3g}",
                    f"{peak:.3g}",
                    str(first_row["newton"]) if engine == "iterative" else "",
                    str(first_row["krylov"]) if engine == "iterative" else "",
                    f"{float(first_row['residual']):.1e}",
                    ratio if engine == "iterative" else "",
                    by["auto"][0]["used"] if by["auto"] and engine == "direct" else "",
                )
            )
            if engine == "iterative" and int(first_row["unknowns"]) >= 40_000:
                sizes.append(float(first_row["unknowns"]))
                least.append(min(seconds[engine]))
                memory.append(peak)
    text = tables.table(HEAD, lines)
    if len(sizes) > 2:
        text += (
            f"\n\n{rows[0]['machine']}, {rows[0]['threads']} threads. Slopes of the "
            f"iterative engine from {sizes[0]:,.0f} to {max(sizes):,.0f} unknowns: time "
            f"{exponent(sizes, least):.2f}, memory {exponent(sizes, memory):.2f}."
        )
    return text


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--again", action="store_true", help="write the table from the stored CSV file"
    )
    args = parser.parse_args()
    folder = tables.folder(args.quick)
    if args.again:
        rows = tables.read_rows(folder / "results" / SHEET)
    else:
        sizes = QUICK if args.quick else [*SMALL, *LARGE]
        rounds = 1 if args.quick else ROUNDS
        with tempfile.TemporaryDirectory() as compiled:
            environment = as_installed(Path(compiled))
            rows = list(measured(sizes, rounds, args.threads, environment))
    text = written(rows)
    print(text)
    tables.write_rows(folder / "results" / SHEET, rows)
    tables.rewrite(folder / "README.md", "engines", text)


if __name__ == "__main__":
    main()
