"""The equations of docs/theory.md, and the LaTeX of all formulas."""

import re

from support.places import ROOT

PAGES = [ROOT / "docs/theory.md", *sorted((ROOT / "docs/paper").glob("*-*.md"))]


def test_equations_of_the_theory_are_numbered_without_gaps() -> None:
    """Each number stands once; the page says how many there are."""
    page = PAGES[0].read_text("utf-8")
    (last,) = re.findall(r"equation numbers \(1\)–\((\d+)\)", page)
    tags = re.findall(r"\\tag\{(\w+)\}", page)
    assert len(tags) == len(set(tags))
    plain = sorted(int(number) for number in tags if number.isdigit())
    assert plain == list(range(1, int(last) + 1))
