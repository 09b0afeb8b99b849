"""Rust source for the layer tests: code without comments, paths resolved."""

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

_SILENT = re.compile(
    r"""//[^\n]*
    |/\*.*?\*/
    |\bb?r(?P<hash>\#*)".*?"(?P=hash)
    |\bb?"(?:\\.|[^"\\])*"|"(?:\\.|[^"\\])*"
    |'(?:\\[^']+|[^\\'])'""",
    re.DOTALL | re.VERBOSE,
)
_TOKEN = re.compile(r"\s*(::|[A-Za-z_]\w*|[{},*])")
_ROOT = re.compile(r"(?<![\w:$])(crate|super|self)(?=\s*::)")
_INLINE = re.compile(r"\bmod\s+(\w+)\s*\{")


class Use(NamedTuple):
    """One path used by a file: its place, and the absolute path in the crate."""

    line: int
    path: tuple[str, ...]


def code(text: str) -> str:
    """Comments, strings and character literals blanked, line numbers kept."""
    return _SILENT.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)


def module(file: str) -> tuple[str, ...]:
    """`law/cone.rs` is `("law", "cone")`, `law/mod.rs` is `("law",)`, `lib.rs` is `()`."""
    parts = tuple(file.removesuffix(".rs").split("/"))
    return parts[:-1] if parts[-1] in {"mod", "lib"} else parts


def uses(file: str, text: str) -> Iterator[Use]:
    """Every `crate::`, `super::` and `self::` path of a file, groups expanded."""
    text = code(text)
    inline = [(m[1], m.end(), _closing(text, m.end())) for m in _INLINE.finditer(text)]
    for found in _ROOT.finditer(text):
        here = module(file) + tuple(
            name for name, start, end in inline if start <= found.start() < end
        )
        line = text.count("\n", 0, found.start()) + 1
        for path in _tree(text, found.start())[0]:
            yield Use(line, _absolute(here, path))


def _closing(text: str, position: int) -> int:
    depth = 1
    while depth and position < len(text):
        depth += {"{": 1, "}": -1}.get(text[position], 0)
        position += 1
    return position


def _tree(text: str, position: int) -> tuple[list[tuple[str, ...]], int]:
    """Paths of the use tree that starts here, and the position of its end."""
    path: tuple[str, ...] = ()
    while (token := _TOKEN.match(text, position)) is not None:
        if token[1] == "{":
            return _group(text, token.end(), path)
        if token[1] in {"::", "}", ","}:
            break
        path, position = (*path, token[1]), token.end()
        separator = _TOKEN.match(text, position)
        if separator is None or separator[1] != "::":
            break
        position = separator.end()
    return [path], position


def _group(
    text: str, position: int, prefix: tuple[str, ...]
) -> tuple[list[tuple[str, ...]], int]:
    found: list[tuple[str, ...]] = []
    while (token := _TOKEN.match(text, position)) is not None and token[1] != "}":
        if token[1] == ",":
            position = token.end()
            continue
        branches, end = _tree(text, position)
        found += [prefix + branch for branch in branches]
        position = max(end, token.end())
        alias = re.compile(r"\s*as\s+\w+").match(text, position)
        position = alias.end() if alias else position
    return found, token.end() if token else len(text)


def _absolute(here: tuple[str, ...], path: tuple[str, ...]) -> tuple[str, ...]:
    if path[0] == "crate":
        return path[1:]
    rest = list(path)
    place = list(here)
    while rest and rest[0] in {"self", "super"}:
        if rest.pop(0) == "super" and place:
            place.pop()
    return (*place, *rest)


def tree_violations(
    tree: Mapping[str, str],
    layers: tuple[str, ...],
    siblings: Mapping[str, tuple[str, ...]],
) -> list[str]:
    """Uses that break the order of the layers, or of the files within one.

    `tree` maps file names below `src` to their text. `layers` are listed from the lowest,
    which uses no other, to the highest. `siblings` lists the files of each layer that is a
    folder in the same way; names in one string must not use each other. A folder's `mod.rs`
    may use its files, but they must not use it. The order within a nested folder, such as
    `linalg/sparse`, need not be given.
    """
    modules = {module(file) for file in tree}
    found = []
    for file, text in sorted(tree.items()):
        here = module(file)
        if not here:
            continue
        if here[0] not in layers:
            found.append(f"{file}: layer {here[0]} is not declared")
            continue
        orders = {}
        for depth in range(1, len(here)):
            folder = "/".join(here[:depth])
            if depth == 1 or folder in siblings:
                orders[here[:depth]] = _ranks(siblings.get(folder, ()))
        unplaced = [f for f, ranks in orders.items() if here[len(f)] not in ranks]
        if unplaced:
            folder = "/".join(unplaced[0])
            found.append(f"{file}: not declared among the files of {folder}")
            continue
        for line, path in uses(file, text):
            where = f"{file}:{line}: {'::'.join(path)}"
            if not path or path[0] not in layers:
                found.append(f"{where}: name the module it lives in")
            elif layers.index(path[0]) > layers.index(here[0]):
                found.append(f"{where}: {here[0]} may not use {path[0]}")
            elif around := [f for f in orders if path[: len(f)] == f]:
                # The innermost folder that contains both.
                depth = len(around[-1])
                if len(path) == depth or path[: depth + 1] not in modules:
                    found.append(f"{where}: name the module it lives in")
                    continue
                own, other = here[depth], path[depth]
                ranks = orders[around[-1]]
                # An undeclared file is reported when its own turn comes.
                if other != own and ranks.get(other, -1) >= ranks[own]:
                    found.append(f"{where}: {own} may not use {other}")
    return found


def _ranks(order: tuple[str, ...]) -> dict[str, int]:
    return {name: rank for rank, names in enumerate(order) for name in names.split()}


def naming_violations(
    tree: Mapping[str, str], word: str, allowed: tuple[str, ...]
) -> list[str]:
    """Files outside `allowed` (names, or folders ending in `/`) whose code contains `word`."""
    pattern = re.compile(rf"(?<!\w){re.escape(word)}(?!\w)")
    return [
        f"{file}: {word}"
        for file, text in sorted(tree.items())
        if not any(
            file == a or (a.endswith("/") and file.startswith(a)) for a in allowed
        )
        and pattern.search(code(text))
    ]
