"""Remove the byte-order mark with which programs on Windows begin a text in UTF-8.

Our own readers use the encoding ``utf-8-sig``, which drops the mark. Libraries that take
the name of a file get a copy of the file without it.
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

    Raises
    ------
    OSError
        The file cannot be read, or the copy not written.
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
