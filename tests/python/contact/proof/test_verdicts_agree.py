"""Verdicts of different functions agree, and their proofs hold."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.methods import WITHOUT_SUPPORTS
from support.verdicts import (
    agree,
    locals_of,
    proofs,
    proves_none,
    sliders,
    three_contacts,
)

Array = NDArray[np.float64]


def held_by_friction(mu: float) -> bp.ReducedProblem:
    """Friction must carry 2, which needs a pressure of 2/mu; a spring then opens by 8/mu."""
    rigid = (np.array([[0.0], [1.0]]), [-2.0])
    return bp.ReducedProblem(np.diag([4.0, 0.0]), [[0.0, -3.0]], mu, rigid=rigid)


@pytest.mark.parametrize("mu", 10.0 ** np.arange(-1, 10))
@pytest.mark.parametrize("method", WITHOUT_SUPPORTS)
def test_a_large_friction_hides_no_opening(mu: float, method: str) -> None:
    problem = held_by_friction(mu)
    assert problem.existence(exhaust=True).verdict == "none"
    assert problem.answers().complete
    for tol in (1e-12, 1e-10, 1e-6):
        assert not problem.solve(method, tol, max_iterations=2000).converged


def test_trying_all_statuses_is_a_proof() -> None:
    solution = held_by_friction(3e5).solve()
    assert str(solution.outcome) == "no_equilibrium"
    assert solution.free_motion is None
    assert "all 4 combinations of statuses were tried" in solution.message
    assert "lower the loads" not in solution.message


def test_diverging_reactions_are_not_a_solution() -> None:
    agree(range(18190, 18191))


def test_a_diverging_rigid_motion_does_not_raise_the_tolerance() -> None:
    # Free to slide and pressed by 1: any motion along the floor is a solution.
    rigid = (np.array([[0.0], [1.0]]), [0.0])
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.5]], 0.0, rigid=rigid)
    near = problem.solve()
    for amount in (1e3, 1e6, 1e9):
        far = replace(near, rigid_motion=np.array([amount]))
        solution = problem.solve(start=far, tol=1e-15)
        assert solution.converged
        assert solution.rigid_motion == pytest.approx([amount])
        # 4 ε times 1e4, the lengths that a solution may need.
        assert solution.tolerance <= 1e-10


def test_verdicts_agree() -> None:
    counts = agree(range(500))
    assert counts["exists"] > 350
    assert counts["absent"] > 70
    assert counts["bound global"] > 20
    assert counts["bound local"] > 80


@pytest.mark.slow
def test_verdicts_agree_twenty_thousand_times() -> None:
    agree(range(500, 20_500))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.quick_variants("0", "5")
def test_verdicts_agree_on_sliders(seed: int) -> None:
    assert sliders(range(10 * seed, 10 * seed + 10))["absent"] >= 1


@pytest.mark.slow
def test_verdicts_agree_on_a_thousand_sliders() -> None:
    sliders(range(60, 1060))


@pytest.mark.slow
def test_a_motion_is_reported_only_as_a_proof() -> None:
    counts = proofs(range(400))
    assert counts["motion"] > 40
    assert counts["statuses"] > 15


@pytest.mark.slow
def test_a_motion_is_reported_only_as_a_proof_ten_thousand_times() -> None:
    proofs(range(400, 10_400))


def refused(problem: bp.ContactProblem, load: Array) -> bp.BipotError | None:
    """The error that a solve raises."""
    try:
        problem.solve(load, max_iterations=2000)
    except bp.BipotError as error:
        return error
    return None


@pytest.mark.slow
def test_the_direction_of_an_error_proves() -> None:
    """The same for bodies given by K: K d = 0 shows that the motion d is rigid."""
    told = Counter[str]()
    for seed in range(300):
        rng = np.random.default_rng([23, seed])
        K = np.zeros((6, 6))
        for _ in range(int(rng.integers(3, 6))):
            bar = rng.integers(-2, 3, 6).astype(float)
            K += np.outer(bar, bar)
        mu = rng.uniform(0.0, 1.0, 3)
        load = rng.integers(-3, 4, 6).astype(float)
        gap = rng.integers(0, 2, 3).astype(float) * (seed % 2)
        problem = bp.ContactProblem(K, np.eye(6), gap=gap, mu=mu)
        error = refused(problem, load)
        if error is None:
            continue
        assert "lower the loads" not in str(error)
        if isinstance(error, bp.NotConvergedError):
            told["open"] += 1
            continue
        d = error.direction
        told["statuses" if d is None else "motion"] += 1
        if d is None:
            assert "statuses were tried" in str(error)
            continue
        assert np.abs(K @ d.ravel()).max() <= 1e-9 * np.abs(K).max()
        assert (d[:, 0] - mu * np.abs(d[:, 1])).min() >= -1e-9
        assert load @ d.ravel() > 0
        assert problem.existence(load).verdict == "none"
    assert told["motion"] > 30
    assert told["statuses"] > 3


@pytest.mark.parametrize("exponent", [*range(-170, 151, 20), 150])
def test_a_bound_does_not_depend_on_scale(exponent: int) -> None:
    """Where r* = 0, and for problems scaled as a whole."""
    scale = 10.0**exponent
    problem = bp.ReducedProblem(4 * np.eye(2), [[3.0, 3.0]], 0.5)
    bound = problem.error_bound([[scale, 0.0]])
    assert bound.kind == "global"
    assert bound.energy is not None
    # ‖r‖ in the norm of W is 2 |r|.
    assert 2.0 <= bound.energy / scale <= 2.0 + 1e-12
    assert bound.reaction is not None
    assert 1.0 <= bound.reaction[0, 0] / scale <= 1.0 + 1e-12
    assert bound.energy_by_gap is None or bound.energy_by_gap >= bound.energy
    none = bp.ReducedProblem(4 * np.eye(2), [[0.0, 0.0]], 0.5)
    bound = none.error_bound([[scale, 0.1 * scale]])
    assert bound.energy is not None
    # Only the point has a size here, so the bound is a multiple of it.
    one = none.error_bound([[1.0, 0.1]])
    assert one.energy is not None
    assert bound.energy / scale == pytest.approx(one.energy, rel=1e-12)
    assert bound.energy / scale >= 2.0 * np.hypot(1.0, 0.1) * (1 - 1e-15)


@pytest.mark.parametrize("exponent", [-170, -90, -1, 60, 150])
def test_a_bound_of_random_problems_at_every_scale(exponent: int) -> None:
    scale = 10.0**exponent
    seen = 0
    for seed in range(40):
        rng = np.random.default_rng([24, seed])
        root = rng.normal(size=(4, 4))
        W = root @ root.T + np.eye(4)
        q, mu = rng.normal(size=(2, 2)), rng.uniform(0.05, 0.4, 2)
        r = np.abs(rng.normal(size=(2, 2))) * [1.0, 0.1]
        plain = bp.ReducedProblem(W, q, mu).error_bound(r)
        bound = bp.ReducedProblem(W, scale * q, mu).error_bound(scale * r)
        assert bound.kind == plain.kind
        if plain.energy is None or bound.energy is None:
            continue
        seen += 1
        # The scale is not a power of two, so it rounds the data; this error is times κ(W).
        assert bound.energy / scale == pytest.approx(plain.energy, rel=1e-11)
        # The point is far smaller or larger than the solution: the error is about r* or the point.
        small = bp.ReducedProblem(W, q, mu)
        answer = small.solve(tol=1e-15)
        far = small.error_bound(scale * r)
        assert far.energy is not None
        d = (scale * r - answer.reaction).ravel()
        size = float(np.abs(d).max())
        if size:
            true = size * np.sqrt((d / size) @ W @ (d / size))
            assert far.energy >= true * (1 - 1e-9)
    assert seen > 20


def test_a_bound_reports_overflow() -> None:
    problem = bp.ReducedProblem(4 * np.eye(2), [[3.0, 3.0]], 0.5)
    for size in (5e-324, 1e-300, 1e290):
        bound = problem.error_bound([[size, 0.0]])
        assert bound.energy is None
        assert "range of doubles" in bound.reason


def test_the_solution_lies_within_the_local_bound() -> None:
    W = np.array([[2.0, -1.0], [-1.0, 11.0]])
    problem = bp.ReducedProblem(W, [[-5.0, 0.0]], 3.0)
    r = np.array([[2.857099, 0.187654]])
    bound = problem.error_bound(r)
    (answer,) = problem.answers()
    d = (answer.reaction - r).ravel()
    assert bound.kind == "local"
    assert bound.energy is not None
    assert bound.alone_within is not None
    assert np.sqrt(d @ W @ d) <= bound.energy <= bound.alone_within


def test_local_verdicts_hold() -> None:
    assert locals_of(range(120))["bound local"] > 100


@pytest.mark.slow
def test_local_verdicts_hold_ten_thousand_times() -> None:
    assert locals_of(range(120, 12_000))["bound local"] > 10_000


def test_the_gap_of_a_contact_that_penetrates_is_negative() -> None:
    """As documented: a sum of such gaps is not a bifunctional."""
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.0]], 0.5)
    bound = problem.error_bound([[0.5, 0.0]])
    assert bound.total == Fraction(-1, 4)


def test_proofs_are_checked_by_their_definition() -> None:
    given = three_contacts(0)
    assert given.rigid is not None
    R, e = given.rigid
    # The proof opposes neither the loads nor a contact.
    assert not proves_none(-(R @ e).reshape(3, 2), given)
