"""`ReducedProblem` with cohesion and dilatancy: closed forms, oracles, invariances, refusals."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

import bipot_rs as bp
from support.cohesive_oracle import (
    Law,
    list_plane_answers,
    violation,
)

Array = NDArray[np.float64]
OPEN, SLIP, STICK = bp.Status.OPEN, bp.Status.SLIP, bp.Status.STICK
METHODS = (
    "auto", "newton", "gauss_seidel", "nesterov", "uzawa", "uzawa_two_projection",
    "return_mapping", "perturbed_lagrangian", "displacement_principle", "stress_principle",
    "minimising_sequence",
)  # fmt: skip


def one(
    q: Any, mu: float = 0.5, w: tuple[float, float] = (2.0, 1.0), **law: Any
) -> bp.Solution:
    """One contact in the plane whose normal and tangent are not coupled."""
    return bp.ReducedProblem(np.diag(w), [q], mu, **law).solve()


def draw(rng: np.random.Generator, n: int, d: int, coupling: float = 1.0) -> Any:
    """A definite compliance, and laws of which some have no cohesion, friction or dilatancy."""
    root = rng.normal(size=(n * d, n * d))
    W = coupling * root @ root.T / (n * d) + 0.3 * np.eye(n * d)
    mu = rng.uniform(0.0, 1.0, n) * (rng.random(n) > 0.2)
    c = 10 ** rng.uniform(-2, 0.5, n) * (rng.random(n) > 0.3)
    beta = mu * rng.choice([0.0, 0.4, 1.0], n)
    return W, rng.normal(size=(n, d)), Law(mu, c, beta)


def make(W: Array, q: Array, law: Law, **more: Any) -> bp.ReducedProblem:
    return bp.ReducedProblem(W, q, law.mu, cohesion=law.c, dilatancy=law.beta, **more)


def fails(W: Array, q: Array, law: Law, solution: bp.Solution) -> float:
    """The violation, with `v` computed here."""
    r = solution.reaction
    v = (W @ r.ravel()).reshape(q.shape) + q
    size = np.abs(q).max()
    assert np.abs(v - solution.relative_displacement).max() <= 1e-12 * size
    return violation(r, v, law, max(np.abs(r).max(), 1e-300), size)


# Closed forms of one contact.


@pytest.mark.parametrize(
    ("q", "mu", "cohesion", "reaction", "status"),
    [
        # mu = 0 is Tresca's law: sticks below c, slides at c, for any pressure.
        ([-1.0, 0.3], 0.0, 0.4, [0.5, -0.3], STICK),
        ([-1.0, 0.75], 0.0, 0.4, [0.5, -0.4], SLIP),
        ([-1.0, 0.75], 0.0, 0.0, [0.5, 0.0], SLIP),
        # An open contact keeps its cohesion.
        ([1.0, 0.3], 0.5, 0.4, [0.0, -0.3], OPEN),
        ([1.0, -0.75], 0.5, 0.4, [0.0, 0.4], OPEN),
        # It slides at c + mu r_n; where this limit is reached exactly, it sticks.
        ([-1.0, 2.0], 0.5, 0.4, [0.5, -0.65], SLIP),
        ([-1.0, 0.625], 0.5, 0.375, [0.5, -0.625], STICK),
    ],
)
def test_one_contact_by_hand(
    q: list[float], mu: float, cohesion: float, reaction: list[float], status: int
) -> None:
    solution = one(q, mu=mu, cohesion=cohesion)
    np.testing.assert_allclose(solution.reaction, [reaction], rtol=1e-15)
    assert solution.status[0] == status
    assert solution.bipotential_gap[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("cohesion", [0.0, 0.25])
@pytest.mark.parametrize("share", [0.25, 1.0])
def test_slip_lifts_by_the_dilatancy(cohesion: float, share: float) -> None:
    """v_n = beta s with s = |q_t| - w_t (c + mu r_n) and v_n = w_n r_n + q_n."""
    mu, w_n, w_t, q_n, q_t = 0.5, 2.0, 1.0, -1.0, 2.0
    beta = share * mu
    r_n = (-q_n + beta * (q_t - w_t * cohesion)) / (w_n + beta * mu * w_t)
    slip = q_t - w_t * (cohesion + mu * r_n)
    solution = one([q_n, q_t], cohesion=cohesion, dilatancy=beta)
    np.testing.assert_allclose(
        solution.reaction, [[r_n, -(cohesion + mu * r_n)]], rtol=1e-14
    )
    np.testing.assert_allclose(
        solution.relative_displacement, [[beta * slip, slip]], rtol=1e-13
    )
    # Slip closes a gap that is smaller than its dilation.
    assert one([0.1, 2.0], dilatancy=beta).status[0] == SLIP
    assert one([1.1, 2.0], dilatancy=beta).status[0] == OPEN


# Oracles.


@pytest.mark.parametrize("seed", range(40))
def test_plane_problems_against_all_statuses(seed: int) -> None:
    rng = np.random.default_rng([37, seed])
    W, q, law = draw(rng, int(rng.integers(1, 4)), 2)
    answers = list_plane_answers(W, q, law)
    assert answers
    for method in ("auto", "gauss_seidel"):
        solution = make(W, q, law).solve(method)
        assert solution.converged
        # η has the condition number of W, some 10, on it.
        nearest = min(np.abs(solution.reaction - r).max() for r in answers)
        assert nearest <= 1e-8
    if solution.unique == "proved":
        assert len(answers) == 1
    assert solution.unique != "others exist" or len(answers) > 1


def test_an_associated_law_is_convex() -> None:
    """beta = mu: proved to be unique for any friction, where Coulomb's law is not."""
    rng = np.random.default_rng(40)
    W, q, _ = draw(rng, 5, 3, coupling=20.0)
    mu = np.full(5, 3.0)
    associated = bp.ReducedProblem(W, q, mu, dilatancy=mu).solve()
    assert associated.unique == "proved"
    assert bp.ReducedProblem(W, q, mu).solve().unique != "proved"
    # So is Tresca's, with a bound of the error for any cohesion.
    tresca = bp.ReducedProblem(W, q, 0.0, cohesion=mu).solve()
    assert tresca.unique == "proved"
    assert tresca.error.kind == "global"


def test_dilatancy_has_no_bound() -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.5, dilatancy=[0.5])
    bound = problem.error_bound([[1.0, 0.0]])
    assert bound.kind == "not available"
    assert bound.reason.startswith("contact 0 has dilatancy")


# Random classes, judged by the law itself.


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_methods_solve_the_law(method: str, d: int) -> None:
    for seed in range(12):
        rng = np.random.default_rng([42, d, seed])
        W, q, law = draw(rng, int(rng.integers(1, 6)), d)
        solution = make(W, q, law).solve(method, max_iterations=20_000)
        # The sequence of a bifunctional may end at a positive limit (section 8 of the theory).
        assert solution.converged or method == "minimising_sequence", seed
        if solution.converged:
            # The tolerance is 1e-10 of the reactions.
            assert fails(W, q, law, solution) <= 3e-9
            open_ones = solution.status == OPEN
            assert (open_ones == (solution.reaction[:, 0] == 0)).all()


def test_the_rest_of_a_pressure_in_a_start_opens() -> None:
    """The start has an η within the tolerance: the answer is this point, without the rest."""
    start = np.array([[1e-13, 0.0], [1.0, -0.2]])
    problem = bp.ReducedProblem(np.eye(4), [[1, 0], [-1, 0.2]], 0.5, cohesion=1.0)
    solution = problem.solve(start=start)
    assert solution.iterations == 0
    np.testing.assert_array_equal(solution.reaction, [[0, 0], [1, -0.2]])


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", ["plain", "strong", "singular", "extreme"])
def test_auto_solves_thousands(d: int, kind: str) -> None:
    for seed in range(1000):
        rng = np.random.default_rng([43, d, seed])
        n = int(rng.integers(1, 13))
        W, q, law = draw(rng, n, d, 10.0 if kind == "strong" else 1.0)
        if kind == "singular":
            root = rng.normal(size=(n * d, max(1, n * d - 3)))
            # In the range of W: else no displacement need fit.
            W, q = (
                root @ root.T / (n * d),
                (root @ rng.normal(size=root.shape[1])).reshape(n, d),
            )
        if kind == "extreme":
            law = law._replace(c=law.c * 10.0 ** rng.uniform(-8, 8, n))
        solution = make(W, q, law).solve()
        if solution.converged:
            assert fails(W, q, law, solution) <= 1e-7, seed
        assert solution.converged or kind in ("singular", "strong"), seed


def test_bodies_that_only_contact_holds() -> None:
    """A block on two contacts, pulled sideways beyond Coulomb's limit: cohesion holds it."""
    legs = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    load = np.array([-1.0, 0.8])

    def solve(**law: Any) -> bp.Solution:
        return bp.ReducedProblem(
            0.1 * np.eye(4), np.zeros((2, 2)), 0.5, rigid=(legs, load), **law
        ).solve()

    assert solve().outcome == "no_equilibrium"
    held = solve(cohesion=0.2)
    assert held.converged
    assert (held.status == STICK).all()
    np.testing.assert_allclose(legs.T @ held.reaction.ravel(), -load, atol=1e-12)
    # c = 0.15 a contact is just too little: 0.5 + 0.3 = 0.8.
    weak = solve(cohesion=0.14)
    assert not weak.converged


# Invariances.


@pytest.mark.parametrize("d", [2, 3])
def test_units(d: int) -> None:
    rng = np.random.default_rng(45)
    W, q, law = draw(rng, 5, d)
    plain = make(W, q, law).solve()
    for force, length in ((2.0**40, 2.0**-33), (2.0**-7, 2.0**90)):
        other = make(
            W * (length / force), q * length, law._replace(c=law.c * force)
        ).solve()
        np.testing.assert_array_equal(other.reaction, plain.reaction * force)
        np.testing.assert_array_equal(other.status, plain.status)
    for force, length in ((1e12, 1e-12), (1e-12, 1e12)):
        other = make(
            W * (length / force), q * length, law._replace(c=law.c * force)
        ).solve()
        np.testing.assert_allclose(other.reaction, plain.reaction * force, rtol=1e-8)


def test_zero_numbers_are_coulombs_law_to_the_bit() -> None:
    rng = np.random.default_rng(47)
    W, q, law = draw(rng, 5, 3)
    plain = bp.ReducedProblem(W, q, law.mu).solve()
    zero = bp.ReducedProblem(W, q, law.mu, cohesion=0.0, dilatancy=np.zeros(5))
    np.testing.assert_array_equal(zero.solve().reaction, plain.reaction)
    assert zero.cohesion is None
    assert zero.dilatancy is None


# Derivatives.


@pytest.mark.parametrize("seed", range(16))
def test_derivatives_against_differences(seed: int) -> None:
    rng = np.random.default_rng([48, seed])
    n, d = 4, 2 + seed % 2
    W, q, law = draw(rng, n, d)
    law = law._replace(
        mu=law.mu + 0.1, c=law.c + 0.05, beta=np.full(n, 0.05)
    )  # away from zero
    change = [rng.normal(size=n) for _ in range(3)]
    of_q = rng.normal(size=q.shape)

    def solve(step: float) -> bp.Solution:
        moved = Law(*(x + step * dx for x, dx in zip(law, change, strict=True)))
        return make(W, q + step * of_q, moved).solve(tol=1e-14)

    solution, h = solve(0.0), 1e-6
    tangent = solution.jvp(
        q=of_q, mu=change[0], cohesion=change[1], dilatancy=change[2]
    )
    up, down = solve(h), solve(-h)
    if tangent.one_sided.any() or (up.status != down.status).any():
        pytest.skip("a border lies within the difference")
    for name in ("reaction", "relative_displacement"):
        slope = (getattr(up, name) - getattr(down, name)) / (2 * h)
        # Solutions to 1e-13 over 2e-6, and the curvature times h².
        np.testing.assert_allclose(getattr(tangent, name), slope, atol=2e-6)
    y, z = rng.normal(size=q.shape), rng.normal(size=q.shape)
    gradient = solution.vjp(reaction=y, relative_displacement=z)
    forward = np.sum(y * tangent.reaction) + np.sum(z * tangent.relative_displacement)
    backward = (
        np.sum(gradient.q * of_q)
        + gradient.mu @ change[0]
        + gradient.cohesion @ change[1]
        + gradient.dilatancy @ change[2]
    )
    assert backward == pytest.approx(forward, rel=1e-9, abs=1e-10)


# The border of the program.


def test_refused_methods_name_the_number() -> None:
    def solve(method: str, **law: Any) -> bp.Solution:
        return bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.5, **law).solve(method)

    with pytest.raises(ValueError, match=r"'pivoting'.*cohesion.*0\.25 at contact 0"):
        solve("pivoting", cohesion=0.25)
    with pytest.raises(ValueError, match=r"'pivoting'.*dilatancy.*0\.125 at contact 0"):
        solve("pivoting", dilatancy=0.125)
    with pytest.raises(ValueError, match=r"'alternating_principles'.*dilatancy"):
        solve("alternating_principles", dilatancy=0.125)
    assert solve("alternating_principles", cohesion=0.25).converged


def draw_balance(seed: int) -> dict[str, Any]:
    """One or two contacts in the plane, W of any rank, with and without rigid motions."""
    rng = np.random.default_rng([1991, seed])
    count = rng.integers(1, 3)
    rank, motions = rng.integers(0, 2 * count + 1), rng.integers(0, 3)
    root = rng.normal(size=(2 * count, rank))
    mu = rng.choice([0.0, rng.uniform(0.1, 1.5)], count)
    problem = {
        "W": root @ root.T,
        "q": rng.choice([0.0, 1.0]) * rng.normal(size=(count, 2)),
        "mu": mu,
        "cohesion": rng.choice([0.0, rng.uniform(0.1, 1.0)], count),
        "dilatancy": mu * rng.choice([0.0, 1.0, rng.random()], count),
    }
    if motions:
        load = rng.normal(size=motions) * rng.choice([0.2, 1.0])
        problem["rigid"] = rng.normal(size=(2 * count, motions)), load
    return problem


def has_answer(p: dict[str, Any]) -> bool:
    """Whether some statuses have a solution: each is a linear programme in r and a."""
    count = len(p["mu"])
    R, e = p.get("rigid", (np.zeros((2 * count, 0)), np.zeros(0)))
    # Rows of v and r in (r, a), with constants.
    V, v0 = np.hstack([p["W"], R]), p["q"].ravel()
    unit = np.eye(2 * count, V.shape[1])
    for statuses in itertools.product(range(6), repeat=count):
        zero = [
            (np.r_[column, np.zeros(R.shape[1])], load)
            for column, load in zip(R.T, e, strict=True)
        ]
        least = []
        for i, status in enumerate(statuses):
            n, t = 2 * i, 2 * i + 1
            mu, c, beta = p["mu"][i], p["cohesion"][i], p["dilatancy"][i]
            opened, way = status >= 3, (0, 1, -1)[status % 3]
            # With way: slip v_t = way |v_t|, and r_t = -way (c + mu r_n); else it sticks.
            zero.append(
                (unit[n], 0.0)
                if opened
                else (V[n] - way * beta * V[t], v0[n] - way * beta * v0[t])
            )
            least.append(
                (V[n] - way * beta * V[t], v0[n] - way * beta * v0[t])
                if opened
                else (unit[n], 0.0)
            )
            if way:
                zero.append((unit[t] + way * mu * unit[n], way * c))
                least.append((way * V[t], way * v0[t]))
            else:
                zero.append((V[t], v0[t]))
                least += [(mu * unit[n] + side * unit[t], c) for side in (1, -1)]
        A, b = np.array([row for row, _ in zero]), -np.array([x for _, x in zero])
        G, h = -np.array([row for row, _ in least]), np.array([x for _, x in least])
        found = linprog(np.zeros(A.shape[1]), G, h, A, b, bounds=(None, None))
        if found.status == 0:
            return True
    return False


@pytest.mark.quick_variants("0")
@pytest.mark.parametrize("part", range(20))
def test_existence_against_all_statuses(part: int) -> None:
    seen = set()
    for seed in range(20 * part, 20 * part + 20):
        p = draw_balance(seed)
        verdict = bp.ReducedProblem(**p).existence().verdict
        if verdict != "unknown":
            # Loads on a limit to the last digit are decided apart.
            assert has_answer(p) == (verdict == "guaranteed"), seed
        seen.add(verdict)
    assert seen == {"guaranteed", "none", "unknown"}


def test_refused_questions_name_the_number(tmp_path: Path) -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.5, cohesion=[0.25])
    for ask in (
        lambda: problem.reaction_range(0),
        lambda: bp.fclib.write(tmp_path / "x.hdf5", problem),
    ):
        with pytest.raises(ValueError, match=r"cohesion, which is 0\.25 at contact 0"):
            ask()
    held = bp.ReducedProblem(
        np.eye(2), [[-1.0, 0.2]], 0.5, dilatancy=0.5, rigid=([[1.0], [0.0]], [-1.0])
    )
    with pytest.raises(ValueError, match="residual without a does not take dilatancy"):
        held.residual([[1.0, 0.0]])
    assert not problem.answers(restarts=3).complete


def test_project_with_cohesion() -> None:
    tau = [[1.0, 0.6], [-1.0, 3.0], [0.5, 3.0], [-1.0, 0.2]]
    t, status = bp.project(tau, 0.5, cohesion=0.25)
    # Slip: the foot on the line t = c + mu n, at (n + mu (t - c)) / (1 + mu²).
    n = np.array([-1.0 + 0.5 * 2.75, 0.5 + 0.5 * 2.75]) / 1.25
    expected = [
        [1.0, 0.6],
        [n[0], 0.25 + n[0] / 2],
        [n[1], 0.25 + n[1] / 2],
        [0.0, 0.2],
    ]
    np.testing.assert_allclose(t, expected, rtol=1e-15)
    np.testing.assert_array_equal(status, [STICK, SLIP, SLIP, OPEN])
    moved, _ = bp.project(np.array(tau) - 0.5, 0.5, np.full((4, 2), 0.5), cohesion=0.25)
    np.testing.assert_allclose(moved, t - 0.5, atol=1e-15)
    with pytest.raises(ValueError, match=r"mu has two coefficients.*cohesion"):
        bp.project(np.ones((1, 3)), [[0.5, 0.4]], cohesion=0.25)
