"""Forks, threads, pools of processes, numbers of threads: no hang, and the same bits."""

import multiprocessing
import os
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from support.children import forked
from support.pressed_in_space import pressed

# A time limit against hanging: each of these takes a second or two.
pytestmark = [pytest.mark.timeout(60), pytest.mark.needs_extra]


def cube(cells: int = 5, num_threads: int | None = None) -> bp.ContactProblem:
    """A lattice of springs on a plane: large enough for METIS and for several fronts."""
    n = cells + 1
    line = sparse.diags_array(
        [np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)],
        offsets=[-1, 0, 1],
    )
    lattice = sparse.kronsum(sparse.kronsum(line, line), line)
    coupled = np.array([[2.0, 0.3, 0.1], [0.3, 1.5, 0.2], [0.1, 0.2, 1.0]])
    K = sparse.csr_array(sparse.kron(lattice, coupled))
    B = sparse.eye_array(3 * n * n, 3 * n**3, format="csr")
    return bp.ContactProblem(K, B, gap=np.zeros(n * n), mu=0.3, num_threads=num_threads)


def loads(n: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(3)
    path = rng.normal(size=(2, n))
    path[:, ::3] -= 1.0
    return path


def solve(problem: bp.ContactProblem) -> bytes:
    """Every bit of a path with two steps."""
    load = loads(int(problem.stats["n"]))
    result = problem.solve(load)
    return result.reaction.tobytes() + result.displacement.tobytes()


def answer(num_threads: int | None = None, cells: int = 5) -> bytes:
    return solve(cube(cells, num_threads))


@pytest.fixture(scope="module")
def expected() -> bytes:
    return answer()


@pytest.mark.parametrize("num_threads", [None, 1, 2, 3])
def test_any_number_of_threads(num_threads: int | None, expected: bytes) -> None:
    assert answer(num_threads) == expected


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.slow_variants("direct")
def test_a_forked_child_with_a_large_matrix(engine: str) -> None:
    """What is done in parallel for large arrays only: K has 980,000 entries."""
    case = pressed(15).assemble()
    expected = case.solve(case.problem(engine=engine)).reaction

    def child() -> None:
        again = pressed(15).assemble()
        reaction = again.solve(again.problem(engine=engine)).reaction
        assert np.array_equal(reaction, expected)

    assert forked(child).returncode == 0


def test_a_problem_made_before_the_fork(expected: bytes) -> None:
    problem = cube()
    load = loads(int(problem.stats["n"]))
    first_step = problem.solve(load[0])

    def child() -> None:
        assert solve(problem) == expected
        second = problem.solve(load[1], start=first_step)
        assert second.reaction[0].tobytes() == problem.solve(load).reaction[1].tobytes()

    assert forked(child).returncode == 0


@pytest.mark.slow
def test_forks_while_threads_solve(expected: bytes) -> None:
    """A fork copies the locks that other threads hold, but not those threads."""
    done = threading.Event()
    wrong: list[bool] = []

    def work(cells: int, bits: bytes) -> None:
        while not done.is_set():
            wrong.append(answer(cells=cells) != bits)

    seven = answer(cells=7)
    workers = [
        threading.Thread(target=work, args=(cells, bits))
        for cells, bits in ((5, expected), (7, seven))
    ]
    for worker in workers:
        worker.start()
    try:
        for k in range(12):
            time.sleep(0.001 * k)  # # interrupts their work at another point each time
            assert forked(lambda: answer() != expected).returncode == 0
    finally:
        done.set()
        for worker in workers:
            worker.join()
    assert wrong
    assert not any(wrong)


def test_threads_that_share_a_problem_or_have_their_own(expected: bytes) -> None:
    problem = cube()
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(answer, [None, 1, 2, None] * 3)) == {expected}
        assert set(pool.map(solve, [problem] * 12)) == {expected}


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.quick_variants("fork")
def test_pool_of_processes(method: str, expected: bytes) -> None:
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        reactions = list(pool.map(answer, [1, None, 2, 1], timeout=50))
    assert set(reactions) == {expected}


def workers() -> int:
    """Threads of the package's pool in this process."""
    tasks = Path("/proc/self/task").iterdir()
    return sum((task / "comm").read_text().startswith("bipot-") for task in tasks)


@pytest.mark.parametrize(
    ("asked", "bipot", "rayon", "count"),
    [
        (3, "2", "1", 3),
        (None, "2", "1", 2),
        (None, " 2 ", None, 2),
        (None, None, "3", 3),
        (None, "", "3", 3),
        (None, None, "0", len(os.sched_getaffinity(0))),
        (None, None, None, len(os.sched_getaffinity(0))),
    ],
)
def test_order_of_precedence(
    asked: int | None,
    bipot: str | None,
    rayon: str | None,
    count: int,
    expected: bytes,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in (("BIPOT_NUM_THREADS", bipot), ("RAYON_NUM_THREADS", rayon)):
        monkeypatch.delenv(name, raising=False)
        if value is not None:
            monkeypatch.setenv(name, value)

    def child() -> None:
        assert workers() == 0, "the pool of the parent"
        assert answer(asked) == expected
        # A thread takes its name when it first runs, which a busy machine delays.
        end = time.monotonic() + 10
        while workers() < count and time.monotonic() < end:
            time.sleep(0.01)
        assert workers() == count

    assert forked(child).returncode == 0


# For rayon zero threads are all of them.
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("BIPOT_NUM_THREADS", "0"),
        *product(
            ["BIPOT_NUM_THREADS", "RAYON_NUM_THREADS"],
            ["two", "-1", "1.5", "1e3", "1000000", "9" * 40],
        ),
    ],
)
def test_wrong_numbers_of_threads(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    words = f'{name} is "{value}", expected a whole number from 1 to'
    with pytest.raises(ValueError, match=words):
        bp.project([[1.0, 0.0]], 0.3)
    with pytest.raises(ValueError, match=words):
        cube(2)
