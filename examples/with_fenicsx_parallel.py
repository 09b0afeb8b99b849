"""Contact with a stiffness that DOLFINx distributes: a block, pressed and dragged.

    mpirun -n 2 python -m mpi4py examples/with_fenicsx_parallel.py [FILE.npz]

It needs DOLFINx 0.5 or newer. Mesh, weak form, K and its parts are those of DOLFINx; the
contact operator comes from the facets of the floor. Units: mm, N, MPa.
"""

import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix
from mpi4py import MPI
from scipy import sparse

from bipot_rs import petsc

YOUNG, POISSON, MU, SIDE = 210e3, 0.3, 0.3, 100.0


def gathered(values: np.ndarray) -> np.ndarray:
    """Rows of all ranks, one after another, on every rank."""
    return np.concatenate(MPI.COMM_WORLD.allgather(values))


def solve(n: int = 6, tol: float = 1e-10) -> tuple[petsc.Result, np.ndarray]:
    """Press a cube of 100 mm on a rigid floor by 0.05, then drag its top by 0.025."""
    corners = [np.zeros(3), np.full(3, SIDE)]
    kind = mesh.CellType.hexahedron
    domain = mesh.create_box(MPI.COMM_WORLD, corners, [n, n, n], kind)
    if hasattr(fem, "functionspace"):  # DOLFINx 0.7
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
    K = assemble_matrix(fem.form(ufl.inner(stress, ufl.sym(ufl.grad(v))) * inside))
    K.assemble()

    # Nodes of this rank, and the number of the first one in K.
    own = space.dofmap.index_map.size_local
    first = space.dofmap.index_map.local_range[0]
    places = space.tabulate_dof_coordinates()[:own]

    def nodes(height: float) -> np.ndarray:
        """Own nodes of the facets at a height."""
        flat = domain.topology.dim - 1
        facets = mesh.locate_entities_boundary(
            domain, flat, lambda x: np.isclose(x[2], height)
        )
        found = fem.locate_dofs_topological(space, flat, facets)
        return found[found < own]

    floor, top = nodes(0.0), nodes(SIDE)
    points = gathered(places[floor])
    # Degree of freedom of a component of a node: 3 node + component. Normal first: z, x, y.
    columns = 3 * gathered(first + floor)[:, None] + [2, 0, 1]
    count = len(points)
    entries = np.ones(3 * count), (np.arange(3 * count), columns.ravel())
    B = sparse.csr_matrix(entries, shape=(3 * count, K.getSize()[1]))
    held = gathered(first + top)
    problem = petsc.ContactProblem(
        K,
        B,
        gap=points[:, 2],
        mu=MU,
        fixed=(3 * held[:, None] + [0, 1, 2]).ravel(),
        points=points,
        frame=np.tile(np.eye(3)[[2, 0, 1]], (count, 1, 1)),
        coordinates=np.repeat(places, 3, axis=0),
    )
    moved = np.tile([[0.0, 0.0, -0.05], [0.025, 0.0, -0.05]], (1, len(held)))
    return problem.solve(prescribed=moved, tol=tol), points


def main() -> None:
    """Print the resultants; save the reactions if a file is given."""
    result, points = solve(tol=1e-12)
    if MPI.COMM_WORLD.rank:
        return
    for k, force in enumerate(result.reaction.sum(axis=1)):
        print(f"step {k}: {force[0]:.1f} N normal, {force[1]:.1f} N along x")
    if len(sys.argv) > 1:
        np.savez(sys.argv[1], x=points, reaction=result.reaction)


if __name__ == "__main__":
    main()
