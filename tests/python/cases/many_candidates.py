"""H18 in its own process, whose peak memory is then that of this problem."""

import json
import sys

import numpy as np
from scipy import sparse

import bipot_rs as bp
from bipot_rs._lib.machine import peak_mb


def main(nodes: int) -> None:
    """Print the error of the solution, and the memory in bytes."""
    touching = np.arange(nodes) % (nodes // 10) == 0
    before = peak_mb()
    K = sparse.diags_array(np.tile([2.0, 1.0], nodes), format="csr")
    B = sparse.eye_array(2 * nodes, format="csr")
    gap = np.where(touching, 0.0, 1.0)
    problem = bp.ContactProblem(K, B, gap=gap, mu=0.5)
    result = problem.solve(np.tile([-1.0, 0.2], nodes))
    reaction = np.where(touching[:, None], [1, -0.2], 0.0)
    displacement = np.where(touching[:, None], 0.0, [-0.5, 0.2])
    u = result.displacement[0].reshape(nodes, 2)
    sys.stdout.write(
        json.dumps(
            {
                "contacts": int((result.reaction[0, :, 0] > 0).sum()),
                "reaction": float(np.abs(result.reaction[0] - reaction).max()),
                "displacement": float(np.abs(u - displacement).max()),
                "bytes": (peak_mb() - before) * 2**20,
                "compliance": problem.stats["bytes_compliance"],
            }
        )
    )


if __name__ == "__main__":
    main(int(sys.argv[1]))
