"""Random reduced problems of every kind, each defined by its seed."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp

Array = NDArray[np.float64]
KINDS = ("held", "graded", "floating", "redundant", "flat", "frictionless", "open")


class Given(NamedTuple):
    W: Array
    q: Array
    mu: Array
    rigid: tuple[Array, Array] | None

    def problem(self) -> bp.ReducedProblem:
        return bp.ReducedProblem(self.W, self.q, self.mu, rigid=self.rigid)


def random_problem(kind: str, d: int, seed: int) -> Given:
    """`kind` is one of `KINDS`; d = 2 or 3."""
    rng = np.random.default_rng([KINDS.index(kind), d, seed])
    n = int(rng.integers(1, 9))
    m = n * d
    rank = m if kind != "redundant" else max(m // 2, 1)
    root = rng.normal(size=(m, rank)) / np.sqrt(rank)
    W = root @ root.T + (0.0 if kind == "redundant" else 0.3) * np.eye(m)
    q = rng.normal(size=(n, d))
    q[:, 0] -= 0.5
    if kind == "redundant":
        # q is in the range of W: otherwise contacts may contradict each other.
        q = -(W @ np.abs(rng.normal(size=m))).reshape(n, d)
    mu = rng.uniform(0, 0.7, n)
    rigid = None
    if kind == "graded":
        # Contacts with stiffnesses from 1e-4 to 1e4, each in its own units.
        grade = np.repeat(10 ** rng.uniform(-2, 2, n), d)
        W, q = W * np.outer(grade, grade), q * grade.reshape(n, d)
    elif kind == "floating":
        # All translations are free; the loads balance reactions well inside the cone.
        R = np.tile(np.eye(d), (n, 1))
        e = np.append(-1.0, 0.5 * mu.min() * rng.uniform(-1, 1, d - 1) / d)
        rigid = (R, n * e)
    elif kind == "flat":
        # Contacts without tangential load, and some that just touch.
        q[:, 1:] = 0.0
        q[rng.random(n) < 0.3] = 0.0
    elif kind == "frictionless":
        mu = np.zeros(n)
    elif kind == "open":
        q[:, 0] = np.abs(q[:, 0])
    return Given((W + W.T) / 2, q, mu, rigid)
