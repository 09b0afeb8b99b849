"""What else is wrong with a scene, where some of it cannot be read.

Names are looked up once all values are what they should be. So that a mistake of a value
does not hide one of a name until the next round, stand-ins take the places of what is
wrong, and the rest of the scene is looked at.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import deepcopy
from typing import Any

from pydantic import ValidationError

from bipot_rs.scene.schema.consistency import (
    Unknown,
    Unused,
    inconsistencies,
    out_of_range,
)
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import KIND

# Keys and numbers of entries, down to a value.
Where = tuple[str | int, ...]

# Tried in turn where something is wrong, until one can be read: a number that most tables
# take, one that counts, a name, vectors, a table. What none of them suits is left out.
_STAND_INS: tuple[Any, ...] = (0.25, 1, "x", [1.0, 0.5], [1.0, 0.5, 0.5], {})
# Tables that make names: without one, nothing can be said of those that use them.
_MAKERS = {("material",), ("body",), ("obstacle",), ("path",), ("path", "amplitude")}


def places(error: ValidationError) -> list[Where]:
    """Where pydantic's mistakes are, as a file says it."""
    return [
        tuple(part for part in e["loc"] if not str(part).startswith(KIND))
        for e in error.errors()
    ]


def others(table: dict[str, Any], wrong: Iterable[Where]) -> list[str]:
    """What else is wrong with a scene, that has nothing to do with what is ``wrong``.

    Some of it may be passed over, which is told once the rest is mended; none is made up.
    """
    try:
        rest = deepcopy(table)
    except RecursionError:  # what is unknown may nest as deep as it likes
        return []
    # Number of the stand-in that each place has.
    mended: dict[Where, int] = {}
    found: list[str] = []
    wrong = list(wrong)
    while wrong:
        if not all(_replace(rest, place, mended) for place in dict.fromkeys(wrong)):
            return found
        try:
            scene = Scene.model_validate(rest)
        except ValidationError as error:
            wrong = places(error)
            continue
        extreme = out_of_range(scene)
        found += [sentence for _, sentence in extreme]
        wrong = [place for place, _ in extreme]
        if not wrong and not any(_makes_names(place) for place in mended):
            found += _apart(inconsistencies(scene), mended)
    return found


def _makes_names(place: Where) -> bool:
    """Whether others may use names from there: a table, or one whose name is misspelt."""
    return place in _MAKERS or (len(place) == 1 and place[0] not in Scene.model_fields)


def _replace(table: dict[str, Any], place: Where, mended: dict[Where, int]) -> bool:
    """Put the next stand-in; whether there was one."""
    if not place:  # a key that looks like what a union calls its kinds
        return False
    at: Any = table
    for depth, part in enumerate(place):
        inside = at[part] if _has(at, part) else None
        below = place[depth + 1 :]
        table_or_list = list if below and isinstance(below[0], int) else dict
        if not below or not isinstance(inside, table_or_list):
            # A plain value, or a list, may stand for a table: its place is then meant.
            place = place[: depth + 1]
            break
        at = inside
    number = mended[place] = mended.get(place, -1) + 1
    last = place[-1]
    if number < len(_STAND_INS):
        if isinstance(at, list) and not _has(at, last):
            return False
        at[last] = deepcopy(_STAND_INS[number])
        return True
    if number == len(_STAND_INS) and isinstance(at, dict):
        at.pop(last, None)
        return True
    return False


def _has(at: Any, part: str | int) -> bool:
    if isinstance(at, list):
        return isinstance(part, int) and part < len(at)
    return part in at


def _apart(found: Iterable[str], mended: Iterable[Where]) -> Iterator[str]:
    """Sentences that no stand-in has to do with."""
    near = {".".join(map(str, place)) for place in mended}
    entries = {".".join(map(str, place[:2])) for place in mended}
    tables = {str(place[0]) for place in mended}
    for sentence in found:
        # What uses a thing may be what a stand-in has taken the place of.
        if isinstance(sentence, Unused) or any(_within(sentence, at) for at in near):
            continue
        name = isinstance(sentence, Unknown)
        # Keys of one entry go together or do not; a name is known whatever is beside it.
        if not name and any(_within(sentence, entry) for entry in entries):
            continue
        # Grids take the cells of the mesh, and the path's counts and names are its own.
        if _within(sentence, "body") and "mesh" in tables and not name:
            continue
        if _within(sentence, "path") and tables & {"path", "body", "mesh"}:
            continue
        if sentence.partition(": ")[0].endswith(".amplitude") and "path" in tables:
            continue
        yield sentence


def _within(sentence: str, place: str) -> bool:
    return sentence.startswith((f"{place}.", f"{place}: "))
