"""Messages about the tables of a scene: what is wrong with a value, and where it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from bipot_rs._lib.messages import counted
from bipot_rs._lib.toml_places import places


def _length(sign: str) -> Callable[[Mapping[str, Any]], str]:
    """Message about the length of a list or the number of tables."""

    def said(about: Mapping[str, Any]) -> str:
        limit = about["min_length" if sign == "at least" else "max_length"]
        found = about["actual_length"]
        return f"should have {sign} {counted(limit, 'entry')}, has {found}"

    return said


def _limit(words: str, name: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda about: f"should be {words} {about[name]:.15g}"


def _words(text: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda _: text


# Message of each kind of error that the tables can raise in pydantic, from its context.
SAID: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "bool_type": _words("should be true or false"),
    "dict_type": _words("should be a table"),
    "extra_forbidden": _words("unknown key"),
    "finite_number": _words("should be a finite number"),
    "float_type": _words("should be a valid number"),
    "greater_than": _limit("greater than", "gt"),
    "greater_than_equal": _limit("greater than or equal to", "ge"),
    "int_from_float": _words("should be a valid integer"),
    "int_type": _words("should be a valid integer"),
    "less_than": _limit("less than", "lt"),
    "less_than_equal": _limit("less than or equal to", "le"),
    "list_type": _words("should be a list"),
    "literal_error": lambda about: f"should be {about['expected']}",
    "missing": _words("is missing"),
    "model_attributes_type": _words("should be a table"),
    "model_type": _words("should be a table"),
    "string_type": _words("should be a text"),
    "too_long": _length("at most"),
    "too_short": _length("at least"),
    "value_error": lambda about: str(about["error"]),
}


def said(error: Mapping[str, Any]) -> str:
    """What is wrong, for an entry of ``ValidationError.errors()``."""
    known = SAID.get(error["type"])
    return known(error.get("ctx", {})) if known else "is not valid"


def with_places(
    problems: Iterable[str], source: str, settings: Sequence[str] = ()
) -> list[str]:
    """Add the line and the column of its key to each message.

    Parameters
    ----------
    problems
        Messages that begin with a key path.
    source
        The text of the scene.
    settings
        ``"key=value"``: values that do not stand in the text.
    """
    found = places(source.removeprefix("\ufeff"))
    known = {".".join(map(str, path)): at for path, at in found.items()}
    set_here = [setting.partition("=")[0].strip() for setting in settings]
    return [problem + _place(problem, known, set_here) for problem in problems]


def _place(
    problem: str, known: Mapping[str, tuple[int, int]], set_here: Sequence[str]
) -> str:
    """End of a message: where its key is, or the table that lacks it; "" if unknown."""
    key = problem.partition(": ")[0]
    if any(key == one or key.startswith(f"{one}.") for one in set_here):
        return ""
    while key and key not in known:
        key = key.rpartition(".")[0]
    if not key:
        return ""
    line, column = known[key]
    return f" (at line {line}, column {column})"
