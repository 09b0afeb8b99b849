"""Cost of each method against its error: products with W and seconds.

    python benches/speed_against_error.py                # the tables and the figure
    python benches/speed_against_error.py --seeds 20 --methods auto,uzawa

Every problem of `problems.py` is solved from r = 0 at decreasing tolerances, on one thread.
A solve is reproducible, so its work is a function of its tolerance. Each result has two
errors: η of (13), and the true error, the distance to the solution that
`reference_solution.py` finds in extended precision from the statuses of the method's own
result at the smallest tolerance: if several solutions exist, each method is compared with
the one it found. If that result is too inaccurate for the statuses, those of `auto` are
taken. Errors are relative, in node-scaled variables, of r; if W does not have full rank, of
v, relative to the larger of v and q.

The cost of an error is that of the largest tolerance whose result converged and has that
error. A solve that does not converge within 20,000 products or the time limit costs infinity,
also in medians and quantiles.

Writes speed_against_error.csv and .png into `results`, or the folder of ``--out``; with all
sets, methods and seeds it rewrites the tables of the README. Solves are stored in the folder
of the problems while the compiled core is the same: an interrupted run continues, and a
run with more seeds computes only the new ones.
"""

import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

# Set before NumPy is imported: each job measures on one core.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
import problems
import tables
from reference_solution import Scaled, refine
from speed_against_error_figure import STYLES, draw
from timing import repeated

import bipot_rs as bp
from bipot_rs import _core

METHODS = tuple(STYLES)
# Methods that refuse bodies that only contact holds; they have no row for such a set.
NEED_SUPPORTS = {"alternating_principles", "minimising_sequence", "pivoting"}
SEEDS = {"auto": 150, "newton": 150, "gauss_seidel": 150}
FEWER = 50  # for methods that need thousands of products
LADDER = [float(f"1e-{k}") for k in range(2, 15)]
TARGETS = LADDER[:11]
SHOWN = TARGETS[::2]
WORK = 20_000
MEASURES = ("eta", "error")


def available(methods):
    """Methods of the list that the package has."""
    problem, able_methods = bp.ReducedProblem(np.eye(2), [[-1.0, 0.0]], 0.3), []
    for method in methods:
        try:
            problem.solve(method)
        except ValueError as error:
            print(f"{method}: left out, {error}", file=sys.stderr)
        else:
            able_methods.append(method)
    return able_methods


def timed(reduced, **settings):
    """Seconds and solution of a solve; short ones are repeated, the minimum counts."""
    return repeated(
        lambda: reduced.solve(**settings, max_iterations=WORK, num_threads=1)
    )


def solve(name, seed, method, limit):
    """Results of one method on one problem, ``{tol, work, seconds, eta, error}`` each.

    ``None`` if the method does not accept the problem.
    """
    problem = problems.SETS[name](seed)
    if problem.rigid is not None and method in NEED_SUPPORTS:
        return None
    reduced = bp.ReducedProblem(problem.W, problem.q, problem.mu, rigid=problem.rigid)
    timed(reduced, method=method, tol=0.5)  # starts threads, allocates memory
    rungs, answers = [], []
    for tol in LADDER:
        seconds, answer = timed(reduced, method=method, tol=tol, max_seconds=limit)
        if not answer.converged or answer.work > WORK:
            break  # a smaller tolerance would fail too
        answers.append(answer)
        rungs.append({"tol": tol, "work": answer.work, "seconds": seconds})
    if not answers:
        return rungs
    # If rounding has spoilt the last statuses, those of the tolerances before are tried.
    for last in [*reversed(answers[-3:]), None]:
        start = (
            reduced.solve(tol=LADDER[-1], max_seconds=limit) if last is None else last
        )
        exact = refine(problem, start.reaction, start.rigid_motion, start.status)
        if exact.trusted:
            break
    for rung, answer in zip(rungs, answers, strict=True):
        rung["eta"] = answer.residual
        rung["error"] = distance(problem, answer, exact) if exact.trusted else np.inf
    return rungs


def distance(problem, answer, exact):
    """True relative error of a result in node-scaled variables."""
    to_v = Scaled(problem).to_v
    if problem.full_rank:
        error, size = (answer.reaction - exact.r) / to_v, [exact.r / to_v]
    else:
        error = (answer.relative_displacement - exact.v) * to_v
        size = [exact.v * to_v, problem.q * to_v]
    error = float(np.linalg.norm(error.astype(float)))
    size = max(float(np.linalg.norm(x.astype(float))) for x in size)
    return error / size if size else (np.inf if error else 0.0)


def collect(sets, methods, seeds, first, limit, jobs):
    """Results by set, method and seed, stored ones or solved now."""
    core = Path(_core.__file__).stat()
    stamp = [core.st_size, core.st_mtime_ns, limit]
    store = problems.folder() / "speed_against_error.jsonl"
    store.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if store.exists():
        for line in store.read_text().splitlines():
            entry = json.loads(line)
            if entry["stamp"] == stamp:
                done[tuple(entry["key"])] = entry["rungs"]
    wanted = []
    for name in sets:
        for method in methods:
            count = SEEDS.get(method, FEWER) if seeds is None else seeds
            seeds_of_set = problems.seeds(name, count, first)
            wanted += [(name, method, seed) for seed in seeds_of_set]
    missing = [key for key in wanted if key not in done]
    # Not forked: the threads of the package do not survive a fork.
    fresh = get_context("spawn")
    with ProcessPoolExecutor(jobs, fresh) as pool, store.open("a") as file:
        running = [pool.submit(solve, k[0], k[2], k[1], limit) for k in missing]
        for i, (key, future) in enumerate(zip(missing, running, strict=True)):
            done[key] = future.result()
            entry = {"stamp": stamp, "key": key, "rungs": done[key]}
            file.write(json.dumps(entry) + "\n")
            file.flush()
            if sys.stderr.isatty():
                print(f"\r{i + 1} of {len(missing)}", end="", file=sys.stderr)
    return {key: done[key] for key in wanted}


def cost(rungs, measure, target):
    """Products and seconds to a target; infinite if it was not reached."""
    for rung in rungs:
        if rung["tol"] <= target if measure == "eta" else rung["error"] <= target:
            return rung["work"], rung["seconds"]
    return np.inf, np.inf


def rows(results):
    """Rows of the CSV file, one for each set, method, measure and target."""
    groups = {}
    for (name, method, _), rungs in results.items():
        if rungs is not None:
            groups.setdefault((name, method), []).append(rungs)
    for (name, method), members in groups.items():
        for measure in MEASURES:
            for target in TARGETS:
                costs = np.array([cost(rungs, measure, target) for rungs in members])
                # Not interpolated, because a value may be infinite.
                middle, high = np.quantile(costs, [0.5, 0.9], axis=0, method="higher")
                yield {
                    "set": name,
                    "method": method,
                    "problems": len(members),
                    "measure": measure,
                    "target": target,
                    "solved": int(np.isfinite(costs[:, 0]).sum()),
                    "products_median": middle[0],
                    "products_q90": high[0],
                    "seconds_median": middle[1],
                    "seconds_q90": high[1],
                }


def table(lines, unit, form):
    """Markdown table of the cost of each true error, median / 90 % quantile."""
    head = ("set", "method", *(f"{target:.0e}" for target in SHOWN), "solved")
    table_rows = []
    error_lines = [line for line in lines if line["measure"] == "error"]
    for name, method in dict.fromkeys((x["set"], x["method"]) for x in error_lines):
        by_target = {
            x["target"]: x
            for x in error_lines
            if (x["set"], x["method"]) == (name, method)
        }
        cells = []
        for target in SHOWN:
            line = by_target[target]
            pair = (line[f"{unit}_{q}"] for q in ("median", "q90"))
            cells.append(" / ".join(form(x) if np.isfinite(x) else "∞" for x in pair))
        # At three errors, since a method may find a solution and not refine it.
        depths = [by_target[t]["solved"] for t in (1e-4, 1e-8, 1e-12)]
        solved = ", ".join(map(str, depths))
        table_rows.append((name, method, *cells, f"{solved} of {line['problems']}"))
    return tables.table(head, table_rows)


def main():
    """Measure, print the tables, write the results."""
    parser = tables.parser(__doc__)
    parser.add_argument("--sets", default=",".join(problems.SETS))
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--seeds", type=int, help="number of seeds, for every method")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument(
        "--seconds-limit", type=float, default=10.0, help="for one solve"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument(
        "--out", type=Path, default=tables.RESULTS, help="folder to write to"
    )
    args = parser.parse_args()
    whole = tables.whole(parser, args, "sets", "methods", "seeds", "first_seed")
    write = whole and not args.print and args.out.resolve() == tables.RESULTS
    methods = available(args.methods.split(","))
    sets, limit = args.sets.split(","), args.seconds_limit
    drawn = args.seeds, args.first_seed
    results = collect(sets, methods, *drawn, limit, args.jobs)
    lines = list(rows(results))
    text = table(lines, "products", "{:.0f}".format)
    tables.publish("products to true error", text, write=write)
    text = table(lines, "seconds", lambda x: f"{1e3 * x:.2g}")
    tables.publish("milliseconds to true error", text, write=write)
    if args.print:
        return
    path = args.out / "speed_against_error.csv"
    args.out.mkdir(parents=True, exist_ok=True)
    tables.write_rows(
        path,
        [
            {k: f"{x:.4g}" if isinstance(x, float) else x for k, x in line.items()}
            for line in lines
        ],
    )
    draw(path, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
