"""What the shell completes: scenes, methods, kinds of pictures, and keys of a scene.

argcomplete calls these functions with the word typed so far, and leaves out what does not
begin like it.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterable
from contextlib import suppress

Completer = Callable[..., Iterable[str]]


def complete_scenes(prefix: str, **_: object) -> Iterable[str]:
    """Names of shipped scenes, and TOML files."""
    from argcomplete.completers import FilesCompleter

    from bipot_rs.scene.library import shipped

    return [*shipped(), *FilesCompleter(["toml"])(prefix)]


def complete_methods(**_: object) -> Iterable[str]:
    """Names of the contact solvers."""
    import bipot_rs._core as _core

    return list(_core.METHODS)


def complete_kinds(**_: object) -> Iterable[str]:
    """Kinds of pictures."""
    from bipot_rs.plots.by_name import KINDS

    return list(KINDS)


def complete_keys(prefix: str, parsed_args: Namespace, **_: object) -> list[str]:
    """Keys for ``--set`` of the scene that is named before it."""
    return list_keys(getattr(parsed_args, "scene", None), prefix)


def list_keys(scene: str | None, incomplete: str) -> list[str]:
    """Keys for ``--set`` that begin so, one level at a time.

    A key that has keys of its own ends in a dot, any other in ``=``.

    ``scene``: its bodies, materials and lists are known by their names and numbers; without a
    scene, or with one that cannot be read, only the keys that all scenes have.
    ``incomplete``: what is typed so far: ``"contact.0.m"``.
    """
    from bipot_rs.scene.schema.root import Scene
    from bipot_rs.scene.schema.suggestions import keys as keys_of_schema

    if "=" in incomplete:
        return []
    *above, _ = incomplete.split(".")
    here = _follow(_read_table(scene), above)
    names: list[str] = keys_of_schema(Scene, above)
    if isinstance(here, list):
        names = [
            str(entry.get("name", k)) if isinstance(entry, dict) else str(k)
            for k, entry in enumerate(here)
        ]
    elif isinstance(here, dict):
        names = list(dict.fromkeys([*here, *names]))
    keys = []
    for name in names:
        inner = here.get(name) if isinstance(here, dict) else None
        # A table, or tables by name or number, of which "0" may be one. A plain value in
        # place of a table has no keys.
        more = not _is_plain(inner) and any(
            keys_of_schema(Scene, [*above, name, *end]) for end in ((), ("0",))
        )
        key = ".".join([*above, name]) + ("." if more else "=")
        if key.startswith(incomplete):
            keys.append(key)
    if len(keys) == 1 and keys[0].endswith(".") and keys[0] != incomplete:
        # The shell would end a single completion by a space.
        return list_keys(scene, keys[0])
    return keys


def _is_plain(value: object) -> bool:
    """Whether a value of the scene has no keys: a number, a text, or a list of these."""
    if isinstance(value, list):
        return not any(isinstance(item, dict) for item in value)
    return value is not None and not isinstance(value, dict)


def _read_table(scene: str | None) -> object:
    if not isinstance(scene, str):
        return {}
    from bipot_rs.scene.library import text
    from bipot_rs.scene.reading import parse

    # A faulty scene has no keys to complete; the command itself reports the fault.
    with suppress(ValueError):
        return parse(scene, text(scene))
    return {}


def _follow(table: object, place: list[str]) -> object:
    """The value at a key path; None if there is none."""
    from bipot_rs.scene.reading import entries

    for part in place:
        if isinstance(table, dict):
            table = table.get(part)
        elif isinstance(table, list) and (chosen := entries(table, part)):
            table = table[chosen[0]]
        else:
            return None
    return table
