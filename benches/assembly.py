"""Time the assembly of stiffness matrices, compared with GetFEM.

    python benches/assembly.py            # the table of the README, milliseconds

bipot_rs runs `elasticity.stiffness` on a given mesh: on grids, whose cells are equal, and
with every node moved, so that no two cells are. If a Python of this machine has getfem,
`asm_linear_elasticity` runs on a mesh of the same cells; both are compiled and use one
thread. The minimum of five runs counts, one program after the other for each mesh. Work
that a program does once for a mesh (facets, numbering) is not timed.
"""

import subprocess

import numpy as np
import tables
from peers import commands
from timing import fastest

from bipot_rs.fem import Body, Material, box, stiffness

# Cell, cells a side, GetFEM's name of the mesh, an exact integration rule of GetFEM.
MESHES = (
    ("quadrilateral", 128, "cartesian", "IM_GAUSS_PARALLELEPIPED(2,3)"),
    ("triangle", 128, "regular simplices", "IM_TRIANGLE(1)"),
    ("hexahedron", 9, "cartesian", "IM_GAUSS_PARALLELEPIPED(3,3)"),
    ("hexahedron", 15, "cartesian", "IM_GAUSS_PARALLELEPIPED(3,3)"),
    ("hexahedron", 24, "cartesian", "IM_GAUSS_PARALLELEPIPED(3,3)"),
    ("tetrahedron", 15, "regular simplices", "IM_TETRAHEDRON(1)"),
)
RUNS = 5
PEER = """
import sys, time
import getfem, numpy
dim, n, kind, method, runs = sys.argv[1:]
dim, grid = int(dim), numpy.linspace(0, 1, int(n) + 1)
mesh = getfem.Mesh(kind, *[grid] * dim)
field, constant = getfem.MeshFem(mesh, dim), getfem.MeshFem(mesh, 1)
field.set_classical_fem(1)
constant.set_classical_fem(0)
points = getfem.MeshIm(mesh, getfem.Integ(method))
lame = [numpy.full(constant.nbdof(), x) for x in (0.577, 0.385)]
seconds = []
for _ in range(int(runs)):
    start = time.perf_counter()
    getfem.asm_linear_elasticity(points, field, constant, *lame)
    seconds.append(time.perf_counter() - start)
print(min(seconds))
"""


def dimension(cell):
    """Dimension of a cell, 2 or 3."""
    return 2 if cell in ("triangle", "quadrilateral") else 3


def bipot_seconds(cell, n, moved):
    """Seconds of bipot_rs, and degrees of freedom."""
    mesh = box([np.linspace(0, 1, n + 1)] * dimension(cell), cell)
    if moved:
        shift = np.random.default_rng(0).uniform(-0.1 / n, 0.1 / n, mesh.p.shape)
        mesh = type(mesh)(mesh.p + shift, mesh.t)
    body = Body("body", mesh, Material(1.0, 0.3))
    seconds, K = fastest(RUNS, lambda: stiffness(body))
    return seconds, K.shape[0]


HEAD = ("cells", "dofs", "grid", "nodes moved", "GetFEM", "ratio, nodes moved")


def rows(python):
    """Row of each mesh; ``python`` can import getfem, or is ``None``."""
    for cell, n, kind, method in MESHES:
        grid, dofs = bipot_seconds(cell, n, moved=False)
        moved, _ = bipot_seconds(cell, n, moved=True)
        getfem, ratio = "not installed", ""
        if python:
            arguments = (str(dimension(cell)), str(n), kind, method, str(RUNS))
            run = subprocess.run(
                [python, "-c", PEER, *arguments],
                capture_output=True,
                text=True,
                check=True,
            )
            seconds = float(run.stdout.split()[-1])
            getfem, ratio = f"{1e3 * seconds:.1f}", f"{seconds / moved:.1f}"
        times = (f"{1e3 * grid:.1f}", f"{1e3 * moved:.1f}")
        yield (f"{cell} {n}", f"{dofs:,}", *times, getfem, ratio)


def main():
    """Measure, and rewrite the table."""
    args = tables.parser(__doc__).parse_args()
    text = tables.table(HEAD, rows(commands.python_with("getfem")))
    tables.publish("assembly", text, write=not args.print)


if __name__ == "__main__":
    main()
