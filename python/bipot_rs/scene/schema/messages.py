"""Errors of pydantic as mistakes with messages of our own, which suggest keys."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeGuard, get_args, get_origin

from pydantic import BaseModel

from bipot_rs._lib.messages import nearest
from bipot_rs.scene.mistakes import Mistake, MistakeKind
from bipot_rs.scene.schema.formula import TEXT_FOR_NUMBER, evaluate
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import key_path

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

# Deeper than any valid scene. A wrong file may nest to any depth.
_DEEPEST = 16


def suggestion(
    root: type[BaseModel], place: Sequence[str], standing: Mapping[str, Sequence[str]]
) -> str:
    """End of a message about the unknown key ``place``: similar keys, else all known ones.

    ``standing`` has other places of the scene with a key of this name.
    """
    *above, wrong = place
    names = keys(root, above)
    if name := nearest(wrong, names):
        return f", did you mean {'.'.join([*above, name])}?"
    if elsewhere := standing.get(wrong):
        return f", did you mean {' or '.join(elsewhere[:3])}?"
    return f", expected one of {', '.join(names)}" if names else ""


def list_key_paths(root: type[BaseModel], table: object) -> dict[str, list[str]]:
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


# For each kind of error that the tables can raise: the message, with names of the context
# of the error.
MESSAGES: Mapping[str, tuple[MistakeKind, str]] = {
    "bool_type": (MistakeKind.TYPE, "should be true or false"),
    "dict_type": (MistakeKind.TYPE, "should be a table"),
    "extra_forbidden": (MistakeKind.UNKNOWN_KEY, "unknown key"),
    "finite_number": (MistakeKind.RANGE, "should be a finite number"),
    "float_type": (MistakeKind.TYPE, "should be a valid number"),
    "greater_than": (MistakeKind.RANGE, "should be greater than {gt:.15g}"),
    "greater_than_equal": (
        MistakeKind.RANGE,
        "should be greater than or equal to {ge:.15g}",
    ),
    "int_from_float": (MistakeKind.INTEGER, "should be a valid integer"),
    "int_type": (MistakeKind.INTEGER, "should be a valid integer"),
    "less_than": (MistakeKind.RANGE, "should be less than {lt:.15g}"),
    "less_than_equal": (MistakeKind.RANGE, "should be less than or equal to {le:.15g}"),
    "list_type": (MistakeKind.TYPE, "should be a list"),
    "literal_error": (MistakeKind.RANGE, "should be {expected}"),
    "missing": (MistakeKind.MISSING_KEY, "is missing"),
    "model_attributes_type": (MistakeKind.TYPE, "should be a table"),
    "model_type": (MistakeKind.TYPE, "should be a table"),
    "string_type": (MistakeKind.TYPE, "should be a text"),
    "too_long": (
        MistakeKind.RANGE,
        "number of entries should be at most {max_length}, is {actual_length}",
    ),
    "too_short": (
        MistakeKind.RANGE,
        "number of entries should be at least {min_length}, is {actual_length}",
    ),
    "value_error": (MistakeKind.RANGE, "{error}"),
}


def describe_error(
    error: ErrorDetails,
    known: Mapping[str, Sequence[str]],
    table: object,
    values: Mapping[str, float],
) -> Mistake:
    """The mistake of one entry of ``ValidationError.errors()`` of the scene ``table``.

    ``known`` is its `list_key_paths`, ``values`` those of the names in formulas.
    """
    kind, words = MESSAGES.get(error["type"], (MistakeKind.RANGE, "is not valid"))
    message = words.format(**error.get("ctx", {}))
    key = ".".join(key_path(error["loc"], table))
    parts = [str(part) for part in error["loc"]]
    if kind is MistakeKind.UNKNOWN_KEY:
        return Mistake(key, message + suggestion(Scene, parts, known), kind)
    if kind is MistakeKind.MISSING_KEY:
        return Mistake(key, message, kind)
    value = error.get("input")
    if parts[0] == "pressure" and isinstance(value, dict) and "amplitude" in value:
        message += "; write amplitude as a key of [[pressure]], not of value"
    if isinstance(value, str | int | float):
        message += f", got {value!r}"
    if error["type"] in TEXT_FOR_NUMBER and isinstance(value, str):
        try:
            evaluate(value, values)
        except ValueError as reason:
            message += f": {reason}"
        if parts[0] == "parameter":
            message += "; a parameter may use those before it"
    return Mistake(key, message, kind)
