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

from bipot_rs.schema import KIND, UNUSED, Scene, inconsistencies

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
    """Inconsistencies of a scene that have nothing to do with what is ``wrong`` in it.

    Few are passed over, which are told once the others are mended; none is made up.
    """
    try:
        rest = deepcopy(table)
    except RecursionError:  # what is unknown may nest as deep as it likes
        return []
    # Number of the stand-in that each place has.
    mended: dict[Where, int] = {}
    wrong = list(wrong)
    while wrong:
        if not all(_replace(rest, place, mended) for place in dict.fromkeys(wrong)):
            return []
        try:
            scene = Scene.model_validate(rest)
        except ValidationError as error:
            wrong = places(error)
            continue
        if _MAKERS & mended.keys():
            return []
        return list(_apart(inconsistencies(scene), mended))
    return []


def _replace(table: dict[str, Any], place: Where, mended: dict[Where, int]) -> bool:
    """Put the next stand-in; whether there was one."""
    at: Any = table
    for depth, part in enumerate(place):
        inside = at[part] if _has(at, part) else None
        below = place[depth + 1 :]
        if not below or not isinstance(inside, list if _is_number(below[0]) else dict):
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


def _is_number(part: str | int) -> bool:
    return isinstance(part, int)


def _apart(found: Iterable[str], mended: Iterable[Where]) -> Iterator[str]:
    """Sentences whose places are neither above nor below those of stand-ins."""
    near = {".".join(map(str, place)) for place in mended}
    above = {place[:k] for place in near for k, sign in enumerate(place) if sign == "."}
    tables = {place.partition(".")[0] for place in near}
    for sentence in found:
        keys = sentence.partition(": ")[0].split(".")
        up = {".".join(keys[:k]) for k in range(1, len(keys) + 1)}
        # Counts of the path are compared with one another, and grids with the mesh.
        beside = {"path": "path", "body": "mesh"}.get(keys[0])
        touched = near & up or ".".join(keys) in above or beside in tables
        if not touched and not sentence.endswith(UNUSED):
            yield sentence
