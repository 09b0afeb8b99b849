"""The equations of docs/theory.md, and the LaTeX of all formulas."""

import re
from pathlib import Path

import pytest

from support.places import ROOT

PAGES = [ROOT / "docs/theory.md", *sorted((ROOT / "docs/paper").glob("*-*.md"))]
FORMULA = re.compile(r"^ *```math\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def test_equations_of_the_theory_are_numbered_without_gaps() -> None:
    """Each number stands once; the page says how many there are."""
    page = PAGES[0].read_text("utf-8")
    (last,) = re.findall(r"equation numbers \(1\)–\((\d+)\)", page)
    tags = re.findall(r"\\tag\{(\w+)\}", page)
    assert len(tags) == len(set(tags))
    plain = sorted(int(number) for number in tags if number.isdigit())
    assert plain == list(range(1, int(last) + 1))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_formulas_are_complete(page: Path) -> None:
    """Braces and environments in pairs; no formula is left as an indented block."""
    text = page.read_text("utf-8")
    assert text.count("```math") == len(FORMULA.findall(text))
    for formula in FORMULA.findall(text):
        plain = re.sub(r"\\[{}]", "", formula)
        assert plain.count("{") == plain.count("}"), formula
        assert plain.count(r"\begin{") == plain.count(r"\end{"), formula
        assert len(re.findall(r"\\left\b", plain)) == plain.count(r"\right"), formula
    outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)
    assert not re.search(r"\n\n    \S.*[=≤≥]", outside)
