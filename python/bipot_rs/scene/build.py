"""Everything that a scene makes: meshes, materials, obstacles, contacts, supports, loads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.assembly.assembly import Assembly, Support
from bipot_rs.fem.bodies.body import Body, Box
from bipot_rs.fem.bodies.boundary import (
    Load,
    PointLoad,
    Spring,
    Symmetry,
    surface,
    with_surfaces,
)
from bipot_rs.fem.bodies.materials import Elastic
from bipot_rs.fem.bodies.stress_recovery import Initial, thermal
from bipot_rs.fem.constraints.bolts import Bolt
from bipot_rs.fem.constraints.references import Remote
from bipot_rs.fem.contact.contact import Contact, Floating
from bipot_rs.mesh.boxes import box_mesh
from bipot_rs.mesh.elements import first_order, kind_of, second_order
from bipot_rs.mesh.kinds import ElementMesh
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.protocol import Obstacle
from bipot_rs.obstacle.shapes import Cylinder, Plane, Sphere, Torus
from bipot_rs.obstacle.triangulated import Surface
from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError
from bipot_rs.scene.schema.consistency import Known, inconsistencies
from bipot_rs.scene.schema.contact import Rigid
from bipot_rs.scene.schema.load import InitialStrain
from bipot_rs.scene.schema.mesh import BodyTable, Place, Within
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import Varying

if TYPE_CHECKING:
    from bipot_rs.fem.constraints.repetition import Repetition

    class _Parts(TypedDict):
        contacts: list[Contact]
        supports: list[Support]
        symmetries: list[Symmetry]
        springs: list[Spring]
        remotes: list[Remote]
        bolts: list[Bolt]
        repetitions: list[Repetition]


def bodies(scene: Scene) -> list[Body]:
    """Make the meshes and materials of a scene.

    Raises
    ------
    SceneError
        All mistakes found: files that cannot be read, names that a mesh does not have,
        surfaces without facets.
    """
    made_bodies: list[Body] = []
    mistakes: list[Mistake] = []
    sections = {bolt.section for bolt in scene.bolt}
    for name, block in scene.body.items():
        key = f"body.{name}"
        place = f"{key}.mesh"
        try:
            mesh = _make_mesh(scene, block)
            surfaces = {}
            for named, table in block.surface.items():
                place = f"{key}.surface.{named}"
                inside = f"{name}.{named}" in sections
                surfaces[named] = _find_surface(mesh, named, table, inside)
            mesh = with_surfaces(mesh, surfaces) if surfaces else mesh
            place = f"{key}.material"
            made_bodies.append(Body(name, mesh, _make_material(scene, block)))
        except (OSError, ValueError) as error:
            mistakes.append(Mistake(place, str(error), MistakeKind.MESH))
    if not mistakes and any(block.mesh is not None for block in scene.body.values()):
        mistakes = inconsistencies(
            scene, {body.name: _describe_body(body) for body in made_bodies}
        )
    if mistakes:
        raise SceneError(scene.title, mistakes)
    return made_bodies


def _describe_body(body: Body) -> Known:
    return Known(
        body.dim, sorted(body.mesh.boundaries or {}), sorted(body.mesh.subdomains or {})
    )


def _make_mesh(scene: Scene, block: BodyTable) -> ElementMesh:
    if block.mesh is not None:
        # The readers take longer to import than a box takes to mesh.
        from bipot_rs.mesh.readers import read_mesh

        file = scene.place(block.mesh.file)
        mesh = read_mesh(file, block.mesh.group)
        _check_shape(scene, mesh)
        if file.suffix.lower() == ".inp" and block.plane != "axisymmetric":
            from bipot_rs.mesh.abaqus import is_axisymmetric

            if is_axisymmetric(file):
                raise ValueError(
                    f'the mesh {file} has cells of type CAX: add plane = "axisymmetric" to '
                    "the body"
                )
    else:
        n = scene.mesh.n if scene.mesh else None
        axes = (block.x, block.y, block.z)
        grids = [axis.grid(n) for axis in axes if axis is not None]
        mesh = box_mesh(grids, scene.cell(block) or "")
    order = scene.order(block)
    if order is None or order == kind_of(mesh).degree:
        return mesh
    return second_order(mesh) if order == 2 else first_order(mesh)


def _check_shape(scene: Scene, mesh: ElementMesh) -> None:
    """Refuse a ``mesh.element`` whose shape is not that of the cells of a file."""
    element = scene.mesh.element if scene.mesh else None
    shape = kind_of(mesh).shape
    simplex = shape in ("triangle", "tetrahedron")
    if element is not None and simplex != element.startswith("P"):
        raise ValueError(
            f"mesh.element is {element!r}, but the cells of the mesh file are of the "
            f"shape {shape}"
        )


def _find_surface(mesh: ElementMesh, name: str, table: Place, inside: bool) -> Ints:
    """Facets of a surface that the scene defines by geometry; of a section ``inside``."""
    if name in (mesh.boundaries or {}):
        raise ValueError("the mesh has a surface of this name, choose another name")
    within = _box_of(table.within)
    return surface(mesh, within, table.normal, table.angle, inside=inside)


def _make_material(scene: Scene, block: BodyTable) -> Elastic | dict[str, Elastic]:
    """The material of a body, or one for each named volume."""
    plane = {
        "plane_stress": block.plane == "stress",
        "thickness": block.thickness,
        "axisymmetric": block.plane == "axisymmetric",
    }
    materials = {
        end: scene.material[name].make(**plane)  # type: ignore[arg-type]
        for end, name in block.materials.items()
    }
    if isinstance(block.material, str):
        return materials[""]
    return {end.removeprefix("."): material for end, material in materials.items()}


def _make_obstacle(scene: Scene, name: str, rigid: Rigid) -> Obstacle:
    try:
        if rigid.plane is not None:
            return Plane(rigid.plane.point, rigid.plane.normal)
        if rigid.sphere is not None:
            ball = rigid.sphere
            return Sphere(ball.centre, ball.radius, rigid.inside)
        if rigid.cylinder is not None:
            bar = rigid.cylinder
            return Cylinder(bar.point, bar.radius, bar.axis, rigid.inside)
        if rigid.torus is not None:
            ring = rigid.torus
            radii = ring.major_radius, ring.minor_radius
            return Torus(ring.centre, ring.axis, *radii, rigid.inside)
        file = scene.place(rigid.surface or "")
        return Surface.from_file(file, flipped=rigid.inside)
    except (OSError, ValueError) as error:
        mistake = Mistake(f"obstacle.{name}", str(error), MistakeKind.MESH)
        raise SceneError(scene.title, [mistake]) from error


def make_parts(scene: Scene, motions: Mapping[str, Motion | None]) -> _Parts:
    """Arguments of `fem.assemble` besides the bodies; ``motions`` of each obstacle."""
    return {
        "contacts": make_contacts(scene, motions),
        "supports": make_supports(scene),
        "symmetries": [Symmetry(*split(s.on)) for s in scene.symmetry],
        "springs": [
            Spring(*split(s.on), s.stiffness, s.normal, s.tangential)
            for s in scene.spring
        ],
        "remotes": make_remotes(scene),
        "bolts": make_bolts(scene),
        "repetitions": make_repetitions(scene),
    }


def make_contacts(scene: Scene, motions: Mapping[str, Motion | None]) -> list[Contact]:
    """Make the contacts, with the motion of their obstacles along the path."""
    # Each obstacle once: a surface with many facets takes long to make.
    obstacles = {
        name: _make_obstacle(scene, name, rigid)
        for name, rigid in scene.obstacle.items()
    }
    contacts = []
    for c in scene.contact:
        rigid = scene.obstacle.get(c.obstacle or "")
        contacts.append(
            Contact(
                *split(c.on),
                mu=c.mu,
                cohesion=c.cohesion,
                dilatancy=c.dilatancy,
                plane=(c.plane.point, c.plane.normal) if c.plane else None,
                against=split(c.other) if c.other else None,
                clearance=c.clearance.at,
                within=_box_of(c.within),
                axis=c.axis,
                pairing=c.pairing,
                name=c.name or "",
                obstacle=obstacles.get(c.obstacle or ""),
                motion=motions.get(c.obstacle or ""),
                floating=None
                if rigid is None or rigid.force is None
                else Floating(str(c.obstacle), tuple(rigid.force.components())),
            )
        )
    return contacts


def make_supports(scene: Scene) -> list[Support]:
    """Make the supports; their prescribed values are in the path."""
    return [
        Support(
            split(s.on)[0],
            split(s.on)[1] or None,
            tuple(s.components()),
            _box_of(s.within),
            s.at,
        )
        for s in scene.support
    ]


def make_remotes(scene: Scene) -> list[Remote]:
    """Make the remote points; their prescribed values and loads are in the path."""
    remotes = []
    for name, table in scene.remote.items():
        body, part = split(table.on)
        settings = table.given()
        remotes.append(
            Remote(
                name,
                body,
                part or None,
                table.point,
                components=tuple(settings.get("move", ())),
                rotations=tuple(settings.get("turn", ())),
                distributed=table.distributed,
                within=_box_of(table.within),
            )
        )
    return remotes


def make_bolts(scene: Scene) -> list[Bolt]:
    """Make the bolts; their forces are in the path."""
    bolts = []
    for table in scene.bolt:
        body, section = split(table.section)
        flat = table.plane
        cut = section if flat is None else (flat.point, flat.normal)
        bolts.append(Bolt(table.title, body, cut, table.share))
    return bolts


def make_repetitions(scene: Scene) -> list[Repetition]:
    """Make the cyclic symmetries and the periodicities."""
    if not (scene.cyclic or scene.periodic):
        return []
    from bipot_rs.fem.constraints.repetition import Cyclic, Periodic

    return [
        *(
            Cyclic(split(c.on), split(c.onto), c.sectors, c.about, c.axis)
            for c in scene.cyclic
        ),
        *(Periodic(split(p.on), split(p.onto)) for p in scene.periodic),
    ]


def _make_strain(table: InitialStrain, body: Body) -> Initial:
    """Initial strain for one kelvin, or for an amplitude of one, by volume if named."""
    _, volume = split(table.on)
    if table.tensor is not None:
        tensor = np.array(table.tensor)
        return {volume: tensor} if volume else tensor
    # Expansion is given along the axes of each material.
    expansion = table.expansion or 0.0
    if isinstance(body.material, dict):
        named = {
            name: np.asarray(thermal(expansion, 1.0, material.directions))
            for name, material in body.material.items()
            if volume in ("", name)
        }
        if named:
            return named
    directions = body.materials[0].directions
    whole = np.asarray(thermal(expansion, 1.0, directions))
    return {volume: whole} if volume else whole


def make_loads(
    scene: Scene, bodies: Sequence[Body], model: Assembly
) -> tuple[LoadHistory, ...]:
    """Make the loads of a scene, each with its nodal forces for factor 1."""
    at_points = _make_point_loads(scene, model.dim)
    of_bodies = _make_body_loads(scene, {b.name: b for b in bodies}, model.dim)
    return tuple(
        LoadHistory(
            load if isinstance(load, Load) else None,
            number,
            model.nodal_forces(load),
        )
        for load, number in chain(of_bodies, at_points)
    )


def _make_body_loads(
    scene: Scene, bodies: Mapping[str, Body], dim: int
) -> Iterator[tuple[Load | PointLoad, Varying]]:
    """Loads on surfaces and bodies for factor 1, and the numbers that they follow."""
    unit = np.eye(dim)
    for traction in scene.traction:
        for k, number in traction.components().items():
            part = _box_of(traction.within)
            yield Load(*split(traction.on), traction=unit[k], within=part), number
    for pressure in scene.pressure:
        part = _box_of(pressure.within)
        yield Load(*split(pressure.on), pressure=1.0, within=part), pressure
    for force in scene.body_force:
        for k, number in force.components().items():
            yield Load(force.on, force=unit[k]), number
    for table in scene.strain:
        body = split(table.on)[0]
        strain = _make_strain(table, bodies[body])
        yield Load(body, strain=strain), table.factor


def _make_point_loads(
    scene: Scene, dim: int
) -> Iterator[tuple[Load | PointLoad, Varying]]:
    """Forces on obstacles, and forces and moments at remote points."""
    unit = np.eye(dim)
    used = {c.obstacle for c in scene.contact}
    for name, rigid in scene.obstacle.items():
        if rigid.force is not None and name in used:
            for k, number in rigid.force.components().items():
                yield PointLoad(name, force=unit[k]), number
    for bolt in scene.bolt:
        yield PointLoad(bolt.title, force=bolt.share * unit[0]), bolt.tightening
    for name, remote in scene.remote.items():
        settings = remote.given()
        for k, number in settings.get("force", {}).items():
            yield PointLoad(name, force=unit[k]), number
        for k, number in settings.get("moment", {}).items():
            axis = np.eye(3)[k] if dim == 3 else np.ones(1)
            yield PointLoad(name, moment=axis), number


def _box_of(within: Within | None) -> Box | None:
    return None if within is None else within.box()


def split(on: str) -> tuple[str, str]:
    """Split ``"body.surface"`` or ``"body.volume"`` at the dot."""
    body, _, part = on.partition(".")
    return body, part


@dataclass(frozen=True)
class LoadHistory:
    """A load that changes along the path in proportion to a factor.

    Attributes
    ----------
    load : fem.Load or None
        The load for factor 1; None for a force or a moment at a reference point.
    number
        The value and amplitude in the scene, from which the factor is computed.
    nodal : (n,)
        Nodal forces for factor 1 [N].
    history : (steps,)
        Factor at the end of each load step; empty before the steps are known.
    """

    load: Load | None
    number: Varying
    nodal: Floats
    history: Floats = field(default_factory=lambda: np.zeros(0))

    __repr__ = short_repr
