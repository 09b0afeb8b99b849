"""What is wrong with a scene that no table shows by itself.

A function a table, each a generator of sentences that begin with their place.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from typing import Any

from bipot_rs.check import RATIO
from bipot_rs.fem import FACES
from bipot_rs.schema.contact import Touch
from bipot_rs.schema.root import Scene
from bipot_rs.schema.table import AXES, LARGEST
from bipot_rs.words import counted


def inconsistencies(scene: Scene) -> list[str]:
    """List what no table shows by itself: names, dimensions, grids, lengths."""
    found = list(_out_of_range(scene.model_dump(by_alias=True, exclude={"solver"})))
    if found:
        return found
    parts = (_bodies, _surfaces, _components, _contacts, _path)
    return [problem for part in parts for problem in part(scene)]


def _bodies(scene: Scene) -> Iterator[str]:
    """Materials, dimensions, grids, and what does not fit in memory."""
    n = scene.mesh.n if scene.mesh else None
    if len({block.dim for block in scene.body.values()}) > 1:
        yield "body: bodies of two and of three dimensions do not mix"
    for name, block in scene.body.items():
        if "." in name:
            yield f"body.{name}: a name has no dot, which parts a body from its surface"
        if block.material not in scene.material:
            yield f"body.{name}.material: {_unknown(block.material, scene.material)}"
        if (block.z is None) != (block.dim == 2):
            needs = "takes no z" if block.dim == 2 else "needs z"
            yield f"body.{name}: a {block.cell} {needs}"
        sides = []
        for letter, axis in zip(AXES, (block.x, block.y, block.z), strict=True):
            try:
                if axis is not None:
                    sides.append(len(axis.grid(n)))
            except ValueError as error:
                yield f"body.{name}.{letter}: {error}"
        if len(sides) == block.dim:
            yield from _too_large(name, math.prod(sides), block.dim, scene.path.count())


def _surfaces(scene: Scene) -> Iterator[str]:
    """Names that tables act on."""
    for kind in ("support", "traction", "pressure", "contact"):
        for i, entry in enumerate(getattr(scene, kind)):
            yield from _surface(scene, f"{kind}.{i}.on", entry.on)
    for i, force in enumerate(scene.body_force):
        if force.on not in scene.body:
            yield f"body_force.{i}.on: {_unknown(force.on, scene.body)}"


def _surface(scene: Scene, path: str, on: str) -> Iterator[str]:
    body, dot, face = on.partition(".")
    if body not in scene.body:
        yield f"{path}: {_unknown(body, scene.body)}"
        return
    known = FACES[scene.body[body].dim]
    if not dot or face not in known:
        yield f"{path}: {_unknown(on, [f'{body}.{face}' for face in known])}"


def _components(scene: Scene) -> Iterator[str]:
    """Components of vectors that act."""
    for kind in ("support", "traction", "body_force"):
        for i, entry in enumerate(getattr(scene, kind)):
            if not entry.components():
                yield f"{kind}.{i}: gives no component x, y or z"
            if scene.dim == 2 and entry.z is not None:
                yield f"{kind}.{i}.z: a scene of two dimensions has no z"


def _contacts(scene: Scene) -> Iterator[str]:
    for i, contact in enumerate(scene.contact):
        place = f"contact.{i}"
        if (contact.plane is None) == (contact.against is None):
            yield f"{place}: needs plane or against, one of them"
        if contact.against is not None:
            yield from _surface(scene, f"{place}.against", contact.against)
            if contact.against.partition(".")[0] == contact.on.partition(".")[0]:
                yield f"{place}.against: a body cannot meet itself"
        for key, vector in (
            ("plane.point", contact.plane.point if contact.plane else None),
            ("plane.normal", contact.plane.normal if contact.plane else None),
            ("clearance.centre", contact.clearance.centre),
            ("axis", contact.axis),
        ):
            if vector is not None and len(vector) != scene.dim:
                yield f"{place}.{key}: should have {scene.dim} components"
        if contact.plane and not any(contact.plane.normal):
            yield f"{place}.plane.normal: should not be zero"
        yield from _friction(place, contact, scene.dim)
        if contact.clearance.radius == 0:
            yield f"{place}.clearance.radius: should not be zero"


def _friction(place: str, contact: Touch, dim: int) -> Iterator[str]:
    if isinstance(contact.mu, list):
        yield from _elliptic(place, contact.mu, contact.axis, dim)
    elif contact.axis is not None:
        yield f"{place}.axis: mu is one number, the same all around"


def _elliptic(
    path: str, mu: Sequence[float], axis: Sequence[float] | None, dim: int
) -> Iterator[str]:
    """Friction along two tangents."""
    if dim == 2:
        yield f"{path}.mu: has two numbers, in two dimensions there is one tangent"
    elif axis is None:
        yield f"{path}.axis: is missing, the direction of the first number of mu"
    elif not any(axis):
        yield f"{path}.axis: should not be zero"
    if not min(mu) * RATIO >= max(mu):
        yield (
            f"{path}.mu: should be two positive numbers within a factor of {RATIO:g} of "
            f"each other, or twice zero, got {list(mu)}"
        )


def _out_of_range(value: Any, path: str = "") -> Iterator[str]:
    """Numbers that arithmetic cannot be trusted with."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _out_of_range(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _out_of_range(inner, f"{path}.{k}")
    elif isinstance(value, float) and not (
        value == 0 or 1 / LARGEST <= abs(value) <= LARGEST
    ):
        yield (
            f"{path}: is {value:g}, expected zero or a size from {1 / LARGEST:g} "
            f"to {LARGEST:g}"
        )


def _too_large(name: str, nodes: int, dim: int, steps: int) -> Iterator[str]:
    """What no machine of this memory can hold, found before it is asked for."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    # Nodes of the cells around a node, a number and a column index for each component.
    stiffness = nodes * dim * 3**dim * dim * 12
    if stiffness > memory:
        yield (
            f"body.{name}: {nodes} nodes, whose stiffness alone takes {stiffness} bytes "
            f"of the {memory} of this machine"
        )
    elif 2 * 8 * nodes * dim * steps > memory:
        yield (
            f"path: {steps} load steps of {nodes} nodes of body {name!r}, whose loads and "
            f"displacements take {2 * 8 * nodes * dim * steps} bytes of the {memory} of "
            "this machine"
        )


def _path(scene: Scene) -> Iterator[str]:
    path = scene.path
    used = {path.parameter}
    for place, number in scene.varying():
        used.add(number.amplitude)
        if number.amplitude is not None and number.amplitude not in path.amplitude:
            yield f"{place}.amplitude: {_unknown(number.amplitude, path.amplitude)}"
    if path.parameter is not None and path.parameter not in path.amplitude:
        yield f"path.parameter: {_unknown(path.parameter, path.amplitude)}"
    for name, amplitude in path.amplitude.items():
        place = f"path.amplitude.{name}"
        if (amplitude.table is None) == (amplitude.wave is None):
            yield f"{place}: should be a list of factors or a wave"
        elif amplitude.wave == "sine" and amplitude.period is None:
            yield f"{place}: a sine needs its period"
        elif amplitude.wave == "ramp" and amplitude.period is not None:
            yield f"{place}: a ramp has no period"
        elif amplitude.wave is not None and path.steps is None:
            yield f"path.steps: is missing, and the wave {name} has no end"
        elif amplitude.table is not None and len(amplitude.table) != path.count():
            yield (
                f"{place}: has {counted(len(amplitude.table), 'factor')} for "
                f"{counted(path.count(), 'step')}"
            )
        if name not in used:
            yield f"{place}: nothing uses it"
    automatic = path.increments
    if automatic is not None and not (
        automatic.smallest
        <= (automatic.first or automatic.largest)
        <= automatic.largest
    ):
        yield (
            "path.automatic: needs smallest <= first <= largest, got "
            f"{automatic.smallest:g}, {automatic.first}, {automatic.largest:g}"
        )


def _unknown(name: str, known: Sequence[str] | dict[str, Any]) -> str:
    return f"there is no {name!r}, expected one of {', '.join(known) or 'none'}"
