"""Errors of pydantic as mistakes with messages of our own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bipot_rs.scene.mistakes import Mistake, MistakeKind
from bipot_rs.scene.schema.formula import TEXT_FOR_NUMBER, evaluate
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.suggestions import suggestion
from bipot_rs.scene.schema.table import key_path

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

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
    """The mistake of one entry of ``ValidationError.errors()``.

    Parameters
    ----------
    known
        As `suggestions.standing` returns it.
    table
        The tables of the scene.
    values
        Values of the names in formulas.
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
