"""Tables in text files: CSV with a header.

Messages name the file and the line.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bipot_rs._lib.messages import count_noun, meant, nearest, printable
from bipot_rs._lib.text_files import real, whole
from bipot_rs._lib.types import Floats, Ints


class CsvTable:
    """A CSV file, its entries as text; line numbers start at 1.

    The first line contains the names of the columns. Blank lines and lines that begin
    with ``#`` are ignored. A blank entry is a missing value.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        rows = csv.reader(_lines(self.path))
        header: list[str] | None = None
        self.lines: list[int] = []
        self.rows: list[list[str]] = []
        try:
            for row in rows:
                cells = [cell.strip() for cell in row]
                if not any(cells) or cells[0].startswith("#"):
                    continue
                if header is None:
                    header = [cell.lower() for cell in cells]
                    self.header_line = rows.line_num
                    continue
                if len(cells) != len(header):
                    raise self.wrong(
                        rows.line_num,
                        f"has {count_noun(len(cells), 'entry')}, expected "
                        f"{len(header)} as in the header",
                    )
                self.lines.append(rows.line_num)
                self.rows.append(cells)
        except csv.Error as error:
            raise self.wrong(rows.line_num, str(error)) from None
        if header is None:
            raise ValueError(f"{self.path} is empty, expected a line with column names")
        if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
            raise self.wrong(
                self.header_line,
                f"has one column, {header[0]!r}: expected names separated by commas",
            )
        if len(set(header)) < len(header):
            raise self.wrong(
                self.header_line, f"repeats a column name: {', '.join(header)}"
            )
        self.names = header

    def __len__(self) -> int:
        return len(self.rows)

    def wrong(self, line: int, what: str) -> ValueError:
        """Make an error that names the file and the line."""
        return ValueError(f"{self.path} line {line}: {printable(what)}")

    def expect(self, needed: Sequence[str], optional: Sequence[str]) -> None:
        """Refuse a table with a missing or an unknown column."""
        for name in needed:
            if name not in self.names:
                similar = nearest(name, set(self.names) - {*needed, *optional})
                guess = f": is it {similar!r}?" if similar else ""
                raise self.wrong(
                    self.header_line,
                    f"there is no column {name}, found {', '.join(self.names)}{guess}",
                )
        for name in self.names:
            if name not in {*needed, *optional}:
                raise self.wrong(
                    self.header_line,
                    f"column {name!r} is unknown, expected some of "
                    f"{', '.join([*needed, *optional])}"
                    f"{meant(name, [*needed, *optional])}",
                )

    def numbers(self, name: str, missing: float | None = None) -> Floats:
        """A column of finite numbers; ``missing`` replaces blank entries."""
        if name not in self.names:
            return np.full(len(self), np.nan if missing is None else missing)
        at = self.names.index(name)
        column = np.empty(len(self))
        for k, row in enumerate(self.rows):
            column[k] = self._number(name, row[at], self.lines[k], missing)
        return column

    def _number(self, name: str, text: str, line: int, missing: float | None) -> float:
        if not text and missing is not None:
            return missing
        try:
            value = real(text)
        except ValueError:
            value = np.inf
        if not np.isfinite(value):
            raise self.wrong(line, f"{name} is {text!r}, expected a finite number")
        return value

    def integers(self, name: str, missing: int | None = None) -> Ints:
        """A column of integers; ``missing`` replaces blank entries."""
        if name not in self.names and missing is not None:
            return np.full(len(self), missing, np.int64)
        at = self.names.index(name)
        column = np.empty(len(self), np.int64)
        for k, row in enumerate(self.rows):
            text = row[at]
            if not text and missing is not None:
                column[k] = missing
                continue
            try:
                column[k] = whole(text)
            except (ValueError, OverflowError):
                raise self.wrong(
                    self.lines[k], f"{name} is {text!r}, expected an integer"
                ) from None
        return column


def _lines(path: Path) -> Iterator[str]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield from file
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not text: {error.reason}") from None


def write(path: Path, header: Sequence[str], rows: Iterator[Sequence[object]]) -> None:
    """Write a table with all digits of floats; an earlier file is replaced at the end."""
    from bipot_rs.files.drafts import aside

    with aside(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(header)
        table.writerows(rows)
