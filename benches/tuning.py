"""What half and twice each fitted constant does to the set it was fitted on.

    python benches/tuning.py
    python benches/tuning.py --only solver::tuning::gain --seeds 150

Compiles the core with the feature ``tuning`` into ``out/tuning``, where the environment
variable BIPOT_TUNING replaces one constant of the ``tuning.rs`` files. Constants of a
``tuning.py`` of the package are replaced in all modules that have read them. Each variant is
a process of its own. What is printed is counted, not timed (`tuning_sets.py`): products with
W or K, Krylov iterations, operations of the factorisation. A problem that is not solved is
counted apart. Rewrites ``results/tuning.csv``, with ``--only`` the rows that are measured.
"""

import argparse
import ast
import csv
import importlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import tables
from tuning_sets import RUNS

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "tuning"
SHEET = "tuning.csv"
BESIDE = (ROOT / "benches", ROOT / "tests" / "python")
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
    "condensation": "candidates",
    "proof": "proofs",
    "bodies": "bodies",
}
# The set of each module of constants.
MODULE_SETS = {
    "contact": "paths",
    "discretisation": "discretisation",
    "petsc": "petsc",
    "fem": "models",
    "mortar": "models",
    "obstacle": "models",
}


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
        numbers = [float(part.replace("_", "")) for part in self.value.split("/")]
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
        kind = MODULE_SETS[path.parent.name]
        for name, value in read_numbers(path).items():
            constants.append(Constant(f"{module}.{name}", repr(value), kind))
    return constants


def read_numbers(path: Path) -> dict[str, float]:
    """The numbers that the assignments of a module give to names."""
    return {
        name: value
        for name, value in runpy.run_path(str(path)).items()
        if name.isupper() and isinstance(value, (int, float))
    }


def compile_core() -> Path:
    """A copy of the package whose core has the feature ``tuning``."""
    command = "cargo rustc --release --locked --lib --crate-type cdylib --features python,tuning"
    # Counts are the same at each level, and this one compiles in a third of the time.
    quick = "profile.release.package.bipot_rs.opt-level=1"
    options = ["--config", quick, "--target-dir", OUT / "target"]
    subprocess.run([*command.split(), *options], cwd=ROOT, check=True)
    package = OUT / "python" / "bipot_rs"
    shutil.rmtree(package, ignore_errors=True)
    shutil.copytree(ROOT / "python" / "bipot_rs", package)
    shutil.copy(
        OUT / "target" / "release" / "libbipot_rs.so", package / "_core.abi3.so"
    )
    return OUT / "python"


def measure(package: Path, kind: str, seeds: int, change: str = "") -> dict[str, float]:
    """The counts of a set in a process of its own, with one constant changed."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, (package, *BESIDE))),
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
        before = getattr(importlib.import_module(module), constant)
        for reader in [m for n, m in sys.modules.items() if n.startswith("bipot_rs.")]:
            if getattr(reader, constant, None) is before:
                setattr(reader, constant, ast.literal_eval(value))
    print(json.dumps(RUNS[kind](kind, seeds)))


def compared(counts: dict[str, float], usual: dict[str, float]) -> str:
    """The change of the work, and what is not solved besides."""
    change = 100.0 * (counts["work"] / usual["work"] - 1.0)
    more = int(counts["unsolved"] - usual["unsolved"])
    text = "same" if counts == usual else f"{change:+.1f} %"
    return text if more == 0 else f"{text}, {more:+d} unsolved"


def merge_rows(rows: list[dict[str, object]], some: bool) -> list[dict[str, object]]:
    """The rows of the sheet; if only some constants were measured, the others stay."""
    if not some:
        return rows
    measured = {row["constant"]: row for row in rows}
    names = [c.name for c in (*rust_constants(), *python_constants())]
    with (tables.RESULTS / SHEET).open(encoding="utf-8", newline="") as file:
        before = {row["constant"]: dict(row) for row in csv.DictReader(file)}
    merged = before | measured
    return [merged[name] for name in names if name in merged]


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
    missing: set[str] = set()
    for constant in (*rust_constants(), *python_constants()):
        if options.only not in constant.name:
            continue
        kind = constant.set
        if kind in missing:
            continue
        if kind not in usual:
            try:
                usual[kind] = measure(package, kind, options.seeds)
            except subprocess.CalledProcessError as error:
                missing.add(kind)
                print(f"{kind} is left out: {error.stderr.splitlines()[-1]}")
                continue
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
    tables.write_rows(tables.RESULTS / SHEET, merge_rows(rows, bool(options.only)))


if __name__ == "__main__":
    main()
