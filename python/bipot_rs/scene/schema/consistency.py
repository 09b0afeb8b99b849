"""Checks that need more than one table of a scene: names, dimensions, sizes.

Each function yields mistakes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from keyword import iskeyword

from bipot_rs._lib.machine import installed
from bipot_rs._lib.messages import count_noun, instead
from bipot_rs._lib.validation import RATIO
from bipot_rs.mesh.boxes import FACES
from bipot_rs.scene.mistakes import Mistake, MistakeKind
from bipot_rs.scene.schema.contact import PlaneTable, Ring, Touch
from bipot_rs.scene.schema.mesh import Block, Within
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import AXES, LARGEST, NAME, Components
from bipot_rs.scene.units import find_inconsistency

_DOT = "contains a dot, which separates a body from its surface; choose another name"
_IN_SPACE = "remove it, the scene has two dimensions"


@dataclass(frozen=True)
class Known:
    """Dimension (2 or 3) and names of one body; None until its mesh file is read."""

    dim: int | None = None
    surfaces: Sequence[str] | None = None
    volumes: Sequence[str] | None = None


def inconsistencies(
    scene: Scene, known: Mapping[str, Known] | None = None
) -> list[Mistake]:
    """Names, dimensions, grids and sizes that contradict each other.

    Parameters
    ----------
    scene
        A scene in which no number is `out_of_range`.
    known
        What the mesh of each body contains; by default what the tables say.
    """
    if known is None:
        known = {name: _of_table(block) for name, block in scene.body.items()}
    dim = max((body.dim for body in known.values() if body.dim), default=None)
    return [
        *_units(scene),
        *_parameters(scene),
        *_bodies(scene, known),
        *_materials(scene),
        *_surfaces(scene, known),
        *_components(scene, dim),
        *_springs(scene, dim),
        *_strains(scene, known, dim),
        *_contacts(scene, known, dim),
        *_obstacles(scene, dim),
        *check_remotes(scene, dim),
        *check_bolts(scene, known, dim),
        *check_repetitions(scene, dim),
        *_path(scene),
        *_wear(scene),
    ]


def _of_table(block: Block) -> Known:
    if block.mesh is not None or block.dim is None:
        return Known()
    return Known(block.dim, [*FACES[block.dim], *block.surface], ())


def _units(scene: Scene) -> Iterator[Mistake]:
    """Units that do not fit together: numbers in pictures would be wrong."""
    problem = find_inconsistency(scene.units.model_dump())
    if problem is not None:
        yield Mistake("units", problem)


def _parameters(scene: Scene) -> Iterator[Mistake]:
    for name in scene.parameter:
        if not name.isidentifier() or iskeyword(name) or name == "n":
            yield Mistake(
                f"parameter.{name}",
                "should have another name: letters, digits and '_', with a letter first, and "
                "not n (mesh.n) or a word that Python reserves",
            )


def _bodies(scene: Scene, known: Mapping[str, Known]) -> Iterator[Mistake]:
    if len({body.dim for body in known.values() if body.dim}) > 1:
        yield Mistake(
            "body", "some bodies have two dimensions and some three, expected the same"
        )
    for name, block in scene.body.items():
        if "." in name:
            yield Mistake(f"body.{name}", _DOT)
        for end, material in block.materials.items():
            if material not in scene.material:
                hint = f"define it as [material.{material}]"
                key = f"body.{name}.material{end}"
                yield _unknown(key, "material", material, scene.material, hint)
        if isinstance(block.material, dict):
            yield from _volumes(f"body.{name}.material", block, known[name])
        check_mesh_of = _box if block.mesh is None else _of_file
        yield from check_mesh_of(name, block, scene)
        yield from _geometry(f"body.{name}.surface", block, known[name].dim)


def _volumes(place: str, block: Block, known: Known) -> Iterator[Mistake]:
    if not block.material:
        yield Mistake(place, "is empty, expected a material for each volume")
    if known.volumes is None:
        return
    for volume in block.material:
        if volume not in known.volumes:
            hint = f"{'a box' if block.mesh is None else 'its mesh file'} has none"
            yield _unknown(place, "volume", volume, known.volumes, hint)


def _box(name: str, block: Block, scene: Scene) -> Iterator[Mistake]:
    for key in ("cell", "x", "y"):
        if getattr(block, key) is None:
            yield Mistake(f"body.{name}.{key}", "is missing", MistakeKind.MISSING_KEY)
    if block.dim is None:
        return
    if block.z is None and block.dim == 3:
        yield Mistake(
            f"body.{name}.z",
            f"is missing, cell = {block.cell!r} has three dimensions",
            MistakeKind.MISSING_KEY,
        )
    elif block.z is not None and block.dim == 2:
        yield Mistake(
            f"body.{name}.z", f"remove it, cell = {block.cell!r} has two dimensions"
        )
    n = scene.mesh.n if scene.mesh else None
    sides = []
    for letter, axis in zip(AXES, (block.x, block.y, block.z), strict=True):
        try:
            if axis is not None:
                sides.append(len(axis.grid(n)))
        except ValueError as error:
            yield Mistake(f"body.{name}.{letter}", str(error))
    if len(sides) == block.dim:
        order = scene.order(block) or 1
        nodes = math.prod(order * (side - 1) + 1 for side in sides)
        yield from _too_large(name, nodes, block.dim, scene.path.count())


def _of_file(name: str, block: Block, _: Scene) -> Iterator[Mistake]:
    for key in ("cell", "x", "y", "z"):
        if getattr(block, key) is not None:
            yield Mistake(
                f"body.{name}.{key}",
                "is for a box, but this body has a mesh; remove one",
            )
    if "order" in block.model_fields_set:
        yield Mistake(
            f"body.{name}.order", f"is for a box; for a mesh set body.{name}.mesh.order"
        )


def _geometry(place: str, block: Block, dim: int | None) -> Iterator[Mistake]:
    for name, surface in block.surface.items():
        if block.mesh is None and block.dim is not None and name in FACES[block.dim]:
            yield Mistake(
                f"{place}.{name}",
                "a box has a surface of this name, choose another name",
            )
        if surface.within is None and surface.normal is None:
            yield Mistake(
                f"{place}.{name}",
                "needs within or normal",
            )
        if surface.within is not None:
            yield from _within(f"{place}.{name}.within", surface.within, dim)
        if surface.normal is not None:
            yield from _direction(f"{place}.{name}.normal", surface.normal, dim)
        elif "angle" in surface.model_fields_set:
            yield Mistake(
                f"{place}.{name}.angle",
                "needs normal, which is missing",
            )


def _within(place: str, within: Within, dim: int | None) -> Iterator[Mistake]:
    limits = within.box()
    if not limits:
        yield Mistake(place, "is empty, expected a range of x, y or z")
    for axis, (low, high) in limits.items():
        if not low <= high:
            yield Mistake(f"{place}.{AXES[axis]}", f"should ascend, got {[low, high]}")
    if dim == 2 and 2 in limits:
        yield Mistake(f"{place}.z", _IN_SPACE)


def _direction(
    place: str, vector: Sequence[float], dim: int | None
) -> Iterator[Mistake]:
    if dim is not None and len(vector) != dim:
        yield from _length(place, vector, dim)
    elif not any(vector):
        yield Mistake(place, "should not be zero")


def _length(
    place: str, vector: Sequence[float] | None, dim: int | None
) -> Iterator[Mistake]:
    if vector and dim is not None and len(vector) != dim:
        yield Mistake(place, f"should have {dim} components, got {len(vector)}")


def _materials(scene: Scene) -> Iterator[Mistake]:
    for name, material in scene.material.items():
        try:
            material.make()
        except ValueError as error:
            yield Mistake(f"material.{name}", str(error))


def _surfaces(scene: Scene, known: Mapping[str, Known]) -> Iterator[Mistake]:
    """Values of ``on``."""
    for kind in ("support", "symmetry", "spring", "traction", "pressure", "contact"):
        for i, entry in enumerate(getattr(scene, kind)):
            inside = kind == "support"
            yield from _surface(known, f"{kind}.{i}.on", entry.on, inside=inside)
    for name, remote in scene.remote.items():
        yield from _surface(known, f"remote.{name}.on", remote.on, inside=True)
    for kind in ("cyclic", "periodic"):
        for i, entry in enumerate(getattr(scene, kind)):
            yield from _surface(known, f"{kind}.{i}.on", entry.on)
            yield from _surface(known, f"{kind}.{i}.onto", entry.onto)
    for i, force in enumerate(scene.body_force):
        if force.on not in scene.body:
            yield _unknown(f"body_force.{i}.on", "body", force.on, scene.body)


def _surface(
    known: Mapping[str, Known], path: str, on: str, *, inside: bool = False
) -> Iterator[Mistake]:
    """A surface; ``inside`` also accepts a volume and a whole body."""
    body, dot, face = on.partition(".")
    if body not in known:
        owners = [name for name, about in known.items() if on in (about.surfaces or ())]
        if owners:
            meant = " or ".join(f"{name}.{on}" for name in owners)
            problem = f"there is no body {on!r}, did you mean {meant}?"
            yield Mistake(path, problem, MistakeKind.NAME)
        else:
            yield _unknown(path, "body", body, list(known))
        return
    names = known[body].surfaces
    if inside and (not dot or face in (known[body].volumes or ())):
        return
    if names is None:
        if not face:
            yield Mistake(
                path, f'should be "{body}.SURFACE", a surface that the mesh file names'
            )
    elif not dot or face not in names:
        hint = f"define one as [body.{body}.surface.NAME]"
        full = [f"{body}.{name}" for name in names]
        yield _unknown(path, "surface", on, full, hint)


def _components(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    for kind in ("support", "traction", "body_force"):
        for i, entry in enumerate(getattr(scene, kind)):
            yield from _check_components(f"{kind}.{i}", entry, dim)
    for kind in ("support", "traction", "pressure", "contact"):
        for i, entry in enumerate(getattr(scene, kind)):
            if entry.within is not None:
                yield from _within(f"{kind}.{i}.within", entry.within, dim)
    for i, support in enumerate(scene.support):
        yield from _length(f"support.{i}.at", support.at, dim)
        if support.at is None and support.within is None and support.on in scene.body:
            yield Mistake(
                f"support.{i}.on",
                f"is the whole body {support.on!r}; name a surface or a "
                "volume, or add within or at",
            )


def _check_components(
    place: str, entry: Components, dim: int | None
) -> Iterator[Mistake]:
    if not entry.components():
        yield Mistake(place, "has no component, expected x, y or z")
    if dim == 2 and entry.z is not None:
        yield Mistake(f"{place}.z", _IN_SPACE)


def _springs(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    for i, spring in enumerate(scene.spring):
        along = spring.normal is not None or spring.tangential is not None
        if along == (spring.stiffness is not None):
            yield Mistake(
                f"spring.{i}",
                "needs stiffness, or normal and tangential",
            )
        if isinstance(spring.stiffness, list):
            yield from _length(f"spring.{i}.stiffness", spring.stiffness, dim)


def _strains(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[Mistake]:
    for i, strain in enumerate(scene.strain):
        place = f"strain.{i}"
        body, _, volume = strain.on.partition(".")
        names = None if body not in known else known[body].volumes
        if body not in known:
            yield _unknown(f"{place}.on", "body", body, list(known))
        elif volume and names is not None and volume not in names:
            full = [f"{body}.{name}" for name in names]
            hint = f"body {body!r} has none"
            yield _unknown(f"{place}.on", "volume", strain.on, full, hint)
        heat = strain.expansion is not None, strain.temperature is not None
        if any(heat) == (strain.tensor is not None) or any(heat) != all(heat):
            yield Mistake(
                place,
                "needs expansion and temperature, or tensor",
            )
        if strain.amplitude is not None and strain.tensor is None:
            yield Mistake(
                f"{place}.amplitude",
                "needs tensor; for a thermal strain write "
                'temperature = { value = ..., amplitude = "..." }',
            )
        if strain.tensor is None:
            continue
        rows = [len(row) for row in strain.tensor]
        if rows != [len(rows)] * len(rows) or len(rows) < (dim or 2):
            yield Mistake(
                f"{place}.tensor", f"should have {dim or 3} rows of {dim or 3} numbers"
            )
        elif any(
            strain.tensor[a][b] != strain.tensor[b][a]
            for a in range(len(rows))
            for b in range(a)
        ):
            yield Mistake(f"{place}.tensor", "should be symmetric")


def _contacts(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[Mistake]:
    names = [contact.name for contact in scene.contact]
    for i, contact in enumerate(scene.contact):
        place = f"contact.{i}"
        if contact.name is not None and not NAME.fullmatch(contact.name):
            yield Mistake(
                f"{place}.name",
                "should be letters, digits, '_' and '-', with a letter first, got "
                f"{contact.name!r}",
            )
        elif contact.name is not None and contact.name in names[:i]:
            yield Mistake(
                f"{place}.name",
                f"contact.{names.index(contact.name)} has this name too; choose another",
            )
        if (contact.plane is None) == (contact.against is None):
            yield Mistake(
                place,
                "needs exactly one of plane and against",
            )
        if contact.obstacle is not None and contact.obstacle not in scene.obstacle:
            yield _no_obstacle(f"{place}.against", contact.obstacle, scene)
        if contact.other is not None:
            yield from _surface(known, f"{place}.against", contact.other)
            if contact.other.partition(".")[0] == contact.on.partition(".")[0]:
                yield Mistake(
                    f"{place}.against",
                    f"should be a surface of another body, got {contact.against!r}",
                )
        if contact.other is None and contact.pairing == "nodes":
            yield Mistake(
                f"{place}.pairing", "should be 'match' or 'mortar' for a rigid obstacle"
            )
        if contact.plane is not None:
            yield from _plane(f"{place}.plane", contact.plane, dim)
        for key, vector in (
            ("clearance.centre", contact.clearance.centre),
            ("axis", contact.axis),
        ):
            yield from _length(f"{place}.{key}", vector, dim)
        if dim is not None:
            yield from _friction(place, contact, dim)
        if contact.clearance.radius == 0:
            yield Mistake(f"{place}.clearance.radius", "should not be zero")


def _no_obstacle(key: str, name: str, scene: Scene) -> Mistake:
    if name in scene.body:
        message = (
            f'{name!r} is a body, expected an obstacle or a surface, "{name}.SURFACE"'
        )
        return Mistake(key, message, MistakeKind.NAME)
    hint = f"define it as [obstacle.{name}]"
    return _unknown(key, "obstacle", name, scene.obstacle, hint)


def _plane(place: str, plane: PlaneTable, dim: int | None) -> Iterator[Mistake]:
    yield from _length(f"{place}.point", plane.point, dim)
    yield from _direction(f"{place}.normal", plane.normal, dim)


def _obstacles(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    used = {contact.obstacle for contact in scene.contact}
    for name, rigid in scene.obstacle.items():
        place = f"obstacle.{name}"
        if "." in name:
            yield Mistake(place, _DOT)
        elif name not in used:
            yield Mistake(
                place, f'is not used; remove it, or set against = "{name}" in a contact'
            )
        if sum(getattr(rigid, shape) is not None for shape in rigid.SHAPES) != 1:
            yield Mistake(
                place,
                f"needs exactly one of {', '.join(rigid.SHAPES)}",
            )
        if rigid.inside and rigid.plane is not None:
            yield Mistake(
                f"{place}.inside", "a plane has no inside; reverse its normal instead"
            )
        if rigid.plane is not None:
            yield from _plane(f"{place}.plane", rigid.plane, dim)
        if rigid.sphere is not None:
            yield from _length(f"{place}.sphere.centre", rigid.sphere.centre, dim)
        if rigid.cylinder is not None:
            yield from _length(f"{place}.cylinder.point", rigid.cylinder.point, dim)
        if rigid.torus is not None:
            yield from _torus(f"{place}.torus", rigid.torus, dim)
        if rigid.turn is not None:
            yield from _length(f"{place}.turn.about", rigid.turn.about, dim)
        for key, part in (("cylinder", rigid.cylinder), ("turn", rigid.turn)):
            if part is not None:
                yield from _axis(f"{place}.{key}.axis", part.axis, dim)
        for key, vector in (("move", rigid.move), ("force", rigid.force)):
            if vector is not None:
                yield from _check_components(f"{place}.{key}", vector, dim)
        if rigid.move is not None and rigid.force is not None:
            for k in rigid.move.components().keys() & rigid.force.components().keys():
                yield Mistake(
                    f"{place}.force.{AXES[k]}",
                    f"remove it or {place}.move.{AXES[k]}: a "
                    "direction has either a force or a displacement",
                )


def check_remotes(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    """Remote points."""
    for name, remote in scene.remote.items():
        place = f"remote.{name}"
        if "." in name:
            yield Mistake(place, _DOT)
        if name in scene.obstacle and scene.obstacle[name].force is not None:
            yield Mistake(
                place, "an obstacle with a force has this name; choose another name"
            )
        yield from _length(f"{place}.point", remote.point, dim)
        if remote.within is not None:
            yield from _within(f"{place}.within", remote.within, dim)
        settings = remote.given()
        if not settings:
            yield Mistake(
                place,
                "needs move, turn, force or moment",
            )
        for key, numbers in settings.items():
            yield from _axes(f"{place}.{key}", key, numbers, dim)
        for held, loaded in (("move", "force"), ("turn", "moment")):
            if remote.distributed and held in settings:
                yield Mistake(
                    f"{place}.{held}",
                    "remove it, or distributed: a part that may deform has no prescribed motion",
                )
            for k in settings.get(held, {}).keys() & settings.get(loaded, {}).keys():
                yield Mistake(
                    f"{place}.{loaded}.{AXES[k]}",
                    f"remove it or {place}.{held}.{AXES[k]}: "
                    "a component is either prescribed or loaded",
                )


def check_bolts(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[Mistake]:
    """Sections of bolts, their steps and names."""
    count = scene.path.count()
    titles = [*scene.remote, *scene.obstacle]
    for i, bolt in enumerate(scene.bolt):
        place = f"bolt.{i}"
        if bolt.plane is None:
            yield from _surface(known, f"{place}.section", bolt.section)
        else:
            if bolt.section not in scene.body:
                yield _unknown(f"{place}.section", "body", bolt.section, scene.body)
            yield from _length(f"{place}.plane.point", bolt.plane.point, dim)
            yield from _length(f"{place}.plane.normal", bolt.plane.normal, dim)
        first, last = bolt.step
        if not first <= last <= count:
            yield Mistake(
                f"{place}.step",
                f"is {bolt.step}, expected the first and the last load step that tighten the "
                f"bolt, from 1 to {count}",
            )
        if bolt.title in titles:
            yield Mistake(
                f"{place}.name",
                f"should be another name than {bolt.title!r}, which exists",
            )
        titles.append(bolt.title)


def _axes(
    place: str, key: str, numbers: Mapping[int, object], dim: int | None
) -> Iterator[Mistake]:
    turning = key in ("turn", "moment")
    if not numbers:
        yield Mistake(
            place, f"has no component, expected {'z' if turning else 'x, y or z'}"
        )
    if dim != 2:
        return
    for k in numbers:
        if turning and k != 2:
            yield Mistake(
                f"{place}.{AXES[k]}", "remove it, in two dimensions the only axis is z"
            )
        elif not turning and k == 2:
            yield Mistake(f"{place}.z", _IN_SPACE)


def check_repetitions(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    """Cyclic symmetries and periodicities."""
    for i, cyclic in enumerate(scene.cyclic):
        place = f"cyclic.{i}"
        yield from _length(f"{place}.about", cyclic.about, dim)
        yield from _axis(f"{place}.axis", cyclic.axis, dim)
    for kind in ("cyclic", "periodic"):
        for i, entry in enumerate(getattr(scene, kind)):
            if entry.on == entry.onto:
                yield Mistake(f"{kind}.{i}.onto", "should be another surface than on")
    tied = scene.tied()
    if tied is not None and scene.solver.engine == "petsc":
        yield Mistake(
            "solver.engine",
            f"should not be 'petsc', which does not support {tied}; use "
            "'auto', 'direct' or 'iterative'",
        )


def _torus(place: str, torus: Ring, dim: int | None) -> Iterator[Mistake]:
    if dim == 2:
        yield Mistake(
            place,
            "needs a scene of three dimensions",
        )
        return
    yield from _length(f"{place}.centre", torus.centre, 3)
    yield from _direction(f"{place}.axis", torus.axis, 3)
    if torus.minor_radius >= torus.major_radius:
        yield Mistake(f"{place}.minor_radius", "should be less than major_radius")


def _axis(
    place: str, axis: Sequence[float] | None, dim: int | None
) -> Iterator[Mistake]:
    if axis is None:
        if dim == 3:
            yield Mistake(place, "is missing", MistakeKind.MISSING_KEY)
    elif dim == 2:
        yield Mistake(place, "remove it, the scene has two dimensions")
    else:
        yield from _direction(place, axis, 3)


def _friction(place: str, contact: Touch, dim: int) -> Iterator[Mistake]:
    mu, axis = contact.mu, contact.axis
    if not isinstance(mu, list):
        if contact.dilatancy > mu:
            yield Mistake(
                f"{place}.dilatancy",
                f"should be at most mu, which is {mu:g}, got {contact.dilatancy:g}",
            )
        if axis is not None:
            yield Mistake(
                f"{place}.axis",
                "needs two numbers in mu, got one",
            )
        return
    for key in ("cohesion", "dilatancy"):
        if getattr(contact, key):
            yield Mistake(f"{place}.{key}", "needs one number in mu, got two")
    if dim == 2:
        yield Mistake(
            f"{place}.mu", "has two numbers, expected one: the scene has two dimensions"
        )
    elif axis is None:
        yield Mistake(
            f"{place}.axis",
            "is missing; it is the direction of the first number of mu",
            MistakeKind.MISSING_KEY,
        )
    elif not any(axis):
        yield Mistake(f"{place}.axis", "should not be zero")
    if not min(mu) * RATIO >= max(mu):
        yield Mistake(
            f"{place}.mu",
            f"should be two positive numbers within a factor of {RATIO:g} of each other, "
            f"or two zeros, got {mu}",
        )


def out_of_range(scene: Scene) -> Iterator[Mistake]:
    """Numbers whose products would overflow or underflow."""
    for place, value in _numbers(scene.model_dump(by_alias=True, exclude={"solver"})):
        if not (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
            expected = f"zero or a magnitude from {1 / LARGEST:g} to {LARGEST:g}"
            key = ".".join(map(str, place))
            yield Mistake(key, f"is {value:g}, expected {expected}", MistakeKind.RANGE)


def _numbers(
    value: object, place: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], float]]:
    if isinstance(value, dict | list):
        inside = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in inside:
            yield from _numbers(inner, (*place, key))
    elif isinstance(value, float):
        yield place, value


def _too_large(name: str, nodes: int, dim: int, steps: int) -> Iterator[Mistake]:
    """Arrays that are larger than the memory, before they are allocated."""
    memory = installed()
    if memory is None:
        return
    # Each node is coupled to the 3^d nodes of the cells around it: 8 bytes for the
    # number and 4 for the column index.
    stiffness = nodes * dim * 3**dim * dim * 12
    path = 2 * 8 * nodes * dim * steps
    if stiffness > memory:
        yield Mistake(
            f"body.{name}",
            f"has {nodes} nodes, whose stiffness matrix takes {stiffness / 1e9:.3g} GB; "
            f"this machine has {memory / 1e9:.3g} GB: use fewer cells",
        )
    elif path > memory:
        yield Mistake(
            "path",
            f"has {steps} load steps of {nodes} nodes (body {name!r}), whose loads and "
            f"displacements take {path / 1e9:.3g} GB; this machine has "
            f"{memory / 1e9:.3g} GB: use fewer steps or cells",
        )


def _path(scene: Scene) -> Iterator[Mistake]:
    path, count = scene.path, scene.path.count()
    used = {path.parameter}
    for place, number in scene.varying():
        used.add(number.amplitude)
        if number.amplitude is not None and number.amplitude not in path.amplitude:
            yield _no_amplitude(f"{place}.amplitude", number.amplitude, scene)
    if path.parameter is not None and path.parameter not in path.amplitude:
        yield _no_amplitude("path.parameter", path.parameter, scene)
    for name, amplitude in path.amplitude.items():
        place = f"path.amplitude.{name}"
        if (amplitude.table is None) == (amplitude.wave is None):
            yield Mistake(place, "should be either a list of factors or a wave")
        elif amplitude.wave == "sine" and amplitude.period is None:
            yield Mistake(
                f"{place}.period",
                "is missing, a sine needs it",
                MistakeKind.MISSING_KEY,
            )
        elif amplitude.wave == "ramp" and amplitude.period is not None:
            yield Mistake(f"{place}.period", "remove it, a ramp has none")
        elif amplitude.wave is not None and path.steps is None:
            yield Mistake(
                "path.steps",
                f"is missing, amplitude {name!r} is a wave and needs it",
                MistakeKind.MISSING_KEY,
            )
        elif amplitude.table is not None and len(amplitude.table) != count:
            yield Mistake(
                place,
                f"has {count_noun(len(amplitude.table), 'factor')} for "
                f"{count_noun(count, 'step')}, expected one for each step",
            )
        if name not in used:
            yield Mistake(
                place, "is not used; remove it, or name it in an amplitude key"
            )
    automatic = path.increments
    if automatic is not None and not (
        automatic.smallest
        <= (automatic.first or automatic.largest)
        <= automatic.largest
    ):
        yield Mistake(
            "path.automatic",
            "needs smallest <= first <= largest, got "
            f"{automatic.smallest:g}, {automatic.first}, {automatic.largest:g}",
        )


def _wear(scene: Scene) -> Iterator[Mistake]:
    wear, count = scene.wear, scene.path.count()
    if wear is None:
        return
    if wear.steps is not None and wear.steps > count:
        yield Mistake(
            "wear.steps",
            f"is {wear.steps}, but the path has only {count_noun(count, 'load step')}",
        )
    if scene.path.increments is not None:
        yield Mistake("path.automatic", "remove it, wear repeats the given load steps")
    if scene.solver.engine == "petsc":
        yield Mistake(
            "solver.engine", "should not be 'petsc', which does not compute wear"
        )
    for k, contact in enumerate(scene.contact):
        for key in ("cohesion", "dilatancy"):
            if getattr(contact, key):
                yield Mistake(
                    f"contact.{k}.{key}", "remove it, wear is not derived for it"
                )
    if isinstance(scene.solver.tol, str):
        yield Mistake(
            "solver.tol", f"should be a number for wear, got {scene.solver.tol!r}"
        )


def _no_amplitude(key: str, name: str, scene: Scene) -> Mistake:
    hint = f"define it as path.amplitude.{name} = [1.0]"
    return _unknown(key, "amplitude", name, scene.path.amplitude, hint)


def _unknown(
    key: str,
    what: str,
    name: str,
    known: Sequence[str] | Mapping[str, object],
    hint: str = "",
) -> Mistake:
    """A name that is not defined; ``hint`` says what to do if no name is known."""
    message = f"there is no {what} {name!r}" + instead(name, known, hint)
    return Mistake(key, message, MistakeKind.NAME)
