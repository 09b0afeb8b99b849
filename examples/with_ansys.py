"""Contact with a stiffness of Ansys, read by ansys-mapdl-reader: a bar pressed on a wall.

    python examples/with_ansys.py [FILE.full FILE.rst]

A static solution in Ansys leaves jobname.full (keep it by EMATWRITE,YES or WRFULL) with K, and
jobname.rst with the nodes. By default these are the files that come with the reader: a bar of
1 x 1 x 5, held at z = 0. Here a rigid wall at z = 5 - 0.01 presses it.
"""

import sys

import numpy as np
from ansys.mapdl.reader import examples, read_binary
from scipy import sparse

import bipot_rs as bp


def read(
    full_file: str, result_file: str
) -> tuple[sparse.csr_array, np.ndarray, np.ndarray, np.ndarray]:
    """K, the node and component (from 0) of each row, the fixed rows, places of the rows."""
    full = read_binary(full_file)
    rows, upper, _ = full.load_km(as_sparse=True, sort=False)
    K = sparse.csr_array(upper + sparse.triu(upper, 1).T)
    held = {tuple(place) for place in full.const.tolist()}
    fixed = np.array(
        [k for k, place in enumerate(rows.tolist()) if tuple(place) in held]
    )
    mesh = read_binary(result_file).mesh
    place = dict(zip(mesh.nnum.tolist(), mesh.nodes, strict=True))
    return K, rows, fixed, np.array([place[n] for n in rows[:, 0].tolist()])


def solve(full_file: str, result_file: str) -> bp.Result:
    """Press the end of the bar by a wall, with friction."""
    K, rows, fixed, places = read(full_file, result_file)
    end = places[:, 2].max()
    across = [
        np.flatnonzero((places[:, 2] == end) & (rows[:, 1] == component))
        for component in (2, 0, 1)
    ]
    count = len(across[0])
    # Rows of one component have the nodes in one order. The wall pushes along -z.
    columns = np.stack(across, axis=1).ravel()
    signs = np.tile([-1.0, 1.0, 1.0], count)
    B = sparse.csr_array(
        (signs, (np.arange(3 * count), columns)), shape=(3 * count, K.shape[0])
    )
    frame = np.tile([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (count, 1, 1))
    problem = bp.ContactProblem(
        K,
        B,
        gap=np.full(count, -0.01),
        mu=0.3,
        fixed=fixed,
        points=places[across[0]],
        frame=frame,
    )
    return problem.solve()


def main(full_file: str = "", result_file: str = "") -> None:
    """Print the force of the wall."""
    files = full_file or examples.fullfile, result_file or examples.rstfile
    print(f"{solve(*files).reaction[-1, :, 0].sum():.6g} presses the bar")


if __name__ == "__main__":
    main(*sys.argv[1:])
