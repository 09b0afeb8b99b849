"""A whole study before any of its rows is solved: its rows, their parts, and digests of them.

Rows are all combinations of the values of ``--set`` and ``--range``; each part of ``--part
I/N`` is solved by a process of its own.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun
from bipot_rs.scene.mistakes import Mistake, MistakeKind

if TYPE_CHECKING:
    from bipot_rs.scene.schema.root import Scene


# More rows are probably a mistake in a range.
MOST = 100_000


def values(setting: str) -> tuple[str, list[str]]:
    """Split ``KEY=V1,V2,…`` into key and values, not at commas in brackets or quotes."""
    key, equals, text = setting.partition("=")
    parts, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += c
    if not equals or not key.strip() or not all(value.strip() for value in parts):
        raise ValueError(
            f"--set {setting}: expected KEY=V1,V2,…, as in contact.0.mu=0.1,0.2"
        )
    return key.strip(), [value.strip() for value in parts]


def space_values(setting: str) -> tuple[str, list[str]]:
    """Split ``KEY=FROM:TO:COUNT`` into the key and COUNT equally spaced values.

    The values are integers if the ends are and the spacing allows it.
    """
    key, equals, text = setting.partition("=")
    parts = text.split(":")

    def problem(why: str) -> ValueError:
        return ValueError(
            f"--range {setting}: {why}; expected KEY=FROM:TO:COUNT, as in "
            "contact.0.mu=0.1:0.5:3, which is 0.1, 0.3, 0.5"
        )

    if not equals or not key.strip():
        raise problem("KEY is missing")
    if len(parts) != 3:
        raise problem(f"has {count_noun(len(parts), 'part')} instead of three")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise problem("FROM and TO must be numbers, COUNT an integer") from None
    if not (abs(low) < 1e300 and abs(high) < 1e300):
        raise problem("a value is beyond 1e300")
    if not 1 <= count <= MOST:
        raise problem(f"COUNT is {count}, not between 1 and {MOST}")
    if count == 1 and low != high:
        raise ValueError(
            f"--range {setting}: COUNT is 1, but FROM {low} and TO {high} differ"
        )
    step = (high - low) / max(count - 1, 1)
    # The last value is TO itself, without rounding.
    numbers = [low + k * step for k in range(count - 1)] + [high]
    whole = all("." not in part and "e" not in part.lower() for part in parts[:2])
    if whole and all(value == round(value) for value in numbers):
        return key.strip(), [str(round(value)) for value in numbers]
    # 0.30000000000000004 should be 0.3.
    return key.strip(), [repr(float(f"{value:.15g}")) for value in numbers]


def list_rows(settings: Sequence[str], ranges: Sequence[str]) -> list[dict[str, str]]:
    """All combinations of the values; the last key changes fastest."""
    axes = [values(s) for s in settings] + [space_values(s) for s in ranges]
    names = [key for key, _ in axes]
    for key in names:
        if names.count(key) > 1:
            raise ValueError(f"{key} is given {names.count(key)} times, expected once")
    if not axes:
        raise ValueError(
            "nothing varies: give --set KEY=V1,V2,… or --range KEY=FROM:TO:COUNT"
        )
    count = 1
    for _, texts in axes:
        count *= len(texts)
    if count > MOST:
        raise ValueError(
            f"the settings have {count} combinations, expected at most {MOST}"
        )
    product = itertools.product(*(texts for _, texts in axes))
    return [dict(zip(names, choice, strict=True)) for choice in product]


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
    """Read ``I/N``."""
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

    ``costs``: a cost of each row; tuples are compared entry by entry.
    """
    parts: list[list[int]] = [[] for _ in range(count)]
    # Sorting is stable: rows of equal cost stay in the order of the study.
    ordered = sorted(range(len(costs)), key=lambda k: costs[k], reverse=True)
    for place, row in enumerate(ordered):
        turn, seat = divmod(place, count)
        parts[seat if turn % 2 == 0 else count - 1 - seat].append(row)
    return [sorted(rows) for rows in parts]


# Parts of a scene that change no size of its problem: numbers, names, loads.
_NO_SIZES: Mapping[str, bool | set[str] | dict[str, set[str]]] = {
    "title": True,
    "units": True,
    "material": True,
    "traction": True,
    "pressure": True,
    "body_force": True,
    "strain": True,
    "contact": {"__all__": {"mu"}},
    "solver": {"method", "tol", "max_iterations"},
}


@dataclass(frozen=True)
class StudyRecord:
    """What a study is, as its folder says."""

    # scene, settings, ranges, method, tol: as on the command line.
    scene: str
    settings: list[str]
    ranges: list[str]
    method: str | None
    tol: float | None
    # title, units: those of the first row without mistakes.
    title: str
    units: dict[str, str]
    study: str  # a digest of all rows: equal for all parts of a study
    count: int  # number of rows of the whole study
    part: str | None = None  # `"I/N"` for the folder of a part
    # Row numbers of the part; all rows if there is no part.
    rows: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Study:
    """One scene with many settings."""

    record: StudyRecord  # what it is, for its folder
    rows: list[dict[str, str]]  # settings of each row
    # A digest of everything that determines a row; empty where the scene has mistakes.
    digests: list[str]
    # Bytes of the assembly and number of load steps of each row, to compare rows.
    costs: list[tuple[float, int]]
    # A digest of what determines the memory of a row; empty where the scene has mistakes.
    shapes: list[str]

    @property
    def keys(self) -> list[str]:
        """The keys that vary."""
        return list(self.rows[0])


def _digest(value: object) -> str:
    text = json.dumps(value, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def row_digest(scene: Scene, method: str | None, tol: float | None) -> str:
    """A digest of everything that determines a row; None: settings of the scene."""
    from bipot_rs.cli.run.resume import stamps

    return _digest(stamps(scene, method, tol))


def format_settings(settings: Mapping[str, str]) -> list[str]:
    """The settings of a row as on the command line, ``KEY=VALUE``."""
    return [f"{key}={value}" for key, value in settings.items()]


def plan(
    scene: str,
    settings: Sequence[str],
    ranges: Sequence[str],
    method: str | None,
    tol: float | None,
) -> Study:
    """Read the scene of each row."""
    from bipot_rs.cli.run.cost_forecast import assembly
    from bipot_rs.scene.mistakes import SceneError
    from bipot_rs.scene.reading import read

    rows = list_rows(settings, ranges)
    digests, costs, shapes, first, first_scene = [], [], [], None, None
    for row in rows:
        try:
            scene_of_row = read(scene, format_settings(row))
        except SceneError as error:
            _refuse_fractions(ranges, error.mistakes)
            first = error if first is None else first
            digests.append("")
            costs.append((0.0, 0))
            shapes.append("")
            continue
        first_scene = scene_of_row if first_scene is None else first_scene
        digests.append(row_digest(scene_of_row, method, tol))
        costs.append((assembly(scene_of_row), scene_of_row.path.count()))
        shapes.append(_digest(scene_of_row.model_dump(mode="json", exclude=_NO_SIZES)))
    if first is not None and first_scene is None:
        raise first
    record = StudyRecord(
        scene,
        list(settings),
        list(ranges),
        method,
        tol,
        title=first_scene.title if first_scene else "",
        units=first_scene.units.model_dump() if first_scene else {},
        study=_digest([rows, digests]),
        count=len(rows),
    )
    return Study(record, rows, digests, costs, shapes)


def _refuse_fractions(ranges: Sequence[str], mistakes: Sequence[Mistake]) -> None:
    """Refuse a range with fractions for a key that takes integers."""
    for setting in ranges:
        key, texts = space_values(setting)
        if any(m.key == key and m.kind is MistakeKind.INTEGER for m in mistakes):
            shown = [f"{float(v):.6g}" for v in texts[:4]]
            shown += ["…"] if len(texts) > len(shown) else []
            raise ValueError(
                f"--range {setting}: {key} takes integers, but this is "
                f"{count_noun(len(texts), 'value')}, {', '.join(shown)}: the third number is "
                "the number of values, not their spacing"
            )
