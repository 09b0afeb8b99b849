"""Steps of random load paths are checked with K and B, in extended precision."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.methods import METHODS
from support.signorini_coulomb import inequalities

Array = NDArray[np.float64]
# As for a reduced problem, where the same check finds at most ten times the tolerance.
# v from K and v from W differ by ε times the condition of S, which is below 1e4.
FACTOR = 30.0


class Given(NamedTuple):
    K: Array
    B: Array
    gap: Array
    mu: Array
    fixed: NDArray[np.int64]
    loads: Array
    prescribed: Array


def random_path(seed: int) -> Given:
    """A held body; contacts with separate or shared degrees of freedom."""
    rng = np.random.default_rng(seed)
    d, contacts = int(rng.integers(2, 4)), int(rng.integers(1, 6))
    n = int(rng.integers(d + 2, 16))
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = root @ root.T + 10 ** rng.uniform(-3, 0) * np.eye(n)
    B = np.zeros((d * contacts, n))
    if seed % 2:
        for i in range(contacts):
            basis, _ = np.linalg.qr(rng.normal(size=(d, d)))
            B[d * i : d * i + d, rng.choice(n, d, replace=False)] = basis
    else:
        B[:] = rng.normal(size=B.shape) * (rng.random(B.shape) < 0.5)
    fixed = rng.choice(n, int(rng.integers(0, 3)), replace=False)
    steps = int(rng.integers(1, 5))
    return Given(
        (K + K.T) / 2,
        B,
        rng.uniform(-0.1, 0.3, contacts) * (rng.random(contacts) < 0.7),
        rng.uniform(0, 0.8, contacts),
        fixed,
        rng.normal(size=(steps, n)),
        0.1 * rng.normal(size=(steps, len(fixed))),
    )


def displacement(given: Given, force: Array, prescribed: Array) -> Array:
    """u of K u = f at the free degrees of freedom, refined in extended precision."""
    free = np.setdiff1d(np.arange(len(given.K)), given.fixed)
    K, u = given.K.astype(np.longdouble), np.zeros(len(given.K), np.longdouble)
    u[given.fixed] = prescribed
    for _ in range(4):
        rest = np.asarray((force - K @ u)[free], float)
        u[free] += np.linalg.solve(given.K[np.ix_(free, free)], rest)
    return np.asarray(u)


def relative(given: Given, u: Array, before: Array) -> Array:
    """Total normal gap, and slip of the step."""
    v = (given.B @ u).reshape(len(given.gap), -1)
    v[:, 1:] = (given.B @ (u - before)).reshape(v.shape)[:, 1:]
    v[:, 0] += given.gap
    return np.asarray(v, float)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.slow_variants(
    "alternating_principles",
    "auto",
    "gauss_seidel",
    "nesterov",
    "newton",
    "stress_principle",
    "uzawa",
)
def test_steps_of_random_paths(method: str) -> None:
    judged = 0
    for seed in range(50):
        random_body = random_path(seed)
        problem = bp.ContactProblem(
            random_body.K,
            random_body.B,
            gap=random_body.gap,
            mu=random_body.mu,
            fixed=random_body.fixed,
        )
        result: bp.Result | None
        try:
            result = problem.solve(
                random_body.loads,
                random_body.prescribed,
                method=method,
                max_iterations=2000,
            )
        except bp.BipotError as error:  # # more contacts than the body can satisfy
            result = error.result
        assert result is not None
        shape = (len(random_body.gap), -1)
        free = np.setdiff1d(np.arange(len(random_body.K)), random_body.fixed)
        W = random_body.B[:, free] @ np.linalg.solve(
            random_body.K[np.ix_(free, free)], random_body.B[:, free].T
        )
        compliance = W.diagonal().reshape(shape).mean(axis=1)
        before = np.zeros(len(random_body.K), np.longdouble)

        for k, step in enumerate(result):
            force = random_body.B.T @ step.reaction.ravel()
            u = displacement(
                random_body, random_body.loads[k] + force, random_body.prescribed[k]
            )
            unloaded = displacement(
                random_body, random_body.loads[k], random_body.prescribed[k]
            )
            missed = inequalities(
                step.reaction,
                relative(random_body, u, before),
                random_body.mu,
                compliance,
                relative(random_body, unloaded, before),
            )
            assert missed.worst <= FACTOR * step.tolerance, (seed, k, missed)
            judged += 1
            before = u
    # In half of the cases there are more contacts than motions: some loads have no solution.
    assert judged >= 60
