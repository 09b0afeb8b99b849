"""Load steps down to the rounding error of the load."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from studies import exact
from studies.exact import SLIP, STICK, Array, Case
from studies.measure import (
    NAN,
    TOL,
    Answer,
    Row,
    answer,
    bounds,
    largest,
    named,
    powers,
    violation,
)

VALUES = powers(-15, -1)
NODES, PULL, STEPS, MU = 20, 10.3, 10, 0.4


def bar() -> Case:
    """Bar on a frictional foundation, (u_n, u_t) at each node, far end fixed, not yet pulled.

    EA = 1000, length 1. The normal force gives each node a friction limit of 50/`NODES`.
    """
    chain = 2 * np.eye(NODES) - np.eye(NODES, k=1) - np.eye(NODES, k=-1)
    chain[-1, -1] = 1.0
    K = np.kron(1000.0 * NODES * chain, np.diag([0.0, 1.0]))
    K += np.kron(np.eye(NODES), np.diag([700.0, 0.0]))
    limit = np.full(NODES, 50.0 / NODES)
    limit[-1] /= 2
    return Case(
        sparse.csr_array(K),
        sparse.eye_array(2 * NODES, format="csr"),
        np.column_stack([-limit / MU, np.zeros(NODES)]).ravel(),
        np.zeros((NODES, 2)),
        np.full(NODES, MU),
        np.zeros(0, np.int64),
        np.zeros(0),
    )


def pulled(case: Case, force: float) -> Case:
    load = case.load.copy()
    load[-1] = force
    return replace(case, load=load)


def front(case: Case, force: float) -> tuple[NDArray[np.int8], Array]:
    """Statuses and directions of slip while the pull only grows.

    The nodes at their friction limit slide, from the pulled end on.
    """
    limit = -case.load[::2] * MU
    carried = np.cumsum(limit[::-1])[::-1]
    status = np.where(carried < force, SLIP, STICK)
    return status.astype(np.int8), np.ones((NODES, 1))


def rows(values: Iterable[float] = VALUES) -> Iterator[Row]:
    """Rows of ten steps of a share of the load: totals, and the slip of a step.

    As the pull only grows, totals equal those of one step, and the slip of a step is the
    difference of two exact solutions.
    """
    for value in values:
        yield from path(value)


def path(share: float) -> tuple[Row, Row]:
    """Row of the totals at the end, and row of the increments."""
    case = bar()
    pulls = PULL * (1 + share * np.arange(STEPS + 1))
    problem = bp.ContactProblem(case.K, case.B, gap=case.gap, mu=case.mu)
    loads = np.array([pulled(case, p).load for p in pulls])
    result = problem.solve(loads, tol=TOL)
    right = [exact.solve(pulled(case, p), *front(case, p)) for p in pulls]

    last = result[-1]
    answer_of_path = Answer(
        last.reaction, last.relative_displacement, last.displacement
    )
    errors_of_path = right[-1].errors(*answer_of_path)
    limits = bounds(right[-1], problem, float(result.residual.max()))
    agree = all(
        np.array_equal(step.status, front(case, p)[0])
        for step, p in zip(result, pulls, strict=True)
    )
    totals = Row(
        "totals",
        share,
        len(case.load),
        NODES,
        **named("error", errors_of_path),
        **named("own", errors_of_path),
        **named("bound", limits),
        law=violation(right[-1].case, answer_of_path),
        statuses_right=agree and all(x.lawful for x in right),
        iterations=int(result.iterations[1:].sum()),
        products=float(result.work[1:].sum()),
        residual=float(result.residual.max()),
        cond_S=float(problem.stats["cond_S"]),
    )
    exact_slip = [
        exact.to_floats(b.v - a.v)[1::2] for a, b in itertools.pairwise(right)
    ]
    size = min(largest(x) for x in exact_slip)
    miss = max(
        largest(step.slip[:, 0] - x)
        for step, x in zip(list(result)[1:], exact_slip, strict=True)
    )
    # A slip is the difference of two totals, each with an error up to its bound.
    whole = largest(answer(right[-1]).u)
    slip = replace(
        totals,
        case="slip of a step",
        error_r=NAN,
        error_u=NAN,
        error_v=miss / size if size else NAN,
        own_v=NAN,
        bound_r=NAN,
        bound_u=NAN,
        bound_v=2 * limits[1] * whole / size if size else NAN,
    )
    return totals, slip
