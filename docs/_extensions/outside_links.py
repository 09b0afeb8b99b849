"""Links that leave `docs/`: right in the repository, and right on the site.

Pages are read in both places. Those of the repository that the site has under another
name (the benches, the changelog, the first page) are linked as pages of the site; what
it has no page for, such as a test, is named and not linked.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from sphinx.application import Sphinx

# File of the repository: page of the site.
PAGES = {
    "README.md": "docs/index.md",
    "benches/README.md": "docs/benchmarks.md",
    "CHANGELOG.md": "docs/changelog.md",
}
# Those that are on the site what they are in the repository.
WHOLE = ("benches/README.md", "CHANGELOG.md")
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s:#]+)(#[^)\s]*)?\)")
IMAGE = re.compile(r"(<img[^>]*\ssrc=\")([^\":]+)(\")")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)


def rewrite(text: str, origin: str, page: str) -> str:
    """Markdown with its links mended.

    Parameters
    ----------
    text
        As it stands in the repository.
    origin, page
        The file it was written for, as ``benches/README.md``, and the one that it is
        shown on, as ``docs/benchmarks.md``.
    """

    def moved(target: str) -> str:
        there = posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))
        return PAGES.get(there, there)

    def near(there: str) -> str:
        return posixpath.relpath(there, posixpath.dirname(page))

    def link(match: re.Match[str]) -> str:
        mark, words, target, anchor = match[1], match[2], match[3], match[4] or ""
        there = moved(target)
        if not mark and not there.startswith("docs/"):
            return words
        return f"{mark}[{words}]({near(there)}{anchor})"

    def image(match: re.Match[str]) -> str:
        return f"{match[1]}{near(moved(match[2]))}{match[3]}"

    def mended(part: str) -> str:
        return IMAGE.sub(image, LINK.sub(link, part))

    parts, last = [], 0
    for fence in FENCE.finditer(text):
        parts += [mended(text[last : fence.start()]), fence[0]]
        last = fence.end()
    return "".join([*parts, mended(text[last:])])


def read(sphinx: Sphinx, document: str, source: list[str]) -> None:
    """Before a page is parsed."""
    page = f"docs/{document}.md"
    for origin in WHOLE:
        if PAGES[origin] == page:
            file = Path(sphinx.srcdir).parent / origin
            sphinx.env.note_dependency(file)
            source[0] = rewrite(file.read_text(encoding="utf-8"), origin, page)
            return
    source[0] = rewrite(source[0], page, page)


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    sphinx.connect("source-read", read)
    return {"parallel_read_safe": True}
