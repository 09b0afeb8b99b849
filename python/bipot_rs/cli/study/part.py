"""Parts of a study, each solved by a process of its own: ``--part I/N``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from bipot_rs.cli.study.axes import MOST

# Names of the folders of parts, for `pathlib.Path.glob`.
FOLDERS = "part-*-of-*"


@dataclass(frozen=True)
class StudyPart:
    """Part ``number`` of ``count``, numbered from 1."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def folder(self) -> str:
        """Name of its folder in the folder of the study."""
        return f"part-{self.number}-of-{self.count}"


def part(text: str) -> StudyPart:
    """Read ``I/N``.

    Raises
    ------
    ValueError
        It is not of this form, or I is not between 1 and N.
    """
    match = re.fullmatch(r"\s*([0-9]{1,9})\s*/\s*([0-9]{1,9})\s*", text)
    if match is None:
        raise ValueError(
            f"--part {text}: expected I/N, as in 2/4 for the second of 4 parts"
        )
    number, count = int(match[1]), int(match[2])
    if not 1 <= count <= MOST:
        raise ValueError(f"--part {text}: N is {count}, not between 1 and {MOST}")
    if not 1 <= number <= count:
        raise ValueError(f"--part {text}: I is {number}, not between 1 and {count}")
    return StudyPart(number, count)


def deal(costs: Sequence[tuple[float, ...]], count: int) -> list[list[int]]:
    """Distribute rows over ``count`` parts; ascending row numbers of each part.

    The rows are sorted by cost and dealt forth and back, so that all parts have about the
    same number of rows of each cost. Every N-th row would not do: with four meshes and
    four parts, one part would get all the finest meshes.

    Parameters
    ----------
    costs
        A cost of each row; tuples are compared entry by entry.
    """
    parts: list[list[int]] = [[] for _ in range(count)]
    # Sorting is stable: rows of equal cost stay in the order of the study.
    ordered = sorted(range(len(costs)), key=lambda k: costs[k], reverse=True)
    for place, row in enumerate(ordered):
        turn, seat = divmod(place, count)
        parts[seat if turn % 2 == 0 else count - 1 - seat].append(row)
    return [sorted(rows) for rows in parts]
