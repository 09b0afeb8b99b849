"""A contact operator of your own: two blocks, each upper node against a lower edge.

The nodes of the blocks do not match. A row of B is the displacement of a node of the
upper block, minus the displacement of the lower edge below it, interpolated between the
two nodes of the edge. Units: mm, N, MPa.
"""

import numpy as np
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem

STEEL = fem.Material(young=210e3, poisson=0.3)


def block(name: str, cells: int, y: tuple[float, float]) -> fem.Body:
    """A block of 4 mm × 2 mm."""
    x = np.linspace(0.0, 4.0, cells + 1)
    mesh = fem.box([x, np.linspace(*y, cells // 2 + 1)], "quadrilateral")
    return fem.Body(name, mesh, STEEL)


def between(x: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edge below each x, and the position on it: 0 at the left end, 1 at the right."""
    edge = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    return edge, (x - edges[edge]) / (edges[edge + 1] - edges[edge])


def solve() -> tuple[bp.Result, fem.Assembly]:
    """Press the upper block by 0.01, then drag it by 0.004."""
    upper, lower = block("upper", 10, (0.0, 2.0)), block("lower", 14, (-2.0, 0.0))
    supports = [
        fem.Support("lower", "bottom", [0, 1]),
        fem.Support("upper", "top", [0, 1]),
    ]
    # K of both bodies, and the first degree of freedom of each; no contacts yet.
    model = fem.assemble([upper, lower], [], supports)

    def along(body: fem.Body, surface: str) -> np.ndarray:
        nodes = body.nodes(surface)
        return nodes[np.argsort(body.points[nodes, 0])]

    ours, theirs = along(upper, "bottom"), along(lower, "top")
    x = upper.points[ours, 0]
    edge, share = between(x, lower.points[theirs, 0])

    B = sparse.lil_array((2 * len(ours), model.n))
    for i, node in enumerate(ours):
        for row, component in ((2 * i, 1), (2 * i + 1, 0)):  # n = +y, t = +x
            B[row, model.offset[0] + 2 * node + component] = 1.0
            for end, weight in ((0, 1 - share[i]), (1, share[i])):
                other = theirs[edge[i] + end]
                B[row, model.offset[1] + 2 * other + component] = -weight

    problem = bp.ContactProblem(
        model.K,
        B,
        gap=np.zeros(len(ours)),
        mu=0.3,
        fixed=model.fixed,
        points=upper.points[ours],
    )
    moved = [model.prescribed([[0.0, 0.0], [u, -0.01]]) for u in (0.0, 0.004)]
    return problem.solve(prescribed=np.array(moved)), model


def main() -> None:
    """Print the resultants of both steps."""
    result, _ = solve()
    for k, step in enumerate(result):
        normal, tangential = step.reaction.sum(axis=0)
        print(f"step {k}: {normal:.2f} N/mm normal, {tangential:.2f} N/mm tangential")


if __name__ == "__main__":
    main()
