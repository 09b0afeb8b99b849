"""Lines and columns of the keys of a TOML text: the parser of Python gives none."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator

# Key path, with the numbers of entries of lists.
Path = tuple[str | int, ...]

_BLANK = re.compile(r"[ \t]*")
_BETWEEN = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTED = re.compile(r'"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'")
_LONG = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}(?!")' + r"|'''.*?'{3,5}(?!')", re.DOTALL)
# Numbers, dates and words; a date may contain a space.
_PLAIN = re.compile(r"[^,\]}\n#]*")


def places(source: str) -> dict[Path, tuple[int, int]]:
    r"""Line and column, from 1, of each key, table and entry of a list.

    Parameters
    ----------
    source
        A text that `tomllib` reads. The keys of the result are all key paths of the tables
        that it returns.

    >>> places("[mesh]\nn = 3\nm = [4, 5]")[("mesh", "m", 1)]
    (3, 9)
    """
    ends = [k for k, c in enumerate(source) if c == "\n"]
    found: dict[Path, tuple[int, int]] = {}
    line, begin = 0, 0
    # Places are found in the order of the text, except for tables that are continued.
    for path, at in sorted(_Scanner(source).found.items(), key=lambda item: item[1]):
        while line < len(ends) and ends[line] < at:
            begin, line = ends[line] + 1, line + 1
        found[path] = line + 1, at - begin + 1
    return found


class _Scanner:
    """Offsets of all key paths of a text that is known to be TOML."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.found: dict[Path, int] = {}
        self.at = 0
        # Number of tables so far of each list of tables.
        self._tables: dict[Path, int] = {}
        self._skip(_BETWEEN)
        prefix: Path = ()
        while self.at < len(source):
            prefix = self._line(prefix)
            self._skip(_BETWEEN)

    def _line(self, prefix: Path) -> Path:
        """Read a heading or a key with its value; returns the table that follows."""
        source = self.source
        if source[self.at] != "[":
            self._pair(prefix)
            return prefix
        listed = source.startswith("[[", self.at)
        self.at += 1 + listed
        self._skip(_BLANK)
        keys = list(self._keys())
        self.at += 1 + listed
        path: Path = ()
        for key, at in keys[:-1]:
            path = self._inside((*path, key), at)
        key, at = keys[-1]
        path = (*path, key)
        if not listed:
            return self._inside(path, at)
        self._note(path, at)
        number = self._tables.get(path, 0)
        self._tables[path] = number + 1
        self._note((*path, number), at)
        return (*path, number)

    def _inside(self, path: Path, at: int) -> Path:
        """A table, or the last one of a list of tables."""
        self._note(path, at)
        number = self._tables.get(path)
        return path if number is None else (*path, number - 1)

    def _pair(self, prefix: Path) -> None:
        path = prefix
        for key, at in self._keys():
            path = (*path, key)
            self._note(path, at)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        self._value(path)

    def _keys(self) -> Iterator[tuple[str, int]]:
        """The parts of a dotted key, each with its offset."""
        while True:
            start = self.at
            quoted = _QUOTED.match(self.source, start)
            word = quoted or _BARE.match(self.source, start)
            text = word[0] if word else ""
            self.at += len(text)
            yield (tomllib.loads(f"k = {text}")["k"] if quoted else text), start
            self._skip(_BLANK)
            if not self.source.startswith(".", self.at):
                return
            self.at += 1
            self._skip(_BLANK)

    def _value(self, path: Path) -> None:
        source = self.source
        first = source[self.at]
        if first == "[":
            self._entries(path)
        elif first == "{":
            self._inline(path)
        elif first in "\"'":
            long = source.startswith((3 * '"', 3 * "'"), self.at)
            self._skip(_LONG if long else _QUOTED)
        else:
            self._skip(_PLAIN)

    def _entries(self, path: Path) -> None:
        self.at += 1
        self._skip(_BETWEEN)
        number = 0
        while self.source[self.at] != "]":
            self._note((*path, number), self.at)
            self._value((*path, number))
            number += 1
            self._next()
        self.at += 1

    def _inline(self, path: Path) -> None:
        self.at += 1
        self._skip(_BETWEEN)
        while self.source[self.at] != "}":
            self._pair(path)
            self._next()
        self.at += 1

    def _next(self) -> None:
        """Go past the comma between two entries, if there is one."""
        self._skip(_BETWEEN)
        if self.source[self.at] == ",":
            self.at += 1
            self._skip(_BETWEEN)

    def _note(self, path: Path, at: int) -> None:
        self.found.setdefault(path, at)

    def _skip(self, what: re.Pattern[str]) -> None:
        match = what.match(self.source, self.at)
        self.at = match.end() if match else self.at + 1
