"""Contact with a stiffness assembled by FEniCSx: a block, pressed and dragged.

    python examples/with_fenicsx.py [FILE.npz]

It needs DOLFINx 0.5 or newer, and runs on one process. Mesh, weak form, K and the
numbering of nodes and components are those of DOLFINx. Units: mm, N, MPa.
"""

import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from scipy import sparse

import bipot_rs as bp

YOUNG, POISSON, MU, SIDE = 210e3, 0.3, 0.3, 100.0


def solve(n: int = 6) -> tuple[bp.Result, np.ndarray]:
    """Press a cube of 100 mm on a rigid floor by 0.05, then drag its top by 0.025."""
    corners = [np.zeros(3), np.full(3, SIDE)]
    kind = mesh.CellType.hexahedron
    domain = mesh.create_box(MPI.COMM_SELF, corners, [n, n, n], kind)
    newer = hasattr(fem, "functionspace")  # DOLFINx 0.7
    if newer:
        space = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    else:
        space = fem.VectorFunctionSpace(domain, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    strain = ufl.sym(ufl.grad(u))
    stress = 2 * shear * strain + lame * ufl.tr(strain) * ufl.Identity(3)
    # Two Gauss points along each edge, exact for this element on boxes.
    inside = ufl.dx(metadata={"quadrature_degree": 3})
    form = fem.form(ufl.inner(stress, ufl.sym(ufl.grad(v))) * inside)
    if newer:
        K = sparse.csr_matrix(fem.assemble_matrix(form).to_scipy())
    else:
        from dolfinx.fem.petsc import assemble_matrix

        A = assemble_matrix(form)
        A.assemble()
        pointers, columns, values = A.getValuesCSR()
        K = sparse.csr_matrix((values, columns, pointers))

    # Degree of freedom of a component of a node: 3 node + component.
    places = space.tabulate_dof_coordinates()
    floor = np.flatnonzero(np.isclose(places[:, 2], 0.0))
    top = np.flatnonzero(np.isclose(places[:, 2], SIDE))
    count = len(floor)
    # Normal first: z, x, y.
    columns = (3 * floor[:, None] + [2, 0, 1]).ravel()
    B = sparse.csr_matrix(
        (np.ones(3 * count), (np.arange(3 * count), columns)),
        shape=(3 * count, K.shape[0]),
    )
    frame = np.tile(np.eye(3)[[2, 0, 1]], (count, 1, 1))

    fixed = (3 * top[:, None] + [0, 1, 2]).ravel()
    moved = np.tile([[0.0, 0.0, -0.05], [0.025, 0.0, -0.05]], (1, len(top)))
    problem = bp.ContactProblem(
        K,
        B,
        gap=places[floor, 2],
        mu=MU,
        fixed=fixed,
        points=places[floor],
        frame=frame,
        coordinates=np.repeat(places, 3, axis=0),
    )
    return problem.solve(prescribed=moved), places[floor]


def main() -> None:
    """Print the resultants; save the reactions if a file is given."""
    result, points = solve()
    for k, force in enumerate(result.reaction.sum(axis=1)):
        print(f"step {k}: {force[0]:.1f} N normal, {force[1]:.1f} N along x")
    if len(sys.argv) > 1:
        np.savez(sys.argv[1], x=points, reaction=result.reaction)


if __name__ == "__main__":
    main()
