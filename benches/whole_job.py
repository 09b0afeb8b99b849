"""Time whole jobs of bipot_rs and its peers, from the mesh to the written result.

    python benches/whole_job.py                  # the tables of both README files
    python benches/whole_job.py --quick
    python benches/whole_job.py --scenes sheared_cube=9,15 --rounds 2 --budget 60 --print

The programs run in turn, round after round, so that all meet the same load of the
machine; a ratio is the median of the ratios within a round. Each run is its own process.
bipot_rs uses all threads. A peer runs with one BLAS thread and with all, and continues
with the faster; if a run is predicted to take more than half a minute, it keeps the
choice of the previous size. A peer whose own slope predicts more than ``--budget``
seconds is not run. Every result is compared with the stored reference of the mesh; an
error above 1e-8 or a wrong status is marked. Without a reference, bipot_rs is compared
with the first peer, and the peers with bipot_rs.

Rewrites the table of `benches/README.md`, the short one of `README.md`, and
`results/whole_job.csv`, which `whole_job_figure.py` draws. ``--quick`` writes copies
into `out/bench`.
"""

import argparse
import math
import os
from pathlib import Path
from statistics import median

import compare_tractions
import tables
from peers import commands

HERE = Path(__file__).resolve().parent
SHEET = "whole_job.csv"
FIRST = HERE.parent / "README.md"
# Rows of the table of the first README.
SHOWN = (
    ("pressed_block", 32),
    ("pressed_block", 128),
    ("sheared_cube", 15),
    ("sheared_cube", 24),
    ("cattaneo_mindlin", 40),
    ("two_blocks", 16),
    ("cyclic_cube", 15),
)
# A result with a larger traction error is not comparable.
TARGET = 1e-8
# Seconds of a run above which a peer keeps its number of threads.
LONG = 30.0
SIZES = {
    "pressed_block": (32, 64, 128),
    "sheared_cube": (9, 15, 24, 40),
    "cattaneo_mindlin": (10, 20, 40),
    "two_blocks": (8, 16, 24),
    "cyclic_cube": (9, 15),
}
QUICK = {
    "pressed_block": (32,),
    "sheared_cube": (5, 9),
    "cattaneo_mindlin": (5,),
    "two_blocks": (4, 8),
    "cyclic_cube": (5,),
}
PLANE = ("pressed_block", "cattaneo_mindlin")
# Phases of the programs that make up each part of a job.
PARTS = {
    "assemble": ("mesh", "assemble"),
    "condense": ("condense", "bricks", "factor", "compliance"),
    "contact": ("solve", "recover", "contact"),
    "write": ("write",),
}
COLUMNS = (
    *tables.columns("scene | n | dofs | contacts | steps | program | threads | rounds"),
    *PARTS,
    *tables.columns(
        "job_min | job_median | process | later_step | error | wrong_statuses | "
        "against | peak_mb | ratio | later_ratio | note | version | machine | "
        "load"
    ),
)


def predicted(known, unknowns, scene):
    """Seconds predicted for a peer, from its smaller sizes of the scene.

    ``known`` is ``[(dofs, seconds, threads), …]``. The slope is that of the last two
    sizes; with one size it is the theoretical one.
    """
    if not known:
        return 0.0
    slope = 1.5 if scene in PLANE else 2.0
    if len(known) > 1:
        (n0, s0, _), (n1, s1, _) = known[-2:]
        slope = max(1.0, math.log(s1 / s0) / math.log(n1 / n0))
    dofs, seconds, _ = known[-1]
    return seconds * (unknowns / dofs) ** slope


class Comparison:
    """All programs on one scene at one size."""

    def __init__(self, scene, n, bipot, peers, args, histories):
        self.scene, self.n, self.args = scene, n, args
        self.bipot, self.histories = bipot, histories
        self.runs = {bipot: []}
        self.threads = {bipot: bipot.threads}
        self.notes, self.settings = {}, {}
        # bipot_rs first: the predictions for the peers need its number of unknowns.
        self.add(bipot)
        self.dofs = self.runs[bipot][0].dofs
        for peer in peers:
            self.runs[peer], self.threads[peer] = [], peer.threads
            expected = predicted(histories[peer], self.dofs, scene)
            if expected > LONG:
                self.threads[peer] = (histories[peer][-1][2],)
                self.settings[peer] = "threads as at the previous size"
            if peer.missing:
                self.notes[peer] = f"not run: {peer.missing}"
            elif expected > args.budget:
                self.notes[peer] = f"not run: predicted {expected:.0f} s"

    def add(self, program):
        """Run a program once with each number of threads not yet excluded."""
        limit = None if program is self.bipot else 3 * self.args.budget
        runs_of_threads = {}
        for threads in self.threads[program]:
            runs_of_threads[threads] = program.run(
                self.scene, self.n, threads, limit=limit
            )
        best = min(runs_of_threads, key=lambda threads: runs_of_threads[threads].job)
        self.threads[program] = (best,)
        self.runs[program].append(runs_of_threads[best])

    def run(self):
        """Run all rounds of all programs; return the rows."""
        spent = 0.0
        for turn in range(self.args.rounds):
            if turn:
                alone = len(self.notes) + 1 == len(self.runs)
                if spent * (turn + 1) / turn > self.args.patience or (
                    alone and turn > 1
                ):
                    break
                self.add(self.bipot)
            spent += self.runs[self.bipot][-1].process
            for peer in self.runs:
                if peer is self.bipot or peer in self.notes:
                    continue
                try:
                    self.add(peer)
                    spent += self.runs[peer][-1].process
                except commands.Failed as why:
                    self.notes[peer] = f"not solved: {why}"
                    self.runs[peer].clear()
        return list(self.rows())

    def rows(self):
        """One dictionary for each program."""
        reference, against = compare_tractions.stored(self.scene, self.n), "reference"
        own_runs = self.runs[self.bipot]
        for program, runs in self.runs.items():
            row = dict.fromkeys(COLUMNS, "")
            row |= {"scene": self.scene, "n": self.n, "dofs": self.dofs}
            row |= {"contacts": len(own_runs[0].x), "steps": len(own_runs[0].R)}
            row |= {"program": program.name, "note": self.notes.get(program, "")}
            if not runs:
                yield row
                continue
            answer = min(runs, key=lambda run: run.job)
            other = reference
            if reference is None:
                other, against = self.other(program)
            if other is not None:
                error, wrong = compare_tractions.compare(answer, other)
                row |= {"error": error, "wrong_statuses": wrong, "against": against}
            jobs = [run.job for run in runs]
            row |= {
                part: sum(answer.phases.get(name, 0.0) for name in names)
                for part, names in PARTS.items()
            }
            row |= {
                "threads": self.threads[program][0],
                "rounds": len(runs),
                "job_min": min(jobs),
                "job_median": median(jobs),
                "process": answer.process,
                "peak_mb": max(run.peak_mb for run in runs),
                "note": row["note"] or self.remarks(program, answer),
            }
            if answer.later is not None:
                row["later_step"] = min(run.later for run in runs)
            if program is not self.bipot:
                pairs = list(zip(runs, own_runs, strict=False))
                row["ratio"] = median(run.job / mine.job for run, mine in pairs)
                if answer.later is not None:
                    row["later_ratio"] = median(
                        run.later / mine.later for run, mine in pairs
                    )
                self.histories[program].append(
                    (self.dofs, min(jobs), self.threads[program][0])
                )
            yield row

    def remarks(self, program, answer):
        """Settings that the run reports, and those chosen before it."""
        return "; ".join(filter(None, (answer.settings, self.settings.get(program))))

    def other(self, program):
        """Result to compare with if no reference is stored, and its program."""
        run_of_ours = self.runs[self.bipot][0]
        as_reference = {
            "x": run_of_ours.x,
            "area": run_of_ours.area,
            "mu": run_of_ours.mu,
        }
        if program is not self.bipot:
            return as_reference | {
                "R": run_of_ours.R,
                "v": run_of_ours.v,
            }, self.bipot.name
        for peer, runs in self.runs.items():
            if peer is not self.bipot and runs:
                run = runs[0]
                order = compare_tractions.nearest(run.x, run_of_ours.x)
                arrays = {"R": run.R[:, order], "v": run.v[:, order]}
                return as_reference | arrays, peer.name
        return None, ""


def trusted(row):
    """Whether the error and the statuses of a row are right."""
    return row["error"] == "" or (
        float(row["error"]) <= TARGET and int(row["wrong_statuses"]) == 0
    )


HEAD = (
    *tables.columns("scene, n | dofs | contacts | steps | program | threads"),
    *PARTS,
    *tables.columns(
        "job | median | process | later step | traction error | statuses | "
        "peak MB | ratio"
    ),
)


def cells(row):
    """Row of the table from a row of the CSV file."""
    first = row["program"] == "bipot_rs"
    scene = (f"{row['scene']}, {row['n']}", f"{int(row['dofs']):,}")
    scene += (str(row["contacts"]), str(row["steps"]))
    head = (*(scene if first else ("",) * 4), row["program"])
    if row["job_min"] == "":
        return (*head, *("",) * (len(HEAD) - len(head) - 1), row["note"])
    seconds = [float(row[key]) if row[key] != "" else None for key in PARTS]
    times = [
        float(row[key]) if row[key] != "" else None
        for key in ("job_min", "job_median", "process", "later_step")
    ]
    mark = "" if trusted(row) else " !"
    error = ""
    if row["error"] != "":
        error = f"{float(row['error']):.0e}"
        error += "" if row["against"] == "reference" else f" (to {row['against']})"
        wrong = int(row["wrong_statuses"])
        statuses = f"{wrong} wrong" if wrong else "right"
    else:
        statuses = "unchecked"
    return (
        *head,
        str(row["threads"]),
        *(tables.figures(s) if s else "" for s in seconds),
        tables.figures(times[0]) + mark,
        *(tables.figures(s) for s in times[1:]),
        error,
        statuses,
        f"{float(row['peak_mb']):.0f}",
        f"{float(row['ratio']):.1f}" if row["ratio"] != "" else "",
    )


def conclusion(rows):
    """Ratio of the fastest correct peer to bipot_rs, scene by scene."""
    best, later = {}, {}
    for row in rows:
        key = place(row)
        if row["program"] != "bipot_rs" and row["ratio"] != "" and trusted(row):
            best[key] = min(
                best.get(key, (math.inf, "")), (float(row["ratio"]), row["program"])
            )
            if row["later_ratio"] != "":
                later[key] = min(
                    later.get(key, (math.inf, "")),
                    (float(row["later_ratio"]), row["program"]),
                )
    if not best:
        return "No peer is installed."

    def words(found, keys):
        return ", ".join(
            f"{scene} {n} {found[scene, n][0]:.1f} ({found[scene, n][1]})"
            for scene, n in keys
        )

    won = sorted((k for k in best if best[k][0] >= 1), key=lambda k: -best[k][0])
    lost = [k for k in best if best[k][0] < 1]
    text = (
        "Job of the fastest peer with a correct result, divided by that of bipot_rs: "
    )
    text += (words(best, won) or "nowhere above 1") + "."
    text += f" Slower than a peer: {words(best, lost) if lost else 'nowhere'}."
    if later:
        text += f" The same ratio of a later load step: {words(later, later)}."
    return text


def written(rows):
    """Text between the markers of the page."""
    machines = tables.machines(rows)
    versions = ", ".join(
        dict.fromkeys(row["version"] for row in rows if row["version"])
    )
    loads = sorted(float(row["load"]) for row in rows)
    return "\n\n".join(
        (
            f"{machines}, load {loads[0]:g} to {loads[-1]:g}; {versions}.",
            tables.table(HEAD, map(cells, rows)),
            conclusion(rows),
        )
    )


def short(rows):
    """Table of the first README: bipot_rs and the fastest peer of each size shown."""
    head = tables.columns(
        "scene, n | unknowns | contacts | steps | "
        "bipot_rs | fastest other | ratio | traction error"
    )
    lines = []
    for scene, n in SHOWN:
        rows_of_scene = [
            row for row in rows if place(row) == (scene, n) and row["job_min"]
        ]
        bipot = next(row for row in rows_of_scene if row["program"] == "bipot_rs")
        peers = (row for row in rows_of_scene if row is not bipot)
        best = min(peers, key=lambda row: float(row["job_min"]))
        lines.append(
            (
                f"{scene}, {n}",
                f"{int(bipot['dofs']):,}",
                str(bipot["contacts"]),
                str(bipot["steps"]),
                tables.figures(float(bipot["job_min"])),
                f"{tables.figures(float(best['job_min']))} {best['program']}",
                f"{float(best['ratio']):.1f}",
                f"{float(bipot['error']):.0e}",
            )
        )
    return tables.table(head, lines)


def chosen(argument, sizes):
    """Scenes and sizes that the command line asks for."""
    if not argument:
        return sizes
    pairs = (pair_text.partition("=") for pair_text in argument)
    return {
        name: tuple(map(int, some.split(","))) if some else SIZES[name]
        for name, _, some in pairs
    }


def measure(args):
    """Yield the rows of each scene and size."""
    bipot, peers = commands.Bipot(), commands.peers()
    versions = {
        p.name: "" if getattr(p, "missing", "") else p.version()
        for p in (bipot, *peers)
    }
    print(", ".join(filter(None, versions.values())), flush=True)
    for scene, sizes in chosen(args.scenes, QUICK if args.quick else SIZES).items():
        histories = {peer: [] for peer in peers}
        for n in sizes:
            measured = Comparison(scene, n, bipot, peers, args, histories).run()
            for row in measured:
                row["version"] = versions[row["program"]]
                row["machine"] = tables.processor()
                row["load"] = f"{os.getloadavg()[0]:.1f}"
                print("| " + " | ".join(cells(row)) + " |", flush=True)
            yield measured


def place(row):
    """Scene and size of a row."""
    return row["scene"], int(row["n"])


def merged(old, new):
    """Replace the rows of the sizes measured again; order as in `SIZES`."""
    measured = {place(row) for row in new}
    rows = [row for row in old if place(row) not in measured] + new
    order = list(SIZES)
    return sorted(rows, key=lambda row: (order.index(row["scene"]), int(row["n"])))


def store(rows, folder, first):
    """Write the CSV file and the tables; with ``first`` that of the first README too."""
    text = written(rows)
    tables.write_rows(folder / "results" / SHEET, rows)
    tables.rewrite(folder / "README.md", "whole jobs", text)
    if first:
        text = f"{short(rows)}\n\n{tables.machines(rows)}."
        tables.rewrite(FIRST, "whole jobs", text)


def main():
    """Measure; rewrite the pages after each size, because a long run may be interrupted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="*", help="SCENE=N,N…; other rows are kept")
    parser.add_argument("--quick", action="store_true", help="small sizes, two rounds")
    parser.add_argument("--rounds", type=int)
    parser.add_argument("--budget", type=float, help="seconds for one run of a peer")
    parser.add_argument(
        "--patience", type=float, default=400.0, help="seconds for one size"
    )
    parser.add_argument("--print", action="store_true", help="write no files")
    parser.add_argument(
        "--again", action="store_true", help="write the tables from the stored CSV file"
    )
    args = parser.parse_args()
    args.rounds = args.rounds or (2 if args.quick else 5)
    args.budget = args.budget or (20.0 if args.quick else 240.0)
    folder = tables.folder(args.quick)
    stored = folder / "results" / SHEET
    kept = (args.scenes or args.again) and stored.exists()
    rows = tables.read_rows(stored) if kept else []
    for new_rows in () if args.again else measure(args):
        rows = merged(rows, new_rows)
        if not args.print:
            store(rows, folder, first=not args.quick)
    if args.again:
        store(rows, folder, first=not args.quick)
    print(conclusion(rows))


if __name__ == "__main__":
    main()
