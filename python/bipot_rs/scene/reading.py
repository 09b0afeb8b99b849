"""From a scene file in TOML to checked tables."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bipot_rs._lib import validation
from bipot_rs._lib.messages import count_noun, instead
from bipot_rs.scene.library import folder_of, text
from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError
from bipot_rs.scene.schema.consistency import inconsistencies, out_of_range
from bipot_rs.scene.schema.formula import Formulas
from bipot_rs.scene.schema.messages import describe_error, list_key_paths
from bipot_rs.scene.schema.root import Scene, Solver


def read(name: str, settings: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name
        A shipped name or a TOML file.
    settings
        ``"key.sub.key=value"``, the value as in TOML or a word without quotes;
        ``contact.0.mu`` is the key ``mu`` of the first contact, ``contact.faying.mu`` of
        the one of this name, ``contact.*.mu`` of all.

    Raises
    ------
    SceneError
        All mistakes found, each with its key path.
    """
    table = parse(name, text(name))
    mistakes = [m for m in (_override(table, item) for item in settings) if m]
    return check(name, table, mistakes, folder_of(name))


def parse(name: str, source: str) -> dict[str, object]:
    """Tables of a TOML text; `SceneError` if it is not TOML."""
    source = source.removeprefix("\ufeff")
    try:
        source.encode()  # refuses half of a surrogate pair, as tomllib does not
        return tomllib.loads(source)
    except ValueError as error:
        wrong = str(error)
    except RecursionError:
        wrong = "it is nested too deeply"
    raise SceneError(name, [Mistake("", f"is not TOML: {wrong}", MistakeKind.FILE)])


def check(
    name: str,
    table: dict[str, object],
    mistakes: Sequence[Mistake] = (),
    folder: Path = Path(),
) -> Scene:
    """Check a table and return its `Scene`.

    Files that the scene names are relative to ``folder``. A `SceneError` lists
    ``mistakes`` and all that are found here.
    """
    mistakes_found = list(mistakes)
    formulas = Formulas(table)
    try:
        scene = _validate(table, formulas)
    except ValidationError as error:
        keys, values = list_key_paths(Scene, table), formulas.values
        every = error.errors()
        # Names in a circle follow from each other.
        errors = [e for e in every if not formulas.follows(e)] or [
            e for e in every if e["loc"][0] in ("parameter", "mesh")
        ]
        mistakes_found += [describe_error(e, keys, table, values) for e in errors]
        mistakes_found += _check_settings(table)
        raise SceneError(name, mistakes_found) from None
    # Grids and sizes are computed only if no number overflows.
    mistakes_found += list(out_of_range(scene)) or inconsistencies(scene)
    mistakes_found += _check_settings(table)
    if mistakes_found:
        raise SceneError(name, mistakes_found)
    return scene.beside(folder, formulas.unused.values())


def _validate(table: dict[str, object], formulas: Formulas) -> Scene:
    """The scene of a table, whose formulas are replaced by their values."""
    try:
        return Scene.model_validate(table)
    except ValidationError as error:
        formulas.fill(table, error.errors())
        return Scene.model_validate(table)


def _check_settings(table: dict[str, object]) -> Iterator[Mistake]:
    """Solver settings that the solver would refuse."""
    if "solver" not in table:
        return
    try:
        solver = Solver.model_validate(table["solver"])
    except ValidationError:
        return
    plain = Solver()
    for method, tol in ((solver.method, plain.tol), (plain.method, solver.tol)):
        try:
            validation.settings(
                method, 1e-10 if isinstance(tol, str) else tol, None, None
            )
        except ValueError as error:
            yield Mistake("solver", str(error), MistakeKind.RANGE)


def _override(table: dict[str, object], setting: str) -> Mistake | None:
    """Set ``key=value`` in the table; a mistake if that is impossible."""
    key, equals, value = setting.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        return Mistake(setting, "should be KEY=VALUE", MistakeKind.SETTING)
    try:
        value.encode()
    except UnicodeEncodeError as error:
        return Mistake(key, str(error), MistakeKind.SETTING)
    try:
        number = tomllib.loads(f"v = {value}")["v"]
    except (tomllib.TOMLDecodeError, RecursionError):
        # .5 and 5. are numbers for users, though not in TOML.
        bare = re.fullmatch(r"\s*[+-]?([0-9]+\.|\.[0-9]+)(e[+-]?[0-9]+)?\s*", value)
        number = float(value) if bare else value
    wrong = put(table, key, number)
    return Mistake(key, wrong, MistakeKind.SETTING) if wrong else None


def entries(at: Sequence[object], part: str) -> list[int]:
    """Indices of the entries of a list that a part of a key means: its number, name or ``*``."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in at]
    return [k for k, name in enumerate(names) if part in (str(k), "*", name)]


def put(table: dict[str, object], key: str, value: object) -> str | None:
    """Set ``"key.0.key"`` of a table, or ``"key.name.key"``, or of all entries ``"key.*.key"``.

    Returns a message if there is no such place.
    """
    parts = key.split(".")
    tables: list[Any] = [table]
    for depth, part in enumerate(parts):
        place, last = ".".join(parts[:depth]), depth == len(parts) - 1
        places: list[tuple[Any, Any]] = []
        for at in tables:
            if isinstance(at, list):
                chosen = entries(at, part)
                if not at:
                    return f"{place} has no entries"
                if not chosen:
                    last_entry = f" to {place}.{len(at) - 1}" if len(at) > 1 else ""
                    named = [
                        e["name"] for e in at if isinstance(e, dict) and "name" in e
                    ]
                    names = f"; none is {part!r}{instead(part, named)}" if named else ""
                    return (
                        f"{place} is a list of {count_noun(len(at), 'entry')}, expected "
                        f"{place}.0{last_entry}{names}"
                    )
                places += [(at, index) for index in chosen]
            elif isinstance(at, dict):
                if part not in at and not (last and place != "parameter"):
                    if place in ("body", "material", "parameter"):
                        # Otherwise a new, incomplete or unused one would be made.
                        return f"there is no {place} {part!r}{instead(part, at)}"
                    at[part] = {}
                places.append((at, part))
            else:
                return f"{place} is not a table"
        if last:
            for at, index in places:
                at[index] = copy.deepcopy(value)
        tables = [] if last else [at[index] for at, index in places]
    return None
