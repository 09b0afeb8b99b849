"""Supports of 1e-13 to 1e-11 of the stiffness: K's own last digits decide the reactions.

A block on two weak springs slides far. The rounding of K, one unit in its last place, acts on
this displacement with forces that reactions must balance: the estimate of the error must
contain them, and no uniqueness is proved where they decide.
"""

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem

EPS = float(np.finfo(float).eps)
SEEDS = [*range(12), *(pytest.param(s, marks=pytest.mark.slow) for s in range(12, 120))]


def block_on_springs(seed: int) -> tuple[fem.Assembly, sparse.csr_array, np.ndarray]:
    """Model without the springs, K with them, and a load that presses and pulls."""
    rng = np.random.default_rng(seed)
    axes = [rng.uniform(0.5, 2) * np.linspace(0, 1, rng.integers(3, 6)) for _ in "xy"]
    young = 10 ** rng.uniform(3, 11)
    body = fem.Body("block", fem.box(axes, "quadrilateral"), fem.Material(young, 0.3))
    mu = rng.uniform(0.05, 0.6)
    contact = fem.Contact("block", "bottom", mu=mu, plane=((0, 0), (0, 1)))
    model = fem.assemble([body], [contact])
    along_x = np.flatnonzero(model.body_force("block", (1.0, 0.0)))
    springs = np.zeros(model.n)
    stiffest = abs(model.K.data).max()
    springs[rng.choice(along_x, 2, replace=False)] = (
        10 ** rng.uniform(-13, -11) * stiffest
    )
    K = sparse.csr_array(model.K + sparse.diags_array(springs))
    pull = rng.uniform(0.3, 1.5) * mu
    return (
        model,
        K,
        model.traction("block", "top", (pull * 1e-3 * young, -1e-3 * young)),
    )


def rounded_otherwise(K: sparse.csr_array, seed: int) -> sparse.csr_array:
    """K with entries that are half a unit in the last place larger or smaller, or equal."""
    upper = sparse.coo_array(sparse.triu(K))
    signs = np.random.default_rng(seed).choice([-1, 0, 1], upper.nnz)
    upper.data = upper.data * signs * EPS / 2
    return sparse.csr_array(K + upper + sparse.triu(upper, 1).T)


def solved(
    K: sparse.csr_array, model: fem.Assembly, load: np.ndarray
) -> bp.Step | None:
    """The step; None where K cannot decide, or contact cannot carry the load."""
    try:
        problem = bp.ContactProblem(K, model.B, gap=model.gap, mu=model.mu)
        return problem.solve(load)[-1]
    except (ValueError, bp.BipotError):
        return None


@pytest.mark.parametrize("seed", SEEDS)
def test_the_estimate_contains_the_rounding_of_stiffness(seed: int) -> None:
    model, K, load = block_on_springs(seed)
    step = solved(K, model, load)
    if step is None:
        return
    others = [solved(rounded_otherwise(K, k), model, load) for k in (1, 2)]
    size = np.abs(step.reaction).max()
    motions = -1 if step.rigid_motion is None else len(step.rigid_motion)
    for other in others:
        # Where the other K has a motion more or less, each is right for its own.
        if other is None or len(other.rigid_motion) != motions:
            continue
        change = np.abs(other.reaction - step.reaction).max() / size
        assert step.error_estimate is not None
        # Four samples of independent roundings: half of their largest is exceeded at times.
        assert change <= 4 * step.error_estimate[0] + 1e-12
        if step.unique == "proved":
            assert change <= 4e-3
