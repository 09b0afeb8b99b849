"""Contact with a stiffness assembled by GetFEM: a block, pressed and dragged.

    /usr/bin/python3 examples/with_getfem.py [FILE.npz]

GetFEM makes the mesh, the elements and K. B, the gaps and the supports use its
numbering. If GetFEM belongs to the Python of the system, install bipot_rs there too.
Units: mm, N, MPa.
"""

import sys

import getfem as gf
import numpy as np
from scipy import sparse

import bipot_rs as bp

YOUNG, POISSON, MU = 210e3, 0.3, 0.3
BOTTOM, TOP = 1, 2


def solve(n: int = 6) -> tuple[bp.Result, np.ndarray]:
    """Press a cube of 100 mm on a rigid floor by 0.05, then drag its top by 0.025."""
    side = np.linspace(0.0, 100.0, n + 1)
    mesh = gf.Mesh("cartesian", side, side, side)
    for region, normal in ((BOTTOM, [0, 0, -1]), (TOP, [0, 0, 1])):
        mesh.set_region(region, mesh.outer_faces_with_direction(normal, 0.1))
    field = gf.MeshFem(mesh, 3)
    field.set_fem(gf.Fem("FEM_QK(3,1)"))
    method = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3,3)"))
    constant = gf.MeshFem(mesh, 1)
    constant.set_fem(gf.Fem("FEM_QK(3,0)"))
    ones = np.ones(constant.nbdof())
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    made = gf.asm_linear_elasticity(method, field, constant, lame * ones, shear * ones)
    pointer, row = made.csc_ind()
    K = sparse.csc_matrix((made.csc_val(), row, pointer), shape=made.size())

    # In GetFEM the degrees of freedom x, y, z of a node are consecutive.
    places = field.basic_dof_nodes()
    first = np.sort(field.basic_dof_on_region(BOTTOM))[::3]
    points = places[:, first].T
    count = len(first)
    # Normal first: z, x, y.
    columns = (first[:, None] + [2, 0, 1]).ravel()
    B = sparse.csr_matrix(
        (np.ones(3 * count), (np.arange(3 * count), columns)),
        shape=(3 * count, K.shape[0]),
    )
    frame = np.tile(np.eye(3)[[2, 0, 1]], (count, 1, 1))

    fixed = np.sort(field.basic_dof_on_region(TOP))
    component = np.arange(len(fixed)) % 3
    moved = np.array([[0.0, 0.0, -0.05], [0.025, 0.0, -0.05]])[:, component]
    problem = bp.ContactProblem(
        K,
        B,
        gap=points[:, 2],
        mu=MU,
        fixed=fixed,
        points=points,
        frame=frame,
        coordinates=places.T,
    )
    return problem.solve(prescribed=moved), points


def main() -> None:
    """Print the resultants; save the reactions if a file is given."""
    result, points = solve()
    for k, force in enumerate(result.reaction.sum(axis=1)):
        print(f"step {k}: {force[0]:.1f} N normal, {force[1]:.1f} N along x")
    if len(sys.argv) > 1:
        np.savez(sys.argv[1], x=points, reaction=result.reaction)


if __name__ == "__main__":
    main()
