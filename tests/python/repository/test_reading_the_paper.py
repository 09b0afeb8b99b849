"""The table from equations of [dSF91] to functions is complete, and its names exist."""

import importlib
import re
from typing import Any

from support.places import ROOT

PAGE = ROOT / "docs" / "paper" / "1-reading.md"
LAST = 87  # the number of the last equation of the paper


def rows() -> list[list[str]]:
    """Cells of the table from equation to function."""
    section = PAGE.read_text("utf-8").partition("## From equation to function")[2]
    lines = [
        line
        for line in section.partition("\n## ")[0].splitlines()
        if line.startswith("| (")
    ]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def numbers(text: str) -> list[int]:
    """Numbers of a list with ranges, as ``(8), (11)–(13)`` or ``79-81``."""
    equations: list[int] = []
    for first, last in re.findall(
        r"\(?(\d+)[a-c]?\)?(?:\s*[–-]\s*\(?(\d+)[a-c]?\)?)?", text
    ):
        equations += range(int(first), int(last or first) + 1)
    return equations


def named(name: str) -> Any:
    """What a dotted name of the page stands for."""
    whole = re.sub(r"^bp\.", "bipot_rs.", name)
    if not whole.startswith("bipot_rs."):
        whole = f"bipot_rs.{whole}"
    parts = whole.split(".")
    for k in range(len(parts), 0, -1):
        try:
            target: Any = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            target = getattr(target, part)
        return target
    raise AttributeError(name)


def test_every_equation_of_the_paper_is_in_one_row() -> None:
    equations = [number for row in rows() for number in numbers(row[0])]
    assert sorted(equations) == list(range(1, LAST + 1))


def test_functions_of_the_table_exist() -> None:
    for row in rows():
        for name in re.findall(r"`([\w.]+)`", row[2]):
            assert callable(named(name)) or isinstance(named(name), property), name
