"""Text from files: without a byte-order mark, and numbers without the extensions of Python.

Programs on Windows begin a text in UTF-8 with the mark. Our own readers use the encoding
``utf-8-sig``, which drops it; libraries that take the name of a file get a copy without it.
``int`` and ``float`` also accept ``1_000`` and the digits of any script: a damaged file with
``1_000`` in place of ``1,000`` would silently give another number.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MARK = b"\xef\xbb\xbf"


def without(content: bytes) -> bytes:
    """Bytes of a text without the mark.

    >>> without(MARK + b"a"), without(b"a")
    (b'a', b'a')
    """
    return content.removeprefix(MARK)


@contextmanager
def strip_mark(path: Path) -> Iterator[Path]:
    """Path of a file without the mark: ``path`` itself, or a temporary copy.

    Raises `OSError`: the file cannot be read, or the copy not written.
    """
    with path.open("rb") as file:
        if file.read(len(MARK)) != MARK:
            yield path
            return
        with tempfile.TemporaryDirectory(prefix="bipot-") as folder:
            copy = Path(folder) / path.name
            with copy.open("wb") as other:
                shutil.copyfileobj(file, other)
            yield copy


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
