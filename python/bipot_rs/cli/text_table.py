"""Tables as text: the one form in which the commands print them."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from itertools import zip_longest

_GAP = "  "


def terminal_width() -> int | None:
    """Characters of a line of standard output; None for a file or a pipe."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def format_table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = ""
) -> str:
    r"""Columns that are aligned to the right, below their heads and a rule.

    Heads may have several lines; the last ones stand in one row.

    >>> print(
    ...     format_table(
    ...         ["step", "body\nFn [N]"], [["1", "3"], ["2", "1e+06"]], title="A"
    ...     )
    ... )
    A
    <BLANKLINE>
             body
     step  Fn [N]
     ────────────
        1       3
        2   1e+06
    <BLANKLINE>
    """
    above = _lines_of_heads(heads)
    widths = _widths(above, rows)
    text = [
        " " + _GAP.join(cell.rjust(n) for cell, n in zip(line, widths, strict=True))
        for line in [*above, *rows]
    ]
    rule = " " + "─" * (table_width(heads, rows) - 1)
    body = [*text[: len(above)], rule, *text[len(above) :]]
    return "\n".join([*([title] if title else []), "", *body, ""])


def table_width(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    """Characters of a line of the table."""
    widths = _widths(_lines_of_heads(heads), rows)
    return 1 + sum(widths) + len(_GAP) * (len(widths) - 1)


def _lines_of_heads(heads: Sequence[str]) -> list[list[str]]:
    parts = [head.split("\n")[::-1] for head in heads]
    return [list(line) for line in zip_longest(*parts, fillvalue="")][::-1]


def _widths(above: Sequence[list[str]], rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*above, *rows, strict=True)]
