"""Contact with a stiffness assembled by scikit-fem: a block pressed on a round bar.

Mesh, elements and weak form are those of scikit-fem. bipot_rs needs the stiffness K, the
gaps, and the operator B, which gives the displacements of the contacts relative to the
obstacle, normal first. Units: mm, N, MPa.
"""

import numpy as np
import skfem
from scipy import sparse
from skfem.models.elasticity import lame_parameters, linear_elasticity

import bipot_rs as bp

YOUNG, POISSON, MU = 210e3, 0.3, 0.2
RADIUS = 50.0


def solve(n: int = 12) -> tuple[bp.Result, dict[str, np.ndarray]]:
    """Press the block down by 0.02, then drag it sideways by 0.01."""
    x = np.linspace(-2.0, 2.0, 2 * n + 1)
    y = np.linspace(0.0, 2.0, n + 1)
    mesh = skfem.MeshQuad.init_tensor(x, y).with_boundaries(
        {
            "bottom": lambda at: at[1] == 0.0,
            "top": lambda at: at[1] == 2.0,
        }
    )
    # This Gauss rule is exact for bilinear elements on rectangles.
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad1()), intorder=2)
    K = linear_elasticity(*lame_parameters(YOUNG, POISSON)).assemble(basis)

    # Contact nodes along the bottom. The bar is below them, with its top at x = 0.
    nodes = np.unique(mesh.facets[:, mesh.boundaries["bottom"]])
    nodes = nodes[np.argsort(mesh.p[0, nodes])]
    points = mesh.p[:, nodes].T
    gap = RADIUS - np.sqrt(RADIUS**2 - points[:, 0] ** 2)
    # Normals point from the bar towards the block, tangents to their right.
    normal = np.stack([points[:, 0], RADIUS - gap], axis=1) / RADIUS
    frame = np.stack([normal, normal[:, ::-1] * [1.0, -1.0]], axis=1)

    # Row 2i + k of B: component k, normal first, of node i.
    dofs = basis.nodal_dofs[:, nodes].T
    rows = np.arange(2 * len(nodes)).reshape(-1, 2, 1)
    entries = (np.broadcast_arrays(rows, dofs[:, None, :])[k].ravel() for k in (0, 1))
    B = sparse.coo_array(
        (frame.ravel(), tuple(entries)), shape=(2 * len(nodes), K.shape[0])
    )

    # Area of each node: the integral of its shape function over the bottom.
    facets = skfem.FacetBasis(mesh, skfem.ElementQuad1(), facets="bottom")
    area = skfem.LinearForm(lambda v, _: v).assemble(facets)[nodes]

    top = basis.get_dofs("top")
    fixed = np.concatenate([top.all("u^1"), top.all("u^2")])
    prescribed = np.zeros((2, len(fixed)))
    half = len(fixed) // 2
    prescribed[:, half:] = -0.02
    prescribed[1, :half] = 0.01

    problem = bp.ContactProblem(
        K, B, gap=gap, mu=MU, fixed=fixed, area=area, points=points, frame=frame
    )
    result = problem.solve(prescribed=prescribed)
    return result, {"K": K, "B": B.toarray(), "fixed": fixed, "frame": frame}


def main() -> None:
    """Print the resultants and the status of both steps."""
    result, _ = solve()
    for k, step in enumerate(result):
        pressed, sheared = step.reaction.sum(axis=0)
        print(
            f"step {k}: {pressed:.1f} N/mm normal, {sheared:.1f} N/mm tangential, "
            f"{np.sum(step.status == bp.Status.STICK)} stick, "
            f"{np.sum(step.status == bp.Status.SLIP)} slip, "
            f"residual {step.residual:.1e}"
        )


if __name__ == "__main__":
    main()
