"""Solve the collection of load paths with all methods and with Siconos.

    python benches/load_paths.py
    python benches/load_paths.py --largest 130 --methods auto,newton
    python benches/load_paths.py --again

The rules are those of docs/collection.md: each file is solved from r = 0 on one thread to
η = 1e-4, 1e-8 and 1e-12, as in `fclib.py`, with the same certificate and the same Siconos. The
cost of a path is the sum over its files, infinite if one of them is not solved. A file without
an answer is solved if the program says that there is none. Siconos has no such outcome and no
rigid motions, and is given no problem above 2000 contacts; some methods of this package need
supports. What a program does not accept is unsolved by it, and further profiles show the paths
that all programs accept. Work is counted in products with W; an iteration of NSGS, a sweep over
all contacts, is one. The Newton method of Siconos counts iterations only, and has no curve of
work.

The distance to the nearest reference is `error`, relative, of u and, if it is unique, of r.

The files are written to the folder of `problems.py` if they are not there, or to that of
``--data``. A method that fails at a target is not tried at a smaller one. Writes
`results/load_paths.csv`, draws the profiles `results/load_paths.png` and, with all methods and
paths, rewrites the table of the README. ``--again`` makes both from the CSV file.
"""

import itertools
import os
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
import problems
import tables
from collection import manifest, write
from fclib import LARGEST_DENSE, SICONOS, TARGETS, ScaledProblem, siconos_answer
from fclib_figure import PROGRAMS, profile
from peers.siconos_process import find
from plot_style import light_grid, pyplot
from speed_against_error import METHODS, NEED_SUPPORTS, available
from timing import repeated

import bipot_rs as bp

SHEET = "load_paths.csv"
COLUMNS = tables.columns(
    "file | path | family | contacts | dim | program | accepted | target | solved | "
    "seconds | work | eta | error"
)
UNSOLVED = (False, np.inf, np.inf, np.inf, np.inf)
COSTS = {"seconds": "seconds / the fastest", "work": "products / the fewest"}
# Rows of the figure: cost, whether only paths that all programs accept, title.
PANELS = (
    ("seconds", False, "all paths"),
    ("seconds", True, "accepted by all"),
    ("work", True, "accepted by all"),
)


class File:
    """A file of the collection: its problem and its references."""

    def __init__(self, path, row):
        self.problem, self.row = ScaledProblem(path), row
        solution = bp.fclib.read_solution(path)
        others = bp.fclib.read_guesses(path) if row.answers > 1 else []
        self.answers = [solution, *others] if row.answers else []

    def error(self, reaction, amounts=None):
        """Distance to the nearest reference."""
        reduced = self.problem.reduced
        deformed = (reduced.W @ reaction.ravel()).reshape(reaction.shape)
        u = deformed + reduced.q
        if reduced.rigid is not None:
            u = u + (reduced.rigid[0] @ amounts).reshape(u.shape)
        errors = []
        for answer in self.answers:
            sizes = [np.abs(x).max() for x in (answer.u, reduced.q, deformed)]
            far = np.abs(u - answer.u).max() / (max(sizes) or 1.0)
            if self.row.determined == "r and u":
                size = np.abs(answer.r).max() or 1.0
                far = max(far, np.abs(reaction - answer.r).max() / size)
            errors.append(far)
        return min(errors)


def run_bipot(file, method, target, limit):
    """Whether solved, seconds, products, η, error."""
    seconds, answer = repeated(
        lambda: file.problem.reduced.solve(
            method, target, max_seconds=limit, max_iterations=2**31 - 1, num_threads=1
        )
    )
    if not file.answers:
        refused = answer.outcome is bp.Outcome.NO_EQUILIBRIUM
        return (True, seconds, answer.work, 0.0, 0.0) if refused else UNSOLVED
    met, eta = file.problem.meets(target, answer.reaction, answer.rigid_motion)
    if not (met and answer.converged):
        return UNSOLVED
    error = file.error(answer.reaction, answer.rigid_motion)
    return True, seconds, answer.work, eta, error


def run_siconos(file, solver, target, siconos):
    """As `run_bipot`."""
    answer = siconos_answer(file.problem, solver, target, siconos)
    if answer is None:
        return UNSOLVED
    seconds, reaction, eta = answer
    work = siconos.iterations if solver == "NSGS" else np.nan
    return True, seconds, work, eta, file.error(reaction)


def measure(path, row, methods, siconos, limit):
    """Row of each program and target for one file."""
    file = File(path, row)
    held = file.problem.rigid is None
    programs = [(m, run_bipot, limit, held or m not in NEED_SUPPORTS) for m in methods]
    if siconos:
        able = held and bool(file.answers) and row.contacts <= LARGEST_DENSE
        programs += [(name, run_siconos, siconos, able) for name in SICONOS]
    line_head = (row.file, row.path, row.family, row.contacts, row.dim)
    for name, run, extra, accepted in programs:
        solved = accepted
        for target in TARGETS:
            outcome = run(file, name, target, extra) if solved else UNSOLVED
            solved = outcome[0]
            line = (*line_head, name, accepted, target, *outcome)
            yield dict(zip(COLUMNS, line, strict=True))


def refused(lines, program=None):
    """Paths with a file that the program, or any, does not accept."""
    return {
        line["path"]
        for line in lines
        if str(line["accepted"]) != "True" and program in (None, line["program"])
    }


def costs(lines, target, cost):
    """Cost of each path, ``{program: (paths,)}``, of the programs that count it."""
    paths = list(dict.fromkeys(line["path"] for line in lines))
    costs_of_programs = {}
    for line in lines:
        if float(line["target"]) == target:
            costs_of_paths = costs_of_programs.setdefault(
                line["program"], np.zeros(len(paths))
            )
            solved = str(line["solved"]) == "True"
            costs_of_paths[paths.index(line["path"])] += (
                float(line[cost]) if solved else np.inf
            )
    # Not-a-number plus infinity is not-a-number.
    return {
        name: costs_of_paths
        for name, costs_of_paths in costs_of_programs.items()
        if not np.isnan(costs_of_paths).any()
    }


def table(lines):
    """Markdown table: paths solved, and medians over paths relative to `auto`."""
    head = tables.columns("program | paths accepted | solved to 1e-04 | to 1e-08")
    head += tables.columns("to 1e-12 | seconds / auto | products / auto")
    programs = dict.fromkeys(line["program"] for line in lines)
    rows, middle = [], TARGETS[1]
    for program in programs:
        times = [costs(lines, target, "seconds")[program] for target in TARGETS]
        cells = [f"{len(times[0]) - len(refused(lines, program))} of {len(times[0])}"]
        cells += [f"{np.isfinite(seconds).sum()}" for seconds in times]
        for cost in COSTS:
            costs_of_programs = costs(lines, middle, cost)
            if program not in costs_of_programs or "auto" not in costs_of_programs:
                cells.append("–")
                continue
            both = np.isfinite(costs_of_programs[program]) & np.isfinite(
                costs_of_programs["auto"]
            )
            # Paths that r = 0 solves cost nothing.
            both &= costs_of_programs["auto"] > 0
            ratios = costs_of_programs[program][both] / costs_of_programs["auto"][both]
            cells.append(f"{np.median(ratios):.2g}" if both.any() else "–")
        rows.append((program, *cells))
    return tables.table(head, rows)


def draw(lines, target):
    """Draw the profiles by time and by work, one column for each target."""
    plt = pyplot()
    figure, axes = plt.subplots(3, 3, figsize=(11, 9.1), sharey=True)
    drawn, left = {}, refused(lines)
    for row, (cost, common, title) in zip(axes, PANELS, strict=True):
        chosen = [x for x in lines if not (common and x["path"] in left)]
        count = len({line["path"] for line in chosen})
        for panel, eta in zip(row, TARGETS, strict=True):
            costs_of_programs = costs(chosen, eta, cost)
            # A factor needs a cost; a path that r = 0 solves costs one product.
            floor = 1.0 if cost == "work" else 0.0
            curves = profile(
                {p: np.maximum(x, floor) for p, x in costs_of_programs.items()}
            )
            ends = [x[-1] for x, _ in curves.values() if len(x)]
            edge = 1.3 * max([10.0, *ends])
            # `auto` last, so that it lies on top.
            for program in sorted(curves, key=lambda p: p == "auto"):
                factors, shares = curves[program]
                colour, mark, name = PROGRAMS[program]
                x = np.concatenate([[1.0], factors, [edge]])
                last = shares[-1:] if len(shares) else [0.0]
                y = np.concatenate([[0.0], shares, last])
                width = 2.2 if program == "auto" else 1.3
                line = "--" if program in SICONOS else "-"
                panel.step(x, y, line, where="post", color=colour, lw=width)
                panel.plot(edge, y[-1], color=colour, marker=mark, ms=4, clip_on=False)
                drawn[program] = plt.Line2D(
                    [], [], ls=line, color=colour, marker=mark, label=name
                )
            panel.set(xscale="log", xlim=(1, edge), ylim=(-0.03, 1.03))
            panel.set(xlabel=COSTS[cost], title=f"{title}, η ≤ {eta:.0e} ({count})")
            light_grid(panel)
        row[0].set_ylabel("share of paths solved")
    figure.tight_layout(rect=(0, 0.11, 1, 1))
    handles = [drawn[program] for program in PROGRAMS if program in drawn]
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False)
    figure.savefig(target, dpi=110, metadata={"Software": None})
    plt.close(figure)


def report(lines, *, write):
    """Print the table, wrong errors, and the files that `auto` does not solve."""
    tables.publish("load paths", table(lines), write=write)
    for line in lines:
        if line["program"] == "auto" and str(line["solved"]) != "True":
            print(f"- not solved by auto: {line['file']}, {line['target']}")
    solved = [line for line in lines if str(line["solved"]) == "True"]
    for program, target in itertools.product(
        dict.fromkeys(line["program"] for line in lines), TARGETS
    ):
        chosen_run = (program, target)
        errors = [
            float(x["error"])
            for x in solved
            if (x["program"], float(x["target"])) == chosen_run
        ]
        if errors:
            print(f"- {program}, {target:.0e}: largest error {max(errors):.0e}")


def main():
    """Solve, write the results and draw the figure."""
    parser = tables.parser(__doc__)
    parser.add_argument("--data", type=Path, help="folder of the collection")
    parser.add_argument("--largest", type=int, help="most contacts of a path")
    parser.add_argument("--max-seconds", type=float, default=10.0, help="for one solve")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--siconos", help="the Python that has it")
    parser.add_argument("--again", action="store_true", help="draw the CSV file again")
    parser.add_argument(
        "--out", type=Path, default=tables.RESULTS, help="folder to write to"
    )
    args = parser.parse_args()
    whole = tables.whole(parser, args, "methods", "largest")
    write = whole and not args.print and args.out.resolve() == tables.RESULTS
    lines = tables.read_rows(args.out / SHEET) if args.again else collect(args)
    report(lines, write=write)
    if not args.print:
        args.out.mkdir(parents=True, exist_ok=True)
        tables.write_rows(args.out / SHEET, list(map(_short, lines)))
        draw(lines, (args.out / SHEET).with_suffix(".png"))


def _short(line):
    """A row with four digits of each measured number."""
    return {k: f"{x:.4g}" if isinstance(x, float) else x for k, x in line.items()}


def collect(args):
    """Rows of all files, which are written first if they are missing."""
    data = args.data or problems.folder() / "collection"
    if not (data / manifest.NAME).exists():
        write.generate(data)
    rows = [
        row for row in manifest.read(data) if row.contacts <= (args.largest or np.inf)
    ]
    methods, lines = available(args.methods.split(",")), []
    with tempfile.TemporaryDirectory() as folder:
        siconos = find(args.siconos, folder, args.max_seconds)
        for row in rows:
            path_lines = measure(
                data / row.file, row, methods, siconos, args.max_seconds
            )
            lines += path_lines
        if siconos:
            siconos.close()
    return lines


if __name__ == "__main__":
    main()
