"""The notebooks of the tutorials are those of their pages, without output."""

import importlib
import json
import sys
from types import ModuleType

import pytest

from support.places import ROOT

DOCS = ROOT / "docs"
FILES = sorted((DOCS / "tutorials").glob("*.ipynb"))


@pytest.fixture
def notebooks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script that writes them."""
    monkeypatch.syspath_prepend(DOCS)
    monkeypatch.delitem(sys.modules, "notebooks", raising=False)
    return importlib.import_module("notebooks")


def test_they_are_those_of_the_pages(notebooks: ModuleType) -> None:
    """Otherwise run `python docs/notebooks.py`."""
    assert [f.stem for f in FILES] == [page.stem for page in notebooks.pages()]
    for page in notebooks.pages():
        made = notebooks.text_of(notebooks.notebook(page))
        assert page.with_suffix(".ipynb").read_text("utf-8") == made, page.name


def test_they_have_the_code_of_the_page_and_no_output() -> None:
    for file in FILES:
        page = file.with_suffix(".md").read_text("utf-8")
        cells = json.loads(file.read_text("utf-8"))["cells"]
        code = ["".join(c["source"]) for c in cells if c["cell_type"] == "code"]
        assert len(code) == page.count("```python\n")
        assert all(f"```python\n{source}\n```" in page for source in code)
        for cell in cells:
            assert cell["source"]
            assert not cell.get("outputs")
            assert cell.get("execution_count") is None
        assert len({cell["id"] for cell in cells}) == len(cells)


def test_pages_become_cells(notebooks: ModuleType) -> None:
    page = (
        "# A\n\nwords\n\n```python\nprint(1)\n```\n\n```text\n1\n```\n\nmore\n\n"
        "```text\na file\n```\n\n```python\nx = 2\n\ny = 3\n```\n\n```{toctree}\na\n```\n"
    )
    assert list(notebooks.cells(page)) == [
        ("markdown", "# A\n\nwords"),
        ("code", "print(1)"),
        ("markdown", "more\n\n```text\na file\n```"),
        ("code", "x = 2\n\ny = 3"),
        ("markdown", ""),
    ]


def test_links_lead_to_notebooks_where_there_are_any(notebooks: ModuleType) -> None:
    made = notebooks.notebook(DOCS / "tutorials" / "own-stiffness.md")
    text = "".join(line for cell in made["cells"] for line in cell["source"])
    assert "](../trust.md)" in text
    other = notebooks.notebook(DOCS / "tutorials" / "two-bodies.md")
    text = "".join(line for cell in other["cells"] for line in cell["source"])
    assert "](from-gmsh.ipynb)" in text


def test_they_are_valid(notebooks: ModuleType) -> None:
    nbformat = pytest.importorskip("nbformat")
    for page in notebooks.pages():
        made = nbformat.reads(notebooks.text_of(notebooks.notebook(page)), as_version=4)
        nbformat.validate(made)


def test_a_notebook_is_run(notebooks: ModuleType, tmp_path: object) -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    page = DOCS / "tutorials" / "fretting.md"
    made = json.loads(notebooks.run(page, tmp_path).read_text("utf-8"))
    code = [cell for cell in made["cells"] if cell["cell_type"] == "code"]
    assert any(cell["outputs"] for cell in code)
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
