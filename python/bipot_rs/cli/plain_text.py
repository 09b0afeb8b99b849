"""Tables and lines for a file or a pipe, as rich prints them on a terminal, without rich.

The import of rich takes a tenth of the time of a small run.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

from bipot_rs.cli.progress import tell

# Variables by which rich takes any stream for a terminal.
_FORCING = ("FORCE_COLOR", "TTY_COMPATIBLE")


def on_terminal() -> bool:
    """Whether standard output is a terminal, or rich shall treat it as one."""
    return sys.stdout.isatty() or any(os.environ.get(name) for name in _FORCING)


class Paper:
    """Standard output that is no terminal, in place of a console of rich."""

    def print(self, text: str, **_: Any) -> None:
        """Print lines as they are."""
        tell(text, sys.stdout)

    def table(self, title: str, heads: Sequence[str], rows: Sequence[Any]) -> None:
        """Print a `table`."""
        tell(table(title, heads, rows), sys.stdout)


def table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    r"""Columns that are aligned to the right, below their heads and a rule.

    Heads may have several lines; the last ones stand in one row.

    >>> print(table("A", ["step", "body\nFn [N]"], [["1", "3"], ["2", "1e+06"]]))
    A
    <BLANKLINE>
             body
     step  Fn [N]
     ────────────
        1       3
        2   1e+06
    <BLANKLINE>
    """
    parts = [head.split("\n")[::-1] for head in heads]
    above = [list(one) for one in zip_longest(*parts, fillvalue="")][::-1]
    lines = [*above, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]
    text = [
        " "
        + "  ".join(
            f"{cell:>{width}}" for cell, width in zip(line, widths, strict=True)
        )
        for line in lines
    ]
    rule = " " + "─" * (len(text[0]) - 1)
    return "\n".join(
        [
            *([title] if title else []),
            "",
            *text[: len(above)],
            rule,
            *text[len(above) :],
            "",
        ]
    )
