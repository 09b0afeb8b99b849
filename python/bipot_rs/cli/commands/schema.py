"""``bipot schema``: the JSON schema of scene files, for editors."""

from __future__ import annotations

import argparse
import sys
from json import dumps

from bipot_rs.cli.arguments import Parser
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import tell

SUMMARY = "Print the JSON schema of scene files, with which an editor can check them."
DETAILS = ""

# Plain values that a scene accepts in place of a table with one key.
_SHORT: dict[str, dict[str, object]] = {
    "Varying": {"type": "number"},
    "Clearance": {"type": "number"},
    "MeshFile": {"type": "string"},
    "Amplitude": {"type": "array", "items": {"type": "number"}, "minItems": 1},
}


# Keys of a schema that restrict nothing.
_ABOUT = ("title", "description", "default")


def add_arguments(_: Parser) -> None:
    """The command has no arguments."""


def run(_: argparse.Namespace, __: Interrupts) -> int:
    """Print the schema."""
    tell(dumps(schema(), indent=2), sys.stdout)
    return SOLVED


def schema() -> dict[str, object]:
    """JSON Schema, draft 2020-12, of the tables of a scene."""
    from bipot_rs.scene.schema.root import Scene

    whole = Scene.model_json_schema(by_alias=True)
    definitions = whole["$defs"]
    axis = definitions["Axis"]["properties"]
    axis["growth"] = {"anyOf": [{"type": "number"}, axis["growth"]]}
    _shorten(whole)
    # Editors show the docstrings of the tables.
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **whole,
        "title": "A scene of bipot",
    }


def _shorten(node: dict[str, object] | list[object]) -> None:
    """Accept the plain values of `_SHORT`, and formulas; changes ``node`` in place."""
    inner = list(node.values() if isinstance(node, dict) else node)
    for part in inner:
        if isinstance(part, dict | list):
            _shorten(part)
    if isinstance(node, dict) and "$ref" in node:
        short = _SHORT.get(str(node["$ref"]).rpartition("/")[2])
        if short is not None:
            plain = dict(short)
            _shorten(plain)
            node["anyOf"] = [plain, {"$ref": node.pop("$ref")}]
    elif isinstance(node, dict) and node.get("type") in ("number", "integer"):
        number = {key: node.pop(key) for key in list(node) if key not in _ABOUT}
        node["anyOf"] = [number, {"type": "string", "description": "A formula: 2*F."}]
