"""Stiffness matrices, in turn with GetFEM's.

    python benches/assembly.py            # the table of the README, milliseconds

Ours are `elasticity.stiffness` of a mesh at hand: on grids, where cells are alike, and
with every node moved, where none are. The peer, if some python3 of this machine can
import getfem, is `asm_linear_elasticity` on its own mesh of the same cells, compiled and
single-threaded as ours. The least of five runs each, one program after the other for
each mesh; what a program does once for a mesh (finding facets, numbering) is not timed.
"""

import shutil
import subprocess
import sys
from time import perf_counter

import numpy as np
import tables

from bipot_rs.fem import Body, Material, box, stiffness

# Kind, cells a side; what GetFEM calls the mesh, and an integration that is exact.
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
    """2 or 3."""
    return 2 if cell in ("triangle", "quadrilateral") else 3


def ours(cell, n, moved):
    """Seconds, and degrees of freedom."""
    mesh = box([np.linspace(0, 1, n + 1)] * dimension(cell), cell)
    if moved:
        shift = np.random.default_rng(0).uniform(-0.1 / n, 0.1 / n, mesh.p.shape)
        mesh = type(mesh)(mesh.p + shift, mesh.t)
    body = Body("it", mesh, Material(1.0, 0.3))
    seconds = []
    for _ in range(RUNS):
        start = perf_counter()
        K = stiffness(body)
        seconds.append(perf_counter() - start)
    return min(seconds), K.shape[0]


def interpreter_with_getfem():
    """A Python that can import getfem, or None."""
    for python in (sys.executable, shutil.which("python3"), "/usr/bin/python3"):
        tried = python and subprocess.run(
            [python, "-c", "import getfem"], capture_output=True
        )
        if tried and tried.returncode == 0:
            return python
    return None


HEAD = ("cells", "dofs", "grid", "nodes moved", "GetFEM", "ratio, nodes moved")


def rows(python):
    """A row for each mesh; ``python`` can import getfem, or is None."""
    for cell, n, kind, method in MESHES:
        grid, dofs = ours(cell, n, moved=False)
        moved, _ = ours(cell, n, moved=True)
        theirs, ratio = "not installed", ""
        if python:
            arguments = (str(dimension(cell)), str(n), kind, method, str(RUNS))
            run = subprocess.run(
                [python, "-c", PEER, *arguments],
                capture_output=True,
                text=True,
                check=True,
            )
            seconds = float(run.stdout.split()[-1])
            theirs, ratio = f"{1e3 * seconds:.1f}", f"{seconds / moved:.1f}"
        times = (f"{1e3 * grid:.1f}", f"{1e3 * moved:.1f}")
        yield (f"{cell} {n}", f"{dofs:,}", *times, theirs, ratio)


def main():
    """Measure, and rewrite the table."""
    asked = tables.parser(__doc__).parse_args()
    text = tables.table(HEAD, rows(interpreter_with_getfem()))
    tables.publish("assembly", text, write=not asked.print)


if __name__ == "__main__":
    main()
