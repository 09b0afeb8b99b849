"""Ratios of other programs to bipot_rs, from the stored results of the benches.

    python benches/ratios.py

Nothing is measured. The table is that of `docs/comparison.md`. A ratio is the number of the
other program divided by that of bipot_rs on the same problem: above 1 bipot_rs needs less.
"""

import statistics
import sys
from pathlib import Path

import tables
import whole_job

PAGE = Path(__file__).resolve().parents[1] / "docs" / "comparison.md"
NAME = "ratios"
HEAD = tables.columns(
    "what | other program | cases | least | median | largest | other program needs less in"
)
PEERS = ("GetFEM", "Siconos", "SciPy")
# Names of Siconos' methods in the files of the benches.
METHODS = {
    "NSGS": "Siconos, Gauss–Seidel",
    "NSN_AC": "Siconos, semismooth Newton",
}
ETA = "1e-08"
# Contacts up to which a call from Python may take longer than the solution.
SMALL = 100
PETSC = {
    "newton": "load path with a multigrid preconditioner",
    "linear": "one linear system with multigrid",
}


def line(what, program, ratios):
    """Row of the table; ``ratios`` holds one number for each case."""
    spread = (min(ratios), statistics.median(ratios), max(ratios))
    lost = sum(ratio < 1 for ratio in ratios)
    return (
        what,
        program,
        str(len(ratios)),
        *(f"{x:,.0f}" if x >= 9.95 else f"{x:#.2g}" for x in spread),
        str(lost) if lost else "none",
    )


def whole_jobs():
    """Ratios from the mesh to the written result; tractions are right to 1e-8."""
    rows = [
        row
        for row in tables.read_rows(tables.RESULTS / whole_job.SHEET)
        if row["job_min"] != "" and whole_job.trusted(row)
    ]
    ours = {whole_job.place(row): row for row in rows if row["program"] == "bipot_rs"}
    others = {name: [r for r in rows if r["program"] == name] for name in PEERS}

    def compared(key, name):
        return [
            float(row[key]) / float(ours[whole_job.place(row)][key])
            for row in others[name]
        ]

    plane = {
        "whole job, plane": lambda row: row["scene"] in whole_job.PLANE,
        "whole job, space": lambda row: row["scene"] not in whole_job.PLANE,
    }
    for what, chosen in plane.items():
        for name in PEERS:
            # The median of the rounds, not a ratio of two minima.
            ratios = [float(r["ratio"]) for r in others[name] if chosen(r)]
            yield what, name, ratios
    for name in PEERS:
        later = [float(r["later_ratio"]) for r in others[name] if r["later_ratio"]]
        yield "a load step after the first", name, later
    for what, key in (
        ("whole process, with start and imports", "process"),
        ("peak memory", "peak_mb"),
    ):
        for name in PEERS:
            yield what, name, compared(key, name)


def files_of_fclib():
    """Ratios of files that both programs solve to the residual ``ETA``, by their size."""
    solved = {}
    for row in tables.read_rows(tables.RESULTS / "fclib.csv"):
        if row["target"] == ETA and row["solved"] == "True":
            solved[row["program"], row["file"]] = row
    for what, least, most in (
        (f"FCLIB files of up to {SMALL} contacts", 0, SMALL),
        (f"FCLIB files of more than {SMALL} contacts", SMALL + 1, sys.maxsize),
    ):
        for method, name in METHODS.items():
            ratios = [
                float(row["seconds"]) / float(solved["auto", file]["seconds"])
                for (program, file), row in solved.items()
                if program == method
                and ("auto", file) in solved
                and least <= int(row["contacts"]) <= most
            ]
            yield what, name, ratios


def petsc():
    """Ratios of PETSc on the same matrices; the median of the rounds of each size."""
    rounds = {}
    for row in tables.read_rows(tables.RESULTS / "beside_petsc.csv"):
        case = rounds.setdefault((row["problem"], row["cells"]), {})
        case.setdefault(row["program"], {})[row["round"]] = float(row["total"])
    for problem, what in PETSC.items():
        ratios = [
            statistics.median(
                case["PETSc"][number] / case["bipot_rs"][number]
                for number in case["PETSc"]
            )
            for (kind, _), case in rounds.items()
            if kind == problem
        ]
        yield what, "PETSc", ratios


def table():
    """Markdown table of all ratios; without the programs that were not run."""
    ratios = (*whole_jobs(), *files_of_fclib(), *petsc())
    return tables.table(HEAD, [line(*ratio) for ratio in ratios if ratio[-1]])


if __name__ == "__main__":
    tables.rewrite(PAGE, NAME, table())
