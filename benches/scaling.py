"""Growth of each phase with the number of unknowns, and a prediction for larger sizes.

    python benches/scaling.py
    python benches/scaling.py --quick

Squares and cubes with their base in contact, four sizes each: seconds of each phase,
operations, nonzeros and bytes. The exponent is the least-squares slope of the logarithms;
the prediction starts at the largest size measured. Rewrites the table of
`benches/README.md` and `results/scaling.csv`.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import matrix_file
import numpy as np
import tables
from peers.commands import lines_of

HERE = Path(__file__).resolve().parent
SHEET = "scaling.csv"
CELLS = {2: (158, 223, 316, 447), 3: (14, 18, 25, 32)}
QUICK = {2: (30, 45, 65, 90), 3: (5, 7, 9, 11)}
# Theoretical exponents of nested dissection in 2D and 3D, without logarithms. One side is
# in contact: its m unknowns grow as n^(1/2) and n^(2/3), and W costs m³.
THEORY = {
    "order": (1, 1),
    "symbolic": (1, 1),
    "factor": (1.5, 2),
    "compliance": (1.5, 2),
    "solve": (1.5, 2),
    "recover": (1, 4 / 3),
    "flops": (1.5, 2),
    "nnz": (1, 4 / 3),
    "bytes_factor": (1, 4 / 3),
    "bytes_peak": (1, 4 / 3),
}
NAMES = {
    "factor": "numeric",
    "compliance": "W",
    "flops": "operations",
    "nnz": "nonzeros of L",
    "bytes_factor": "GB of L",
    "bytes_peak": "GB at the peak",
}
SCALE = {"bytes_factor": 1e-9, "bytes_peak": 1e-9}
FAR = (10**6, 10**7)
HEAD = (
    *tables.columns("unknowns | quantity | smallest | largest | exponent | theory"),
    *(f"at 10^{len(str(n)) - 1}" for n in FAR),
)


def exponent(n, values):
    """Least-squares slope of log(values) against log(n)."""
    return float(np.polyfit(np.log(n), np.log(values), 1)[0])


def measured(dim, cells, threads):
    """Rows of the CSV file, one for each size."""
    command = [sys.executable, str(HERE / "condense_file.py")]
    for count in cells:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "matrix"
            n, m = matrix_file.write(path, dim, count)
            repeat = "3" if n < 60_000 else "2"
            _, (line,) = lines_of([*command, str(path), repeat], threads, None)
        row = {"dim": dim, "n": n, "m": m, "threads": threads}
        row |= {key: line[key] for key in THEORY}
        row["machine"] = tables.processor()
        print(row, flush=True)
        yield row


def predictions(rows):
    """Values, exponent, theoretical exponent and prediction of each quantity."""
    n = np.array([float(row["n"]) for row in rows])
    dim = int(rows[0]["dim"])
    for key, theory in THEORY.items():
        values = np.array([float(row[key]) for row in rows]) * SCALE.get(key, 1.0)
        slope = exponent(n, values)
        far = [values[-1] * (size / n[-1]) ** slope for size in FAR]
        yield key, values, slope, theory[dim - 2], far


def written(rows):
    """Text between the markers: table and conclusion."""
    lines, words = [], []
    for dim in (2, 3):
        rows_of_dim = [row for row in rows if int(row["dim"]) == dim]
        sizes = [int(row["n"]) for row in rows_of_dim]
        total, far = np.zeros(len(FAR)), {}
        for key, values, slope, theory, predicted in predictions(rows_of_dim):
            first = f"{dim}D, {sizes[0]:,} to {sizes[-1]:,}" if key == "order" else ""
            lines.append(
                (
                    first,
                    NAMES.get(key, key),
                    tables.figures(values[0]),
                    tables.figures(values[-1]),
                    f"{slope:.2f}",
                    f"{theory:.2f}".rstrip("0").rstrip("."),
                    *(tables.figures(float(f"{x:.2g}")) for x in predicted),
                )
            )
            far[key] = predicted
            if key in ("order", "symbolic", "factor", "compliance", "solve", "recover"):
                total += predicted
        place = f"in {dim}D"
        for size, seconds, memory in zip(FAR, total, far["bytes_peak"], strict=True):
            shown = [tables.figures(float(f"{x:.2g}")) for x in (seconds, memory)]
            words.append(
                f"{shown[0]} s and {shown[1]} GB for {size:,} unknowns {place}"
            )
    text = tables.table(HEAD, lines)
    return f"{text}\n\n{tables.machines(rows)}. Times in seconds. {conclusion(rows, words)}"


def conclusion(rows, words):
    """Predictions, and the largest size that fits the memory of this machine."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    space = [row for row in rows if int(row["dim"]) == 3]
    predicted = {key: rest for key, *rest in predictions(space)}
    values, slope, *_ = predicted["bytes_peak"]
    largest = float(space[-1]["n"]) * (memory / values[-1]) ** (1 / slope)
    return (
        f"Expected: {', '.join(words)}. In 3D memory limits a direct method before time "
        f"does: the {memory:.0f} GB of this machine are full at about {largest:.1g} unknowns."
    )


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--print", action="store_true", help="write no files")
    parser.add_argument(
        "--again", action="store_true", help="write the table from the stored CSV file"
    )
    args = parser.parse_args()
    threads, folder = os.cpu_count() or 1, tables.folder(args.quick)
    if args.again:
        rows = tables.read_rows(folder / "results" / SHEET)
    else:
        rows = [
            row
            for dim, cells in (QUICK if args.quick else CELLS).items()
            for row in measured(dim, cells, threads)
        ]
    text = written(rows)
    print(text)
    if args.print:
        return
    tables.write_rows(folder / "results" / SHEET, rows)
    tables.rewrite(folder / "README.md", "scaling", text)


if __name__ == "__main__":
    main()
