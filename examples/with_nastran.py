"""Contact with a stiffness of Nastran, read by pyYeti: a block, pressed and dragged.

    python examples/with_nastran.py [FILE.npz]

Nastran writes KGG, the stiffness without supports, by OUTPUT4, for instance with the lines

    ASSIGN OUTPUT4='block.op4', UNIT=21, FORM=FORMATTED
    COMPILE SEMG $
    ALTER 'KGG' $
    OUTPUT4 KGG,,,,//-1/21 $

KGG has six rows for each GRID, in ascending order of their numbers. `write` stands for Nastran
here. Units: mm, N, MPa.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from pyyeti.nastran import bulk, op4
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem

YOUNG, POISSON, MU = 210e3, 0.3, 0.3


def write(folder: Path, n: int) -> None:
    """Write the files of a cube of 100 mm: block.bdf with the nodes, block.op4 with KGG."""
    side = np.linspace(0.0, 100.0, n + 1)
    body = fem.Body(
        "block", fem.box([side] * 3, "hexahedron"), fem.Material(YOUNG, POISSON)
    )
    model = fem.assemble([body], [])
    count = len(model.nodes)
    moves = (6 * np.arange(count)[:, None] + [0, 1, 2]).ravel()
    entries = sparse.coo_array(model.K)
    ends = moves[entries.coords[0]], moves[entries.coords[1]]
    whole = sparse.coo_matrix((entries.data, ends), shape=(6 * count, 6 * count))
    op4.write(str(folder / "block.op4"), {"KGG": whole}, binary=False, forms=[6])
    with (folder / "block.bdf").open("w") as file:
        bulk.wtgrids(file, np.arange(1, count + 1), xyz=model.nodes)


def read(folder: Path) -> tuple[sparse.csr_array, np.ndarray]:
    """K of the displacements, three for each node, and the places of the nodes."""
    whole = sparse.csr_array(op4.load(str(folder / "block.op4"), sparse=True)["kgg"][0])
    table = bulk.bulk2uset(str(folder / "block.bdf"))[0]
    places = table.loc[(slice(None), 1), ["x", "y", "z"]].to_numpy()
    moves = (6 * np.arange(len(places))[:, None] + [0, 1, 2]).ravel()
    return whole[moves][:, moves], places


def solve(n: int = 6) -> tuple[bp.Result, np.ndarray]:
    """Press a cube of 100 mm on a rigid floor by 0.05, then drag its top by 0.025."""
    with tempfile.TemporaryDirectory() as name:
        write(Path(name), n)
        K, places = read(Path(name))

    # The degrees of freedom x, y, z of a node are consecutive. Normal first: z, x, y.
    bottom = np.flatnonzero(places[:, 2] == 0.0)
    top = np.flatnonzero(places[:, 2] == 100.0)
    columns = (3 * bottom[:, None] + [2, 0, 1]).ravel()
    B = sparse.csr_array(
        (np.ones(len(columns)), (np.arange(len(columns)), columns)),
        shape=(len(columns), K.shape[0]),
    )
    moved = np.tile([[0.0, 0.0, -0.05], [0.025, 0.0, -0.05]], len(top))
    problem = bp.ContactProblem(
        K,
        B,
        gap=places[bottom, 2],
        mu=MU,
        fixed=(3 * top[:, None] + [0, 1, 2]).ravel(),
        points=places[bottom],
        frame=np.tile(np.eye(3)[[2, 0, 1]], (len(bottom), 1, 1)),
    )
    return problem.solve(prescribed=moved), places[bottom]


def main() -> None:
    """Print the resultants; save the reactions if a file is given."""
    result, points = solve()
    for k, force in enumerate(result.reaction.sum(axis=1)):
        print(f"step {k}: {force[0]:.1f} N normal, {force[1]:.1f} N along x")
    if len(sys.argv) > 1:
        np.savez(sys.argv[1], x=points, reaction=result.reaction)


if __name__ == "__main__":
    main()
