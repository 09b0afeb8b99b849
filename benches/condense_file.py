"""Time the condensation of a matrix file with bipot_rs, for `condensation_peers.py`.

    python benches/condense_file.py FILE REPEAT

`peers/cholmod.c` describes FILE. Prints one JSON line: seconds of each phase, the minimum
of a construction and, as for the peers, of REPEAT updates that know the pattern and reuse
memory; counts; and the rate of NumPy's matrix product on as many threads. Writes W to
FILE.s. BIPOT_NUM_THREADS sets the threads.
"""

import json
import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy import sparse

import bipot_rs as bp

PHASES = ("order", "symbolic", "factor", "compliance")


def rate():
    """Flops per second of a matrix product of size 1500."""
    a = np.random.default_rng(1).standard_normal((1500, 1500))
    seconds = []
    for _ in range(4):
        start = perf_counter()
        a @ a
        seconds.append(perf_counter() - start)
    return 2 * 1500**3 / min(seconds)


def main():
    """Condense, and print the JSON line."""
    path, repeat = Path(sys.argv[1]), int(sys.argv[2])
    with path.open("rb") as file:
        n, m, d, nnz = np.fromfile(file, np.int64, 4)
        pointers = np.fromfile(file, np.int64, n + 1)
        indices = np.fromfile(file, np.int64, nnz)
        values = np.fromfile(file, np.float64, nnz)
    lower = sparse.csc_array((values, indices, pointers), shape=(n, n))
    K = (lower + sparse.tril(lower, -1).T).tocsr()
    B = sparse.csr_array((np.ones(m), (np.arange(m), np.arange(n - m, n))), (m, n))
    problem = bp.ContactProblem(K, B, gap=np.zeros(m // d), mu=0.3)
    best = {phase: problem.stats[f"seconds_{phase}"] for phase in PHASES}
    # The first update still holds the old factor; later ones reuse its memory.
    for _ in range(repeat if repeat > 1 else 0):
        problem.update(K)
        for phase in ("factor", "compliance"):
            best[phase] = min(best[phase], problem.stats[f"seconds_{phase}"])
    stats = problem.stats
    problem.compliance.tofile(f"{path}.s")
    # Press the body onto the contact plane and pull it along so that some nodes slip.
    load = np.zeros((n // d, d))
    load[:, -1], load[:, 0] = -1.0, 0.2
    for _ in range(2):
        result = problem.solve(load.ravel())
        # Displacements are computed when they are asked for.
        start = perf_counter()
        if not np.isfinite(result.displacement).all():
            raise SystemExit("a displacement is not finite")
        seconds = {"solve": result.seconds["solve"], "recover": perf_counter() - start}
        for phase, spent in seconds.items():
            best[phase] = min(best.get(phase, np.inf), spent)
    print(
        json.dumps(
            best
            | {
                "numeric": best["factor"],
                "flops": stats["flops"],
                "nnz": stats["nnz_factor"],
                "bytes_factor": stats["bytes_factor"],
                "bytes_peak": stats["bytes_peak"],
                "ordering": stats["ordering"],
                "rate": rate(),
            }
        )
    )


if __name__ == "__main__":
    main()
