"""Each tutorial as a notebook with its output, beside its page on the site.

The notebooks of `docs/notebooks.py` are run while the site is built; a cell that fails is a
warning, which `make docs` takes for an error. A notebook is run again if its page or the
package changes.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

sys.path.insert(0, str(Path(__file__).parents[1]))
import notebooks

LOG = logging.getLogger(__name__)


def _key(page: Path) -> str:
    """Changes if a page, a mesh of a page, or the package changes."""
    root = Path(__file__).parents[2]
    files = [
        page,
        *sorted(page.parent.glob("*.msh")),
        *sorted(page.parent.glob("*.inp")),
        *sorted(page.parent.glob("*.json")),
    ]
    files += sorted((root / "python" / "bipot_rs").rglob("*.py"))
    made = hashlib.sha256()
    for file in files:
        made.update(file.read_bytes())
    return made.hexdigest()


def offer(_sphinx: Sphinx, document: nodes.document, name: str) -> None:
    """Link the notebook below the title of its page."""
    page = notebooks.TUTORIALS / f"{Path(name).name}.md"
    if not name.startswith("tutorials/") or page not in notebooks.pages():
        return
    title = document.next_node(nodes.title)
    if title is None:
        return
    file = page.with_suffix(".ipynb").name
    link = nodes.reference("", "As a notebook, with its output", refuri=file)
    section = title.parent
    section.insert(
        section.index(title) + 1, nodes.paragraph("", "", link, classes=["notebook"])
    )


def write(sphinx: Sphinx, error: Exception | None) -> None:
    """Run the notebooks and put them into the site."""
    if error is not None or sphinx.builder.format != "html":
        return
    kept = Path(sphinx.doctreedir) / "notebooks"
    site = Path(sphinx.outdir) / "tutorials"
    for page in notebooks.pages():
        file, key = kept / page.stem / f"{page.stem}.ipynb", _key(page)
        mark = kept / page.stem / "key"
        if not (mark.exists() and mark.read_text() == key):
            try:
                notebooks.run(page, file.parent)
            except Exception as failed:  # noqa: BLE001, an error of a cell has any type
                LOG.warning("the notebook of %s fails: %s", page.name, failed)
                continue
            mark.write_text(key)
        site.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, site)
    # Meshes that they read, and pictures.
    for other in notebooks.TUTORIALS.iterdir():
        if other.suffix in (".msh", ".inp", ".json", ".png", ".svg"):
            shutil.copy(other, site)


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """Register the two steps with Sphinx."""
    sphinx.connect("doctree-resolved", offer)
    sphinx.connect("build-finished", write)
    return {"parallel_read_safe": True}
