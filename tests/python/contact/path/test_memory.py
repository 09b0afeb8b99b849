"""Memory: K of a caller is borrowed; long use does not grow, and no object stays alive."""

import ctypes
import gc
import sys
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bars import bar_problem, pulled
from support.children import RESET, forked, memory
from support.methods import METHODS
from support.pressed_in_space import arrays
from support.random_problems import KINDS, random_problem

pytestmark = pytest.mark.needs_extra


class _Heap(ctypes.Structure):
    """`struct mallinfo2` of glibc: `uordblks` bytes in use, `hblkhd` bytes mapped."""

    _names = (
        "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    )
    _fields_ = [(name, ctypes.c_size_t) for name in _names.split()]


def in_use() -> tuple[int, int]:
    """Bytes in use on the heap, and resident bytes."""
    gc.collect()
    libc = ctypes.CDLL(None)
    libc.malloc_trim(0)
    libc.mallinfo2.restype = _Heap
    heap = libc.mallinfo2()
    return heap.uordblks + heap.hblkhd, memory("VmRSS")


def growth(work: Callable[[int], object], warm_up: int, rounds: int) -> None:
    """Change of the memory of a child process between warm-up and end.

    The limit is one per cent of a process that has loaded this package and solved a
    problem. A problem kept alive, or a few bytes lost in each call, exceed it by far.
    """

    def child() -> int:
        for k in range(warm_up):
            work(k)
        # What is loaded once may come late; a leak grows in every part.
        grown, first = True, warm_up
        while grown and first < warm_up + 2 * rounds:
            before = in_use()
            for k in range(first, first + rounds):
                work(k)
            after = in_use()
            sys.stdout.write(f"heap, resident: {before} -> {after}")
            grown = any(b > 1.01 * a for a, b in zip(before, after, strict=True))
            first += rounds
        return int(grown)

    run = forked(child, seconds=900)
    assert run.returncode == 0, run.stdout


def use_small_problems(seed: int) -> None:
    """Problems of a random kind, solved or refused."""
    W, q, mu, rigid = random_problem(KINDS[seed % len(KINDS)], 2 + seed % 2, seed)
    reduced = bp.ReducedProblem(W, q, mu, rigid=rigid)
    # Some methods need supports.
    with suppress(ValueError):
        solution = reduced.solve(METHODS[seed % len(METHODS)], max_iterations=200)
        _ = solution.unique, solution.error_estimate, reduced.residual(q)
    with suppress(bp.BipotError):
        result = bp.solve(W, np.eye(q.size), q.ravel(), gap=q[:, 0], mu=mu)
        _ = result.displacement, result[-1].message
    bp.project(q, mu)
    with pytest.raises(ValueError, match="mu"):
        bp.ReducedProblem(W, q, -1.0)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_thousands_of_small_problems() -> None:
    growth(use_small_problems, 1000, 4000)


def test_nothing_is_kept_alive() -> None:
    problem, load = bar_problem(6)

    class Callback:
        def __call__(self, k: int, step: bp.Step) -> None: ...

    callback = Callback()
    result = problem.solve(pulled(load, np.array([1.0, 2.0])), on_step=callback)
    reduced = problem.reduced(load)
    solution = reduced.solve()
    _ = result.displacement, solution.unique, result[1].error_estimate
    step = result[1]
    kept = [weakref.ref(x) for x in (result, reduced, callback, solution)]
    last = [weakref.ref(problem), weakref.ref(step)]
    held = sys.getrefcount(load)
    del problem, result, reduced, solution, callback
    gc.collect()
    assert [ref() for ref in kept] == [None] * 4
    # A step keeps its problem alive, because its properties need it.
    assert np.isfinite(step.displacement).all()
    del step
    gc.collect()
    assert [ref() for ref in last] == [None] * 2
    assert sys.getrefcount(load) <= held


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
