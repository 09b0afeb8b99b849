"""Checks that need more than one table of a scene: names, dimensions, sizes.

Each function yields mistakes. `_geometry` checks the vectors and ranges of all tables alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from keyword import iskeyword

from pydantic import BaseModel

from bipot_rs._lib.machine import installed
from bipot_rs._lib.messages import count_noun, instead
from bipot_rs._lib.validation import RATIO
from bipot_rs.mesh.boxes import FACES
from bipot_rs.scene.mistakes import Mistake, MistakeKind
from bipot_rs.scene.schema.contact import Bar, CyclicTable, Driven, Ring, Touch, Turn
from bipot_rs.scene.schema.mesh import BodyTable, Within
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import AXES, LARGEST, NAME, Components
from bipot_rs.scene.units import find_inconsistency

# Numbers of the law of a contact beside its friction.
_LAW = {"cohesion", "dilatancy"}
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
    """Names, dimensions, grids and sizes that contradict each other; no number is `out_of_range`.

    ``known``: what the mesh of each body contains; by default what the tables say.
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
        *_supports(scene),
        *_springs(scene),
        *_strains(scene, known, dim),
        *_contacts(scene, known, dim),
        *_obstacles(scene),
        *_remotes(scene),
        *_bolts(scene, known),
        *_repetitions(scene),
        *_geometry(scene, dim),
        *_path(scene),
        *_wear(scene),
    ]


def _of_table(block: BodyTable) -> Known:
    if block.mesh is not None or block.dim is None:
        return Known()
    return Known(block.dim, [*FACES[block.dim], *block.surface], ())


def _refuse(*checks: tuple[bool, str, str]) -> Iterator[Mistake]:
    """The mistakes of checks: whether something is wrong, its key path, and what to do."""
    return (Mistake(key, message) for wrong, key, message in checks if wrong)


def _units(scene: Scene) -> Iterator[Mistake]:
    """Units that do not fit together: numbers in pictures would be wrong."""
    problem = find_inconsistency(scene.units.model_dump())
    return _refuse((problem is not None, "units", problem or ""))


def _parameters(scene: Scene) -> Iterator[Mistake]:
    advice = (
        "should have another name: letters, digits and '_', with a letter first, and not n "
        "(mesh.n) or a word that Python reserves"
    )
    for name in scene.parameter:
        reserved = not name.isidentifier() or iskeyword(name) or name == "n"
        yield from _refuse((reserved, f"parameter.{name}", advice))


# Keys of vectors, which have the dimension of the scene, and of those that are directions.
_DIRECTIONS = ("normal", "axis")
_VECTORS = ("point", "centre", "about", "at", "stiffness", *_DIRECTIONS)


def _tables(value: object, place: str = "") -> Iterator[tuple[str, BaseModel]]:
    """All tables below a value, with their key paths."""
    entries: Iterable[tuple[object, object]] = ()
    if isinstance(value, BaseModel):
        if place:
            yield place, value
        entries = value
    elif isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list):
        entries = enumerate(value)
    for key, inner in entries:
        yield from _tables(inner, f"{place}.{key}" if place else str(key))


def _geometry(scene: Scene, dim: int | None) -> Iterator[Mistake]:
    """Vectors, components and ranges of coordinates."""
    for place, table in _tables(scene):
        if isinstance(table, Within):
            yield from _ranges(place, table)
        # Rotations in the plane have the component z only.
        turning = place.startswith("remote.") and place.endswith((".turn", ".moment"))
        if isinstance(table, Components):
            axes = "z" if turning and dim == 2 else "x, y or z"
            empty = f"has no component, expected {axes}"
            yield from _refuse((not table.components(), place, empty))
        if isinstance(table, Components | Within) and dim == 2:
            advice = "remove it, in two dimensions the only axis is z"
            for key in ("x", "y") if turning else ("z",):
                given = getattr(table, key) is not None
                why = advice if turning else _IN_SPACE
                yield from _refuse((given, f"{place}.{key}", why))
        if isinstance(table, Ring) and dim == 2:
            yield Mistake(place, "needs a scene of three dimensions")
            continue
        if isinstance(table, Bar | Turn | CyclicTable) and dim == 3 and not table.axis:
            yield Mistake(f"{place}.axis", "is missing", MistakeKind.MISSING_KEY)
        for key in _VECTORS:
            vector = vars(table).get(key)
            if isinstance(vector, list):
                yield from _vector(f"{place}.{key}", vector, dim)


def _ranges(place: str, within: Within) -> Iterator[Mistake]:
    limits = within.box()
    yield from _refuse((not limits, place, "is empty, expected a range of x, y or z"))
    for axis, (low, high) in limits.items():
        key = f"{place}.{AXES[axis]}"
        yield from _refuse((low > high, key, f"should ascend, got {[low, high]}"))


def _vector(place: str, vector: list[float], dim: int | None) -> Iterator[Mistake]:
    key = place.rpartition(".")[2]
    if key == "axis" and dim == 2:
        yield Mistake(place, _IN_SPACE)
    elif dim is not None and len(vector) != dim:
        yield Mistake(place, f"should have {dim} components, got {len(vector)}")
    elif key in _DIRECTIONS and not any(vector):
        yield Mistake(place, "should not be zero")


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
        yield from _places(f"body.{name}.surface", block)


def _volumes(place: str, block: BodyTable, known: Known) -> Iterator[Mistake]:
    if not block.material:
        yield Mistake(place, "is empty, expected a material for each volume")
    if known.volumes is None:
        return
    for volume in block.material:
        if volume not in known.volumes:
            hint = f"{'a box' if block.mesh is None else 'its mesh file'} has none"
            yield _unknown(place, "volume", volume, known.volumes, hint)


def _box(name: str, block: BodyTable, scene: Scene) -> Iterator[Mistake]:
    for key in ("cell", "x", "y"):
        if getattr(block, key) is None:
            yield Mistake(f"body.{name}.{key}", "is missing", MistakeKind.MISSING_KEY)
    if block.dim is None:
        return
    place, cell = f"body.{name}.z", f"cell = {block.cell!r}"
    if block.z is None and block.dim == 3:
        missing = f"is missing, {cell} has three dimensions"
        yield Mistake(place, missing, MistakeKind.MISSING_KEY)
    deep = block.z is not None and block.dim == 2
    yield from _refuse((deep, place, f"remove it, {cell} has two dimensions"))
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


def _of_file(name: str, block: BodyTable, _: Scene) -> Iterator[Mistake]:
    only_box = "is for a box, but this body has a mesh; remove one"
    order = f"is for a box; for a mesh set body.{name}.mesh.order"
    yield from _refuse(
        *(
            (getattr(block, key) is not None, f"body.{name}.{key}", only_box)
            for key in ("cell", "x", "y", "z")
        ),
        ("order" in block.model_fields_set, f"body.{name}.order", order),
    )


def _places(key: str, block: BodyTable) -> Iterator[Mistake]:
    """Surfaces that the scene defines by geometry."""
    taken = {} if block.mesh is not None or block.dim is None else FACES[block.dim]
    for name, surface in block.surface.items():
        place, bare = f"{key}.{name}", surface.normal is None
        alone = bare and "angle" in surface.model_fields_set
        yield from _refuse(
            (name in taken, place, "a box has a surface of this name, choose another"),
            (bare and surface.within is None, place, "needs within or normal"),
            (alone, f"{place}.angle", "needs normal, which is missing"),
        )


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


def _supports(scene: Scene) -> Iterator[Mistake]:
    for i, support in enumerate(scene.support):
        whole = (
            support.at is None and support.within is None and support.on in scene.body
        )
        advice = (
            f"is the whole body {support.on!r}; name a surface or a volume, or add "
        )
        yield from _refuse((whole, f"support.{i}.on", f"{advice}within or at"))


def _springs(scene: Scene) -> Iterator[Mistake]:
    for i, spring in enumerate(scene.spring):
        along = spring.normal is not None or spring.tangential is not None
        unclear = along == (spring.stiffness is not None)
        needs = "needs stiffness, or normal and tangential"
        yield from _refuse((unclear, f"spring.{i}", needs))


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
        tensor, none = strain.tensor or [], strain.tensor is None
        unclear = any(heat) != none or any(heat) != all(heat)
        hint = (
            "needs tensor; for a thermal strain write "
            'temperature = { value = ..., amplitude = "..." }'
        )
        size = len(tensor)
        square = [len(row) for row in tensor] == [size] * size and size >= (dim or 2)
        mirrored = square and tensor != [list(row) for row in zip(*tensor, strict=True)]
        rows = f"should have {dim or 3} rows of {dim or 3} numbers"
        yield from _refuse(
            (unclear, place, "needs expansion and temperature, or tensor"),
            (none and strain.amplitude is not None, f"{place}.amplitude", hint),
            (not none and not square, f"{place}.tensor", rows),
            (mirrored, f"{place}.tensor", "should be symmetric"),
        )


def _contacts(
    scene: Scene, known: Mapping[str, Known], dim: int | None
) -> Iterator[Mistake]:
    names = [contact.name for contact in scene.contact]
    for i, contact in enumerate(scene.contact):
        place = f"contact.{i}"
        name, first = contact.name or "a", names.index(contact.name)
        letters = (
            f"should be letters, digits, '_' and '-', with a letter first, got {name!r}"
        )
        twice = f"contact.{first} has this name too; choose another"
        unclear = (contact.plane is None) == (contact.against is None)
        yield from _refuse(
            (not NAME.fullmatch(name), f"{place}.name", letters),
            (contact.name is not None and first < i, f"{place}.name", twice),
            (unclear, place, "needs exactly one of plane and against"),
        )
        if contact.obstacle is not None and contact.obstacle not in scene.obstacle:
            yield _no_obstacle(f"{place}.against", contact.obstacle, scene)
        if contact.other is not None:
            yield from _surface(known, f"{place}.against", contact.other)
        same = contact.on.partition(".")[0] == (contact.other or "").partition(".")[0]
        other = f"should be a surface of another body, got {contact.against!r}"
        alone = contact.other is None and contact.pairing == "nodes"
        match = "should be 'match' or 'mortar' for a rigid obstacle"
        flat = contact.clearance.radius == 0
        yield from _refuse(
            (same, f"{place}.against", other),
            (alone, f"{place}.pairing", match),
            (flat, f"{place}.clearance.radius", "should not be zero"),
        )
        if dim is not None:
            yield from _friction(place, contact, dim)


def _no_obstacle(key: str, name: str, scene: Scene) -> Mistake:
    if name in scene.body:
        message = (
            f'{name!r} is a body, expected an obstacle or a surface, "{name}.SURFACE"'
        )
        return Mistake(key, message, MistakeKind.NAME)
    hint = f"define it as [obstacle.{name}]"
    return _unknown(key, "obstacle", name, scene.obstacle, hint)


def _obstacles(scene: Scene) -> Iterator[Mistake]:
    used = {contact.obstacle for contact in scene.contact}
    for name, rigid in scene.obstacle.items():
        place = f"obstacle.{name}"
        idle = f'is not used; remove it, or set against = "{name}" in a contact'
        many = sum(getattr(rigid, shape) is not None for shape in rigid.SHAPES) != 1
        thick = rigid.torus and rigid.torus.minor_radius >= rigid.torus.major_radius
        reverse = "a plane has no inside; reverse its normal instead"
        yield from _refuse(
            ("." in name, place, _DOT),
            ("." not in name and name not in used, place, idle),
            (many, place, f"needs exactly one of {', '.join(rigid.SHAPES)}"),
            (rigid.inside and rigid.plane is not None, f"{place}.inside", reverse),
            (
                bool(thick),
                f"{place}.torus.minor_radius",
                "should be less than major_radius",
            ),
        )
        yield from _twice(place, rigid, "move", "force")


def _twice(place: str, table: Driven, held: str, loaded: str) -> Iterator[Mistake]:
    """Components that are both prescribed and loaded."""
    given = table.given()
    for k in given.get(held, {}).keys() & given.get(loaded, {}).keys():
        yield Mistake(
            f"{place}.{loaded}.{AXES[k]}",
            f"remove it or {place}.{held}.{AXES[k]}: a component is either prescribed or "
            "loaded",
        )


def _remotes(scene: Scene) -> Iterator[Mistake]:
    """Remote points."""
    for name, remote in scene.remote.items():
        place, settings = f"remote.{name}", remote.given()
        rigid = scene.obstacle.get(name)
        loaded = rigid is not None and rigid.force is not None
        taken = "an obstacle with a force has this name; choose another name"
        yield from _refuse(
            ("." in name, place, _DOT),
            (loaded, place, taken),
            (not settings, place, "needs move, turn, force or moment"),
        )
        deforms = (
            "remove it, or distributed: a part that may deform has no prescribed motion"
        )
        for held, load in (("move", "force"), ("turn", "moment")):
            wrong = remote.distributed and held in settings
            yield from _refuse((wrong, f"{place}.{held}", deforms))
            yield from _twice(place, remote, held, load)


def _bolts(scene: Scene, known: Mapping[str, Known]) -> Iterator[Mistake]:
    """Sections of bolts, their steps and names."""
    count = scene.path.count()
    titles = [*scene.remote, *scene.obstacle]
    for i, bolt in enumerate(scene.bolt):
        place = f"bolt.{i}"
        if bolt.plane is None:
            yield from _surface(known, f"{place}.section", bolt.section)
        elif bolt.section not in scene.body:
            yield _unknown(f"{place}.section", "body", bolt.section, scene.body)
        first, last = bolt.step
        steps = (
            f"is {bolt.step}, expected the first and the last load step that tighten the "
            f"bolt, from 1 to {count}"
        )
        taken = f"should be another name than {bolt.title!r}, which exists"
        yield from _refuse(
            (not first <= last <= count, f"{place}.step", steps),
            (bolt.title in titles, f"{place}.name", taken),
        )
        titles.append(bolt.title)


def _repetitions(scene: Scene) -> Iterator[Mistake]:
    """Cyclic symmetries and periodicities, and engines that do not take ties."""
    for kind in ("cyclic", "periodic"):
        for i, entry in enumerate(getattr(scene, kind)):
            same, place = entry.on == entry.onto, f"{kind}.{i}.onto"
            yield from _refuse((same, place, "should be another surface than on"))
    tied = scene.tied()
    others = f"which does not support {tied}; use 'auto', 'direct' or 'iterative'"
    wrong = tied is not None and scene.solver.engine == "petsc"
    yield from _refuse((wrong, "solver.engine", f"should not be 'petsc', {others}"))


def _list_law(contact: Touch) -> Iterable[tuple[str, float]]:
    return contact.model_dump(include=_LAW).items()


def _friction(place: str, contact: Touch, dim: int) -> Iterator[Mistake]:
    mu, axis = contact.mu, contact.axis
    if not isinstance(mu, list):
        most = f"should be at most mu, which is {mu:g}, got {contact.dilatancy:g}"
        yield from _refuse(
            (contact.dilatancy > mu, f"{place}.dilatancy", most),
            (axis is not None, f"{place}.axis", "needs two numbers in mu, got one"),
        )
        return
    if dim == 3 and axis is None:
        yield Mistake(
            f"{place}.axis",
            "is missing; it is the direction of the first number of mu",
            MistakeKind.MISSING_KEY,
        )
    two = "has two numbers, expected one: the scene has two dimensions"
    near = (
        f"should be two positive numbers within a factor of {RATIO:g} of each other, or two "
        f"zeros, got {mu}"
    )
    twice = "needs one number in mu, got two"
    yield from _refuse(
        *((value > 0, f"{place}.{key}", twice) for key, value in _list_law(contact)),
        (dim == 2, f"{place}.mu", two),
        (not min(mu) * RATIO >= max(mu), f"{place}.mu", near),
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
    has = f"this machine has {memory / 1e9:.3g} GB: use fewer"
    dense = (
        f"has {nodes} nodes, whose stiffness matrix takes {stiffness / 1e9:.3g} GB; "
    )
    long = (
        f"has {steps} load steps of {nodes} nodes (body {name!r}), whose loads and "
        f"displacements take {path / 1e9:.3g} GB; "
    )
    yield from _refuse(
        (stiffness > memory, f"body.{name}", f"{dense}{has} cells"),
        (stiffness <= memory < path, "path", f"{long}{has} steps or cells"),
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
        idle = "is not used; remove it, or name it in an amplitude key"
        yield from _refuse((name not in used, place, idle))
    plan = path.increments
    if plan is not None:
        first = plan.first or plan.largest
        wrong = not plan.smallest <= first <= plan.largest
        needs = f"{plan.smallest:g}, {plan.first}, {plan.largest:g}"
        ordered = f"needs smallest <= first <= largest, got {needs}"
        yield from _refuse((wrong, "path.automatic", ordered))


def _wear(scene: Scene) -> Iterator[Mistake]:
    wear, count, solver = scene.wear, scene.path.count(), scene.solver
    if wear is None:
        return
    steps = f"is {wear.steps}, but the path has only {count_noun(count, 'load step')}"
    given = "remove it, wear repeats the given load steps"
    petsc = "should not be 'petsc', which does not compute wear"
    tol = f"should be a number for wear, got {solver.tol!r}"
    yield from _refuse(
        ((wear.steps or 0) > count, "wear.steps", steps),
        (scene.path.increments is not None, "path.automatic", given),
        (solver.engine == "petsc", "solver.engine", petsc),
        *(
            (value > 0, f"contact.{k}.{key}", "remove it, wear is not derived for it")
            for k, contact in enumerate(scene.contact)
            for key, value in _list_law(contact)
        ),
        (isinstance(solver.tol, str), "solver.tol", tol),
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
