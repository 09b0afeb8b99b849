"""Time the whole job against its traction error, for decreasing tolerances.

    python benches/time_against_error.py            # sheared_cube 15
    python benches/time_against_error.py --quick    # sheared_cube 9

bipot_rs and every installed peer solve one scene with a stored reference, in turn at
each tolerance; the faster of two runs counts. Each program measures its tolerance in its
own way; the error is measured here for all. Writes `results/time_against_error.csv`.
"""

import argparse

import compare_tractions
import tables
from peers import commands

SHEET = "time_against_error.csv"
COLUMNS = ("scene", "n", "program", "tol", "error", "job", "contact")
SCENE = "sheared_cube"
LADDER = tuple(10.0**-k for k in range(1, 14, 2))
CONTACT = ("solve", "recover", "contact")


def rows(n, rounds, ladder):
    """Row of each program and tolerance."""
    reference = compare_tractions.stored(SCENE, n)
    everyone = [commands.Bipot(), *(p for p in commands.peers() if not p.missing)]
    for tol in ladder:
        for program in everyone:
            try:
                runs = [
                    program.run(SCENE, n, program.threads[0], tol=tol)
                    for _ in range(rounds)
                ]
            except commands.Failed as why:
                print(f"{program.name} at {tol:g}: {why}", flush=True)
                continue
            run = min(runs, key=lambda run: run.job)
            error, _ = compare_tractions.compare(run, reference)
            contact = sum(run.phases.get(name, 0.0) for name in CONTACT)
            row = (SCENE, n, program.name, tol, error, run.job, contact)
            print(*row, flush=True)
            yield dict(zip(COLUMNS, row, strict=True))


def main():
    """Measure, and write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small mesh, one run")
    args = parser.parse_args()
    measured = list(rows(9, 1, LADDER[::3]) if args.quick else rows(15, 2, LADDER))
    tables.write_rows(tables.folder(args.quick) / "results" / SHEET, measured)


if __name__ == "__main__":
    main()
