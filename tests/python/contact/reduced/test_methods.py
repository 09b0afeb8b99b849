"""All methods on one problem, and callbacks and interrupts during a solve."""

import os
import signal
import threading
import time
from itertools import pairwise

import numpy as np
import pytest

import bipot_rs as bp
from support.children import forked
from support.methods import METHODS
from support.pressed import cube

TOL = 1e-12


@pytest.mark.parametrize("method", METHODS)
def test_history(method: str) -> None:
    solution = cube().solve(method, tol=TOL)
    work, residual = solution.history.T
    # The first row is the start r = 0, whose residual is one by definition.
    assert len(work) == solution.iterations + 1
    assert residual[0] == 1.0
    assert 0 <= work[0] <= 1
    assert np.all(np.diff(work) > 0)
    # The residual of the end is computed again, which costs a product.
    assert work[-1] < solution.work <= work[-1] + 2
    assert residual[-1] <= solution.tolerance
    assert residual[:-1].min() > TOL


@pytest.mark.parametrize("method", METHODS)
def test_a_near_start_takes_fewer_iterations(method: str) -> None:
    before, after = cube().solve(method, tol=TOL), cube(0.01)
    cold = after.solve(method, tol=TOL)
    for start in (before, before.reaction):
        warm = after.solve(method, tol=TOL, start=start)
        assert warm.converged
        assert warm.iterations < cold.iterations
    # A start from the solution needs no iteration.
    done = after.solve(method, tol=TOL, start=cold)
    assert done.iterations == 0
    np.testing.assert_array_equal(done.reaction, cold.reaction)


def endless() -> bp.ReducedProblem:
    """More contacts than a soft body has motions: the reactions are not unique."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(600, 40)) * np.logspace(0, -6, 40)
    q = rng.normal(size=(200, 3)) - [1.0, 0.0, 0.0]
    return bp.ReducedProblem(columns @ columns.T, q, 0.5)


def test_callback_gets_the_progress() -> None:
    told: list[tuple[int, float, float]] = []
    limited = {"max_seconds": 1.0, "max_iterations": 10**9}
    solution = endless().solve(
        "uzawa", 1e-13, **limited, callback=lambda *now: told.append(now)
    )
    assert str(solution.outcome) == "time_limit"
    # At most twenty calls a second; fewer if the machine is busy.
    assert 2 <= len(told) <= 20 * solution.seconds + 1
    for iterations, work, residual in told:
        assert (type(iterations), type(work), type(residual)) == (int, float, float)
    for (i, work, residual), (later, more, less) in pairwise(told):
        assert i <= later
        assert work <= more
        assert residual >= less
    assert told[-1][0] <= solution.iterations
    assert told[-1][2] >= 0.99 * solution.residual


def test_an_exception_of_the_callback_ends_the_solve() -> None:
    class EnoughError(Exception):
        pass

    told = []

    def callback(iterations: int, _work: float, _residual: float) -> None:
        told.append(iterations)
        if len(told) == 3:
            raise EnoughError

    problem = endless()
    with pytest.raises(EnoughError):
        # Without a limit the solve would take minutes.
        problem.solve("uzawa", 1e-13, callback=callback, max_iterations=10**9)
    assert len(told) == 3
    # The problem can be used again.
    assert problem.solve(max_iterations=1).iterations == 1
    with pytest.raises(TypeError, match="callback"):
        problem.solve(callback=3)  # type: ignore[arg-type]


def lattice(n: int, pull: float) -> bp.ReducedProblem:
    """Contacts on n × n places that press, and are pulled more and more along a side."""
    x = np.stack(np.meshgrid(np.arange(n), np.arange(n)), -1).reshape(-1, 2)
    near = 1 / np.sqrt(((x[:, None] - x) ** 2).sum(-1) + 1.0)
    q = np.zeros((n * n, 3))
    q[:, 0], q[:, 1] = -1, pull * np.linspace(0, 1, n * n)
    return bp.ReducedProblem(np.kron(near, np.eye(3)) + np.eye(3 * n * n) / 2, q, 0.5)


# Of order 2028 with nearly all contacts sticking, where W is inverted; and of order 3072,
# where GMRES and sweeps take seconds.
@pytest.mark.parametrize(
    ("n", "pull", "method", "inverse"),
    [(26, 0.12, "newton", 8 * 2028**2), (32, 0.4, "auto", 0)],
)
@pytest.mark.slow_variants("*-0")
def test_ctrl_c_ends_a_large_solve(
    n: int, pull: float, method: str, inverse: int
) -> None:
    problem = lattice(n, pull)

    def repeat() -> None:
        while True:
            problem.solve(method, 1e-12)

    def child() -> None:
        assert problem.solve(method, 1e-12).stats["bytes_beside_W"] == inverse
        for delay in (0.05, 0.4):
            sent: list[float] = []

            def fire(sent: list[float] = sent) -> None:
                sent.append(time.perf_counter())
                os.kill(os.getpid(), signal.SIGINT)

            threading.Timer(delay, fire).start()
            with pytest.raises(KeyboardInterrupt):
                repeat()
            # Signals are checked every 0.05 s, and work stops within one block of a
            # factorisation or product. A machine with other jobs may need another second.
            assert time.perf_counter() - sent[0] < 1.5

    assert forked(child, seconds=200).returncode == 0


def test_compliance_is_read_where_it_is() -> None:
    data = cube()
    W = data.W.copy()
    problem = bp.ReducedProblem(W, data.q, data.mu)
    assert problem.W is W
    solution = problem.solve(tol=TOL)
    before = problem.residual(solution.reaction)
    assert before <= TOL
    W *= 2
    assert problem.residual(solution.reaction) > 1e-2
    # Half the force for the same displacement; η of both and the condition of W.
    halved = problem.solve(tol=TOL).reaction * 2
    size = np.abs(solution.reaction).max()
    np.testing.assert_allclose(halved, solution.reaction, rtol=0, atol=1e-9 * size)
    W /= 2
    assert problem.residual(solution.reaction) == before
    W[4, 7] = np.nan
    for ask in (problem.solve, lambda: problem.residual(solution.reaction)):
        with pytest.raises(ValueError, match=r"W is not finite at row 4, column 7"):
            ask()
