"""Gradients and directional derivatives of load paths beside their solution.

    python benches/sensitivities.py
    python benches/sensitivities.py --quick

Each scene is condensed, its path solved, and differentiated: `vjp` of the sum of squares of
the reactions, with the gradients by loads, gaps and friction; and `jvp` along a change of
all friction coefficients. The derivatives are compared with each other, by the products of
both, and with central differences of the path. Rewrites a table of `benches/README.md` and
`results/sensitivities.csv`.
"""

import argparse
import time

import numpy as np
import tables
from timing import fastest

from bipot_rs import scene

SHEET = "sensitivities.csv"
RUNS = [("cyclic_cube", 9), ("cyclic_cube", 15), ("sheared_cube", 15)]
RUNS += [("sheared_cube", 24)]
QUICK = [("cyclic_cube", 6), ("sheared_cube", 6)]
HEAD = tables.columns(
    "scene, n | unknowns | contacts | steps | condense s | solve s | vjp s | jvp s | "
    "vjp / solve | vjp / job | jvp against vjp | against differences"
)
# Step of central differences: small enough that no contact changes its status, large enough
# that the error of a solution does not matter.
STEP = 1e-6
TOL = 1e-13


def measured(name, n):
    """The row of a scene."""
    case = scene.assemble(*_bodies(scene.read(name, [f"mesh.n={n}"])))
    began = time.perf_counter()
    problem = case.problem(engine="direct")
    condense = time.perf_counter() - began
    solve, result = fastest(3, lambda: case.solve(problem, tol=TOL))
    mu = np.broadcast_to(case.model.mu, len(case.model.gap))

    def gradient():
        result._linearised = None
        full_gradient = result.vjp(reaction=2 * result.reaction)
        return full_gradient, full_gradient.load

    def change():
        result._linearised = None
        return result.jvp(mu=mu)

    vjp, (full_gradient, _) = fastest(3, gradient)
    jvp, tangent = fastest(3, change)
    forward = float((2 * result.reaction * tangent.reaction).sum())
    backward = float(full_gradient.mu @ mu)
    size = float(np.abs(2 * result.reaction * tangent.reaction).sum())
    path = {"load": case.load, "prescribed": case.prescribed}
    both = [path | {"mu": (1 + sign * STEP) * mu} for sign in (1, -1)]
    ends = [end_of_case.reaction for end_of_case in problem.solve_many(both, tol=TOL)]
    central = (ends[0] - ends[1]) / (2 * STEP)
    off = np.abs(central - tangent.reaction).max() / np.abs(tangent.reaction).max()
    return {
        "scene": name,
        "n": n,
        "unknowns": case.model.n,
        "contacts": len(mu),
        "steps": len(result),
        "condense": round(condense, 4),
        "solve": round(solve, 4),
        "vjp": round(vjp, 4),
        "jvp": round(jvp, 4),
        "apart": abs(forward - backward) / size,
        "differences": float(off),
        "one_sided": int(full_gradient.one_sided.sum()),
        "machine": tables.processor(),
    }


def _bodies(read):
    return read, scene.bodies(read)


def written(rows):
    """The table."""
    lines = [
        (
            f"{row['scene']}, {row['n']}",
            f"{int(row['unknowns']):,}",
            f"{int(row['contacts']):,}",
            str(row["steps"]),
            *(
                tables.figures(row[name])
                for name in ("condense", "solve", "vjp", "jvp")
            ),
            f"{row['vjp'] / row['solve']:.2f}",
            f"{row['vjp'] / (row['condense'] + row['solve']):.2f}",
            f"{row['apart']:.0e}",
            f"{row['differences']:.0e}",
        )
        for row in rows
    ]
    return f"{tables.table(HEAD, lines)}\n\n{tables.machines(rows)}."


def main():
    """Measure, and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small problems")
    parser.add_argument("--print", action="store_true", help="write no files")
    args = parser.parse_args()
    rows = [measured(*run) for run in (QUICK if args.quick else RUNS)]
    text = written(rows)
    print(text)
    if not args.print:
        folder = tables.folder(args.quick)
        tables.write_rows(folder / "results" / SHEET, rows)
        tables.rewrite(folder / "README.md", "sensitivities", text)


if __name__ == "__main__":
    main()
