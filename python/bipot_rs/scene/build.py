"""From the tables of a scene to meshes, materials, obstacles, contacts and strains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.boundary import Spring, Symmetry, surface, with_surfaces
from bipot_rs.fem.bodies.stress_recovery import Initial, thermal
from bipot_rs.fem.constraints.references import Remote
from bipot_rs.fem.contact.meeting import Contact, Floating
from bipot_rs.mesh.boxes import box_mesh
from bipot_rs.mesh.elements import first_order, kind_of, second_order
from bipot_rs.obstacle.protocol import Obstacle
from bipot_rs.obstacle.shapes import Cylinder, Plane, Sphere, Torus
from bipot_rs.obstacle.triangulated import Surface
from bipot_rs.scene.case import motion_of
from bipot_rs.scene.library import SceneError
from bipot_rs.scene.schema.consistency import Known, inconsistencies
from bipot_rs.scene.schema.contact import Rigid
from bipot_rs.scene.schema.load import InitialStrain
from bipot_rs.scene.schema.mesh import Block
from bipot_rs.scene.schema.root import Scene

if TYPE_CHECKING:
    from bipot_rs.fem.constraints.repetition import Repetition


def bodies(scene: Scene) -> list[Body]:
    """Make the meshes and materials of a scene.

    Raises
    ------
    SceneError
        All mistakes found: files that cannot be read, names that a mesh does not have,
        surfaces without facets.
    """
    found: list[Body] = []
    problems: list[str] = []
    for name, block in scene.body.items():
        place = f"body.{name}.mesh"
        try:
            mesh = _mesh(scene, block)
            place = f"body.{name}.surface"
            mesh = _named(mesh, block)
            place = f"body.{name}.material"
            found.append(Body(name, mesh, _material(scene, block)))
        except (OSError, ValueError) as error:
            problems.append(
                f"{place}{error}"
                if isinstance(error, _Mistake)
                else f"{place}: {error}"
            )
    if not problems and any(block.mesh is not None for block in scene.body.values()):
        problems = inconsistencies(scene, {body.name: _known(body) for body in found})
    if problems:
        raise SceneError(scene.title, problems)
    return found


class _Mistake(ValueError):
    """A message that begins with the rest of its key path."""


def _known(body: Body) -> Known:
    return Known(
        body.dim, sorted(body.mesh.boundaries or {}), sorted(body.mesh.subdomains or {})
    )


def _mesh(scene: Scene, block: Block) -> Any:
    if block.mesh is not None:
        # The readers take longer to import than a box takes to mesh.
        from bipot_rs.mesh.readers import read_mesh

        mesh = read_mesh(scene.place(block.mesh.file), block.mesh.group)
        _check_shape(scene, mesh)
    else:
        n = scene.mesh.n if scene.mesh else None
        axes = (block.x, block.y, block.z)
        grids = [axis.grid(n) for axis in axes if axis is not None]
        mesh = box_mesh(grids, scene.cell(block) or "")
    order = scene.order(block)
    if order is None or order == kind_of(mesh).degree:
        return mesh
    return second_order(mesh) if order == 2 else first_order(mesh)


def _check_shape(scene: Scene, mesh: Any) -> None:
    """Refuse a ``mesh.element`` whose shape is not that of the cells of a file."""
    element = scene.mesh.element if scene.mesh else None
    shape = kind_of(mesh).shape
    simplex = shape in ("triangle", "tetrahedron")
    if element is not None and simplex != element.startswith("P"):
        raise ValueError(
            f"mesh.element is {element!r}, but the cells of the mesh file are of the "
            f"shape {shape}"
        )


def _named(mesh: Any, block: Block) -> Any:
    """Add the surfaces that the scene defines by geometry."""
    found = {}
    for name, place in block.surface.items():
        if name in (mesh.boundaries or {}):
            raise _Mistake(
                f".{name}: the mesh has a surface of this name, choose another name"
            )
        within = None if place.within is None else place.within.box()
        try:
            found[name] = surface(mesh, within, place.normal, place.angle)
        except ValueError as error:
            raise _Mistake(f".{name}: {error}") from error
    return with_surfaces(mesh, found) if found else mesh


def _material(scene: Scene, block: Block) -> Any:
    """The material of a body, or one for each named volume."""
    chosen = {"plane_stress": block.plane == "stress", "thickness": block.thickness}
    made = {
        end: scene.material[name].made(**chosen)  # type: ignore[arg-type]
        for end, name in block.materials.items()
    }
    if isinstance(block.material, str):
        return made[""]
    return {end.removeprefix("."): material for end, material in made.items()}


def _obstacle(scene: Scene, name: str, rigid: Rigid) -> Obstacle:
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
        raise SceneError(scene.title, [f"obstacle.{name}: {error}"]) from error


def contacts(scene: Scene) -> list[Contact]:
    """Make the contacts, with the motion of their obstacles along the path."""
    # Each obstacle once: a surface with many facets takes long to make.
    known = {
        name: _obstacle(scene, name, rigid) for name, rigid in scene.obstacle.items()
    }
    ends = np.arange(1.0, scene.path.count() + 1)
    found = []
    for c in scene.contact:
        body, surface_name = split(c.on)
        rigid = scene.obstacle.get(c.obstacle or "")
        found.append(
            Contact(
                body,
                surface_name,
                mu=c.mu,
                plane=(c.plane.point, c.plane.normal) if c.plane else None,
                against=split(c.other) if c.other else None,
                clearance=c.clearance.at,
                within=c.within.box() if c.within else None,
                axis=c.axis,
                obstacle=None if c.obstacle is None else known[c.obstacle],
                motion=None if rigid is None else motion_of(rigid, scene.path, ends),
                pairing=c.pairing,
                floating=None if rigid is None else _floating(str(c.obstacle), rigid),
            )
        )
    return found


def _floating(name: str, rigid: Rigid) -> Floating | None:
    """The obstacle as one that a force moves."""
    if rigid.force is None:
        return None
    return Floating(name, tuple(rigid.force.components()))


def supports(scene: Scene) -> list[Support]:
    """Make the supports; their prescribed values are in the path."""
    return [
        Support(
            split(s.on)[0],
            split(s.on)[1] or None,
            tuple(s.components()),
            s.within.box() if s.within else None,
            s.at,
        )
        for s in scene.support
    ]


def remotes(scene: Scene) -> list[Remote]:
    """Make the remote points; their prescribed values and loads are in the path."""
    found = []
    for name, table in scene.remote.items():
        body, part = split(table.on)
        given = table.given()
        found.append(
            Remote(
                name,
                body,
                part or None,
                table.point,
                components=tuple(given.get("move", ())),
                rotations=tuple(given.get("turn", ())),
                distributed=table.distributed,
                within=table.within.box() if table.within else None,
            )
        )
    return found


def repetitions(scene: Scene) -> list[Repetition]:
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


def symmetries(scene: Scene) -> list[Symmetry]:
    """Make the planes of symmetry."""
    return [Symmetry(*split(s.on)) for s in scene.symmetry]


def springs(scene: Scene) -> list[Spring]:
    """Make the elastic foundations."""
    return [
        Spring(*split(s.on), s.stiffness, s.normal, s.tangential) for s in scene.spring
    ]


def strain_of(table: InitialStrain, body: Body) -> Initial:
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


def split(on: str) -> tuple[str, str]:
    """Split ``"body.surface"`` or ``"body.volume"`` at the dot."""
    body, _, part = on.partition(".")
    return body, part
