"""Tutorials as Jupyter notebooks, made from their Markdown pages and run by `make docs`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TUTORIALS = Path(__file__).parent / "tutorials"
# A block of Python, with the block of text that shows its output.
BLOCK = re.compile(
    r"^```python\n(?P<code>.*?)^```\n(?:\n```text\n.*?^```\n)?",
    re.MULTILINE | re.DOTALL,
)
# For MyST alone; a notebook has no list of pages.
TOCTREE = re.compile(r"^```\{toctree\}\n.*?^```\n", re.MULTILINE | re.DOTALL)
FORMULA = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(\]\()([\w-]+)\.md([#)])")


def pages() -> list[Path]:
    """The tutorials that have code, without the list of them."""
    sources = sorted(TUTORIALS.glob("*.md"))
    return [page for page in sources if BLOCK.search(page.read_text("utf-8"))]


def cells(text: str) -> Iterator[tuple[str, str]]:
    """Kind and source of each cell of a page. Outputs that a page shows are left out."""
    # Jupyter reads formulas between dollars.
    text = FORMULA.sub(r"$$\n\1$$", TOCTREE.sub("", text))
    last = 0
    for match in BLOCK.finditer(text):
        yield "markdown", text[last : match.start()].strip()
        yield "code", match["code"].rstrip()
        last = match.end()
    yield "markdown", text[last:].strip()


def notebook(page: Path) -> dict[str, Any]:
    """A page as a notebook of format 4.5 without output."""
    # Other tutorials are notebooks beside this one.
    names = {other.stem for other in pages()}

    def beside(match: re.Match[str]) -> str:
        suffix = "ipynb" if match[2] in names else "md"
        return f"{match[1]}{match[2]}.{suffix}{match[3]}"

    made: list[dict[str, Any]] = []
    for kind, source in cells(page.read_text("utf-8")):
        if not source:
            continue
        cell: dict[str, Any] = {
            "cell_type": kind,
            "id": f"{kind}-{len(made)}",
            "metadata": {},
            "source": LINK.sub(beside, source) if kind == "markdown" else source,
        }
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        made.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def run(page: Path, folder: Path) -> Path:
    """Run the notebook of a page and write it with its output.

    Files that it writes, and pictures, go into the folder; those that it reads are
    copied there.
    """
    import shutil

    import nbformat
    from nbclient import NotebookClient

    folder.mkdir(parents=True, exist_ok=True)
    for file in TUTORIALS.iterdir():
        if file.suffix in (".msh", ".inp", ".json"):
            shutil.copy(file, folder)
    made = nbformat.from_dict(notebook(page))
    client = NotebookClient(
        made,
        timeout=600,
        resources={"metadata": {"path": folder}},
        # ipykernel 7.4 warns at each start that others on this machine could read along.
        extra_arguments=["--IPKernelApp.log_level=40"],
    )
    client.execute()
    there = folder / page.with_suffix(".ipynb").name
    # Times of cells would make every build differ.
    for cell in made.cells:
        cell.metadata.pop("execution", None)
    nbformat.write(made, there)
    return there
