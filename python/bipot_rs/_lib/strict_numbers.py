"""Numbers as files write them.

``int`` and ``float`` take Python's ``1_000`` and the digits of any alphabet too: of a
damaged file, ``1_000`` for ``1,000``, they would make another number.
"""

from __future__ import annotations


def whole(text: str) -> int:
    """An integer; `ValueError` for anything else."""
    return int(_plain(text))


def real(text: str) -> float:
    """A number, also ``nan`` and ``inf``; `ValueError` for anything else."""
    return float(_plain(text))


def _plain(text: str) -> str:
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is no number")
    return text
