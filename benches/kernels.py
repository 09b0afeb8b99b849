"""Two kernels as Python calls them, beside NumPy and SciPy doing the same.

    python benches/kernels.py

The tables of the README: `project` beside a vectorised NumPy projection, and the
condensation of a cube and of a square beside `scipy.sparse.linalg.splu` with one
solve for every contact unknown. The two sides run in turn, the smallest of
three; errors are those of W against the other side.
"""

from time import perf_counter

import numpy as np
import tables
from scipy import sparse
from scipy.sparse.linalg import splu

import bipot_rs as bp
from bipot_rs.fem import Body, Material, box, stiffness


def best(times, work):
    """Smallest time of some runs, and the last result."""
    seconds = []
    for _ in range(times):
        start = perf_counter()
        result = work()
        seconds.append(perf_counter() - start)
    return min(seconds), result


def numpy_project(tau, mu):
    """The closed form (12), all contacts at once."""
    n, t = tau[:, 0], np.linalg.norm(tau[:, 1:], axis=1)
    sticks, opens = t <= mu * n, mu * t <= -n
    normal = (n + mu * t) / (1 + mu**2)
    scale = np.divide(mu * normal, t, out=np.zeros_like(t), where=t > 0)
    slips = np.column_stack([normal, scale[:, None] * tau[:, 1:]])
    inside = np.where(sticks[:, None], tau, slips)
    return np.where(opens[:, None], 0.0, inside)


PROJECTION = (
    *("d", "nodes", "project, M nodes/s", "NumPy, M nodes/s", "ratio"),
    "largest difference",
)
CONDENSATION = (
    *("body", "unknowns", "contact", "ours, s", "splu and solves, s", "ratio"),
    "W differs",
)


def projection():
    """Rows of nodes a second."""
    rng = np.random.default_rng(7)
    for d in (2, 3):
        for nodes in (1_000, 1_000_000):
            tau, mu = rng.standard_normal((nodes, d)), np.full(nodes, 0.4)
            ours, (t, _) = best(5, lambda tau=tau, mu=mu: bp.project(tau, mu))
            theirs, other = best(5, lambda tau=tau, mu=mu: numpy_project(tau, mu))
            yield (
                *(str(d), f"{nodes:,}"),
                *(f"{nodes / seconds / 1e6:.1f}" for seconds in (ours, theirs)),
                *(f"{theirs / ours:.1f}", f"{abs(t - other).max():.0e}"),
            )


def bodies():
    """Name, K, contact unknowns, prescribed unknowns: base in contact, top held."""
    for name, dim, cells in (("cube", 3, 13), ("cube", 3, 25), ("square", 2, 316)):
        axis = np.linspace(0.0, 1.0, cells + 1)
        mesh = box([axis] * dim, "hexahedron" if dim == 3 else "quadrilateral")
        K = stiffness(Body("body", mesh, Material(1.0, 0.3)))
        nodes = [np.flatnonzero(mesh.p[-1] == end) for end in (0.0, 1.0)]
        base, top = ((dim * at[:, None] + np.arange(dim)).ravel() for at in nodes)
        yield name, dim, sparse.csr_array(K), base, top


def condensation():
    """Rows of seconds to W."""
    for name, dim, K, base, top in bodies():
        n, m = K.shape[0], len(base)
        B = sparse.csr_array((np.ones(m), (np.arange(m), base)), shape=(m, n))
        free = np.setdiff1d(np.arange(n), top)

        def ours(K=K, B=B, top=top, contacts=m // dim):
            problem = bp.ContactProblem(K, B, gap=np.zeros(contacts), mu=0.3, fixed=top)
            return problem.compliance

        def theirs(K=K, base=base, free=free):
            A = K[free][:, free].tocsc()
            lu = splu(A, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            at = np.searchsorted(free, base)
            W = np.empty((len(at), len(at)))
            for first in range(0, len(at), 256):
                block = slice(first, min(first + 256, len(at)))
                unit = np.zeros((len(free), len(at[block])))
                unit[at[block], np.arange(unit.shape[1])] = 1.0
                W[:, block] = lu.solve(unit)[at]
            return W

        repeat = 3 if n < 20_000 else 1
        fast, W = best(3, ours)
        slow, other = best(repeat, theirs)
        error = abs(W - other).max() / abs(other).max()
        times = (f"{fast:.2f}", f"{slow:.2f}", f"{slow / fast:.1f}", f"{error:.0e}")
        yield (name, f"{n:,}", f"{m:,}", *times)


def main():
    """Measure, and rewrite the tables."""
    asked = tables.parser(__doc__).parse_args()
    for name, head, rows in (
        ("projection beside NumPy", PROJECTION, projection()),
        ("condensation beside SciPy", CONDENSATION, condensation()),
    ):
        tables.publish(name, tables.table(head, rows), write=not asked.print)


if __name__ == "__main__":
    main()
