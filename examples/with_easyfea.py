"""Contact with a stiffness assembled by EasyFEA: a block, pressed and dragged.

    python examples/with_easyfea.py [FILE.npz]

EasyFEA makes the mesh, the elements and K. B, the gaps and the supports use its numbering.
Units: mm, N, MPa.
"""

import sys

import numpy as np
from EasyFEA import ElemType, Mesher, Models, Simulations
from EasyFEA.Geoms import Domain, Point
from scipy import sparse

import bipot_rs as bp

YOUNG, POISSON, MU = 210e3, 0.3, 0.3


def solve(n: int = 6) -> tuple[bp.Result, np.ndarray]:
    """Press a cube of 100 mm on a rigid floor by 0.05, then drag its top by 0.025."""
    square = Domain(Point(0, 0), Point(100, 100), 100 / n)
    mesh = Mesher().Mesh_Extrude(
        square, [], [0, 0, 100], [n], ElemType.HEXA8, isOrganised=True
    )
    material = Models.Elastic.Isotropic(3, E=YOUNG, v=POISSON)
    K = sparse.csr_array(Simulations.Elastic(mesh, material).Get_K_C_M_F()[0])
    places = np.round(mesh.coord, 9)

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
