"""Numbers and names in a sentence."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """``1 entry``, ``2 entries``."""
    if number == 1:
        return f"1 {noun}"
    if noun.endswith("y"):
        return f"{number} {noun[:-1]}ies"
    return f"{number} {noun}s"


def printable(text: str) -> str:
    """On one line, in characters that any terminal takes: file names hold all but /."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )
