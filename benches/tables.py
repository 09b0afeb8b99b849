"""Tables of a Markdown page, each between two markers, and CSV files of results.

    <!-- NAME, written by PROGRAM -->
    | … |
    <!-- end of NAME -->

The text outside the markers is kept byte for byte.
"""

import argparse
import csv
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
# Vector units by their names in /proc/cpuinfo, the widest first.
VECTORS = {"avx512f": "AVX-512", "avx2": "AVX2", "asimd": "NEON"}
PACKAGES = ("bipot-rs", "numpy", "scipy", "scikit-fem")


def columns(text: str) -> tuple[str, ...]:
    """Column heads from a text such as ``"set | problems | solved"``."""
    return tuple(text.split(" | "))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"{len(row)} cells below a head of {len(head)}: {row}")
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines)


def replaced(page: str, name: str, text: str) -> str:
    """Replace the text between the markers of ``name``, which must exist exactly once."""
    begin = rf"<!-- {re.escape(name)}, written by [^>]* -->\n"
    end = f"<!-- end of {name} -->"
    pattern = re.compile(rf"({begin}).*?({re.escape(end)})", re.DOTALL)
    if len(pattern.findall(page)) != 1 or page.count(end) != 1:
        raise ValueError(f"markers of {name}: the page needs exactly one pair")
    return pattern.sub(lambda m: m[1] + text.strip("\n") + "\n" + m[2], page)


def rewrite(path: Path, name: str, text: str) -> None:
    """Replace a table of a file. An interrupted run leaves the old file."""
    page = replaced(path.read_text(encoding="utf-8"), name, text)
    new = path.with_suffix(".new")
    new.write_text(page, encoding="utf-8")
    new.replace(path)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write a CSV file whose columns are the keys of the first row.

    An interrupted run leaves the old file, never half of the new one.
    """
    new = path.with_suffix(".new")
    with new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    new.replace(path)


def processor() -> str:
    """Name, cores and vector unit of this machine."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    model = re.search(r"model name\s*: (.*)", text)
    name = model[1].strip() if model else platform.processor() or platform.machine()
    units = [unit for key, unit in VECTORS.items() if re.search(rf"\b{key}\b", text)]
    return ", ".join((name, f"{os.cpu_count()} cores", *units[:1]))


def machine() -> str:
    """Processor, versions and load of this machine."""
    versions = [f"{name} {version(name)}" for name in PACKAGES]
    try:
        run = ["rustc", "--version"]
        output = subprocess.run(run, capture_output=True, text=True, check=True).stdout
        versions.insert(0, f"Rust {output.split()[1]}")
    except OSError:
        pass  # rustc is not on the path
    load = f"load {os.getloadavg()[0]:.1f} at the end"
    return ", ".join((processor(), *versions, load)) + "."


def machines(rows: Iterable[Mapping[str, str]]) -> str:
    """Machines that measured the rows of a CSV file."""
    names = (row.get("machine") or "machine not recorded" for row in rows)
    return "; ".join(dict.fromkeys(names))


def parser(doc: str) -> argparse.ArgumentParser:
    """Parser with the arguments that all measuring scripts share."""
    made = argparse.ArgumentParser(description=doc.splitlines()[0])
    made.add_argument("--print", action="store_true", help="write no files")
    return made


def whole(made: argparse.ArgumentParser, args: argparse.Namespace, *names: str) -> bool:
    """Whether these arguments have their defaults, so that the table is complete."""
    return all(made.get_default(name) == getattr(args, name) for name in names)


def publish(name: str, text: str, *, write: bool) -> None:
    """Print a table; with ``write`` put it into the page, with the machine below it."""
    print(text, end="\n\n", flush=True)
    if write:
        rewrite(HERE / "README.md", name, f"{text}\n\n{machine()}")


def folder(quick: bool) -> Path:
    """Folder of the page and of ``results/``: this one, or `out/bench` for a quick run."""
    if not quick:
        return HERE
    copy = HERE.parent / "out" / "bench"
    (copy / "results").mkdir(parents=True, exist_ok=True)
    page, own_page = HERE / "README.md", copy / "README.md"
    # Copied again if the page has changed, because its markers may have changed.
    if not own_page.exists() or own_page.stat().st_mtime < page.stat().st_mtime:
        shutil.copy(page, own_page)
    return copy


def figures(x: float | None) -> str:
    """Format with three digits, without an exponent from 1e-3 to 1e6."""
    if x is None:
        return ""
    if x == 0 or not 1e-3 <= abs(x) < 1e6:
        return f"{x:.3g}"
    return f"{float(f'{x:.3g}'):,.10g}"
