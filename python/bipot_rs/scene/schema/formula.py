"""Formulas in place of numbers: ``"2*F"``. Nothing but arithmetic is evaluated.

A formula has numbers, names of ``[parameter]``, ``n`` for ``mesh.n``, ``+ - * /`` and parentheses.
It is replaced by its value when a scene is read.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Iterable, Mapping, MutableMapping
from typing import TYPE_CHECKING, Any
from unicodedata import normalize

from bipot_rs._lib.messages import instead
from bipot_rs._lib.types import Record
from bipot_rs.scene.schema.table import key_path

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_OPERATORS: Mapping[type, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
# Longer texts are mistakes, and may nest too deeply.
_CHARACTERS = re.compile(r"[\w\s.+*/()-]{1,1000}")
# What pydantic says of a text in place of a number.
TEXT_FOR_NUMBER = ("float_type", "int_type")


def evaluate(text: str, values: Mapping[str, float]) -> float:
    """Value of a formula.

    Raises `ValueError`: it is none, or a name has no value; the message is the end of a sentence.
    """
    try:
        if not _CHARACTERS.fullmatch(text):
            raise SyntaxError
        value = _evaluate(ast.parse(text.strip(), mode="eval").body, values)
    except ZeroDivisionError:
        raise ValueError("it divides by zero") from None
    except (SyntaxError, RecursionError, OverflowError):
        raise ValueError("expected numbers, names, + - * / and parentheses") from None
    if not math.isfinite(value):
        raise ValueError("its value is not finite")
    return value


def _evaluate(node: ast.AST, values: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number) if type(number) is not bool:
            return float(number)
        case ast.Name(id=name) if name in values:
            if math.isnan(values[name]):
                raise ValueError(f"{name!r} has no value yet")
            return float(values[name])
        case ast.Name(id=name):
            hint = "define it in [parameter]"
            if name == "n":
                raise ValueError("it needs mesh.n, which is missing")
            raise ValueError(
                f"there is no parameter {name!r}{instead(name, values, hint)}"
            )
        case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
            of = _OPERATORS[type(op)]
            return float(of(_evaluate(left, values), _evaluate(right, values)))
        case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_evaluate(operand, values)))
    raise SyntaxError


def _names(text: object) -> list[str]:
    return re.findall(r"[^\W\d]\w*", normalize("NFKC", str(text)))


class Formulas:
    """Replaces the formulas of a table, which pydantic found where numbers should be.

    ``values`` of the names, and key paths of those that are ``unused``.
    """

    def __init__(self, table: Record) -> None:
        given, mesh = table.get("parameter"), table.get("mesh")
        self.values: MutableMapping[str, float] = {}
        self.unused: dict[str, str] = {}
        for name, value in given.items() if isinstance(given, dict) else ():
            self._define(name, f"parameter.{name}", value)
        if mesh is not None and (not isinstance(mesh, dict) or "n" in mesh):
            self._define("n", "mesh.n", mesh["n"] if isinstance(mesh, dict) else mesh)

    def _define(self, name: str, key: str, value: object) -> None:
        name = normalize("NFKC", name)  # as Python reads it in a formula
        self.unused[name] = key
        # Not a number yet, or a mistake that is reported for its own key.
        self.values[name] = value if isinstance(value, int | float) else math.nan

    def follows(self, error: ErrorDetails) -> bool:
        """Whether an error follows from a name whose own value is a mistake."""
        names = _names(error.get("input")) if error["type"] in TEXT_FOR_NUMBER else []
        return any(math.isnan(self.values.get(name, 0.0)) for name in names)

    def fill(self, table: Any, errors: Iterable[ErrorDetails]) -> None:
        """Replace the formulas that have a value; a parameter may use those before it."""
        for error in errors:
            text = error.get("input")
            if error["type"] not in TEXT_FOR_NUMBER or not isinstance(text, str):
                continue
            path = key_path(error["loc"], table)
            try:
                value = evaluate(text, self.values)
            except ValueError:
                continue  # described with the errors that remain
            for name in _names(text):
                self.unused.pop(name, None)
            if error["type"] == "int_type" and value.is_integer():
                value = int(value)
            at = table
            for part in path[:-1]:
                at = at[int(part)] if isinstance(at, list) else at[part]
            at[int(path[-1]) if isinstance(at, list) else path[-1]] = value
            if path[0] == "parameter" or path == ["mesh", "n"]:
                self.values[normalize("NFKC", path[-1])] = value
