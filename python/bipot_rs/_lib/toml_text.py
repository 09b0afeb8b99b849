"""Tables as TOML: what `tomllib` reads and Python does not write."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

# Half of a surrogate pair: names of files in other encodings leave it in strings.
HALF = re.compile("[\\ud800-\\udfff]")
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def text(table: Mapping[str, Any]) -> str:
    """TOML of a table of tables, lists, strings, numbers and truth values.

    ``tomllib.loads`` gives the same table back, numbers to the bit.

    Raises
    ------
    TypeError
        Something that TOML has no word for; the message names its place.
    ValueError
        Half of a surrogate pair in a string, which no file of TOML holds.
    """
    # Plain values first: below a heading, they would be of its table.
    plain = {k: v for k, v in table.items() if not _has_heading(v)}
    lines = list(_flat(plain, ()))
    for key, value in table.items():
        name = _key(key)
        if key in plain:
            continue
        if isinstance(value, list):
            for k, one in enumerate(value):
                lines += ["", f"[[{name}]]", *_flat(one, (key, str(k)))]
        elif value and all(map(_is_table, value.values())):
            # A table of tables alone, such as materials by name, needs no heading.
            for one, content in value.items():
                lines += ["", f"[{name}.{_key(one)}]", *_flat(content, (key, one))]
        else:
            lines += ["", f"[{name}]", *_flat(value, (key,))]
    return "\n".join(lines).lstrip("\n") + "\n"


def _flat(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    for key, value in table.items():
        yield f"{_key(key)} = {_inline(value, (*path, key))}"


def _has_heading(value: Any) -> bool:
    return _is_table(value) or (
        isinstance(value, list) and bool(value) and all(map(_is_table, value))
    )


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _key(key: Any) -> str:
    if not isinstance(key, str):
        raise TypeError(f"key {key!r} is a {type(key).__name__}, expected a string")
    return key if _BARE.fullmatch(key) else _string(key)


def _string(value: str) -> str:
    if half := HALF.search(value):
        raise ValueError(
            f"{value!r} holds {half[0]!r}, half of a surrogate pair, expected text that "
            "UTF-8 can write"
        )
    # JSON escapes all that TOML wants escaped, but for DEL.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _inline(value: Any, path: tuple[str, ...]) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        # 17 digits where they are needed: read back to the bit.
        return repr(value)
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, list):
        inner = (_inline(v, (*path, str(k))) for k, v in enumerate(value))
        return "[" + ", ".join(inner) + "]"
    if isinstance(value, Mapping):
        pairs = (f"{_key(k)} = {_inline(v, (*path, k))}" for k, v in value.items())
        return "{ " + ", ".join(pairs) + " }" if value else "{}"
    raise TypeError(
        f"{'.'.join(path)} is a {type(value).__name__}, expected a table, a list, a "
        "string, a number or a truth value"
    )
