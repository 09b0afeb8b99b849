"""Steps of random load paths by every method are checked with K, B and textbook conditions."""

import numpy as np
import pytest

import bipot_rs as bp
from support.methods import METHODS, NEED_SUPPORTS
from support.random_paths import random_path
from support.signorini_coulomb import inequalities

# As for a reduced problem, where the same check finds at most ten times the tolerance.
# v from K and v from W differ by ε times the condition of S, which is below 1e4.
FACTOR = 30.0


@pytest.mark.parametrize("method", METHODS)
def test_steps_of_random_paths(method: str) -> None:
    kinds = ["held", "prescribed", "bodies", "frictionless", "floating"]
    judged = 0
    for seed in range(30):
        kind, d = kinds[seed % 5], 2 + seed // 5 % 2
        if kind == "floating" and method in NEED_SUPPORTS:
            continue
        made, data = random_path(kind, d, seed)
        problem = made.problem(data)
        given = data.load, data.prescribed
        result: bp.Result | None
        try:
            result = problem.solve(*given, method=method, max_iterations=2000)
        except bp.BipotError as error:
            result = error.result
        assert result is not None
        compliance = problem.compliance.diagonal().reshape(-1, d).mean(axis=1)
        free = np.setdiff1d(np.arange(len(data.K)), made.fixed)
        before = np.zeros_like(data.gap)
        for k, step in enumerate(result):
            u, r = step.displacement, step.reaction
            load, moved = (np.atleast_2d(x)[min(k, len(x) - 1)] for x in given)
            left = (data.K @ u - load - made.B.T @ r.ravel())[free]
            # The balance of a floating body holds to η.
            assert np.abs(left).max() <= 1e-9 * np.abs(load).max()
            # Total normal gap, and slip of the step.
            total = (made.B @ u).reshape(r.shape) + data.gap
            v = np.column_stack([total[:, 0], (total - before)[:, 1:]])
            alone = problem.reduced(load, moved).q
            missed = inequalities(r, v, data.mu, compliance, alone)
            assert missed.worst <= FACTOR * step.tolerance, (seed, k, missed)
            judged += 1
            before = total
    assert judged >= 40
