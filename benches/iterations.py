"""Iterations of the iterative engine by kind of problem: material, cells, two bodies.

    python benches/iterations.py
    python benches/iterations.py --only "two blocks" --print
    python benches/iterations.py --quick

Each problem has two load steps and a residual of 1e-10. Iterations are the same on every
machine; seconds are those of the load path, without mesh and assembly; without
coordinates the search for near-null vectors counts too. Tetrahedra of an
unstructured mesh need the package gmsh; without it these rows are left out. Rewrites the
table of `benches/README.md` and `results/iterations.csv`.
"""

import argparse
import importlib.util
import tempfile
import time
from pathlib import Path

import numpy as np
import tables

import bipot_rs as bp

SHEET = "iterations.csv"
TOL = 1e-10
# The kind of problems that are given as K and B alone.
BARE = "no coordinates"
HEAD = tables.columns(
    "kind | problem | unknowns | contacts | solved by | steps | Krylov | residual | s"
)


def cube(n, poisson=0.3, height=None, **body):
    """A block pressed on a rigid plane and sheared, with the strains of `sheared_cube`."""
    m = bp.Model("Block")
    m.material("steel", young=210e3, poisson=poisson)
    side = np.linspace(0.0, n, n + 1)
    z = side if height is None else np.linspace(0.0, height, n + 1)
    m.body(
        "block", material="steel", x=side, y=side, z=z, **{"cell": "hexahedron"} | body
    )
    moved = float(z[-1])
    m.support("block.top", x=m.times(2.5e-4 * moved, "shear"), y=0.0, z=-5e-4 * moved)
    m.contact("block.bottom", plane={"point": [0, 0, 0], "normal": [0, 0, 1]}, mu=0.3)
    m.path(shear=[0.0, 1.0])
    return m


def blocks(upper, lower, contrast, shear=1.0):
    """Two blocks of ``upper`` and ``lower`` cells a side; ``contrast`` is E above over below."""
    m = bp.Model("Blocks")
    m.material("above", young=1e3 * contrast, poisson=0.3)
    m.material("below", young=1e3, poisson=0.3)
    for name, n, low, high in (("upper", upper, 0.0, 0.5), ("lower", lower, -0.5, 0.0)):
        side = np.linspace(0.0, 1.0, n + 1)
        m.body(
            name,
            material="above" if name == "upper" else "below",
            cell="hexahedron",
            x=side,
            y=side,
            z=np.linspace(low, high, n // 2 + 1),
        )
    m.support("lower.bottom", x=0.0, y=0.0, z=0.0)
    m.support("upper.top", x=m.times(5e-4 * shear, "shear"), y=0.0, z=-1e-3)
    pairing = "match" if upper == lower else "mortar"
    m.contact("upper.bottom", against="lower.top", mu=0.3, pairing=pairing)
    m.path(shear=[0.0, 1.0])
    return m


def ball(size, file):
    """A half ball of tetrahedra from gmsh, pressed on a rigid plane and sheared."""
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        whole = gmsh.model.occ.addSphere(0, 0, 1, 1)
        box = gmsh.model.occ.addBox(-2, -2, 0, 4, 4, 1)
        gmsh.model.occ.intersect([(3, whole)], [(3, box)])
        gmsh.model.occ.synchronize()
        top, curved = [], []
        for _, tag in gmsh.model.getEntities(2):
            flat = gmsh.model.getType(2, tag) == "Plane"
            (top if flat else curved).append(tag)
        gmsh.model.addPhysicalGroup(2, top, name="top")
        gmsh.model.addPhysicalGroup(2, curved, name="curved")
        volumes = [tag for _, tag in gmsh.model.getEntities(3)]
        gmsh.model.addPhysicalGroup(3, volumes, name="ball")
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.Algorithm3D", 10)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()
    m = bp.Model("Ball on a plane")
    m.material("steel", young=210e3, poisson=0.3)
    m.body("ball", material="steel", mesh=str(file))
    m.support("ball.top", x=m.times(1e-3, "shear"), y=0.0, z=-4e-3)
    plane = {"point": [0, 0, 0], "normal": [0, 0, 1]}
    m.contact("ball.curved", plane=plane, mu=0.3, within={"z": [0.0, 0.05]})
    m.path(shear=[0.0, 1.0])
    return m


def families(quick, folder):
    """Kind and name of each problem, with what makes its model."""
    n = 8 if quick else 36
    for poisson in (0.3, 0.45, 0.49, 0.499):
        yield "ν", f"{n}³, ν = {poisson}", lambda nu=poisson: cube(n, nu)
    cells = {"cell": "tetrahedron"}
    yield "cells", f"tetrahedra {n}³", lambda: cube(n, **cells)
    half = n // 2
    sizes = (n // 2, n) if quick else (24, n)
    for size in sizes:
        yield BARE, f"{size}³", lambda n=size: cube(n)
    yield BARE, f"tetrahedra {n}³", lambda: cube(n, **cells)
    yield BARE, f"second order {half}³", lambda: cube(half, order=2)
    yield "cells", f"second order {half}³", lambda: cube(half, order=2)
    for flat in (5, 20):
        name = f"{n}³, cells 1:1:{1 / flat:g}"
        yield "cells", name, lambda flat=flat: cube(n, height=n / flat)
    if importlib.util.find_spec("gmsh") is not None:
        size = 0.2 if quick else 0.0325
        name = f"half ball, tetrahedra of gmsh of size {size}"
        yield "cells", name, lambda: ball(size, folder / "ball.msh")
    sides = (6, 8) if quick else (16, 24, 32)
    for contrast in (1.0, 10.0, 100.0, 1000.0):
        for n in sides:
            for above in dict.fromkeys((contrast, 1 / contrast)):
                name = f"2 × {n}×{n}×{n // 2}, E {above:g}:1"
                yield "two blocks", name, lambda n=n, e=above: blocks(n, n, e)
    n = sides[1]
    for above in (10.0, 0.1):
        name = f"mortar {n} on {2 * n // 3}, E {above:g}:1"
        yield "two blocks", name, lambda e=above: blocks(n, 2 * n // 3 // 2 * 2, e)
        name = f"{n}, all slides, E {above:g}:1"
        yield "two blocks", name, lambda e=above: blocks(n, n, e, shear=20.0)
    if not quick:
        yield "two blocks", "2 × 60×60×30, E 10:1", lambda: blocks(60, 60, 10.0)


def bare(case):
    """The arrays of a model as another program has them, without coordinates."""
    model = case.model
    return bp.ContactProblem(
        model.K,
        model.B,
        gap=model.gap,
        mu=model.mu,
        fixed=model.fixed,
        engine="iterative",
    )


def row(kind, name, model):
    """Solve one problem."""
    case = model.assemble()
    began = time.perf_counter()
    if kind == BARE:
        problem = bare(case)
        result = problem.solve(prescribed=case.prescribed, tol=TOL)
    else:
        problem = case.problem(engine="iterative")
        began = time.perf_counter()
        result = case.solve(problem, tol=TOL)
    seconds = time.perf_counter() - began
    replaced = not all("krylov" in step.stats for step in result)
    return {
        "kind": kind,
        "problem": name,
        "unknowns": len(result[-1].displacement.ravel()),
        "contacts": len(result[-1].status),
        "solved by": "direct, after a stall" if replaced else "iterative",
        "steps": sum(step.stats.get("newton", 0) for step in result),
        "Krylov": problem.stats.get("krylov", 0),
        "residual": max(step.residual for step in result),
        "s": round(seconds, 2),
        "machine": tables.processor(),
    }


def written(rows):
    """The table, with the numbers as they are read."""
    lines = [
        tuple(
            f"{float(row_of_method[name]):.1e}"
            if name == "residual"
            else f"{int(row_of_method[name]):,}"
            if name in ("unknowns", "contacts")
            else f"{float(row_of_method[name]):.3g}"
            if name == "s"
            else str(row_of_method[name])
            for name in HEAD
        )
        for row_of_method in rows
    ]
    return tables.table(HEAD, lines) + f"\n\n{rows[0]['machine']}, all threads."


def main():
    """Solve all problems and rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small problems")
    parser.add_argument("--only", default="", help="kind of problem")
    parser.add_argument("--print", action="store_true", help="write no file")
    args = parser.parse_args()
    folder = tables.folder(args.quick)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        for kind, name, model in families(args.quick, Path(work)):
            if args.only and kind != args.only:
                continue
            rows.append(row(kind, name, model()))
            print(rows[-1], flush=True)
    text = written(rows)
    print(text)
    if not args.print:
        tables.write_rows(folder / "results" / SHEET, rows)
        tables.rewrite(folder / "README.md", "iterations", text)


if __name__ == "__main__":
    main()
