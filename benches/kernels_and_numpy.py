"""Time two kernels as Python calls them, compared with NumPy and SciPy.

    python benches/kernels_and_numpy.py

Tables of the README: `project` compared with a vectorised NumPy projection, and the
condensation of a cube and a square compared with `scipy.sparse.linalg.splu` and one
solve for each contact unknown. The minimum of several calls counts. Differences are
between the results of the two sides.
"""

import numpy as np
import tables
from peers.sweep import project
from problems import compliance_by_solves
from scipy import sparse
from scipy.sparse.linalg import splu
from timing import fastest
from unit_body import unit_body

import bipot_rs as bp

PROJECTION = tables.columns(
    "d | nodes | project, M nodes/s | NumPy, M nodes/s | ratio | largest difference"
)
CONDENSATION = tables.columns(
    "body | unknowns | contact unknowns | bipot_rs, s | splu and solves, s | "
    "ratio | difference of W"
)


def projection():
    """Rows of the projection, in nodes per second."""
    rng = np.random.default_rng(7)
    for d in (2, 3):
        for nodes in (1_000, 1_000_000):
            tau, mu = rng.standard_normal((nodes, d)), np.full(nodes, 0.4)
            bipot, (t, _) = fastest(5, lambda tau=tau, mu=mu: bp.project(tau, mu))
            numpy, other = fastest(5, lambda tau=tau, mu=mu: project(tau, mu))
            yield (
                str(d),
                f"{nodes:,}",
                f"{nodes / bipot / 1e6:.1f}",
                f"{nodes / numpy / 1e6:.1f}",
                f"{numpy / bipot:.1f}",
                f"{abs(t - other).max():.0e}",
            )


def bodies():
    """Name, dimension, K, contact unknowns (base), prescribed unknowns (top)."""
    for name, dim, cells in (("cube", 3, 13), ("cube", 3, 25), ("square", 2, 316)):
        body = unit_body(dim, cells)
        base, top = (
            (dim * nodes[:, None] + np.arange(dim)).ravel()
            for nodes in (body.base, body.top)
        )
        yield name, dim, body.K, base, top


def condensation():
    """Rows of the condensation, in seconds from K to W."""
    for name, dim, K, base, top in bodies():
        n, m = K.shape[0], len(base)
        B = sparse.csr_array((np.ones(m), (np.arange(m), base)), shape=(m, n))
        free = np.setdiff1d(np.arange(n), top)

        def by_bipot(K=K, B=B, top=top, contacts=m // dim):
            problem = bp.ContactProblem(K, B, gap=np.zeros(contacts), mu=0.3, fixed=top)
            return problem.compliance

        def by_scipy(K=K, base=base, free=free):
            A = K[free][:, free].tocsc()
            lu = splu(A, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            return compliance_by_solves(lu, np.searchsorted(free, base))

        repeat = 3 if n < 20_000 else 1
        fast, W = fastest(3, by_bipot)
        slow, other = fastest(repeat, by_scipy)
        error = abs(W - other).max() / abs(other).max()
        times = (f"{fast:.2f}", f"{slow:.2f}", f"{slow / fast:.1f}", f"{error:.0e}")
        yield (name, f"{n:,}", f"{m:,}", *times)


def main():
    """Measure, and rewrite the tables."""
    args = tables.parser(__doc__).parse_args()
    for name, head, rows in (
        ("projection and NumPy", PROJECTION, projection()),
        ("condensation and SciPy", CONDENSATION, condensation()),
    ):
        tables.publish(name, tables.table(head, rows), write=not args.print)


if __name__ == "__main__":
    main()
