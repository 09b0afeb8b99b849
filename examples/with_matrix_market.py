"""Contact with files of another program: a Matrix Market stiffness, and tables.

    python examples/with_matrix_market.py [FOLDER]

`write` stands for the other program. It writes K.mtx, the node list of an Abaqus or
CalculiX input file, and tables of contacts, loads and supports. `solve` reads and solves
them, like the command

    bipot solve --stiffness K.mtx --nodes nodes.inp --contacts contacts.csv \
        --load load.csv --fixed fixed.csv --out results

Units: mm, N, MPa.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.cli.run import matrix_files

WIDTH, HEIGHT, PRESSURE, MU = 40.0, 20.0, 50.0, 0.3


def write(folder: Path, n: int = 8) -> None:
    """Write the files of a block on a rigid floor, pressed at its top, held at its left."""
    grid = [np.linspace(0.0, size, n + 1) for size in (WIDTH, HEIGHT)]
    body = fem.Body("block", fem.box(grid, "quadrilateral"), fem.Material(210e3, 0.3))
    model = fem.assemble([body], [])
    mmwrite(folder / "K.mtx", model.K, symmetry="symmetric", precision=17)
    label = np.arange(len(model.nodes)) + 1
    (folder / "nodes.inp").write_text(
        "*NODE, NSET=NALL\n"
        + "".join(
            f"{k}, {x!r}, {y!r}\n"
            for k, (x, y) in zip(label, model.nodes.tolist(), strict=True)
        )
    )
    load = model.pressure("block", "top", PRESSURE).reshape(-1, 2)
    tables = {
        "contacts": (
            "node,nx,ny,mu",
            [(label[i], 0, 1, MU) for i in body.nodes("bottom")],
        ),
        "load": ("node,fx,fy", [(label[i], *load[i]) for i in body.nodes("top")]),
        "fixed": ("node,ux", [(label[i], 0) for i in body.nodes("left")]),
    }
    for name, (header, rows) in tables.items():
        with (folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([header.split(","), *rows])


def solve(folder: Path) -> bp.Result:
    """Solve the files as `bipot solve` does, without writing results."""
    given = matrix_files.read(
        folder / "K.mtx",
        folder / "contacts.csv",
        nodes=folder / "nodes.inp",
        load=folder / "load.csv",
        fixed=folder / "fixed.csv",
    )
    return given.problem().solve(given.load, given.prescribed)


def main() -> None:
    """Print the resultant on the floor."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/matrix_market")
    folder.mkdir(parents=True, exist_ok=True)
    write(folder)
    result = solve(folder)
    normal, tangential = result.reaction[-1].sum(axis=0)
    print(
        f"{normal:.6g} N/mm normal, {tangential:.6g} N/mm tangential; {result.message}"
    )


if __name__ == "__main__":
    main()
