"""The keys that a scene may have at a place, read off its tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from bipot_rs.words import nearest

# Deeper than any table of a scene; a file may nest as deep as it likes.
_DEEPEST = 16


def instead(root: type[BaseModel], place: Sequence[str], table: Any) -> str:
    """What an unknown key at ``place`` may have been meant for, to end a sentence.

    Parameters
    ----------
    root
        The whole scene.
    place
        Keys and numbers of entries down to the unknown one.
    table
        The scene as it was read, where the key may stand somewhere else.
    """
    *above, wrong = place
    known = keys(root, above)
    if found := nearest(wrong, known):
        return f", did you mean {'.'.join([*above, found])}?"
    elsewhere = [path for path in _paths(table) if path.split(".")[-1] == wrong]
    elsewhere = [path for path in elsewhere if path != ".".join(place)]
    if elsewhere:
        return f", did you mean {' or '.join(elsewhere[:3])}?"
    return f", expected one of {', '.join(known)}" if known else ""


def keys(root: type[BaseModel], place: Sequence[str]) -> list[str]:
    """Keys of the table at a place; none where there is no table."""
    found: list[Any] = [root]
    for part in place:
        found = [inner for kind in found for inner in _step(kind, part)]
    return list(dict.fromkeys(name for kind in found for name in _keys(kind)))


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _fields(table: type[BaseModel]) -> dict[str, Any]:
    return {f.alias or name: f.annotation for name, f in table.model_fields.items()}


def _step(annotation: Any, part: str) -> Iterator[Any]:
    """What the entry ``part`` may be, of a table, a list, a mapping or a union of them."""
    inner = get_args(annotation)
    if _is_table(annotation):
        fields = _fields(annotation)
        if part in fields:
            yield fields[part]
    elif get_origin(annotation) is list:
        if part.isdigit():
            yield inner[0]
    elif get_origin(annotation) is dict:
        yield inner[1]
    else:
        for one in inner:
            yield from _step(one, part)


def _keys(annotation: Any) -> Iterator[str]:
    if _is_table(annotation):
        yield from _fields(annotation)
    elif get_origin(annotation) not in (list, dict):
        for one in get_args(annotation):
            yield from _keys(one)


def _paths(table: Any, path: str = "", depth: int = _DEEPEST) -> Iterator[str]:
    """Places of the keys of a table that was read, down to a depth."""
    entries: Any = ()
    if not depth:
        return
    if isinstance(table, dict):
        entries = table.items()
    elif isinstance(table, list):
        entries = enumerate(table)
    for key, inner in entries:
        here = f"{path}.{key}" if path else str(key)
        if isinstance(table, dict):
            yield here
        yield from _paths(inner, here, depth - 1)
