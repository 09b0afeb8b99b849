"""Altered inputs for readers: each gives an error with a message, or the right content."""

import random
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from support.children import forked

# Values that a typing error or an attacker may put into a file.
_INTEGERS = (0, -1, 10**9, -(10**9), 10**400, True)
_REALS = (1e308, -1e308, 1e-308, 5e-324, float("nan"), float("inf"), -0.0)
_WORDS = ("", "n", "n/0", "0*n", "0/n", "9e9*n", "nonsense", "\U0001f980")
_LISTS = ([], [[]], [0.0], [1.0, 0.0], [0.0] * 7)
_TABLES = ({}, {"x": 0}, {"value": 1e300}, {"points": [0.0, 0.0]}, {"table": []})
NASTY = (*_INTEGERS, *_REALS, *_WORDS, *_LISTS, *_TABLES)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all entries of a table."""
    keys = value if isinstance(value, dict) else range(len(value))
    for key in keys:
        yield (*path, key)
        if isinstance(value[key], (dict, list)):
            yield from places(value[key], (*path, key))


def altered(draw: Callable[..., Any], table: dict[str, Any]) -> None:
    """Drop, rename, add, replace or nest an entry of a table, in place."""
    path = draw(st.sampled_from(list(places(table))))
    at: Any = table
    for key in path[:-1]:
        at = at[key]
    key = path[-1]
    change = draw(st.sampled_from(["drop", "rename", "add", "scale", "nest", "put"]))
    if change == "drop":
        del at[key]
    elif change == "rename" and isinstance(at, dict):
        at[f"{key}x"] = at.pop(key)
    elif change == "add" and isinstance(at, dict):
        at["nothing_of_the_kind"] = draw(st.sampled_from(NASTY))
    elif change == "scale" and isinstance(at[key], (int, float)):
        factor = draw(st.sampled_from([-1, 0, 1e3, 1e-3, 1e150, 1e-150]))
        at[key] = float(at[key]) * factor if abs(at[key]) < 1e300 else 0
    elif change == "nest":
        at[key] = [at[key]] if draw(st.booleans()) else {"x": at[key]}
    else:
        at[key] = draw(st.sampled_from(NASTY))


def toml(value: Any) -> str:
    """A value as TOML, with inline tables."""
    if isinstance(value, dict):
        inner = ", ".join(f"{_text(k)} = {toml(v)}" for k, v in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value)


def document(table: dict[str, Any]) -> str:
    """A whole TOML file."""
    return "".join(f"{_text(key)} = {toml(value)}\n" for key, value in table.items())


def _text(value: str) -> str:
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def damaged(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """A file with bits flipped, bytes replaced, parts missing, moved or added."""
    random_ = random.Random(seed)
    for k in range(count):
        data = bytearray(content)
        # The start of an HDF5 file has dense metadata; the rest is large in comparison.
        reach = len(data) if k % 2 else min(len(data), 4096)
        at = random_.randrange(reach)
        kind = k % 6
        if kind < 2:
            data[at] ^= 1 << random_.randrange(8)
        elif kind == 2:
            for _ in range(8):
                data[random_.randrange(reach)] = random_.randrange(256)
        elif kind == 3:
            del data[at:]
        elif kind == 4:
            data[at : at + 64] = bytes(64)
        else:
            data[at:at] = random_.randbytes(random_.randrange(1, 64))
        yield bytes(data)


def survives_damage(
    read: Callable[[Path], Any],
    same: Callable[[Any], bool],
    path: Path,
    *,
    count: int = 100,
    seed: int = 0,
) -> None:
    """Check a reader on damaged copies of a file.

    Each copy is read in a child process, which must neither crash nor hang: ``read`` raises
    ``OSError`` or ``ValueError`` with one sentence, or returns the content of the file.

    Parameters
    ----------
    read
        The reader, called with a path.
    same
        Whether the content that was read is right.
    path
        An undamaged file.
    count, seed
        Number of copies, and the seed of their damage.
    """
    content = path.read_bytes()
    assert same(read(path)), "the file must be in order to begin with"
    copy = path.with_name(f"damaged-{path.name}")
    copies = list(damaged(content, count, seed))
    refused = 0
    for first in range(0, count, 25):
        # Several copies per child: starting a child takes longer than reading a file.
        def work(first: int = first) -> int:
            return _refusals(read, same, copy, copies[first : first + 25])

        run = forked(work, seconds=60)
        assert 0 <= run.returncode <= 25, f"copies from {first} on: {run.returncode}"
        refused += run.returncode
    assert refused > 0, "no damage was noticed"


def _refusals(
    read: Callable[[Path], Any],
    same: Callable[[Any], bool],
    copy: Path,
    contents: list[bytes],
) -> int:
    refused = 0
    for number, content in enumerate(contents):
        copy.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = read(copy)
        except (OSError, ValueError) as error:
            refused += 1
            words = str(error)
        else:
            words = "read" if same(found) else ""
        assert words, f"copy {number}: an error without words, or another content"
        assert "\n" not in words, f"copy {number}: {words}"
    return refused
