"""Formulas of the pages on theory, typeset on the site.

In the repository a formula is an indented block of plain text, with its number at the end of
the line. On the site it is MathML, which browsers draw without a script. A number ``(12)``
gives the line the anchor ``eq-12``: other pages link to ``theory.md#eq-12``, and ``(12)`` in
the text of the page, and in docstrings, becomes such a link.
"""

from __future__ import annotations

import re
from fnmatch import fnmatch
from typing import Any

from docutils import nodes
from formula_blocks import ONE, anchors, html, lines
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

# Pages whose indented blocks are formulas.
PAGES = ("theory", "paper/*")
# The page with the numbers of docstrings, and pages of docstrings.
NUMBERS, DOCSTRINGS = "theory", "api/*"
# Pages, and sections of pages, in which numbers are those of the 1991 paper.
OF_THE_PAPER = "api/theory"
NUMBERS_OF_THE_PAPER = re.compile(r"paper.s numbers|in the print")
# Languages of an indented block for Sphinx.
PLAIN = ("none", "default")


class equations(nodes.General, nodes.Element):
    """A block of formulas; its child is the block of text, for outputs without MathML."""


class ReadEquations(SphinxTransform):
    """Finds the formulas of a page, and the anchors of their numbers."""

    # Before the links of the page are resolved.
    default_priority = 800

    def apply(self, **_: Any) -> None:
        """Wrap indented blocks of the pages on theory."""
        name = self.env.docname
        if not any(fnmatch(name, pattern) for pattern in PAGES):
            return
        slugs = self.env.metadata[name].setdefault("myst_slugs", {})
        for block in list(self.document.findall(nodes.literal_block)):
            if "language" in block and block["language"] not in PLAIN:
                continue
            found = equations("", text=block.astext())
            block.replace_self(found)
            found += block
            for line in lines(block.astext()):
                for anchor in anchors(line.number):
                    slugs[anchor] = (block.line or 0, anchor, f"({anchor[3:]})")
        # Links of the page itself are resolved with these.
        self.document.myst_slugs = slugs


def link_numbers(sphinx: Sphinx, document: nodes.document, name: str) -> None:
    """Link ``(12)`` in paragraphs and tables, but not in titles and links."""
    if sphinx.builder.format != "html" or name == OF_THE_PAPER:
        return
    page = NUMBERS if fnmatch(name, DOCSTRINGS) else name
    known = sphinx.env.metadata[page].get("myst_slugs", {})
    target = "" if page == name else sphinx.builder.get_relative_uri(name, page)
    for text in list(document.findall(nodes.Text)):
        if _is_ours(text) and (made := _linked(text.astext(), target, known)):
            text.parent.replace(text, made)


def _is_ours(text: nodes.Text) -> bool:
    """Whether numbers in a text are those of the page, and no links yet."""
    kinds = (nodes.title, nodes.reference, nodes.literal, nodes.literal_block)
    node: Any = text.parent
    while node is not None:
        if isinstance(node, nodes.section):
            title = node.next_node(nodes.title)
            if title is not None and NUMBERS_OF_THE_PAPER.search(title.astext()):
                return False
        if isinstance(node, kinds):
            return False
        node = node.parent
    return True


def _linked(text: str, target: str, known: dict[str, Any]) -> list[nodes.Node]:
    """A text with links, or nothing if it has no number of an equation."""
    parts = ONE.split(text)
    if not any(f"eq-{number}" in known for number in parts[1::2]):
        return []
    made: list[nodes.Node] = []
    for k, part in enumerate(parts):
        if k % 2 == 0:
            made += [nodes.Text(part)] if part else []
        elif f"eq-{part}" in known:
            uri = f"{target}#eq-{part}"
            made.append(nodes.reference("", f"({part})", internal=True, refuri=uri))
        else:
            made.append(nodes.Text(f"({part})"))
    return made


def _visit(translator: Any, node: equations) -> None:
    translator.body.append(html(node["text"]))
    raise nodes.SkipNode


def _pass(_translator: Any, _node: equations) -> None:
    """Other outputs show the text."""


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """Register the node and the transforms with Sphinx."""
    others = dict.fromkeys(("latex", "text", "man", "texinfo"), (_pass, _pass))
    sphinx.add_node(equations, html=(_visit, _pass), **others)
    sphinx.add_transform(ReadEquations)
    sphinx.connect("doctree-resolved", link_numbers)
    return {"parallel_read_safe": True}
