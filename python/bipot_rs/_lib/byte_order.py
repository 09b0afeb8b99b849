"""The byte-order mark that programs on Windows put before a text in UTF-8.

What reads text of its own takes the encoding ``utf-8-sig``, which leaves the mark out.
Libraries that read by the name of a file are given a copy without it.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MARK = b"\xef\xbb\xbf"


def without(content: bytes) -> bytes:
    """Bytes of a text, without the mark.

    >>> without(MARK + b"a"), without(b"a")
    (b'a', b'a')
    """
    return content.removeprefix(MARK)


@contextmanager
def unmarked(path: Path) -> Iterator[Path]:
    """A file that begins with its text: ``path`` itself, or a copy without the mark.

    Raises
    ------
    OSError
        It cannot be read, or there is no place for the copy.
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
