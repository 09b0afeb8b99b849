"""Hard cases: vertices, redundancy, bad input, histories. H1, H2, … are their ids."""

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.conditions import violation
from support.contacts import K1, SMALL, TOL, one_node
from support.methods import EVERY_WAY
from support.oracle import Problem, answers

OPEN, SLIP, STICK = bp.Status.OPEN, bp.Status.SLIP, bp.Status.STICK


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("f_t", [0.0, 0.3, -0.3])
def test_h1_vertex(f_t: float, engine: str) -> None:
    result = one_node([0.0, f_t], 0.5, stiffness=np.diag([2.0, 1.0]), engine=engine)
    np.testing.assert_allclose(result.reaction[0, 0], 0, atol=SMALL)
    np.testing.assert_allclose(result.displacement[0], [0, f_t], atol=SMALL)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_h2_zero_slip(engine: str) -> None:
    result = one_node([-1.0, 0.0], 0.5, engine=engine)
    assert result.status[0, 0] == STICK
    np.testing.assert_allclose(result.reaction[0, 0], [1, 0], atol=SMALL)
    # Only K⁻¹ and the solve have rounding errors if the statuses are right.
    np.testing.assert_allclose(result.slip[0, 0], 0, atol=4e-16)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_h3_grazing_gap(engine: str) -> None:
    answers_at = [
        one_node([-1.0, 1.9], 0.5, gap=g, engine=engine) for g in (0.0, 1e-16, -1e-16)
    ]
    for result in answers_at:
        np.testing.assert_allclose(result.reaction[0, 0], [1.56, -0.78], rtol=SMALL)
        np.testing.assert_allclose(result.displacement[0, 1], 1.12, rtol=SMALL)
        # A gap of 1e-16 changes the force by 1e-16; each solution has η = 1e-12.
        np.testing.assert_allclose(
            result.reaction, answers_at[0].reaction, rtol=2 * TOL
        )


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_h4_no_friction(engine: str) -> None:
    result = one_node([-1.0, 1.5], 0.0, engine=engine)
    assert result.reaction[0, 0, 1] == 0.0
    assert result.reaction[0, 0, 0] == pytest.approx(1.75, rel=SMALL)
    assert result.displacement[0, 1] == pytest.approx(1.5, rel=SMALL)
    assert result.status[0, 0] == SLIP


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize(
    ("mu", "u_t", "r", "status"),
    [
        (0.5, 0.0, [0.2, 0.05], STICK),
        (0.1, -0.0315789473684, [0.184210526316, 0.0184210526316], SLIP),
    ],
)
def test_h6_penetration_is_pressed_out(
    mu: float, u_t: float, r: list[float], status: bp.Status, engine: str
) -> None:
    result = one_node([0.0, 0.0], mu, gap=-0.1, engine=engine)
    np.testing.assert_allclose(result.displacement[0], [0.1, u_t], atol=1e-11)
    np.testing.assert_allclose(result.reaction[0, 0], r, rtol=1e-10)
    assert result.status[0, 0] == status


def test_h7_duplicate_contact() -> None:
    W, q = np.array([[0.5, 0.1], [0.1, 1.0]]), np.array([[-1.0, 0.7]])
    single = bp.ReducedProblem(W, q, 0.3).solve(tol=TOL)
    # Nine and eight digits are printed.
    np.testing.assert_allclose(single.reaction[0], [2.12765957, -0.63829787], rtol=1e-8)
    assert single.relative_displacement[0, 1] == pytest.approx(0.27446809, rel=1e-7)
    twice = bp.ReducedProblem(np.tile(W, (2, 2)), np.tile(q, (2, 1)), 0.3)
    double = twice.solve(tol=TOL)
    assert double.converged
    np.testing.assert_allclose(
        double.reaction.sum(axis=0), single.reaction[0], rtol=SMALL
    )
    np.testing.assert_allclose(
        double.relative_displacement,
        np.tile(single.relative_displacement, (2, 1)),
        atol=SMALL,
    )


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_h8_redundant_supports(mu: float) -> None:
    # A rigid bar (v, θ, w along the supports) on three supports.
    at = [-1.0, 0.0, 1.0]
    B = sparse.csr_array(np.vstack([[[1.0, x, 0.0], [0.0, 0.0, 1.0]] for x in at]))
    load = np.array([-1.0, 0.0, 0.1])
    result = bp.solve(1e-3 * np.eye(3), B, load, gap=np.zeros(3), mu=mu, tol=TOL)
    # W of size 1e3 for forces of size 1, three supports.
    np.testing.assert_allclose(result.displacement[0, :2], 0, atol=1e-7)
    total = result.reaction[0].sum(axis=0)
    np.testing.assert_allclose(total, [1.0, -0.1 * (mu > 0)], atol=SMALL)
    w = 0.0 if mu else 100.0
    assert result.displacement[0, 2] == pytest.approx(w, abs=1e-7)


def test_h17_no_contact_is_a_linear_solve() -> None:
    load = np.array([-1.0, 0.3])
    result = bp.solve(
        K1, sparse.csr_array((0, 2)), load, gap=np.zeros(0), mu=np.zeros(0), dim=2
    )
    assert result.reaction.shape == (1, 0, 2)
    assert result.slip.shape == (1, 0, 1)
    assert result.status.shape == (1, 0)
    # Two unknowns, condition 3.
    np.testing.assert_allclose(result.displacement[0], np.linalg.solve(K1, load), 1e-14)
    empty = bp.ReducedProblem(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros(0)).solve()
    assert empty.converged
    assert empty.reaction.shape == (0, 3)


@pytest.mark.parametrize("how", EVERY_WAY, ids=str)
def test_h25_released_contact_remembers_nothing(how: dict[str, str]) -> None:
    path = np.array([[-1.0, 1.5], [1.0, 1.5], [-1.0, -0.2]])
    result = one_node(path, 0.3, **how)
    assert result.status[1, 0] == OPEN
    np.testing.assert_allclose(result.reaction[1, 0], 0, atol=SMALL)
    free = np.linalg.solve(K1, path[1])
    np.testing.assert_allclose(result.displacement[1], free, atol=SMALL)
    # In contact again: slip counts from where the last step left the node.
    W = np.linalg.inv(K1)
    q = W @ path[2] - [0.0, free[1]]
    (only,) = answers(Problem(W, q[None], 0.3))
    np.testing.assert_allclose(result.reaction[2], only.r, atol=SMALL)
    np.testing.assert_allclose(result.slip[2, 0], only.v[0, 1:], atol=SMALL)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("f_t", [0.2, 1.5])
def test_h26_a_step_without_a_change_of_load_changes_nothing(
    f_t: float, engine: str
) -> None:
    result = one_node([[-1.0, f_t]] * 3, 0.3, engine=engine)
    for k in (1, 2):
        np.testing.assert_allclose(result.reaction[k], result.reaction[0], rtol=SMALL)
        np.testing.assert_allclose(result.slip[k], 0, atol=SMALL)


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "uzawa"])
@pytest.mark.parametrize(
    ("W", "q", "mu", "status"),
    [
        # The second tangent is prescribed: its row and column vanish.
        ([[1, 0.2, 0], [0.2, 2, 0], [0, 0, 0]], [-1, 0.1, 0], 0.5, STICK),
        ([[1, 0.2, 0], [0.2, 2, 0], [0, 0, 0]], [-1, 0.1, 0], 0.01, SLIP),
        ([[1, 0, 0.2], [0, 0, 0], [0.2, 0, 2]], [-1, 0, 0.1], 0.5, STICK),
        # Both tangents are prescribed.
        ([[1, 0, 0], [0, 0, 0], [0, 0, 0]], [-1, 0, 0], 0.5, STICK),
        # A guide at 45 degrees in the contact plane.
        ([[1, 0.5, 0.5], [0.5, 1, 1], [0.5, 1, 1]], [-1, 0.1, 0.1], 0.5, STICK),
    ],
)
def test_tangent_that_cannot_move(
    W: list[list[float]], q: list[float], mu: float, status: bp.Status, method: str
) -> None:
    matrix, free = np.array(W, float), np.array([q], float)
    solution = bp.ReducedProblem(matrix, free, mu).solve(method=method, tol=TOL)
    assert str(solution.outcome) == "converged"
    assert solution.status[0] == status
    # r is undetermined along directions in the null space of W; v is determined.
    v = solution.relative_displacement
    assert violation(solution.reaction, v, mu, free) <= SMALL
