"""Run the benches of the crate, `cargo bench`, and write their tables into the README.

    python benches/criterion_tables.py                 # all, with the cube of 148,000
    python benches/criterion_tables.py --only fronts

`condense` and `fronts` print their tables. For `projection` and `solvers` criterion stores
medians and the amount of work of a call, which give the rates.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import tables

ROOT = Path(__file__).resolve().parent.parent
# A folder of its own, so that other results of criterion are kept.
SAMPLES = ROOT / "target" / "bench-tables"
PRINTED, SAMPLED = ("condense", "fronts"), ("projection", "solvers")
# Throughput of criterion: unit of the rate and its scale.
RATES = {"Elements": ("M/s", 1e6), "Bytes": ("GiB/s", 2.0**30)}


def cargo(bench):
    """Run a bench; return its output."""
    run = subprocess.run(
        ["cargo", "bench", "--locked", "--bench", bench],
        cwd=ROOT,
        env=os.environ | {"BIPOT_BENCH_LARGE": "1", "CRITERION_HOME": str(SAMPLES)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return run.stdout


def samples(folder):
    """Rates that criterion stored in a folder, ``{group: {function: {value: rate}}}``."""
    found = {}
    for path in sorted(folder.glob("**/new/benchmark.json")):
        entry = json.loads(path.read_text(encoding="utf-8"))
        estimates = json.loads((path.parent / "estimates.json").read_text("utf-8"))
        ((kind, amount),) = (entry["throughput"] or {None: 0}).items()
        if kind not in RATES:
            continue
        unit, scale = RATES[kind]
        rate = amount / scale / (1e-9 * estimates["median"]["point_estimate"])
        functions = found.setdefault(f"{entry['group_id']}, {unit}", {})
        values = functions.setdefault(entry["function_id"] or "", {})
        values[entry["value_str"] or ""] = f"{rate:.3g}"
    if not found:
        raise SystemExit(f"no rates of criterion in {folder}: did the bench run?")
    return found


def pivoted(found):
    """One table for each set of values: rows are functions, columns are values."""
    pages = {}
    for group, functions in found.items():
        for function, values in functions.items():
            head = tuple(sorted(values, key=lambda v: (len(v), v)))
            cells = (values[value] for value in head)
            pages.setdefault(head, []).append((group, function, *cells))
    return "\n\n".join(
        tables.table(("bench, unit", "function", *head), rows)
        for head, rows in pages.items()
    )


def measured(bench):
    """Run a bench and format its table."""
    if bench in PRINTED:
        return f"```text\n{cargo(bench).strip()}\n```"
    # Emptied first, so that it holds the results of this run only.
    shutil.rmtree(SAMPLES, ignore_errors=True)
    cargo(bench)
    return pivoted(samples(SAMPLES))


def main():
    """Measure, and rewrite the tables."""
    parser = tables.parser(__doc__)
    every = (*PRINTED, *SAMPLED)
    parser.add_argument("--only", choices=every)
    args = parser.parse_args()
    for bench in [args.only] if args.only else every:
        tables.publish(bench, measured(bench), write=not args.print)


if __name__ == "__main__":
    main()
