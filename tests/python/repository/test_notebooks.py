"""Pages of tutorials become notebooks."""

import notebooks


def test_pages_become_cells() -> None:
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


def test_a_notebook_has_the_code_of_its_page_and_links_to_notebooks() -> None:
    pages = {page.stem: page for page in notebooks.pages()}
    assert len(pages) > 15
    for page in pages.values():
        cells = notebooks.notebook(page)["cells"]
        code = [c["source"] for c in cells if c["cell_type"] == "code"]
        text = page.read_text("utf-8")
        assert len(code) == text.count("```python\n")
        assert all(f"```python\n{source}\n```" in text for source in code)
    cells = notebooks.notebook(pages["two-bodies"])["cells"]
    assert "](from-gmsh.ipynb)" in "".join(c["source"] for c in cells)
