"""Suggestions for unknown keys, from the annotations of the tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeGuard, get_args, get_origin

from pydantic import BaseModel

from bipot_rs._lib.messages import nearest

# Deeper than any valid scene. A wrong file may nest to any depth.
_DEEPEST = 16


def suggestion(
    root: type[BaseModel], place: Sequence[str], standing: Mapping[str, Sequence[str]]
) -> str:
    """End of a message about an unknown key: similar keys, else all known ones.

    Parameters
    ----------
    root
        Table of the whole scene.
    place
        Key path of the unknown key, its parts.
    standing
        `standing` of the scene: other places that have a key of this name.
    """
    *above, wrong = place
    names = keys(root, above)
    if name := nearest(wrong, names):
        return f", did you mean {'.'.join([*above, name])}?"
    if elsewhere := standing.get(wrong):
        return f", did you mean {' or '.join(elsewhere[:3])}?"
    return f", expected one of {', '.join(names)}" if names else ""


def standing(root: type[BaseModel], table: object) -> dict[str, list[str]]:
    """Key paths of a scene by their last key, for all keys that are known."""
    paths: dict[str, list[str]] = {}
    for key, path in _paths([root], table):
        paths.setdefault(key, []).append(path)
    return paths


def keys(root: type[BaseModel], place: Sequence[str]) -> list[str]:
    """Keys of the table at a key path; [] if there is no table."""
    kinds: list[object] = [root]
    for part in place:
        kinds = [inner for kind in kinds for inner in _step(kind, part)]
    return list(dict.fromkeys(name for kind in kinds for name in _keys(kind)))


def _is_table(annotation: object) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _fields(table: type[BaseModel]) -> dict[str, object]:
    return {f.alias or name: f.annotation for name, f in table.model_fields.items()}


def _step(annotation: object, part: str) -> Iterator[object]:
    """Possible annotations of the entry ``part`` of a table, list, mapping or union."""
    inner = get_args(annotation)
    if _is_table(annotation):
        fields = _fields(annotation)
        if part in fields:
            yield fields[part]
    elif get_origin(annotation) is list:
        yield inner[0]
    elif get_origin(annotation) is dict:
        yield inner[1]
    else:
        for kind in inner:
            yield from _step(kind, part)


def _keys(annotation: object) -> Iterator[str]:
    if _is_table(annotation):
        yield from _fields(annotation)
    elif get_origin(annotation) not in (list, dict):
        for kind in get_args(annotation):
            yield from _keys(kind)


def _paths(
    kinds: Sequence[object], table: object, path: str = "", depth: int = _DEEPEST
) -> Iterator[tuple[str, str]]:
    """Known keys of ``table``, which has one of ``kinds``, with their key paths."""
    if not depth or not kinds:
        return
    if isinstance(table, dict):
        entries: Iterable[tuple[object, object]] = table.items()
        names = {name for kind in kinds for name in _keys(kind)}
    elif isinstance(table, list):
        entries, names = enumerate(table), set()
    else:
        return
    for key, inner in entries:
        here = f"{path}.{key}" if path else str(key)
        if key in names:
            yield str(key), here
        below = [kind_below for kind in kinds for kind_below in _step(kind, str(key))]
        yield from _paths(below, inner, here, depth - 1)
