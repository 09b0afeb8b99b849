"""K of a caller is borrowed: 50 MB of it, counted in the memory of the process."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.children import RESET, forked, memory
from support.pressed_in_space import arrays


def chain(count: int) -> dict[str, Any]:
    """A chain of dense blocks of 27 unknowns, with a factor smaller than K."""
    half = np.random.default_rng(3).normal(size=(27, 27))
    along = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=[count] * 2)
    K = sparse.csr_array(sparse.kron(along, half @ half.T + np.eye(27), format="csr"))
    contact = sparse.eye_array(3, K.shape[0], format="csr")
    return {"K": K, "B": contact, "gap": [0.0], "mu": 0.3}


def predict(problem: bp.ContactProblem) -> float:
    """Bytes that the engine says it takes to prepare K."""
    if problem.stats["engine"] == "direct":
        return float(problem.stats["bytes_peak"])
    core = problem.stiffness.choose_engine(1, "auto").core
    return float(core.bytes[0])


@pytest.mark.slow
@pytest.mark.skipif(not RESET.exists(), reason="the system does not count this")
@pytest.mark.parametrize(
    ("engine", "make", "few", "many"),
    [
        ("direct", chain, 20, 2000),
        ("iterative", lambda n: arrays(n)[0], 3, 26),
    ],
    ids=["direct", "iterative"],
)
def test_only_the_core_has_a_copy_of_its_own(
    engine: str, make: Callable[[int], dict[str, Any]], few: int, many: int
) -> None:
    def child() -> None:
        # Imports, and the threads of the core.
        bp.ContactProblem(**make(few), engine=engine)
        given = make(many)
        K = given["K"]
        size = K.data.nbytes + K.indices.nbytes
        assert size > 45e6
        RESET.write_text("5")
        before = memory("VmRSS")
        problem = bp.ContactProblem(**given, engine=engine)
        extra = (memory("VmHWM") - before - predict(problem)) / size
        # The direct engine reads indices of 64 bits, two thirds of K, before its factor is
        # made; one more copy of K would be 1.
        assert extra < 0.85, extra

    run = forked(child, seconds=120)
    assert run.returncode == 0, run.stderr
