"""Contact with a stiffness assembled by CalculiX: a block, pressed and dragged.

    python examples/with_calculix.py [JOB]

CalculiX writes K of a deck without supports and contact by the step

    *STEP
    *FREQUENCY, SOLVER=MATRIXSTORAGE
    1
    *END STEP

which also needs a density: JOB.sti has the entries above the diagonal, with 14 digits, and
JOB.dof the node and component of each row. The deck has nodes and sets. Units: those of the
deck, here mm, N, MPa.
"""

import sys
from pathlib import Path

import numpy as np
from scipy import sparse

import bipot_rs as bp
from bipot_rs.mesh.abaqus import Reader

JOB = "tests/python/data/stiffness/cube"


def read(job: Path) -> tuple[sparse.csr_array, dict[tuple[int, int], int], Reader]:
    """K, the row of each node and component (from 1), and the deck."""
    row, column, value = np.loadtxt(job.with_suffix(".sti")).T
    i, j = row.astype(int) - 1, column.astype(int) - 1
    upper = sparse.csr_array(sparse.coo_array((value, (i, j))))
    K = sparse.csr_array(upper + sparse.triu(upper, 1).T)
    lines = job.with_suffix(".dof").read_text().split()
    places = [tuple(map(int, line.split("."))) for line in lines]
    return (
        K,
        {place: k for k, place in enumerate(places)},
        Reader(job.with_suffix(".inp")),
    )


def solve(job: Path) -> tuple[bp.Result, np.ndarray]:
    """Press the set FOOT on the floor z = 0 by 0.01 at GRIP, then drag it by 0.004."""
    K, row, deck = read(job)
    foot, grip = (deck.find_set(deck.nodes_of, name) for name in ("FOOT", "GRIP"))
    points = np.array([deck.places[deck.node[n]] for n in foot])
    # Normal first: z, x, y.
    columns = [row[n, component] for n in foot for component in (3, 1, 2)]
    count = len(columns)
    ones = np.ones(count), (np.arange(count), columns)
    B = sparse.csr_array(sparse.coo_array(ones, shape=(count, K.shape[0])))
    fixed = [row[n, component] for n in grip for component in (1, 2, 3)]
    moved = np.tile([[0.0, 0.0, -0.01], [0.004, 0.0, -0.01]], len(grip))
    problem = bp.ContactProblem(
        K,
        B,
        gap=points[:, 2],
        mu=0.25,
        fixed=fixed,
        points=points,
        frame=np.tile(np.eye(3)[[2, 0, 1]], (len(foot), 1, 1)),
    )
    return problem.solve(prescribed=moved), points


def main(job: str = JOB) -> None:
    """Print the forces of both steps."""
    result, _ = solve(Path(job))
    for k, step in enumerate(result):
        normal, x, y = step.reaction.sum(axis=0)
        print(f"step {k}: {normal:.1f} N normal, {x:.1f} N and {y:.1f} N tangential")


if __name__ == "__main__":
    main(*sys.argv[1:])
