"""Make disc_on_block.msh: a half disc of radius 10 on a block, with physical groups."""

import sys
from pathlib import Path

import gmsh

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
geo = gmsh.model.geo

# The bodies touch at the origin and share no node.
fine, coarse = 0.2, 3.0
low = geo.addPoint(0, 0, 0, fine)
centre = geo.addPoint(0, 10, 0, coarse)
left, right = geo.addPoint(-10, 10, 0, coarse), geo.addPoint(10, 10, 0, coarse)
arc = [geo.addCircleArc(left, centre, low), geo.addCircleArc(low, centre, right)]
top = geo.addLine(right, left)
disc = geo.addPlaneSurface([geo.addCurveLoop([*arc, top])])

corners = [(-15, -15), (15, -15), (15, 0), (0, 0), (-15, 0)]
points = [geo.addPoint(x, y, 0, fine if x == 0 else coarse) for x, y in corners]
lines = [
    geo.addLine(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)
]
block = geo.addPlaneSurface([geo.addCurveLoop(lines)])

geo.synchronize()
for dim, parts, name in (
    (1, arc, "arc"),
    (1, [top], "top"),
    (1, lines[:1], "base"),
    (1, lines[2:4], "face"),
    (2, [disc], "disc"),
    (2, [block], "block"),
):
    gmsh.model.addPhysicalGroup(dim, parts, name=name)
gmsh.model.mesh.generate(2)
here = Path(sys.argv[0]).with_suffix(".msh")
gmsh.write(str(here))
gmsh.finalize()
