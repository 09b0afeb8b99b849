"""Makes the meshes of this folder; needs gmsh: ``python make.py``."""

import os
from pathlib import Path

import gmsh

# Name: shape, order, whether with fewer nodes, version of the format, binary.
BOXES = {
    "quad.msh": ("quad", 1, False, 4.1, True),
    "quad8.msh": ("quad", 2, True, 4.1, False),
    "quad9.msh": ("quad", 2, False, 2.2, True),
    "triangle.msh": ("triangle", 1, False, 2.2, False),
    "tetra.msh": ("tetra", 1, False, 2.2, False),
    "tetra10.msh": ("tetra", 2, False, 4.1, True),
    "hexahedron.msh": ("hexahedron", 1, False, 4.1, False),
    "hexahedron20.msh": ("hexahedron", 2, True, 4.1, False),
    "hexahedron27.msh": ("hexahedron", 2, False, 4.1, True),
    "tetra.inp": ("tetra", 1, False, 0, False),
    "tetra10.inp": ("tetra", 2, False, 0, False),
    "hexahedron20.inp": ("hexahedron", 2, True, 0, False),
    "triangle6.inp": ("triangle", 2, False, 0, False),
}


def write(name: str, order: int, few: bool, version: float, binary: bool) -> None:
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(few))
    gmsh.model.mesh.setOrder(order)
    if version:
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", int(binary))
    gmsh.write(name)
    gmsh.model.remove()


def box(name: str, shape: str, *rest: object) -> None:
    """2 long, 1 wide and high, split in volumes "left" and "right", with named faces."""
    gmsh.model.add(name)
    occ, solid = gmsh.model.occ, shape in ("tetra", "hexahedron")
    dim = 3 if solid else 2
    for x in (0, 1):
        if solid:
            occ.addBox(x, 0, 0, 1, 1, 1)
        else:
            occ.addRectangle(x, 0, 0, 1, 1)
    occ.fragment([(dim, 1)], [(dim, 2)])
    occ.synchronize()
    if shape in ("quad", "hexahedron"):
        for _, line in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(line, 3 if dim == 2 else 2)
        for _, face in gmsh.model.getEntities(2):
            gmsh.model.mesh.setTransfiniteSurface(face)
            gmsh.model.mesh.setRecombine(2, face)
        for _, volume in gmsh.model.getEntities(3):
            gmsh.model.mesh.setTransfiniteVolume(volume)
    else:
        for bound in ("Mesh.MeshSizeMin", "Mesh.MeshSizeMax"):
            gmsh.option.setNumber(bound, 0.7 if rest[0] == 1 else 1.5)
    small, end = 1e-6, 1 if solid else 0

    def within(low: tuple[float, ...], high: tuple[float, ...], d: int) -> list[int]:
        low = tuple(x - small for x in low)
        high = tuple(x + small for x in high)
        return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, d)]

    up = 2 if solid else 1  # the axis upwards
    for word, at in (("base", 0.0), ("top", 1.0)):
        low, high = [0.0, 0.0, 0.0], [2.0, 1.0, float(end)]
        low[up] = high[up] = at
        gmsh.model.addPhysicalGroup(dim - 1, within(low, high, dim - 1), name=word)
    middle = within((1, 0, 0), (1, 1, end), dim - 1)
    gmsh.model.addPhysicalGroup(dim - 1, middle, name="middle")
    for word, x in (("left", 0), ("right", 1)):
        gmsh.model.addPhysicalGroup(
            dim, within((x, 0, 0), (x + 1, 1, end), dim), name=word
        )
    gmsh.model.mesh.generate(dim)
    write(name, *rest)


def two_bodies() -> None:
    """A block of triangles under one of quadrilaterals with other sizes, 0.1 apart."""
    gmsh.model.add("two")
    occ = gmsh.model.occ
    occ.addRectangle(0, 0, 0, 2, 1)
    occ.addRectangle(0.5, 1.1, 0, 1, 1)
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    for line in (5, 6, 7, 8):
        gmsh.model.mesh.setTransfiniteCurve(line, 4)
    gmsh.model.mesh.setTransfiniteSurface(2)
    gmsh.model.mesh.setRecombine(2, 2)
    for dim, tag, name in (
        *((2, 1, "lower"), (2, 2, "upper")),
        *((1, 1, "base"), (1, 3, "lower top"), (1, 5, "upper bottom"), (1, 7, "load")),
    ):
        gmsh.model.addPhysicalGroup(dim, [tag], name=name)
    gmsh.model.mesh.generate(2)
    write("two_bodies.msh", 1, False, 4.1, False)


def save_all() -> None:
    """Two squares, one of them named, with all cells saved."""
    gmsh.model.add("all")
    for x in (0, 1):
        gmsh.model.occ.addRectangle(x, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], name="named")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1)
    gmsh.model.mesh.generate(2)
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    write("save_all.msh", 1, False, 4.1, False)
    gmsh.option.setNumber("Mesh.SaveAll", 0)


def groups() -> None:
    """Two squares whose lines and faces are in several groups, or reversed in one.

    Lines and a face share one name. In the files that end in ``_bare`` nothing has a name.
    """
    for bare in (False, True):
        for version, binary in ((2.2, False), (4.1, False), (4.1, True)):
            gmsh.model.add("groups")
            for bound in ("Mesh.MeshSizeMin", "Mesh.MeshSizeMax"):
                gmsh.option.setNumber(bound, 1)
            geo = gmsh.model.geo
            corners = ((0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1))
            points = [geo.addPoint(x, y, 0) for x, y in corners]
            rim = [
                geo.addLine(a, b)
                for a, b in zip(points, [*points[1:], points[0]], strict=False)
            ]
            middle = geo.addLine(points[1], points[4])
            left = geo.addCurveLoop([rim[0], middle, rim[4], rim[5]])
            right = geo.addCurveLoop([rim[1], rim[2], rim[3], -middle])
            faces = [geo.addPlaneSurface([loop]) for loop in (left, right)]
            geo.synchronize()
            for tag, (dim, numbers, name) in enumerate(
                (
                    (1, [rim[0], rim[1]], "base"),
                    (1, [-rim[2]], "side"),
                    (1, [rim[2], rim[3], rim[4]], "round"),
                    (2, [faces[0]], "left"),
                    (2, faces, "all"),
                    (2, [-faces[1]], "base"),
                ),
                start=1,
            ):
                gmsh.model.addPhysicalGroup(dim, numbers, tag, "" if bare else name)
            gmsh.model.mesh.generate(2)
            kind = "_binary" if binary else ""
            name = f"groups{version:g}{kind}{'_bare' if bare else ''}.msh"
            write(name.replace(".", "", 1), 1, False, version, binary)


def main() -> None:
    """Make all meshes."""
    # gmsh writes the name that it is given into some of the files.
    os.chdir(Path(__file__).parent)
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 0)
    for name, box_settings in BOXES.items():
        box(name, *box_settings)
    two_bodies()
    save_all()
    groups()
    gmsh.finalize()


if __name__ == "__main__":
    main()
