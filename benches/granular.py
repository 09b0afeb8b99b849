"""Time `auto` to each residual on walls of disks and packings of balls.

    python benches/granular.py                       # seeds 0 to 49, the table, the figure
    python benches/granular.py --sets walls --first-seed 10 --seeds 5

Every assembly of `grains.py` is solved from r = 0 to η = 1e-10 within 20 seconds, one
after the other on all cores. During a solve the smallest η so far is read about twenty
times a second; the seconds to a target are those of the first reading that meets it. An
assembly counts as solved if η, computed again from the reactions, meets the last
target. A target that is not reached costs infinity, also in medians and quantiles.

Seconds are wall-clock time; ``cpu`` in the CSV file is the processor time of all cores.

Rows are added to `results/granular.csv` as they are measured and replace those of the same
set and seed; table and figure show all rows of the file.
"""

import sys
from time import perf_counter, process_time

import grains
import numpy as np
import tables
from plot_style import light_grid, pyplot

import bipot_rs as bp

TARGETS = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10]
SECONDS = 20.0
TITLES = {
    "walls": "walls of disks",
    "heaps": "disks in staggered rows",
    "packings": "packings of balls",
}


def measure(name, seed, limit):
    """Row of the CSV file."""
    assembly = grains.SETS[name](seed)
    W, q = assembly.step()
    problem = bp.ReducedProblem(W, q, assembly.mu)
    readings = []
    start, worked = perf_counter(), process_time()

    def reading(_iterations, _work, residual):
        readings.append((perf_counter() - start, residual))

    solution = problem.solve(tol=TARGETS[-1], max_seconds=limit, callback=reading)
    seconds, worked = perf_counter() - start, process_time() - worked
    residual = problem.residual(solution.reaction)
    readings.append((seconds, residual))
    line = {
        "set": name,
        "seed": seed,
        "contacts": len(q),
        "mu": assembly.mu,
        "outcome": solution.outcome.value,
        "residual": f"{residual:.2e}",
        "iterations": solution.iterations,
        "work": f"{solution.work:.0f}",
        "cpu": f"{worked:.3g}",
    }
    for target in TARGETS:
        reached = [at for at, eta in readings if eta <= target]
        line[f"{target:.0e}"] = f"{min(reached):.3g}" if reached else "inf"
    return line


def table(lines):
    """Markdown table of seconds to each target, median / 90 % quantile."""
    head = ("set", *(f"{target:.0e}" for target in TARGETS), "solved")
    rows = []
    for name in dict.fromkeys(line["set"] for line in lines):
        lines_of_set = [line for line in lines if line["set"] == name]
        cells = []
        for target in TARGETS:
            seconds = [float(line[f"{target:.0e}"]) for line in lines_of_set]
            pair = np.quantile(seconds, [0.5, 0.9], method="higher")
            cells.append(
                " / ".join(f"{x:.2g}" if np.isfinite(x) else "∞" for x in pair)
            )
        solved = sum(float(line["residual"]) <= TARGETS[-1] for line in lines_of_set)
        rows.append((name, *cells, f"{solved} of {len(lines_of_set)}"))
    return tables.table(head, rows)


def draw(lines, target):
    """Draw one curve for each assembly, and the median on top."""
    plt = pyplot()
    names = list(dict.fromkeys(line["set"] for line in lines))
    figure, axes = plt.subplots(
        1, len(names), figsize=(4.2 * len(names), 3.2), sharey=True, squeeze=False
    )
    for panel, name in zip(axes[0], names, strict=True):
        lines_of_set = [line for line in lines if line["set"] == name]
        seconds = np.array(
            [[float(x[f"{t:.0e}"]) for t in TARGETS] for x in lines_of_set]
        )
        for curve in seconds:
            panel.plot(TARGETS, curve, color="0.75", lw=0.7)
        middle = np.quantile(seconds, 0.5, axis=0, method="higher")
        panel.plot(TARGETS, middle, color="#000000", marker="o", ms=4, lw=2.2)
        panel.set(xscale="log", yscale="log", xlim=(2e-2, 5e-11), title=TITLES[name])
        panel.set_xlabel("residual η")
        light_grid(panel)
    axes[0][0].set_ylabel("seconds; black: median")
    figure.tight_layout()
    figure.savefig(target, dpi=100)
    plt.close(figure)


def main():
    """Measure, write the results, print the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--sets", default=",".join(grains.SETS))
    parser.add_argument("--seeds", type=int, default=50, help="how many")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds-limit", type=float, default=SECONDS)
    args = parser.parse_args()
    path = tables.RESULTS / "granular.csv"
    stored = tables.read_rows(path) if path.exists() else []
    kept = {(x["set"], int(x["seed"])): x for x in stored}
    last = args.first_seed + args.seeds
    for name in args.sets.split(","):
        for seed in range(args.first_seed, last):
            line = measure(name, seed, args.seconds_limit)
            print(*line.values(), file=sys.stderr, flush=True)
            kept[name, seed] = line
            if not args.print:
                write(path, kept)
    lines = list(kept.values())
    tables.publish("walls and packings", table(lines), write=not args.print)
    if not args.print:
        draw(lines, path.with_suffix(".png"))


def write(path, kept):
    """Write the CSV file, ordered by set and seed."""
    order = list(grains.SETS)
    lines = sorted(kept.items(), key=lambda x: (order.index(x[0][0]), x[0][1]))
    tables.write_rows(path, [line for _, line in lines])


if __name__ == "__main__":
    main()
