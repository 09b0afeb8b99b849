"""Indented blocks of formulas as HTML: a table with a line for each, and its number."""

from __future__ import annotations

import re
import unicodedata
from html import escape
from itertools import pairwise
from typing import NamedTuple

from unicode_math import fenced, mathml

# The number of an equation, or several of them, at the end of a line.
_NUMBER = re.compile(
    r"(?:^|\s{2,})((?:\([\w∗]{1,3}\))(?:(?:–|, )\([\w∗]{1,3}\))*|\[dSF91, [^]]*\])$"
)
ONE = re.compile(r"\((\d+[a-e]?)\)")
_RELATION = re.compile(r"[=≤≥∈]")
_MATRIX = re.compile(r"[⎡⎢⎣](.*?)[⎤⎥⎦]")


class Line(NamedTuple):
    """A line of formulas: its cells from left to right, and its number or an empty text."""

    cells: list[str]
    number: str


def anchors(number: str) -> list[str]:
    """Anchors of a number as it stands in the page: ``(12)`` gives ``eq-12``.

    The numbers between two of them, as in ``(3)–(5)``, have anchors too.
    """
    found = [match[1] for match in ONE.finditer(number)]
    if "–" in number and len(found) == 2 and all(n.isdigit() for n in found):
        found = [str(n) for n in range(int(found[0]), int(found[1]) + 1)]
    return [f"eq-{n}" for n in found]


def lines(block: str) -> list[Line]:
    """The lines of a block of formulas, with cells that are aligned in all lines."""
    texts, numbers = [], []
    for line in block.splitlines():
        match = _NUMBER.search(line.rstrip())
        texts.append(line[: match.start()] if match else line)
        numbers.append(match[1] if match else "")
    rows = [(t.rstrip(), n) for t, n in zip(texts, numbers, strict=True)]
    rows = [row for row in rows if row != ("", "")]
    if any("⎡" in text for text, _ in rows):
        return [Line(["\n".join(t for t, _ in rows)], "".join(n for _, n in rows))]
    at = _edges([text for text, _ in rows])
    return [Line(_cut(text, at), number) for text, number in rows]


def _columns(text: str) -> list[int]:
    """Column of each character on the screen; accents take none."""
    found, column = [], 0
    for character in text:
        found.append(column)
        column += not unicodedata.combining(character)
    return found


def _edges(texts: list[str]) -> list[int]:
    """Columns at which cells begin, because every line has a cell or a relation there."""
    if len(texts) == 1:
        return []
    shared: set[int] | None = None
    for text in texts:
        columns = _columns(text)
        starts = {columns[m.end()] for m in re.finditer(r"\s{2,}(?=\S)", text)}
        first = _RELATION.search(text)
        if first is not None and text[: first.start()].endswith(" "):
            starts.add(columns[first.start()])
        shared = starts if shared is None else shared & starts
    return sorted(shared or ())


def _cut(text: str, at: list[int]) -> list[str]:
    """A line cut at columns."""
    columns = _columns(text)
    places = [columns.index(column) for column in at]
    cells = [text[a:b].strip() for a, b in pairwise([0, *places, len(text)])]
    # A line that continues the one before is indented.
    return cells if at or not text.startswith("  ") else ["  " + cells[0]]


def formula(text: str) -> str:
    """One cell as an element ``math``."""
    inner = _matrices(text.splitlines()) if "⎡" in text else _phrases(text)
    said = " ".join(text.split())
    return (
        f'<math display="inline" displaystyle="true" alttext="{escape(said)}">'
        f"<mrow>{inner}</mrow></math>"
    )


def _phrases(text: str) -> str:
    """Formulas with wide spaces between them, except around a relation."""
    close = re.sub(r"\s+([=≤≥])\s+", r" \1 ", text)
    parts = [mathml(part) for part in re.split(r"\s{2,}", close)]
    return '<mspace width="1.5em"/>'.join(parts)


def _matrices(rows: list[str]) -> str:
    """Matrices drawn with brackets over several lines."""
    between = [_MATRIX.split(row)[::2] for row in rows]
    inside = [_MATRIX.findall(row) for row in rows]
    made = []
    for k in range(len(between[0])):
        text = " ".join(row[k].strip() for row in between).strip()
        if text.startswith("ᵀ") and made:
            made[-1] = f'<msup>{made[-1]}<mi mathvariant="normal">T</mi></msup>'
            text = text[1:].strip()
        if text:
            made.append(_phrases(text))
        if k < len(inside[0]):
            made.append(_matrix([row[k] for row in inside]))
    return "".join(made)


def _matrix(rows: list[str]) -> str:
    entries = [re.split(r"\s{2,}", row.strip()) for row in rows]
    made = "".join(
        f"<mtr>{''.join(f'<mtd>{mathml(e)}</mtd>' for e in row)}</mtr>"
        for row in entries
    )
    return fenced("[", f"<mtable>{made}</mtable>", "]")


def _cell(text: str, after: list[str]) -> str:
    """A cell of a line; it stands close to a relation in the cell after it."""
    close = after and _RELATION.match(after[0])
    kind = ' class="close"' if close else ""
    return f"<td{kind}>{formula(text) if text else ''}</td>"


def html(block: str) -> str:
    """A block of formulas as a table, whose last column has the numbers."""
    rows = lines(block)
    made = []
    for row in rows:
        cells = [
            _cell(cell, row.cells[k : k + 1]) for k, cell in enumerate(row.cells, 1)
        ]
        ids = anchors(row.number)
        # The first anchor is that of the line; others are empty elements in it.
        own = f' id="{ids[0]}"' if ids else ""
        more = "".join(f'<span id="{name}"></span>' for name in ids[1:])
        number = escape(row.number)
        if ids:
            number = f'{more}<a href="#{ids[0]}">{number}</a>'
        made.append(f'<tr{own}>{"".join(cells)}<td class="number">{number}</td></tr>')
    return f'<table class="equations" role="presentation">{"".join(made)}</table>\n'
