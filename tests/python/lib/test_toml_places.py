"""Places of keys: all paths that tomllib finds, each where its key is written."""

import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bipot_rs._lib.toml_places import places
from bipot_rs._lib.toml_text import text
from bipot_rs.scene.library import shipped
from bipot_rs.scene.library import text as scene_text

HARD = r'''# A comment with key = 3
title = "a # no comment \" = [x]" # "one
"quoted key" . inner = 'single \'
dates = [1979-05-27 07:32:00Z, 1979-05-27]
long = """
[not.a.table]
key = 3 \" "" """ # end
raw = \'\'\'it\'s [[no]] table''\'\'\'
deep.er.key = 0x_ff
empty = [ # comment ]
]
nested = [ [1, 2], [ {a = 1, b.c = [ {d = 2} ] }, ], ]
"" = 1

[table]  # heading
n=3
  [ table . "sub.table" ]
  x = {}
[[list]]
[[list]]
name = "b"
[list.one]
z = 1
[[list.inner]]
[[list.inner]]
k = true
[table.more]
'''.replace("\\'", "'").replace("0x_ff", "0xff")


def paths(table: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    entries = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in entries:
        yield (*above, key)
        if isinstance(value, dict | list):
            yield from paths(value, (*above, key))


def check(source: str) -> None:
    found, lines = places(source), source.split("\n")
    assert set(found) == set(paths(tomllib.loads(source)))
    for path, (line, column) in found.items():
        rest = lines[line - 1][column - 1 :]
        if isinstance(path[-1], str) and path[-1].isalnum() and path[-1].isascii():
            assert rest.lstrip("\"'").startswith(path[-1])
        else:
            assert rest


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_every_kind_of_key(newline: str) -> None:
    check(HARD.replace("\n", newline))
    found = places(HARD)
    assert found[("title",)] == (2, 1)
    assert found[("quoted key", "inner")] == (3, 16)
    assert found[("nested", 1, 0, "b", "c", 0, "d")] == (12, 39)
    assert found[("list", 1, "inner", 1, "k")] == (26, 1)
    assert found[("table", "sub.table")] == (17, 13)


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenes(name: str) -> None:
    check(scene_text(name))


LEAVES = st.one_of(st.integers(-9, 9), st.booleans(), st.text(max_size=6))
TABLES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.text(max_size=4), inner, max_size=3),
    ),
    max_leaves=12,
)


@given(st.dictionaries(st.text(max_size=4), TABLES, max_size=4))
@pytest.mark.slow
def test_any_table(table: dict[str, Any]) -> None:
    try:
        source = text(table)
    except ValueError:  # a lone surrogate
        return
    assert set(places(source)) == set(paths(tomllib.loads(source)))
