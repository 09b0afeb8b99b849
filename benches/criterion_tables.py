"""The benches of the crate, `cargo bench`, as tables of the README.

    python benches/criterion_tables.py                 # all, condensation with the cube of 148,000
    python benches/criterion_tables.py --only fronts

`condense` and `fronts` print what they measure; of `projection` and `solvers` criterion
keeps medians and what a call works on, from which the rates are.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import tables

ROOT = Path(__file__).resolve().parent.parent
# Of its own: what others measured by criterion stays.
SAMPLES = ROOT / "target" / "bench-tables"
PRINTED, SAMPLED = ("condense", "fronts"), ("projection", "solvers")
# What a rate counts: its unit, and how many of it a call works on.
RATES = {"Elements": ("M/s", 1e6), "Bytes": ("GiB/s", 2.0**30)}


def cargo(bench):
    """Run a bench; what it printed."""
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
    """``{group: {function: {value: rate}}}`` of all that criterion kept in a folder."""
    found = {}
    for path in sorted(folder.glob("**/new/benchmark.json")):
        told = json.loads(path.read_text(encoding="utf-8"))
        estimates = json.loads((path.parent / "estimates.json").read_text("utf-8"))
        ((kind, amount),) = (told["throughput"] or {None: 0}).items()
        if kind not in RATES:
            continue
        unit, scale = RATES[kind]
        rate = amount / scale / (1e-9 * estimates["median"]["point_estimate"])
        functions = found.setdefault(f"{told['group_id']}, {unit}", {})
        values = functions.setdefault(told["function_id"] or "", {})
        values[told["value_str"] or ""] = f"{rate:.3g}"
    if not found:
        raise SystemExit(f"criterion left no rates in {folder}")
    return found


def pivoted(found):
    """A table for each set of values: groups and their functions down, values across."""
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
    """The text of a bench."""
    if bench in PRINTED:
        return f"```text\n{cargo(bench).strip()}\n```"
    # Emptied before: what is found there after is of this run.
    shutil.rmtree(SAMPLES, ignore_errors=True)
    cargo(bench)
    return pivoted(samples(SAMPLES))


def main():
    """Measure, and rewrite the tables."""
    parser = tables.parser(__doc__)
    every = (*PRINTED, *SAMPLED)
    parser.add_argument("--only", choices=every)
    asked = parser.parse_args()
    for bench in [asked.only] if asked.only else every:
        tables.publish(bench, measured(bench), write=not asked.print)


if __name__ == "__main__":
    main()
