"""What half and twice each fitted constant does to the set it was fitted on.

    python benches/tuning.py
    python benches/tuning.py --only solver::tuning::gain --seeds 150

Compiles the core with the feature ``tuning`` into ``out/tuning``, where the environment
variable BIPOT_TUNING replaces one constant of the ``tuning.rs`` files. Constants of a
``tuning.py`` of the package are replaced in the module, so that their users must read them as
``tuning.NAME``. Each variant is a process of its own. What is printed is counted, not timed:
products with W or K, Krylov iterations, operations of the factorisation. A problem that is
not solved is counted apart. Rewrites ``results/tuning.csv``.
"""

import argparse
import ast
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tables

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "tuning"
SHEET = "tuning.csv"
# The set of each file of constants, or of the section of one.
SETS = {
    "solver": "reduced",
    "solver/uzawa": "projections",
    "solver/multipliers": "penalties",
    "solver/convex": "principles",
    "solver/minimising_sequence": "principles",
    "solver/pivoting": "pivoting",
    "primal": "iterative",
    "linalg/amg": "iterative",
    "linalg/sparse": "direct",
    "path": "candidates",
}
METHODS = {
    "reduced": ("auto",),
    "projections": ("nesterov", "uzawa", "uzawa_two_projection"),
    "penalties": ("return_mapping", "perturbed_lagrangian"),
    "principles": (
        "displacement_principle",
        "alternating_principles",
        "stress_principle",
        "minimising_sequence",
    ),
    "pivoting": ("pivoting",),
}
FLOATING = ("floating", "rigid")
# The iterations of a method that hardly converges.
MOST = 2000


@dataclass(frozen=True)
class Constant:
    """A fitted constant: its name, its value as it is written, and the set it is tried on."""

    name: str
    value: str
    set: str

    def scaled(self, factor: float) -> str:
        """The value times ``factor``, a whole number if it is one."""
        if re.fullmatch(r"[\d_]+", self.value):
            return str(max(1, round(int(self.value) * factor)))
        numbers = [float(part) for part in self.value.split("/")]
        return repr(numbers[0] / (numbers[1] if len(numbers) > 1 else 1.0) * factor)


def rust_constants() -> list[Constant]:
    """The constants of all ``tuning.rs``."""
    constants = []
    for path in sorted((ROOT / "src").rglob("tuning.rs")):
        layer = path.parent.relative_to(ROOT / "src").as_posix()
        section = ""
        for line in path.read_text(encoding="utf-8").splitlines():
            if head := re.fullmatch(r"    // (\w+)\.rs", line):
                section = head[1]
            if entry := re.fullmatch(r"    (\w+): (?:f64|usize) = (.*);", line):
                name = f"bipot_rs::{layer.replace('/', '::')}::tuning::{entry[1]}"
                kind = SETS.get(f"{layer}/{section}", SETS.get(layer, "reduced"))
                constants.append(Constant(name, entry[2], kind))
    return constants


def python_constants() -> list[Constant]:
    """The numbers in capitals of all ``tuning.py`` of the package."""
    constants = []
    for path in sorted((ROOT / "python" / "bipot_rs").rglob("tuning.py")):
        module = ".".join(path.relative_to(ROOT / "python").with_suffix("").parts)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            match node:
                case ast.Assign(
                    targets=[ast.Name(id=name)], value=ast.Constant(value=value)
                ):
                    constants.append(
                        Constant(f"{module}.{name}", repr(value), "iterative")
                    )
    return constants


def compile_core() -> Path:
    """A copy of the package whose core has the feature ``tuning``."""
    command = "cargo rustc --release --locked --lib --crate-type cdylib --features python,tuning"
    subprocess.run(
        [*command.split(), "--target-dir", OUT / "target"], cwd=ROOT, check=True
    )
    package = OUT / "python" / "bipot_rs"
    shutil.rmtree(package, ignore_errors=True)
    shutil.copytree(ROOT / "python" / "bipot_rs", package)
    shutil.copy(
        OUT / "target" / "release" / "libbipot_rs.so", package / "_core.abi3.so"
    )
    return OUT / "python"


def run_reduced(kind: str, seeds: int) -> dict[str, float]:
    """The products with W of the random sets of `problems.py`."""
    import problems

    import bipot_rs as bp

    work, unsolved = 0.0, 0
    names = set(problems.SETS) - {"scenes"}
    if kind not in {"reduced", "projections"}:
        names -= set(FLOATING)
    for name in sorted(names):
        for seed in range(seeds):
            p = problems.SETS[name](seed)
            reduced = bp.ReducedProblem(p.W, p.q, p.mu, rigid=p.rigid)
            for method in METHODS[kind]:
                most = None if kind == "reduced" else MOST
                solution = reduced.solve(method=method, max_iterations=most)
                unsolved += not solution.converged
                work += solution.work if solution.converged else 0.0
    return {"work": work, "unsolved": unsolved}


def run_scenes(kind: str, _seeds: int) -> dict[str, float]:
    """The products with K, or the operations of the factorisation, of the shipped scenes."""
    from bipot_rs import scene

    work, unsolved = 0.0, 0
    engine = "iterative" if kind == "iterative" else "direct"
    cells = {
        "pressed_block": 10,
        "sheared_cube": 8,
        "two_blocks": 8,
        "cattaneo_mindlin": 6,
    }
    if kind == "candidates":
        cells = {"pressed_block": 24, "cattaneo_mindlin": 8}
    for name, n in cells.items():
        read = scene.read(name, [f"mesh.n={n}"])
        case = scene.assemble(read, scene.bodies(read))
        problem = case.problem(engine=engine)
        if kind == "direct":
            work += problem.stats["flops"]
            continue
        result = problem.solve(case.load, case.prescribed)
        unsolved += not result.success
        work += float(sum(step.work for step in result))
    return {"work": work, "unsolved": unsolved}


RUNS: dict[str, Callable[[str, int], dict[str, float]]] = {
    **dict.fromkeys(METHODS, run_reduced),
    **dict.fromkeys(("iterative", "direct", "candidates"), run_scenes),
}


def measure(package: Path, kind: str, seeds: int, change: str = "") -> dict[str, float]:
    """The counts of a set in a process of its own, with one constant changed."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(package), str(ROOT / "benches"))),
        "BIPOT_TUNING": change,
    }
    command = [sys.executable, __file__, "--count", kind, "--seeds", str(seeds)]
    run = subprocess.run(
        command, env=environment, check=True, capture_output=True, text=True
    )
    counts: dict[str, float] = json.loads(run.stdout)
    return counts


def count(kind: str, seeds: int) -> None:
    """Print the counts of a set; a constant of Python is replaced first."""
    name, _, value = os.environ.get("BIPOT_TUNING", "").partition("=")
    if "." in name:
        module, _, constant = name.rpartition(".")
        setattr(importlib.import_module(module), constant, ast.literal_eval(value))
    print(json.dumps(RUNS[kind](kind, seeds)))


def compared(counts: dict[str, float], usual: dict[str, float]) -> str:
    """The change of the work, and what is not solved besides."""
    change = 100.0 * (counts["work"] / usual["work"] - 1.0)
    more = int(counts["unsolved"] - usual["unsolved"])
    text = "same" if counts == usual else f"{change:+.1f} %"
    return text if more == 0 else f"{text}, {more:+d} unsolved"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="constants whose name contains this")
    parser.add_argument(
        "--seeds", type=int, default=10, help="seeds of each random set"
    )
    parser.add_argument("--count", choices=RUNS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.count:
        count(options.count, options.seeds)
        return
    package = compile_core()
    rows: list[dict[str, object]] = []
    usual: dict[str, dict[str, float]] = {}
    for constant in (*rust_constants(), *python_constants()):
        if options.only not in constant.name:
            continue
        kind = constant.set
        if kind not in usual:
            usual[kind] = measure(package, kind, options.seeds)
        row: dict[str, object] = {
            "constant": constant.name,
            "set": kind,
            "value": constant.value,
        }
        for head, factor in (("half", 0.5), ("twice", 2.0)):
            change = f"{constant.name}={constant.scaled(factor)}"
            counts = measure(package, kind, options.seeds, change)
            row[head] = compared(counts, usual[kind])
        print(" | ".join(map(str, row.values())), flush=True)
        rows.append(row)
    if not options.only:
        tables.write_rows(tables.RESULTS / SHEET, rows)


if __name__ == "__main__":
    main()
