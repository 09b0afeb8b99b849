"""From a scene file in TOML to the arrays of a contact problem and its load path.

`read` parses and checks; `build.bodies` meshes; `assemble` makes the arrays of (1), (2)
and (21).
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from bipot_rs._lib.messages import counted, instead
from bipot_rs._lib.toml_text import HALF
from bipot_rs.contact.reduced import refuse_settings
from bipot_rs.fem.assembly import assemble as assembling
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.body import Body
from bipot_rs.scene.build import (
    contacts,
    remotes,
    repetitions,
    split,
    springs,
    strain_of,
    supports,
    symmetries,
)
from bipot_rs.scene.case import Case, Load, along
from bipot_rs.scene.library import SceneError, folder_of, shipped, text
from bipot_rs.scene.schema.consistency import inconsistencies, out_of_range
from bipot_rs.scene.schema.root import Scene, Solver
from bipot_rs.scene.schema.table import KIND
from bipot_rs.scene.suggestions import standing, suggestion

_NO_TEXT = "contains the lone surrogate {!r}, which UTF-8 cannot encode"


def read(name: str, settings: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name
        A shipped name or a TOML file.
    settings
        ``"key.sub.key=value"``, the value as in TOML or a word without quotes;
        ``contact.0.mu`` is the key ``mu`` of the first contact.

    Raises
    ------
    SceneError
        All mistakes found, each with its key path, and of a file with line and column.
    """
    source = text(name)
    table = parsed(name, source)
    problems = [p for p in (_override(table, item) for item in settings) if p]
    try:
        return checked(name, table, problems, folder_of(name))
    except SceneError as error:
        if name in shipped():
            # There is no file to mend.
            raise
        from bipot_rs.scene.mistakes import with_places

        found = with_places(error.problems, source, settings)
        raise SceneError(name, found) from None


def parsed(name: str, source: str) -> dict[str, Any]:
    """Tables of a TOML text; `SceneError` if it is not TOML."""
    source = source.removeprefix("\ufeff")
    if half := HALF.search(source):
        raise SceneError(name, [f"is not TOML: it {_NO_TEXT.format(half[0])}"])
    try:
        return tomllib.loads(source)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(name, [f"is not TOML: {error}"]) from error
    except RecursionError:
        raise SceneError(name, ["is not TOML: it is nested too deeply"]) from None


def checked(
    name: str,
    table: dict[str, Any],
    problems: Sequence[str] = (),
    folder: Path = Path(),
) -> Scene:
    """Check a table and return its `Scene`.

    Files that the scene names are relative to ``folder``. A `SceneError` lists
    ``problems`` and all mistakes found here.
    """
    found = list(problems)
    try:
        scene = Scene.model_validate(table)
    except ValidationError as error:
        known = standing(Scene, table)
        found += [_mistake(e, known, table) for e in error.errors()]
        found += _settings(table)
        raise SceneError(name, found) from None
    # Grids and sizes are computed only if no number overflows.
    found += list(out_of_range(scene)) or inconsistencies(scene)
    found += _settings(table)
    if found:
        raise SceneError(name, found)
    return scene.beside(folder)


def _settings(table: dict[str, Any]) -> Iterator[str]:
    """Messages about solver settings that the solver would refuse."""
    if "solver" not in table:
        return
    try:
        solver = Solver.model_validate(table["solver"])
    except ValidationError:
        return
    plain = Solver()
    for method, tol in ((solver.method, plain.tol), (plain.method, solver.tol)):
        if (method, tol) == (plain.method, plain.tol):
            continue  # The defaults are valid, and the check imports the solver.
        try:
            refuse_settings(method, tol)
        except ValueError as error:
            yield f"solver: {error}"


def assemble(scene: Scene, meshed: Sequence[Body], *, stiffness: bool = True) -> Case:
    """Make the arrays of a scene on its meshes; all but K without ``stiffness``.

    Raises
    ------
    SceneError
        Mistakes that need the meshes: nodes of a pair that do not match, supports that
        contradict each other, a contact without nodes.
    """
    make = assembling.assemble if stiffness else assembling.without_stiffness
    try:
        model = make(
            meshed,
            contacts(scene),
            supports(scene),
            symmetries=symmetries(scene),
            springs=springs(scene),
            remotes=remotes(scene),
            repetitions=repetitions(scene),
        )
        loads = tuple(_loads(scene, meshed, model))
        return along(scene, model, loads, np.arange(1.0, scene.path.count() + 1))
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(scene.title, [str(error)]) from error


def _loads(scene: Scene, meshed: Sequence[Body], model: Assembly) -> Iterator[Load]:
    """Loads of a scene, each with factor 1."""
    unit, none = np.eye(model.dim), np.zeros(0)
    place = {body.name: index for index, body in enumerate(meshed)}
    for t in scene.traction:
        on, face = split(t.on)
        facets = meshed[place[on]].facets(face)
        for k, number in t.components().items():
            nodal = model.traction(on, face, unit[k])
            yield Load(place[on], facets, unit[k], none, nodal, number)
    for p in scene.pressure:
        on, face = split(p.on)
        body = meshed[place[on]]
        normals = np.asarray(body.surface(face).normals)
        nodal = model.pressure(on, face, 1.0)
        # Facets are flat: one normal for each.
        inwards = -normals[:, :, 0].T
        yield Load(place[on], body.facets(face), inwards, none, nodal, p)
    for b in scene.body_force:
        for k, number in b.components().items():
            nodal = model.body_force(b.on, unit[k])
            yield Load(place[b.on], None, unit[k], none, nodal, number)
    for s in scene.strain:
        on, _ = split(s.on)
        strain = strain_of(s, meshed[place[on]])
        nodal = model.initial_strain(on, strain)
        still = np.zeros(model.dim)
        yield Load(place[on], None, still, none, nodal, s.factor, strain)
    yield from _at_points(scene, model, place)


def _at_points(
    scene: Scene, model: Assembly, place: Mapping[str, int]
) -> Iterator[Load]:
    """Forces on obstacles, and forces and moments at remote points."""
    unit, none, still = np.eye(model.dim), np.zeros(0), np.zeros(model.dim)
    # Its first contact: a force acts once, also on an obstacle of several contacts.
    first = {c.obstacle: c for c in reversed(scene.contact)}
    for name, rigid in scene.obstacle.items():
        if rigid.force is None or name not in first:
            continue
        body = place[split(first[name].on)[0]]
        for k, number in rigid.force.components().items():
            nodal = model.reference_force(name, unit[k])
            yield Load(body, None, still, none, nodal, number)
    for name, remote in scene.remote.items():
        body, given = place[split(remote.on)[0]], remote.given()
        for k, number in given.get("force", {}).items():
            nodal = model.reference_force(name, unit[k])
            yield Load(body, None, still, none, nodal, number)
        for k, number in given.get("moment", {}).items():
            axis = np.eye(3)[k] if model.dim == 3 else np.ones(1)
            nodal = model.reference_force(name, moment=axis)
            yield Load(body, None, still, none, nodal, number)


def _place(loc: Sequence[str | int], table: Any) -> list[str]:
    """Key path of an error of pydantic, as written in the file ``table``.

    `wrap` puts some plain values into a table with one key; that key is left out.
    """
    found, at = [], table
    for part in loc:
        if isinstance(part, str) and part.startswith(KIND):
            continue
        if isinstance(at, dict):
            at = at.get(part)
        elif isinstance(at, list) and isinstance(part, int):
            at = at[part] if part < len(at) else None
        elif at is not None:
            continue
        found.append(str(part))
    return found


def _mistake(error: Any, known: Mapping[str, Sequence[str]], table: Any) -> str:
    """Message for one error of pydantic; ``known`` as `standing` returns it."""
    parts = [str(part) for part in error["loc"]]
    path = ".".join(_place(error["loc"], table))
    from bipot_rs.scene.mistakes import said

    kind, message = error["type"], said(error)
    if kind == "extra_forbidden":
        return f"{path}: {message}{suggestion(Scene, parts, known)}"
    if kind == "missing":
        return f"{path}: {message}"
    given = error.get("input")
    if kind in ("float_type", "int_type") and isinstance(given, str):
        with suppress(ValueError):
            float(given)
            message += ", without quotes"
    if parts[0] == "pressure" and isinstance(given, dict) and "amplitude" in given:
        message += "; write amplitude as a key of [[pressure]], not of value"
    if isinstance(given, str | int | float):
        return f"{path}: {message}, got {given!r}"
    return f"{path}: {message}"


def _override(table: dict[str, Any], setting: str) -> str | None:
    """Set ``key=value`` in the table; a message if that is impossible."""
    if half := HALF.search(setting):
        return f"--set {setting!r}: {_NO_TEXT.format(half[0])}"
    key, equals, value = setting.partition("=")
    if not equals or not all(key.strip().split(".")):
        return f"--set {setting}: should be KEY=VALUE"
    try:
        parsed = tomllib.loads(f"v = {value}")["v"]
    except (tomllib.TOMLDecodeError, RecursionError):
        # .5 and 5. are numbers for users, though not in TOML.
        bare = re.fullmatch(r"\s*[+-]?([0-9]+\.|\.[0-9]+)(e[+-]?[0-9]+)?\s*", value)
        parsed = float(value) if bare else value
    wrong = put(table, key.strip(), parsed)
    return wrong and f"--set {key}: {wrong}"


def entry(part: str) -> int | None:
    """Index of a list entry; None if ``part`` is not a number."""
    # Not str.isdigit: it accepts superscripts, which int refuses. Nor more digits: int
    # refuses thousands of them.
    return int(part) if re.fullmatch("[0-9]{1,18}", part) else None


def put(table: dict[str, Any], key: str, value: Any) -> str | None:
    """Set ``"key.0.key"`` of a table; a message if there is no such place."""
    parts = key.split(".")
    at: Any = table
    for depth, part in enumerate(parts):
        place, last = ".".join(parts[:depth]), depth == len(parts) - 1
        if isinstance(at, list):
            index: Any = entry(part)
            if not at:
                return f"{place} has no entries"
            if index is None or index >= len(at):
                last_entry = f" to {place}.{len(at) - 1}" if len(at) > 1 else ""
                return (
                    f"{place} is a list of {counted(len(at), 'entry')}, expected "
                    f"{place}.0{last_entry}"
                )
        elif isinstance(at, dict):
            index = part
            if not last and index not in at:
                if depth == 1 and parts[0] in ("body", "material"):
                    # Otherwise a new, incomplete body or material would be made.
                    return f"there is no {parts[0]} {part!r}{instead(part, at)}"
                at[index] = {}
        else:
            return f"{place} is not a table"
        if last:
            at[index] = value
        else:
            at = at[index]
    return None
