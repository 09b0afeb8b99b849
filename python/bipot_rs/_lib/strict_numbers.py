"""Convert text from files to numbers, without the extensions of Python.

``int`` and ``float`` also accept ``1_000`` and the digits of any script. A damaged file
with ``1_000`` in place of ``1,000`` would silently give another number.
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
        raise ValueError(f"{text!r} is not a number")
    return text
