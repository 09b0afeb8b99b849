r"""Formulas of the pages: LaTeX in blocks ``math``, which the build makes MathML of.

Browsers draw MathML without a script. Lines of ``align*`` are rows of a table, with the number
of ``\tag`` at the end of the line; number ``(12)`` gives its row the anchor ``eq-12``.
"""

from __future__ import annotations

import re
from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

TAG = re.compile(r"\s*\\tag(\*?)\{([^}]*)\}\s*$")
ALIGNED = re.compile(r"\\begin\{align\*\}(.*)\\end\{align\*\}", re.DOTALL)


def table(latex: str) -> str:
    """A block of formulas as HTML."""
    aligned = ALIGNED.search(latex)
    lines = re.split(r"\\\\\n", aligned[1]) if aligned else [latex]
    return f'<table class="equations">{"".join(map(row, lines))}</table>\n'


def row(line: str) -> str:
    """A line of formulas: its cells, and its number."""
    tag = TAG.search(line.strip())
    number = (tag[2] if tag[1] else f"({tag[2]})") if tag else ""
    # A matrix has signs of alignment of its own.
    parts = re.split(r"(\\begin\{bmatrix\}.*?\\end\{bmatrix\})", TAG.sub("", line))
    marked = "".join(
        part if k % 2 else part.replace("&", "\0") for k, part in enumerate(parts)
    )
    cells = [formula(cell.strip()) for cell in marked.split("\0") if cell.strip()]
    anchor = f' id="eq-{tag[2]}"' if tag and not tag[1] else ""
    inner = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr{anchor}>{inner}<td class="number">{escape(number)}</td></tr>'


def formula(latex: str) -> str:
    """One cell; its fractions and limits are those of a displayed formula."""
    # The converter keeps the backslash of an underscore within text.
    return convert(rf"\displaystyle {latex}").replace(r"\_", "_")


def visit_block(translator: Any, node: nodes.Element) -> None:
    """Write a block, and nothing else for its children."""
    translator.body.append(table(node.astext()))
    raise nodes.SkipNode


def visit_inline(translator: Any, node: nodes.Element) -> None:
    """Write a formula within a line."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """Name the writer, for `html_math_renderer`."""
    sphinx.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True}
