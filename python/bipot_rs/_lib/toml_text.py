"""Write tables as TOML: the standard library can only read it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

# A lone surrogate. File names in other encodings put them into strings.
HALF = re.compile("[\\ud800-\\udfff]")
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def text(table: Mapping[str, Any]) -> str:
    """TOML text of a table of tables, lists, strings, numbers and booleans.

    ``tomllib.loads`` returns the same table, with bitwise the same numbers.

    Raises
    ------
    TypeError
        A value that TOML cannot represent; the message names its key path.
    ValueError
        A lone surrogate in a string, which UTF-8 cannot encode.
    """
    # Plain values first: after a heading they would belong to that table.
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
            # A table that contains tables only needs no heading.
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
            f"{value!r} contains the lone surrogate {half[0]!r}, which UTF-8 cannot encode"
        )
    # JSON escapes all characters that TOML escapes, except DEL.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _inline(value: Any, path: tuple[str, ...]) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
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
        "string, a number or a boolean"
    )
