"""What the shell completes: scenes, methods, kinds of pictures, and keys of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any


def scenes(incomplete: str) -> list[str]:
    """Names of shipped scenes; the shell completes files itself."""
    from bipot_rs.scene.library import shipped

    return _beginning(incomplete, shipped())


def methods(incomplete: str) -> list[str]:
    """Names of the contact solvers, as the core lists them for a wrong one."""
    from bipot_rs.contact.reduced import refuse_settings

    try:
        refuse_settings("", 1e-10)
    except ValueError as error:
        names = str(error).partition("expected one of ")[2]
        return _beginning(incomplete, names.replace("'", "").split(", "))
    return []


def kinds(incomplete: str) -> list[str]:
    """Kinds of pictures."""
    from bipot_rs.cli.commands.plot import kinds as known

    return _beginning(incomplete, known())


def templates(incomplete: str) -> list[str]:
    """Kinds of scenes to start from."""
    from bipot_rs.cli.commands.new import templates as known

    return _beginning(incomplete, known())


def keys(scene: str | None, incomplete: str) -> list[str]:
    """Keys for ``--set`` that begin so, one level at a time.

    A key that has keys of its own ends in a dot, any other in ``=``.

    Parameters
    ----------
    scene
        Its bodies, materials and lists are known by their names and numbers; without a
        scene, or with one that cannot be read, only the keys that all scenes have.
    incomplete
        What is typed so far: ``"contact.0.m"``.
    """
    from bipot_rs.scene.schema.root import Scene
    from bipot_rs.scene.suggestions import keys as known

    if "=" in incomplete:
        return []
    *above, _ = incomplete.split(".")
    here = _at(_table(scene), above)
    names: list[str] = known(Scene, above)
    if isinstance(here, list):
        names = [str(k) for k in range(len(here))]
    elif isinstance(here, dict):
        names = list(dict.fromkeys([*here, *names]))
    found = []
    for name in names:
        inner = here.get(name) if isinstance(here, dict) else None
        # A table, or tables by name or number, of which "0" may be one. A plain value in
        # place of a table has no keys.
        more = not _is_plain(inner) and any(
            known(Scene, [*above, name, *end]) for end in ((), ("0",))
        )
        found.append(".".join([*above, name]) + ("." if more else "="))
    return _beginning(incomplete, found)


def _is_plain(value: Any) -> bool:
    """Whether a value of the scene has no keys: a number, a text, or a list of these."""
    if isinstance(value, list):
        return not any(isinstance(one, dict) for one in value)
    return value is not None and not isinstance(value, dict)


def _table(scene: str | None) -> Any:
    if scene is None:
        return {}
    from bipot_rs.scene.library import text
    from bipot_rs.scene.reading import parsed

    # A faulty scene has no keys to complete; the command itself reports the fault.
    with suppress(ValueError):
        return parsed(scene, text(scene))
    return {}


def _at(table: Any, place: list[str]) -> Any:
    """The value at a key path; None if there is none."""
    for part in place:
        if isinstance(table, dict):
            table = table.get(part)
        elif isinstance(table, list) and part.isdecimal() and int(part) < len(table):
            table = table[int(part)]
        else:
            return None
    return table


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
