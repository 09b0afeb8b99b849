"""What is wrong with a scene that no table shows by itself.

A function a table, each a generator of sentences that begin with their place.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bipot_rs._lib.messages import counted, instead
from bipot_rs._lib.validation import RATIO
from bipot_rs.mesh.boxes import FACES
from bipot_rs.scene.schema.contact import Plane, Ring, Touch
from bipot_rs.scene.schema.mesh import Block, Within
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import AXES, LARGEST, Components
from bipot_rs.scene.units import inconsistent


@dataclass(frozen=True)
class Known:
    """What is known of a body: of a mesh from a file, nothing before it is read.

    Attributes
    ----------
    dim
        2 or 3.
    surfaces, volumes
        Names.
    """

    dim: int | None = None
    surfaces: Sequence[str] | None = None
    volumes: Sequence[str] | None = None


def inconsistencies(
    scene: Scene, known: Mapping[str, Known] | None = None
) -> list[str]:
    """List what no table shows by itself: names, dimensions, grids, lengths.

    Parameters
    ----------
    scene
        All of it, no number of it `out_of_range`.
    known
        Of each body what its mesh tells; without it, what the tables do.
    """
    if known is None:
        known = {name: _of_table(block) for name, block in scene.body.items()}
    dim = max((one.dim for one in known.values() if one.dim), default=None)
    return [
        *_units(scene),
        *_bodies(scene, known),
        *_materials(scene),
        *_surfaces(scene, known),
        *_components(scene, dim),
        *_held(scene, dim),
        *_strains(scene, known, dim),
        *_contacts(scene, known, dim),
        *_obstacles(scene, dim),
        *_path(scene),
    ]


def _of_table(block: Block) -> Known:
    if block.mesh is not None or block.dim is None:
        return Known()
    return Known(block.dim, [*FACES[block.dim], *block.surface], ())


def _units(scene: Scene) -> Iterator[str]:
    """Names that do not belong together: pictures would be wrong by powers of ten."""
    said = inconsistent(scene.units.model_dump())
    if said is not None:
        yield f"units: {said}"


def _bodies(scene: Scene, known: Mapping[str, Known]) -> Iterator[str]:
    """Materials, dimensions, and the parts of a body."""
    if len({one.dim for one in known.values() if one.dim}) > 1:
        yield "body: bodies of two and of three dimensions do not mix"
    for name, block in scene.body.items():
        if "." in name:
            yield f"body.{name}: a name has no dot, which parts a body from its surface"
        for end, material in block.materials.items():
            if material not in scene.material:
                place = f"body.{name}.material{end}"
                table = f"[material.{material}] makes it"
                yield f"{place}: {_unknown(material, scene.material, table)}"
        if isinstance(block.material, dict):
            yield from _volumes(f"body.{name}.material", block, known[name])
        own = _box if block.mesh is None else _of_file
        yield from own(name, block, scene)
        yield from _geometry(f"body.{name}.surface", block, known[name].dim)


def _volumes(place: str, block: Block, known: Known) -> Iterator[str]:
    if not block.material:
        yield f"{place}: is empty, expected a material for each volume"
    if known.volumes is None:
        return
    for volume in block.material:
        if volume not in known.volumes:
            why = (
                "a box names no volume" if block.mesh is None else "its file names none"
            )
            said = f"{place}: there is no volume {volume!r}"
            yield said + instead(volume, known.volumes, why)


def _box(name: str, block: Block, scene: Scene) -> Iterator[str]:
    """A grid, and what does not fit in memory."""
    for key in ("cell", "x", "y"):
        if getattr(block, key) is None:
            yield f"body.{name}.{key}: is missing"
    if block.dim is None:
        return
    if (block.z is None) != (block.dim == 2):
        needs = "takes no z" if block.dim == 2 else "needs z"
        yield f"body.{name}: a {block.cell} {needs}"
    n = scene.mesh.n if scene.mesh else None
    sides = []
    for letter, axis in zip(AXES, (block.x, block.y, block.z), strict=True):
        try:
            if axis is not None:
                sides.append(len(axis.grid(n)))
        except ValueError as error:
            yield f"body.{name}.{letter}: {error}"
    if len(sides) == block.dim:
        order = scene.order(block) or 1
        nodes = math.prod(order * (side - 1) + 1 for side in sides)
        yield from _too_large(name, nodes, block.dim, scene.path.count())


def _of_file(name: str, block: Block, _: Scene) -> Iterator[str]:
    for key in ("cell", "x", "y", "z"):
        if getattr(block, key) is not None:
            yield f"body.{name}.{key}: is of a box, this body has a mesh"
    if "order" in block.model_fields_set:
        yield f"body.{name}.order: is of a box, that of a mesh is mesh.order"


def _geometry(place: str, block: Block, dim: int | None) -> Iterator[str]:
    """Surfaces by place and direction."""
    for name, surface in block.surface.items():
        if block.mesh is None and block.dim is not None and name in FACES[block.dim]:
            yield f"{place}.{name}: a box has a surface of this name, choose another"
        if surface.within is None and surface.normal is None:
            yield f"{place}.{name}: needs within or normal"
        if surface.within is not None:
            yield from _within(f"{place}.{name}.within", surface.within, dim)
        if surface.normal is not None:
            yield from _direction(f"{place}.{name}.normal", surface.normal, dim)
        elif "angle" in surface.model_fields_set:
            yield f"{place}.{name}.angle: goes with normal, which is missing"


def _within(place: str, within: Within, dim: int | None) -> Iterator[str]:
    given = within.box()
    if not given:
        yield f"{place}: gives no range of x, y or z"
    for axis, (low, high) in given.items():
        if not low <= high:
            yield f"{place}.{AXES[axis]}: should ascend, got {[low, high]}"
    if dim == 2 and 2 in given:
        yield f"{place}.z: a scene of two dimensions has no z"


def _direction(place: str, vector: Sequence[float], dim: int | None) -> Iterator[str]:
    if dim is not None and len(vector) != dim:
        yield f"{place}: should have {dim} components"
    elif not any(vector):
        yield f"{place}: should not be zero"


def _materials(scene: Scene) -> Iterator[str]:
    for name, material in scene.material.items():
        try:
            material.made()
        except ValueError as error:
            yield f"material.{name}: {error}"


def _surfaces(scene: Scene, known: Mapping[str, Known]) -> Iterator[str]:
    """Names that tables act on."""
    for kind in ("support", "symmetry", "spring", "traction", "pressure", "contact"):
        for i, entry in enumerate(getattr(scene, kind)):
            yield from _surface(known, f"{kind}.{i}.on", entry.on)
    for i, force in enumerate(scene.body_force):
        if force.on not in scene.body:
            yield f"body_force.{i}.on: {_unknown(force.on, scene.body)}"


def _surface(known: Mapping[str, Known], path: str, on: str) -> Iterator[str]:
    body, dot, face = on.partition(".")
    if body not in known:
        told = _unknown(body, list(known))
        owners = [name for name, one in known.items() if on in (one.surfaces or ())]
        if owners:
            meant = " or ".join(f"{name}.{on}" for name in owners)
            told = f"there is no body {on!r}, did you mean {meant}?"
        yield f"{path}: {told}"
        return
    names = known[body].surfaces
    if names is None:
        if not face:
            yield f"{path}: should be {body}.SURFACE, a surface that its mesh names"
    elif not dot or face not in names:
        table = f"[body.{body}.surface.NAME] makes one, by place and direction"
        told = _unknown(on, [f"{body}.{name}" for name in names], table)
        yield f"{path}: {told}"


def _components(scene: Scene, dim: int | None) -> Iterator[str]:
    """Components of vectors that act."""
    for kind in ("support", "traction", "body_force"):
        for i, entry in enumerate(getattr(scene, kind)):
            yield from _given(f"{kind}.{i}", entry, dim)
    for i, support in enumerate(scene.support):
        if support.within is not None and dim == 2 and support.within.z is not None:
            yield f"support.{i}.within.z: a scene of two dimensions has no z"


def _given(place: str, entry: Components, dim: int | None) -> Iterator[str]:
    if not entry.components():
        yield f"{place}: gives no component x, y or z"
    if dim == 2 and entry.z is not None:
        yield f"{place}.z: a scene of two dimensions has no z"


def _held(scene: Scene, dim: int | None) -> Iterator[str]:
    """Springs."""
    for i, spring in enumerate(scene.spring):
        along = spring.normal is not None or spring.tangential is not None
        if along == (spring.stiffness is not None):
            yield f"spring.{i}: needs stiffness, or normal and tangential"
        if (
            dim is not None
            and isinstance(spring.stiffness, list)
            and len(spring.stiffness) != dim
        ):
            yield f"spring.{i}.stiffness: should have {dim} components"


def _strains(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[str]:
    for i, strain in enumerate(scene.strain):
        place = f"strain.{i}"
        body, _, volume = strain.on.partition(".")
        names = None if body not in known else known[body].volumes
        if body not in known:
            yield f"{place}.on: {_unknown(body, list(known))}"
        elif volume and names is not None and volume not in names:
            told = f"{_unknown(volume, names)} of the volumes of body {body!r}"
            yield f"{place}.on: {told}"
        heat = strain.expansion is not None, strain.temperature is not None
        if any(heat) == (strain.tensor is not None) or any(heat) != all(heat):
            yield f"{place}: needs expansion and temperature, or tensor"
        if strain.amplitude is not None and strain.tensor is None:
            yield (
                f"{place}.amplitude: goes with tensor, that of heat is "
                'temperature = { value = ..., amplitude = "..." }'
            )
        if strain.tensor is None:
            continue
        rows = [len(row) for row in strain.tensor]
        if rows != [len(rows)] * len(rows) or len(rows) < (dim or 2):
            yield f"{place}.tensor: should have {dim or 3} rows of {dim or 3} numbers"
        elif any(
            strain.tensor[a][b] != strain.tensor[b][a]
            for a in range(len(rows))
            for b in range(a)
        ):
            yield f"{place}.tensor: should be symmetric"


def _contacts(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[str]:
    for i, contact in enumerate(scene.contact):
        place = f"contact.{i}"
        if (contact.plane is None) == (contact.against is None):
            yield f"{place}: needs plane or against, one of them"
        if contact.obstacle is not None and contact.obstacle not in scene.obstacle:
            yield f"{place}.against: {_no_obstacle(contact.obstacle, scene)}"
        if contact.other is not None:
            yield from _surface(known, f"{place}.against", contact.other)
            if contact.other.partition(".")[0] == contact.on.partition(".")[0]:
                yield f"{place}.against: a body cannot meet itself"
        yield from _pairing(place, contact)
        if contact.plane is not None:
            yield from _plane(f"{place}.plane", contact.plane, dim)
        for key, vector in (
            ("clearance.centre", contact.clearance.centre),
            ("axis", contact.axis),
        ):
            if vector is not None and dim is not None and len(vector) != dim:
                yield f"{place}.{key}: should have {dim} components"
        if dim is not None:
            yield from _friction(place, contact, dim)
        if contact.clearance.radius == 0:
            yield f"{place}.clearance.radius: should not be zero"


def _no_obstacle(name: str, scene: Scene) -> str:
    said = f"there is no obstacle {name!r}"
    if name in scene.body:
        return f"{said}, and a surface of body {name!r} is {name}.SURFACE"
    return said + instead(name, scene.obstacle, f"[obstacle.{name}] makes it")


def _pairing(place: str, contact: Touch) -> Iterator[str]:
    if contact.other is None and contact.pairing == "nodes":
        yield f"{place}.pairing: of a rigid obstacle should be 'match' or 'mortar'"


def _plane(place: str, plane: Plane, dim: int | None) -> Iterator[str]:
    if dim is not None and len(plane.point) != dim:
        yield f"{place}.point: should have {dim} components"
    yield from _direction(f"{place}.normal", plane.normal, dim)


def _obstacles(scene: Scene, dim: int | None) -> Iterator[str]:
    used = {contact.obstacle for contact in scene.contact}
    for name, rigid in scene.obstacle.items():
        place = f"obstacle.{name}"
        if "." in name:
            yield f"{place}: a name has no dot, which parts a body from its surface"
        elif name not in used:
            yield f"{place}: no contact is against it"
        shapes = ("plane", "sphere", "cylinder", "torus", "surface")
        if sum(getattr(rigid, shape) is not None for shape in shapes) != 1:
            yield f"{place}: needs one of {', '.join(shapes)}"
        if rigid.inside and rigid.plane is not None:
            yield f"{place}.inside: a plane has no inside, turn its normal round"
        if rigid.plane is not None:
            yield from _plane(f"{place}.plane", rigid.plane, dim)
        for key, point in (
            ("sphere.centre", rigid.sphere and rigid.sphere.centre),
            ("cylinder.point", rigid.cylinder and rigid.cylinder.point),
            ("turn.about", rigid.turn and rigid.turn.about),
        ):
            if point and dim is not None and len(point) != dim:
                yield f"{place}.{key}: should have {dim} components"
        if rigid.torus is not None:
            yield from _torus(f"{place}.torus", rigid.torus, dim)
        for key, part in (("cylinder", rigid.cylinder), ("turn", rigid.turn)):
            if part is not None:
                yield from _axis(f"{place}.{key}.axis", part.axis, dim)
        if rigid.move is not None:
            yield from _given(f"{place}.move", rigid.move, dim)


def _torus(place: str, torus: Ring, dim: int | None) -> Iterator[str]:
    if dim == 2:
        yield f"{place}: needs a scene of three dimensions"
        return
    if len(torus.centre) != 3:
        yield f"{place}.centre: should have 3 components"
    yield from _direction(f"{place}.axis", torus.axis, 3)
    if torus.minor_radius >= torus.major_radius:
        yield f"{place}.minor_radius: should be less than major_radius"


def _axis(place: str, axis: Sequence[float] | None, dim: int | None) -> Iterator[str]:
    """A direction in space, which the plane does not need."""
    if axis is None:
        if dim == 3:
            yield f"{place}: is missing"
    elif dim == 2:
        yield f"{place}: in two dimensions there is none"
    else:
        yield from _direction(place, axis, 3)


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


def out_of_range(scene: Scene) -> Iterator[str]:
    """Sentences about numbers that arithmetic cannot be trusted with."""
    for place, value in _numbers(scene.model_dump(by_alias=True, exclude={"solver"})):
        if not (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
            expected = f"zero or a size from {1 / LARGEST:g} to {LARGEST:g}"
            yield f"{'.'.join(map(str, place))}: is {value:g}, expected {expected}"


def _numbers(
    value: Any, place: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], float]]:
    if isinstance(value, dict | list):
        inside = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in inside:
            yield from _numbers(inner, (*place, key))
    elif isinstance(value, float):
        yield place, value


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
    path, count = scene.path, scene.path.count()
    used = {path.parameter}
    for place, number in scene.varying():
        used.add(number.amplitude)
        if number.amplitude is not None and number.amplitude not in path.amplitude:
            table = f"path.amplitude.{number.amplitude} = [1.0] makes it"
            told = _unknown(number.amplitude, path.amplitude, table)
            yield f"{place}.amplitude: {told}"
    if path.parameter is not None and path.parameter not in path.amplitude:
        table = f"path.amplitude.{path.parameter} = [1.0] makes it"
        told = _unknown(path.parameter, path.amplitude, table)
        yield f"path.parameter: {told}"
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
        elif amplitude.table is not None and len(amplitude.table) != count:
            yield (
                f"{place}: has {counted(len(amplitude.table), 'factor')} for "
                f"{counted(count, 'step')}"
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


def _unknown(
    name: str, known: Sequence[str] | dict[str, Any], otherwise: str = ""
) -> str:
    """A name that is not known, and what to do where none is."""
    return f"there is no {name!r}" + instead(name, known, otherwise)
