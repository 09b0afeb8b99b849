"""A whole study before any of its rows is solved."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.study import axes
from bipot_rs.scene.mistakes import Mistake, MistakeKind

if TYPE_CHECKING:
    from bipot_rs.scene.schema.root import Scene

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


def _digest(known: object) -> str:
    text = json.dumps(known, sort_keys=True)
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
    """Read the scene of each row.

    Raises `SceneError`: the scene of every row has mistakes; the error is that of the first
    row.
    Raises `ValueError`: ``settings`` or ``ranges`` are wrong.
    """
    from bipot_rs.cli.run.cost_forecast import assembly
    from bipot_rs.scene.mistakes import SceneError
    from bipot_rs.scene.reading import read

    rows = axes.rows(settings, ranges)
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
        key, texts = axes.space_values(setting)
        if any(m.key == key and m.kind is MistakeKind.INTEGER for m in mistakes):
            shown = [f"{float(v):.6g}" for v in texts[:4]]
            shown += ["…"] if len(texts) > len(shown) else []
            raise ValueError(
                f"--range {setting}: {key} takes integers, but this is "
                f"{count_noun(len(texts), 'value')}, {', '.join(shown)}: the third number is "
                "the number of values, not their spacing"
            )
