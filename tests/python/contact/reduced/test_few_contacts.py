"""Problems of a few contacts are solved on the calling thread: same bits, no thread."""

from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from support.children import forked

METHODS = ("auto", "newton", "gauss_seidel", "nesterov", "uzawa_two_projection")


def problem(contacts: int, d: int, seed: int) -> bp.ReducedProblem:
    """A random compliance, and free displacements that mostly penetrate."""
    rng = np.random.default_rng([contacts, d, seed])
    n = contacts * d
    root, q = rng.normal(size=(n, n)), rng.normal(size=(contacts, d))
    q[:, 0] -= 0.5
    return bp.ReducedProblem(
        root @ root.T / n + np.eye(n) / 9, q, rng.uniform(0, 1, contacts)
    )


@pytest.mark.parametrize("contacts", [1, 3, 11, 30])
@pytest.mark.parametrize("d", [2, 3])
def test_the_bits_are_those_of_a_worker(contacts: int, d: int) -> None:
    """With a callback a worker of the pool does the work, while this thread calls back."""
    for seed, method in enumerate(METHODS):
        reduced = problem(contacts, d, seed)
        here = reduced.solve(method)
        worker = reduced.solve(method, callback=lambda *_: None)
        for name in ("reaction", "relative_displacement", "status", "history"):
            assert getattr(here, name).tobytes() == getattr(worker, name).tobytes()
        assert (here.outcome, here.work) == (worker.outcome, worker.work)


def test_a_hundred_contacts_wake_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BIPOT_NUM_THREADS", "2")

    def threads() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    def make(n: int) -> bp.ReducedProblem:
        return bp.ReducedProblem(np.eye(3 * n), -np.ones((n, 3)), 0.3)

    def child() -> None:
        before, few = threads(), make(100)
        few.residual(few.solve().reaction)
        assert few.solve().unique
        assert threads() == before
        make(101).solve()
        assert threads() == before + 2

    assert forked(child).returncode == 0


def test_a_forked_child_solves_few_contacts_after_many() -> None:
    """The pool of the parent is not in the child, nor is rayon's."""
    expected = problem(8, 3, 0).solve().reaction
    problem(101, 3, 0).solve()

    def child() -> None:
        assert np.array_equal(problem(8, 3, 0).solve().reaction, expected)

    assert forked(child).returncode == 0


@pytest.mark.parametrize("d", [2, 3])
def test_without_contacts_nothing_is_unknown(d: int) -> None:
    problem = bp.ReducedProblem(np.zeros((0, 0)), np.zeros((0, d)), 0.3)
    assert problem.solve().converged
    assert problem.existence().verdict == "guaranteed"
    answers = problem.answers()
    assert answers.complete
    assert [answer.reaction.shape for answer in answers] == [(0, d)]
    assert problem.reaction_ranges() == []
    with pytest.raises(ValueError, match="contact is 0, but the problem has no contac"):
        problem.reaction_range(0)
