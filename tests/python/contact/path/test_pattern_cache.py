"""Problems with one pattern share their orderings, which are counted."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bodies import Body, block, uniform_shear
from support.children import forked

LIMIT = "BIPOT_PATTERN_CACHE_MB"


def body(cells: int, young: float = 100.0) -> Body:
    """Each test uses its own sizes, so that its pattern is not yet in the cache."""
    return block([4.0, 2.0], [2 * cells + 1, cells], young, 0.3)


def problem(of: Body, **more: Any) -> bp.ContactProblem:
    fixed = np.concatenate([of.dofs(1, 2.0, k) for k in range(2)])
    arguments = {"gap": of.gap, "mu": 0.4, "fixed": fixed, "area": of.area}
    return bp.ContactProblem(more.pop("K", of.K), of.B, **(arguments | more))


def orderings(made: bp.ContactProblem) -> int:
    return int(made.stats["orderings"])


def test_a_pattern_is_ordered_once_whatever_the_numbers() -> None:
    """Also those of an update."""
    pattern, other = body(9), body(9, young=7.0)
    first = problem(pattern)
    again = problem(other, mu=0.1, gap=other.gap + 0.25, area=None, num_threads=1)
    assert (orderings(first), orderings(again)) == (1, 0)
    assert again.stats["ordering"] == first.stats["ordering"]
    assert again.stats["flops"] == first.stats["flops"]
    assert again.stats["seconds_order"] == again.stats["seconds_symbolic"] == 0
    again.update(3.0 * pattern.K)
    assert orderings(again) == 0


def test_stored_zeros() -> None:
    """In a grid the material decides which entries cancel within the blocks of nodes."""
    here = body(10)
    stored = sparse.csr_array(here.K)
    clean = stored.copy()
    clean.eliminate_zeros()
    # Every entry of each coupled pair of nodes, then every entry of the matrix.
    n = stored.shape[0]
    pairs = sparse.bsr_array(clean, blocksize=(2, 2)).tocsr()
    rows, columns = np.indices((n, n)).reshape(2, -1)
    whole = sparse.coo_array((clean.toarray().ravel(), (rows, columns))).tocsr()
    assert clean.nnz < pairs.nnz < whole.nnz == n**2
    made = [problem(here, K=K) for K in (pairs, whole, clean)]
    # Stored zeros between uncoupled nodes cost nothing. Zeros within coupled nodes keep the
    # unknowns of a node together and fill in anyway.
    assert [orderings(problem_made) for problem_made in made] == [1, 1, 0]
    counts = [problem_made.stats["nnz_factor"] for problem_made in made]
    assert counts[1] == counts[2]
    assert counts[0] <= 1.05 * counts[2]
    W = [problem_made.compliance for problem_made in made]
    # Other orderings round differently: S is right to 1e-14, W to that times cond(S).
    bound = 1e-14 * made[0].stats["cond_S"] * np.abs(W[0]).max()
    assert np.abs(W[0] - W[1]).max() <= bound


def test_the_cache_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    here = body(8)
    load = uniform_shear(here, 0.2, [0.05])

    def answer() -> tuple[int, bytes, bytes, bytes]:
        made = problem(here)
        result = made.solve(load)
        values = made.compliance, result.reaction, result.displacement
        return (orderings(made), *(value.tobytes() for value in values))  # type: ignore[return-value]

    first, second = answer(), answer()
    monkeypatch.setenv(LIMIT, "0")
    alone = answer()
    assert [first[0], second[0], alone[0]] == [1, 0, 1]
    assert first[1:] == second[1:] == alone[1:]


def test_different_patterns_are_distinguished() -> None:
    here = body(7)
    assert orderings(problem(here)) == 1
    fixed = np.concatenate([here.dofs(1, 2.0, k) for k in range(2)])
    places = np.ascontiguousarray(here.basis.doflocs.T)
    assert places.shape == (here.K.shape[0], 2)
    # One support less, contacts in another order, stored entries where there were none, a
    # spring between uncoupled unknowns: about the same number of entries each time.
    n = here.K.shape[0]
    spring = sparse.csr_array(([1e-3] * 4, ([0, 0, 9, 9], [0, 9, 0, 9])), shape=(n, n))
    turned = np.arange(here.B.shape[0]).reshape(-1, 2)[::-1].ravel()
    others = (
        lambda: problem(here, fixed=fixed[1:]),
        lambda: bp.ContactProblem(
            here.K, here.B[turned], gap=here.gap[::-1], mu=0.4, fixed=fixed
        ),
        lambda: problem(here, coordinates=places),
        lambda: problem(here, coordinates=2 * places),
        lambda: problem(here, K=sparse.csr_array(here.K) + spring),
    )
    for make in others:
        assert (orderings(make()), orderings(make())) == (1, 0)


def test_the_least_recently_used_pattern_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(LIMIT, "1")
    # Some 0.3 MB each: three fit, four do not.
    a, b, c, d = (body(cells) for cells in (24, 25, 26, 27))
    # A pattern larger than the limit is made each time and removes no other.
    large = block([4.0, 2.0], [104, 52], 1.0, 0.3)
    asked = [(a, 1), (b, 1), (a, 0), (c, 1), (d, 1), (d, 0), (b, 1)]
    for pattern, count in [*asked, (large, 1), (large, 1), (b, 0)]:
        assert orderings(problem(pattern)) == count


@pytest.mark.parametrize("value", ["abc", "-1", "1.5", "64MB", "9" * 40])
def test_a_wrong_cache_size(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LIMIT, value)
    words = f'{LIMIT} is "{value}", expected a whole number of megabytes'
    with pytest.raises(ValueError, match=words):
        problem(body(6))
    # An empty variable counts as not set.
    monkeypatch.setenv(LIMIT, "")
    assert problem(body(6)).stats["n"] > 0


def test_threads_share_one_pattern() -> None:
    here = body(11)
    expected = problem(here).compliance.tobytes()

    def work(cells: int) -> bytes:
        return problem(body(cells), num_threads=1).compliance.tobytes()

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(work, [11, 5, 11] * 4))
    assert answers[::3] + answers[2::3] == [expected] * 8


def test_a_forked_child_has_its_own() -> None:
    here = body(12)
    expected = problem(here).compliance.tobytes()

    def work() -> None:
        assert [orderings(problem(here)) for _ in range(2)] == [1, 0]
        assert problem(here).compliance.tobytes() == expected

    assert forked(work).returncode == 0
    assert orderings(problem(here)) == 0
