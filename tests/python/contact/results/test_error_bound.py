"""`error`: a sharp upper bound of the true error, or None with a reason."""

import itertools
import pickle
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from support.random_problems import random_problem

Array = NDArray[np.float64]
# With supports and definite W, where a bound can be proved.
KINDS = ("held", "graded", "flat", "frictionless", "open", "asymmetric", "cohesive")
# Sizes of error, from a first guess to a solution.
SIZES = np.array([1.0, 1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10])


def energy_norm(W: Array, d: Array) -> float:
    return float(np.sqrt(max(d.ravel() @ W @ d.ravel(), 0.0)))


def parts_of(bound: bp.ErrorBound) -> tuple[Array, Array, float]:
    """Bounds of r, of v and of the energy."""
    return bound.reaction, bound.relative_displacement, bound.energy


def approximations(answer: Array, mu: Array, rng: np.random.Generator) -> Array:
    """Points at distances `SIZES` from a solution, inside their cones or not."""
    size = np.abs(answer).max(axis=1, keepdims=True) + 0.1 * np.abs(answer).max()
    points = answer + SIZES[:, None, None] * rng.normal(size=(7, *answer.shape)) * size
    points[:, mu == 0, 1:] = 0.0
    return points


def excess(
    W: Array, point: Array, answer: Array, bound: bp.ErrorBound, blur: bp.ErrorBound
) -> float:
    """The largest amount by which an error exceeds its bound, relative to the solution.

    `answer` is exact to rounding only; its own error `blur` is added to the bound.
    """
    d = point - answer
    moved = (W @ d.ravel()).reshape(d.shape)
    in_r, in_v, in_energy = (
        a + b for a, b in zip(parts_of(bound), parts_of(blur), strict=True)
    )
    terms = (np.abs(W) @ np.abs(d).ravel()).reshape(d.shape)
    over = [
        (np.abs(d) - in_r).max() / np.abs(d).max(),
        ((np.abs(moved) - in_v) / np.where(terms > 0, terms, 1.0)).max(),
        (energy_norm(W, d) - in_energy) / (energy_norm(W, d) or 1.0),
    ]
    # d is rounded too: at most 20 unknowns, and W d has as many terms.
    return float(max(over)) - 1e-14


def ratios_of(seeds: range) -> Iterator[float]:
    """Bound over error of approximations, asserted; friction up to twice that of the kinds."""
    for seed, kind, d in itertools.product(seeds, KINDS, (2, 3)):
        rng, skewed = np.random.default_rng([seed, d]), kind == "asymmetric"
        plain = "held" if kind in ("asymmetric", "cohesive") else kind
        W, q, mu, _ = random_problem(plain, d, seed)
        if skewed:
            # The proof does not need symmetry.
            skew = 0.03 * rng.normal(size=W.shape) * np.abs(W).max()
            W = W + skew - skew.T
        mu = mu * (1 + seed % 3) / 1.5
        held = rng.exponential(size=len(mu)) * (rng.random(len(mu)) < 0.7)
        cohesion = held if kind == "cohesive" else None
        problem = bp.ReducedProblem(W, q, mu, cohesion=cohesion)
        solution = problem.solve(tol=1e-15)
        if not (solution.converged and solution.reaction.any()):
            continue  # # no solution, or only zero: there are no relative errors
        points = approximations(solution.reaction, mu, rng)
        bounds = problem.error_bounds(np.concatenate([points, solution.reaction[None]]))
        *bounds_of_points, blur = bounds
        for point, bound in zip(points, bounds_of_points, strict=True):
            assert bound.unique == (bound.kind == "global")
            if bound.kind == "global":
                beaten = excess(W, point, solution.reaction, bound, blur)
                assert beaten <= 0, (kind, d, seed)
                true = energy_norm(W, point - solution.reaction)
                if bound.energy_by_gap is not None:
                    assert true <= bound.energy_by_gap + parts_of(blur)[2]
                yield parts_of(bound)[2] / true


@pytest.mark.parametrize(
    ("seeds", "count"),
    [
        (range(22), 1000),
        pytest.param(range(22, 250), 10_000, marks=pytest.mark.slow),
    ],
)
def test_bound_holds(seeds: range, count: int) -> None:
    ratios = list(ratios_of(seeds))
    assert len(ratios) > count
    # The bound is also useful: these matrices have a condition of about ten.
    assert np.median(ratios) < 2
    assert np.quantile(ratios, 0.9) < 10


def differences(x: Array, exact: Iterable[Any]) -> list[Fraction]:
    return [Fraction(a) - Fraction(b) for a, b in zip(x.ravel(), exact, strict=True)]


def check_exactly(
    W: Array, d: list[Fraction], bound: bp.ErrorBound, w: list[Fraction] | None = None
) -> None:
    """The bound holds for the error d of r without rounding, and for w of v, else W d."""
    in_r, in_v, in_energy = parts_of(bound)
    moved = [sum(Fraction(a) * b for a, b in zip(row, d, strict=True)) for row in W]
    energy = sum(a * b for a, b in zip(moved, d, strict=True))
    assert energy <= Fraction(in_energy) ** 2
    for errors, limits in ((d, in_r), (w or moved, in_v)):
        for error, most in zip(errors, limits.flat, strict=True):
            assert abs(error) <= Fraction(most)


def test_units_change_no_bit() -> None:
    random_data = random_problem("held", 3, 4)
    problem = bp.ReducedProblem(random_data.W, random_data.q, random_data.mu)
    point = problem.solve("uzawa", 1e-4).reaction
    bound = problem.error_bound(point)
    for length, force in ((2.0**-40, 2.0**30), (2.0**17, 2.0**-5)):
        scaled = bp.ReducedProblem(
            random_data.W * (length / force), random_data.q * length, random_data.mu
        ).error_bound(point * force)
        assert bound.relative == scaled.relative
        (r, v, energy), (r2, v2, energy2) = parts_of(bound), parts_of(scaled)
        np.testing.assert_array_equal(r * force, r2)
        np.testing.assert_array_equal(v * length, v2)
        # √2 to an odd power is not a power of two.
        assert energy2 == pytest.approx(energy * np.sqrt(length * force), rel=4e-16)


def test_threads_change_no_bit() -> None:
    """Large enough for every kernel to use several threads."""
    rng = np.random.default_rng(8)
    size = 600
    root = rng.normal(size=(size, 2 * size))
    W = root @ root.T / (2 * size)
    q = rng.normal(size=(size // 3, 3))
    problem = bp.ReducedProblem((W + W.T) / 2, q, 0.05)
    point = problem.solve(tol=1e-4).reaction
    on_one_thread, two = (
        problem._problem.error_bounds(point, 1, np.empty(0), None, threads)[0]
        for threads in (1, 2)
    )
    assert on_one_thread.kind == "global"
    assert on_one_thread.energy == two.energy
    for name in ("reaction", "relative_displacement"):
        np.testing.assert_array_equal(getattr(on_one_thread, name), getattr(two, name))


@pytest.mark.parametrize("k_c", [0.1, -0.4, 0.7])
def test_one_contact_up_to_the_exact_limit(k_c: float) -> None:
    """Unique below μ = k_t/|k_c|; proved for k_c² ≤ ½ k_n k_t, up to the search."""
    k_n, k_t = 1.0, 1.0
    assert k_c**2 <= 0.5 * k_n * k_t
    W = np.linalg.inv([[k_n, k_c], [k_c, k_t]])
    limit = k_t / abs(k_c)
    q = np.array([[-1.0, 0.3]])
    below = bp.ReducedProblem(W, q, 0.9 * limit)
    assert below.solve().unique == "proved"
    assert below.error_bound(np.zeros((1, 2))).kind == "global"
    # Above the limit some loads have three solutions, so uniqueness cannot hold for all loads.
    above = bp.ReducedProblem(W, q, 1.001 * limit)
    assert above.solve().error.kind != "global"
    assert not above.solve().error.unique


def test_an_exact_answer_has_no_error() -> None:
    """Open contacts: the solution is r = 0, and every bound of r is zero."""
    W = np.array([[2.0, 0.5], [0.5, 1.0]])
    error = bp.ReducedProblem(W, [[1.0, -3.0]], 0.3).solve().error
    assert (error.energy, error.relative, error.total, error.share) == (0, 0, 0, 0)
    assert not parts_of(error)[0].any()


REASONS: list[tuple[str, bp.ReducedProblem]] = [
    ("contact alone holds a body",
     bp.ReducedProblem(np.eye(2), [[0.0, 0.0]], 0.5, rigid=([[1.0], [0.0]], [-1.0]))),
    ("not positive definite", bp.ReducedProblem(np.ones((4, 4)), -np.ones((2, 2)), 0.1)),
    ("contact 1, which just touches",
     bp.ReducedProblem(np.diag([1.0, 1.0, 0.0, 0.0]), [[-1.0, 0.0], [0.0, 0.0]], 0.1)),
    ("friction along a tangent", bp.ReducedProblem(np.diag([1.0, 0.0]), [[-1.0, 0.5]], 0.1)),
    ("is too large for a proof", bp.ReducedProblem([[1.0, 0.9], [0.9, 1.0]], [[-1.0, 0.0]], 50.0)),
]  # fmt: skip


@pytest.mark.parametrize(("words", "problem"), REASONS)
def test_reason_without_a_bound(words: str, problem: bp.ReducedProblem) -> None:
    error = problem.error_bound(np.zeros(problem.q.shape))
    assert error.kind == "not available"
    assert words in error.reason
    assert not error.unique
    rest = (error.energy, error.relative, error.reaction, error.relative_displacement)
    assert rest == (None,) * 4
    assert error.constitutive.shape == (len(problem.q),)


def test_a_reaction_that_the_law_excludes() -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.5]], 0.0)
    assert "the law excludes" in problem.error_bound([[1.0, 1e-9]]).reason
    assert problem.error_bound([[1.0, 0.0]]).relative == pytest.approx(0, abs=1e-14)


def test_wrong_arguments() -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.5]], 0.1)
    with pytest.raises(ValueError, match=r"r has shape \(2,\), expected \(1, 2\)"):
        problem.error_bound([1.0, 0.0])
    with pytest.raises(ValueError, match=r"reactions has shape"):
        problem.error_bounds(np.zeros((3, 2, 2)))
    with pytest.raises(ValueError, match=r"r .*nan"):
        problem.error_bound([[np.nan, 0.0]])
    assert problem.error_bounds(np.zeros((0, 1, 2))) == []


def test_bounds_of_a_path_and_of_its_pickle() -> None:
    K = np.array([[2.0, 0.5], [0.5, 1.0]])
    loads = [[-1.0, 0.2], [-1.0, 1.5], [-0.5, 1.5]]
    result = bp.solve(K, sparse.eye_array(2), loads, gap=[0.0], mu=0.3, area=[2.0])
    errors = result.error
    assert [error.kind for error in errors] == ["global"] * 3
    for step, error in zip(result, errors, strict=True):
        np.testing.assert_array_equal(error.traction, parts_of(error)[0] / 2.0)
        np.testing.assert_allclose(error.constitutive, step.bipotential_gap, atol=1e-14)
    asked, unasked = pickle.loads(pickle.dumps(result[0])), result[1]
    assert asked.error.energy == errors[0].energy
    lost = pickle.loads(
        pickle.dumps(bp.solve(K, sparse.eye_array(2), loads[1], gap=[0.0], mu=0.3)[0])
    )
    assert "problem is not available" in lost.error.reason
    # A body with supports: ‖u - u*‖ in K equals ‖r - r*‖ in W. By hand, it slides:
    # u_n = 0, 0.5 u_t = -1 + r_n and u_t = 1.5 - 0.3 r_n.
    d = unasked.displacement - [0.0, 1.5 - 0.3 * 1.75 / 1.15]
    assert np.sqrt(d @ K @ d) <= parts_of(errors[1])[2]


def test_without_contacts_the_error_is_zero() -> None:
    problem = bp.ReducedProblem(np.zeros((0, 0)), np.zeros((0, 2)), 0.3)
    for bound in (problem.error_bound(np.zeros((0, 2))), problem.solve().error):
        assert bound.total == 0.0
        assert bound.energy == 0.0
    assert problem.error_bounds(np.zeros((3, 0, 2)))[2].energy == 0.0


def dyadic(values: Array, bits: int) -> Array:
    """Rounded to multiples of a power of two, so that sums of products are exact."""
    return np.asarray(np.round(np.ldexp(values, bits)) * 0.5**bits)


def exact_case(
    rng: np.random.Generator, d: int, soft: float
) -> tuple[bp.ReducedProblem, Array, Array]:
    """A problem whose solution is exact in doubles: ``r`` and ``v``; in space two coefficients.

    A contact that slides has ``D v_t = mu_1 mu_2 k (3, 4)``, of length ``5 mu_1 mu_2 k``, so
    that ``r_t = -r_n (3 mu_1, 4 mu_2)/5``; ``r_n`` is a multiple of 5. The ratio of the two
    coefficients, which the change of variables needs, is rounded.
    """
    n, way = (
        (int(rng.integers(1, 6)), [3, 4]) if d == 3 else (int(rng.integers(1, 4)), [5])
    )
    root = rng.normal(size=(d * n, d * n))
    grade = np.repeat(np.where(rng.random(n) < 0.5, 1.0, soft), d)
    W = dyadic(root @ root.T / (d * n) + np.eye(d * n), 10) * np.outer(grade, grade)
    mu = rng.integers(1, 16, (n, d - 1)) / 32
    r, v = np.zeros((2, n, d))
    for i, status in enumerate(rng.integers(0, 3, n)):
        force = 5 * rng.integers(1, 64) / 16
        sign = rng.choice([-1.0, 1.0], d - 1)
        if status == 0:
            v[i] = rng.integers(-64, 64, d) / 64
            v[i, 0] = rng.integers(1, 64) / 64
        elif status == 1:
            r[i, 0] = force
            r[i, 1:] = dyadic(0.7 * force * mu[i] * rng.uniform(-1, 1, d - 1), 8)
        else:
            r[i, 0] = force
            r[i, 1:] = -force / 5 * mu[i] * way * sign
            v[i, 1:] = mu[i, ::-1] * way * sign * rng.integers(1, 64) / 16
    moved = [sum(map(Fraction, row * r.ravel())) for row in W]
    q = [Fraction(x) - y for x, y in zip(v.ravel(), moved, strict=True)]
    friction = mu if d == 3 else mu[:, 0]
    problem = bp.ReducedProblem(W, np.array(q, dtype=float).reshape(n, d), friction)
    assert [Fraction(x) for x in problem.q.ravel()] == q
    return problem, r, v


@pytest.mark.parametrize(
    ("d", "soft", "count"),
    # With `soft`, W has a condition of 1e8: a solve loses half of all digits.
    [
        (2, 1.0, 40),
        (2, 2.0**-13, 40),
        (3, 1.0, 15),
        pytest.param(3, 1.0, 400, marks=pytest.mark.slow),
    ],
)
def test_bound_holds_exactly(d: int, soft: float, count: int) -> None:
    """At the solution, at computed ones and at approximations, without a rounding to spare."""
    rng = np.random.default_rng(count)
    available = 0
    for _ in range(count):
        problem, r, v = exact_case(rng, d, soft)
        W = np.asarray(problem.W)
        solution = problem.solve(tol=10.0 ** rng.uniform(-14, -6))
        points = [(solution.reaction, solution.relative_displacement, solution.error)]
        for size in (0.0, 1e-15, 1e-10, 1e-4):
            near = r + size * np.abs(r).max() * rng.normal(size=r.shape)
            points.append((near, None, problem.error_bound(near)))
        for near, reported, bound in points:
            if bound.kind == "not available":
                assert "friction" in bound.reason
                continue
            available += 1
            told = None if reported is None else differences(reported, v.flat)
            check_exactly(W, differences(near, r.flat), bound, told)
            if near is r:
                # The rounding of W r + q and of its change of variables.
                assert parts_of(bound)[2] <= 1e-12 * energy_norm(W, r) + 1e-12
    assert available > 3 * count


def test_two_coefficients_on_a_path() -> None:
    """Bounds of steps with a history: the change of variables rounds it too."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(9, 9))
    K, mu = (
        root @ root.T + 9 * np.eye(9),
        np.array([[0.3, 0.1], [0.2, 0.25], [0.1, 0.3]]),
    )
    problem = bp.ContactProblem(K, np.eye(9), gap=np.zeros(3), mu=mu)
    loads = rng.normal(size=(4, 9)) - np.tile([3.0, 0, 0], 3)
    result = problem.solve(loads, tol=1e-12)
    for k in range(4):
        assert result[k].error.kind == "global"
        start = result[k - 1] if k else None
        again = problem.reduced(loads[k], start=start).solve(tol=1e-14)
        # The other computed answer has an error of its own, of some 1e-14.
        away = np.abs(again.reaction - result[k].reaction)
        assert (
            away <= result[k].error.reaction + 1e-13 * np.abs(again.reaction).max()
        ).all()
        assert result[k].error.relative < 1e-10
