"""Formulas of the pages are typeset on the site: the extension that does it."""

import re
import sys
import textwrap
import unicodedata
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from support.places import ROOT

EXTENSIONS = ROOT / "docs" / "_extensions"
PAGES = [ROOT / "docs/theory.md", *sorted((ROOT / "docs/paper").glob("*-*.md"))]
INDENTED = re.compile(r"(?<=\n\n)((?: {4}.*\n(?:\n(?= {4}))?)+)")
# Signs of the plain text that say where its parts stand, and have no place in the output.
MARKS = dict.fromkeys(map(ord, " _^{}()√/[]⎡⎢⎣⎤⎥⎦\n\u00a0"))
# A character of the text, and what stands for it.
SAME = str.maketrans(
    "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀᵏⁱ₀₁₂₃₄₅₆₇₈₉₊₋ₙₖ'Σ",
    "0123456789+−Tki0123456789+−nk′∑",
)
ACCENTS = {"^": "\u0302", "~": "\u0303", "¯": "\u0304", "˙": "\u0307"}


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that makes HTML of a block; it needs no Sphinx."""
    monkeypatch.syspath_prepend(EXTENSIONS)
    for name in ("formula_blocks", "unicode_math"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import formula_blocks

    return formula_blocks


def formulas(page: Path) -> list[str]:
    """Indented blocks of a page, outside fences."""
    text = re.sub(r"^```.*?^```\n", "\n", page.read_text("utf-8"), flags=re.M | re.S)
    return [textwrap.dedent(found) for found in INDENTED.findall(text)]


def characters(text: str) -> list[str]:
    """Letters, digits and signs of a text in any order, without marks of position."""
    apart = "".join(
        unicodedata.normalize("NFD", c) if c.isalpha() and c != "é" else c for c in text
    )
    return sorted(apart.translate(SAME).translate(MARKS))


def shown(html: str) -> str:
    """Text of the output, with each accent as the character that the source has."""
    tree = ElementTree.fromstring(html)
    for over in tree.iter("mover"):
        over[1].text = ACCENTS[over[1].text or ""]
    return "".join(tree.itertext())


def test_pages_have_formulas() -> None:
    assert len(formulas(ROOT / "docs/theory.md")) > 50


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_every_character_of_a_formula_is_on_the_site(
    page: Path, blocks: ModuleType
) -> None:
    for block in formulas(page):
        made = blocks.html(block)
        assert characters(shown(made)) == characters(block), block
        names = re.sub("<mtext class='code'>.*?</mtext>", "", made)
        assert not set(shown(names)) & set("_^"), block


def test_equations_of_the_theory_are_numbered_without_gaps(blocks: ModuleType) -> None:
    """Each has one anchor; the page says how many there are."""
    page = (ROOT / "docs/theory.md").read_text("utf-8")
    (last,) = re.findall(r"equation numbers \(1\)–\((\d+)\)", page)
    ids = [
        element.get("id", "")[3:]
        for block in formulas(ROOT / "docs/theory.md")
        for element in ElementTree.fromstring(blocks.html(block)).iter()
        if element.get("id")
    ]
    assert len(ids) == len(set(ids))
    plain = sorted(int(number) for number in ids if number.isdigit())
    assert plain == list(range(1, int(last) + 1))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("r_n", "<msub><mi>r</mi><mi>n</mi></msub>"),
        (
            "K_ii⁻¹",
            (
                "<msubsup><mi>K</mi><mrow><mi>i</mi><mi>i</mi></mrow>"
                "<mrow><mo>−</mo><mn>1</mn></mrow></msubsup>"
            ),
        ),
        ("Bᵀ", '<msup><mi>B</mi><mi mathvariant="normal">T</mi></msup>'),
        (
            "a/(b c)",
            "<mfrac><mi>a</mi><mrow><mi>b</mi><mi>c</mi></mrow></mfrac>",
        ),
        ("a / b", "<mrow><mi>a</mi><mo>/</mo><mi>b</mi></mrow>"),
        (
            "a b_t/c",
            (
                "<mrow><mi>a</mi><mfrac><msub><mi>b</mi><mi>t</mi></msub>"
                "<mi>c</mi></mfrac></mrow>"
            ),
        ),
        ("√(a b)", "<msqrt><mrow><mi>a</mi><mi>b</mi></mrow></msqrt>"),
        ("ṽ", '<mover accent="true"><mi>v</mi><mo>~</mo></mover>'),
        ("dA", '<mrow><mi mathvariant="normal">d</mi><mi>A</mi></mrow>'),
        ("x in", "<mrow><mi>x</mi><mtext>\u00a0in</mtext></mrow>"),
        ("0.1", "<mn>0.1</mn>"),
        ("λ_max", "<msub><mi>λ</mi><mi>max</mi></msub>"),
        ("v_t'", "<msubsup><mi>v</mi><mi>t</mi><mo>′</mo></msubsup>"),
    ],
)
def test_forms_of_plain_text(text: str, expected: str, blocks: ModuleType) -> None:
    assert blocks.mathml(text) == expected


def test_bars_in_bars_are_paired(blocks: ModuleType) -> None:
    """An inner pair of bars does not close the outer one."""
    made = ElementTree.fromstring(blocks.mathml("‖ ‖a‖ b + c ‖"))
    assert [child.text for child in (made[0], made[-1])] == ["‖", "‖"]
    inner = made[1][0]
    assert "".join(inner.itertext()) == "‖a‖"


def test_lines_are_aligned_at_their_relation(blocks: ModuleType) -> None:
    found = blocks.lines("K u = f + Bᵀ r        (1)\n  v = B u\n")
    assert [line.cells for line in found] == [["K u", "= f + Bᵀ r"], ["v", "= B u"]]
    assert [line.number for line in found] == ["(1)", ""]


def test_a_matrix_has_its_entries(blocks: ModuleType) -> None:
    block = "⎡ A   B ⎤ᵀ ⎡ x ⎤   ⎡ 0 ⎤\n⎣ C   0 ⎦  ⎣ y ⎦ = ⎣ b ⎦,   y > 0   (9)\n"
    tree = ElementTree.fromstring(blocks.html(block))
    tables = [
        [["".join(cell.itertext()) for cell in row] for row in table]
        for table in tree.iter("mtable")
    ]
    assert tables == [[["A", "B"], ["C", "0"]], [["x"], ["y"]], [["0"], ["b"]]]
    assert tree[0].get("id") == "eq-9"


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        ("(12)", ["eq-12"]),
        ("(3)–(5)", ["eq-3", "eq-4", "eq-5"]),
        ("(8), (11)", ["eq-8", "eq-11"]),
        ("(20a)", ["eq-20a"]),
        ("[dSF91, 54]", []),
        ("(∗)", []),
    ],
)
def test_numbers_give_anchors(
    number: str, expected: list[str], blocks: ModuleType
) -> None:
    assert blocks.anchors(number) == expected
    (line,) = blocks.lines(f"a = b     {number}")
    assert line.number == number


# The parser of Markdown uses names that Sphinx will drop.
@pytest.mark.filterwarnings("ignore:.*myst_parser.*is deprecated")
def test_the_site_links_numbers(tmp_path: Path) -> None:
    """Links from other pages, from docstrings and in the text lead to the equation."""
    application = pytest.importorskip("sphinx.application")
    pytest.importorskip("myst_parser")
    source, site = tmp_path / "docs", tmp_path / "site"
    (source / "api").mkdir(parents=True)
    (source / "conf.py").write_text(
        f"import sys\nsys.path.insert(0, {str(EXTENSIONS)!r})\n"
        "extensions = ['myst_parser', 'equations']\nmyst_heading_anchors = 4\n"
    )
    (source / "index.md").write_text(
        "# Start\n\n[law](theory.md#eq-2), not (2)\n\n    make it\n\n"
        "```{toctree}\ntheory\napi/a\n```\n"
    )
    (source / "theory.md").write_text(
        "# Theory\n\nBy (1) and `(1)`, [here](#eq-2):\n\n    v_n ≥ 0     (1)\n"
        "    r = 0       (2)\n\n## The paper's numbers\n\n(1) is another.\n"
    )
    (source / "api" / "a.md").write_text("# Names\n\nSee (2).\n")
    application.Sphinx(
        source, source, site, tmp_path / "cache", "html", warningiserror=True
    ).build()
    theory = (site / "theory.html").read_text("utf-8")
    assert theory.count('id="eq-1"') == theory.count('id="eq-2"') == 1
    assert (
        theory.count('href="#eq-1">(1)</a>') == 2
    )  # in the text, and the number itself
    assert 'href="#eq-2">here' in re.sub(r"<span[^>]*>", "", theory)
    assert "<msub><mi>v</mi><mi>n</mi></msub>" in theory
    index = re.sub(r"<span[^>]*>", "", (site / "index.html").read_text("utf-8"))
    assert 'href="theory.html#eq-2">law' in index
    assert "not (2)" in index
    assert "make it" in index
    assert 'href="../theory.html#eq-2">(2)' in (site / "api/a.html").read_text("utf-8")
