"""The oracle agrees with closed forms, and its two algorithms agree with each other."""

import csv

import numpy as np
import pytest
from numpy.typing import NDArray

from support.anisotropic_slip import ANISOTROPIC_SLIP
from support.conditions import violation
from support.oracle import OPEN, SLIP, STICK, Problem, answers
from support.places import REFERENCE
from support.smoothing import follow

Array = NDArray[np.float64]
DATA = REFERENCE
# Dense solves with a dozen unknowns and a condition below 1e3: rounding times condition.
ROUNDING = 1e-12


def random_problem(seed: int, contacts: int, dim: int) -> Problem:
    """Positive definite W, pressed on average; all three statuses occur."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(contacts * dim, contacts * dim))
    q = rng.normal(size=(contacts, dim))
    q[:, 0] -= 1
    return Problem(root @ root.T + 0.3 * np.eye(contacts * dim), q, 0.4)


def test_each_violation_is_found() -> None:
    r, v = np.array([[1.0, -0.5]]), np.array([[0.0, 2.0]])
    assert violation(r, v, 0.5) == 0
    for wrong_r, wrong_v in [
        (-r, v),  # tension
        (r, np.array([[-1.0, 2.0]])),  # penetration
        (r, np.array([[1.0, 2.0]])),  # force at a distance
        (np.array([[1.0, -0.6]]), v),  # # outside the cone
        (np.array([[1.0, -0.4]]), v),  # slip below the limit
        (np.array([[1.0, 0.5]]), v),  # slip along the force
    ]:
        assert violation(wrong_r, wrong_v, 0.5) > 0.04
    turned = np.array([[0.0, 1.0, 1.0]])  # slip not opposite to the reaction
    assert violation(np.array([[1.0, -0.5, 0.0]]), turned, 0.5) > 0.04


def test_enumeration_finds_every_listed_branch() -> None:
    listed: dict[tuple[float, float], list[list[float]]] = {}
    with (DATA / "one_contact_branches.csv").open() as file:
        for row in csv.DictReader(file):
            values = [float(row[name]) for name in ("r_n", "r_t", "u_n", "u_t")]
            key = float(row["mu"]), float(row["f_t"])
            listed.setdefault(key, []).append(values)
    W = np.linalg.inv([[2.0, 0.5], [0.5, 1.0]])
    for (mu, f_t), rows in listed.items():
        problem = Problem(W, (W @ [-1.0, f_t])[None], mu)
        branches = sorted([*x.r[0], *x.v[0]] for x in answers(problem))
        assert len(branches) == len(rows)
        for got, want in zip(branches, sorted(rows), strict=True):
            # Twelve digits are printed.
            assert got == pytest.approx(want, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize(("W", "r", "v"), ANISOTROPIC_SLIP)
def test_slip_of_an_anisotropic_contact(
    W: list[list[float]], r: list[float], v: list[float]
) -> None:
    problem = Problem(np.array(W), np.array([[-1.0, 1.6, 0.9]]), 0.4)
    (only,) = answers(problem)
    assert only.status == (SLIP,)
    # Eight decimals are printed.
    np.testing.assert_allclose(only.r[0], r, atol=1e-8)
    np.testing.assert_allclose(only.v[0], v, atol=1e-8)
    np.testing.assert_allclose(follow(problem).r, only.r, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("contacts", "dim", "seeds"), [(1, 2, 20), (3, 2, 10), (1, 3, 20), (2, 3, 3)]
)
@pytest.mark.quick_variants("1-2-*")
def test_both_routes_agree(contacts: int, dim: int, seeds: int) -> None:
    seen: set[int] = set()
    for seed in range(seeds):
        problem = random_problem(seed, contacts, dim)
        all_answers = list(answers(problem))
        # The number of solutions is odd, because the map has degree one.
        assert len(all_answers) % 2 == 1
        followed = follow(problem)
        near = min(np.abs(followed.r - x.r).max() for x in all_answers)
        assert near <= ROUNDING * problem.force
        seen.update(followed.status)
    assert seen == {OPEN, SLIP, STICK}


def test_body_held_by_contact_alone() -> None:
    # A rigid bar on two supports, loaded at a quarter from the left: 3 to 1, by moments.
    at = np.array([0.0, 1.0])
    R = np.array([[1.0, 0.0, at[0]], [0, 1, 0], [1, 0, at[1]], [0, 1, 0]])
    e = np.array([-4.0, 0.8, -1.0])  # weight 4, 0.8 along the supports, moment
    problem = Problem(np.eye(4) * 1e-2, np.zeros((2, 2)), 0.5, (R, e))
    followed = follow(problem)
    np.testing.assert_allclose(followed.r[:, 0], [3, 1], rtol=ROUNDING)
    assert followed.r[:, 1].sum() == pytest.approx(-0.8, rel=ROUNDING)
    assert any(np.allclose(x.r, followed.r, rtol=1e-10) for x in answers(problem))


def test_no_solution_is_found_if_there_is_none() -> None:
    # The same bar pushed beyond the limit: 2.1 > 0.5 · 4.
    R = np.array([[1.0, 0.0, 0.0], [0, 1, 0], [1, 0, 1], [0, 1, 0]])
    e = np.array([-4.0, 2.1, -1.0])
    problem = Problem(np.eye(4) * 1e-2, np.zeros((2, 2)), 0.5, (R, e))
    assert list(answers(problem)) == []
    with pytest.raises(AssertionError, match="no answer"):
        follow(problem)
