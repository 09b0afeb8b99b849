"""Known solutions by every engine and method; `cases` has more of them, by the default one.

Ids: A have closed forms, P are published problems, H are hard cases.
"""

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import analytic
from support.bars import BAR, bar_problem, pulled
from support.bodies import block
from support.conditions import violation
from support.contacts import K1, SMALL, TOL, one_node
from support.methods import EVERY_WAY
from support.places import REFERENCE

Array = NDArray[np.float64]
OPEN, SLIP, STICK = bp.Status.OPEN, bp.Status.SLIP, bp.Status.STICK
FREE = np.linalg.solve(K1, [1.0, 1.5])
# It slides back until r_t = μ r_n; with u_n = 0, r_n = 1 + k_c u_t and k_t u_t = r_t.
BACK = 1 + 0.5 * 0.3 / (1 - 0.3 * 0.5)
PLAIN, FLAT = np.eye(2), np.diag([2.0, 1.0])
WEDGE = np.outer(np.linspace(1, 0, 9), [-1, 8])
# Path, μ, gap, K; u, r and status of its last step, by enumeration of all statuses.
BY_HAND: dict[str, tuple[Any, float, float, Array, Any, Any, Any]] = {
    "h1 vertex": ([0, 0.3], 0.5, 0, FLAT, [0, 0.3], [0, 0], None),
    "h2 no slip": ([-1, 0], 0.5, 0, K1, [0, 0], [1, 0], STICK),
    "h3 grazing": ([-1, 1.9], 0.5, 1e-16, K1, [0, 1.12], [1.56, -0.78], SLIP),
    "h4 no friction": ([-1, 1.5], 0, 0, K1, [0, 1.5], [1.75, 0], SLIP),
    "h6 pressed out": ([0, 0], 0.5, -0.1, K1, [0.1, 0], [0.2, 0.05], STICK),
    "h6 pressed aside": (
        [0, 0], 0.1, -0.1, K1, [0.1, -0.6 / 19], [3.5 / 19, 0.35 / 19], SLIP
    ),
    "a4 wedged": ([[-1, 8], [0, 0]], 3, 0, K1, [0, 2], [1, 2], STICK),
    "a4 in steps": (WEDGE, 3, 0, K1, [0, 2], [1, 2], STICK),
    "a5 normal first": ([[-1, 0], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0], [1, -0.4], STICK),
    "a5 in proportion": (
        [[-0.25, 0.1], [-0.5, 0.2], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0], [1, -0.4], STICK
    ),
    "a5 aside first": ([[0, 0.4], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0.4], [1, 0], STICK),
    "h25 released": ([[-1, 1.5], [1, 1.5]], 0.3, 0, K1, FREE, [0, 0], OPEN),
    "h25 back": (
        [[-1, 1.5], [1, 1.5], [-1, 0]], 0.3, 0, K1,
        [0, 0.3 * BACK], [BACK, 0.3 * BACK], SLIP,
    ),
    "h26 a step of nothing": (
        [[-1, 1.5]] * 3, 0.3, 0, K1, [0, 1.2 / 1.15], [1.75 / 1.15, -0.525 / 1.15], None
    ),
}  # fmt: skip


@pytest.mark.parametrize("how", EVERY_WAY, ids=str)
@pytest.mark.parametrize("name", BY_HAND)
def test_one_contact_by_hand(name: str, how: dict[str, str]) -> None:
    if name.startswith("a4") and "method" in how:
        return  # above μ = k_t/k_c there are several answers
    path, mu, gap, K, u, r, status = BY_HAND[name]
    result = one_node(path, mu, gap=gap, stiffness=K, **how)
    np.testing.assert_allclose(result.displacement[-1], u, atol=SMALL)
    np.testing.assert_allclose(result.reaction[-1, 0], r, atol=SMALL)
    if name == "h2 no slip" and "engine" in how:
        # Only K⁻¹ and the solve have rounding errors if the statuses are right.
        np.testing.assert_allclose(result.slip[0, 0], 0, atol=4e-16)
    if name == "h26 a step of nothing":
        np.testing.assert_allclose(result.slip[1:], 0, atol=SMALL)
    assert status is None or result.status[-1, 0] == status


def test_a6_smallest_force_that_holds() -> None:
    mu, weight, slope = 0.3, 7.0, math.radians(30)
    s, c = math.sin(slope), math.cos(slope)
    least = weight * (s - mu * c) / (c + mu * s)
    body = block((3, 1), (3, 2), 1e3, 0.0)

    def push(force: float) -> Any:
        # A horizontal body force has a part up the slope and a part into it.
        load = body.weight([weight * s - force * c, -(weight * c + force * s)])
        return bp.solve(body.K, body.B, load, gap=body.gap, mu=mu, tol=TOL)

    force = least * (1 + 1e-6)
    pressed = push(force).reaction[0, :, 0].sum()
    assert pressed == pytest.approx(weight * c + force * s, rel=1e-10)
    with pytest.raises(bp.NoEquilibriumError):
        push(least * (1 - 1e-6))


def test_a11_bar_monotone() -> None:
    problem, load = bar_problem()
    # Multiples of q h: nodal values equal the continuum's.
    ends = np.arange(1, 17) * 2.5
    result = problem.solve(pulled(load, ends), tol=1e-13)
    exact = analytic.bar_end_displacement(ends, **BAR)
    np.testing.assert_allclose(result.displacement[:, -1], exact, rtol=1e-10)
    # Between multiples the deviation is at most q h²/(4 EA).
    odd = problem.solve(pulled(load, ends - 0.9), tol=1e-13).displacement[:, -1]
    bound = 50 * 0.05**2 / 4e3
    assert np.abs(odd - analytic.bar_end_displacement(ends - 0.9, **BAR)).max() <= bound
    # The slipped length is P/q, measured from the end: exactly these nodes slip.
    assert np.flatnonzero(np.abs(result.displacement[11, 1::2]) > 1e-12)[0] == 8


@pytest.mark.parametrize("method", ["auto", "gauss_seidel"])
@pytest.mark.parametrize(
    "name",
    [
        "fc2d_11_contacts",
        "fc2d_slider_crank_singular",
        "fc3d_confeti_4_contacts",
        "fc3d_example1",
    ],
)
def test_p5_published_problems(name: str, method: str) -> None:
    data = json.loads((REFERENCE / f"{name}.json").read_text())
    shape = data["nc"], data["dim"]
    W, mu = np.array(data["W"]), np.array(data["mu"])
    q = np.array(data["q"]).reshape(shape)
    solution = bp.ReducedProblem(W, q, mu).solve(method=method, tol=1e-12)
    assert solution.converged
    v = np.array(data["u_checked"]).reshape(shape)
    # v equals W r + q for any condition of W: η of r times the sizes in the sum.
    atol = 1e-8 * np.abs(v).max()
    np.testing.assert_allclose(solution.relative_displacement, v, atol=atol)
    # The law itself is the reference; the inputs are printed to six to sixteen digits.
    r = solution.reaction
    assert violation(r, (W @ r.ravel()).reshape(shape) + q, mu, q) <= 1e-9
    if name == "fc3d_example1":
        exact = [1.0, *(-0.1 * np.array([1, 3]) / math.sqrt(10))]
        np.testing.assert_allclose(r, np.tile(exact, (3, 1)), atol=1e-11)
    if data["rank"] == W.shape[0] and name != "fc3d_confeti_4_contacts":
        r_checked = np.array(data["r_checked"]).reshape(shape)
        # The published solution has η below 3e-14; the condition of W is below 1e5.
        np.testing.assert_allclose(r, r_checked, atol=1e-7 * np.abs(r).max())


def test_h17_no_contact_is_a_linear_solve() -> None:
    none, load = sparse.csr_array((0, 2)), np.array([-1.0, 0.3])
    result = bp.solve(K1, none, load, gap=np.zeros(0), mu=np.zeros(0), dim=2)
    assert result.reaction.shape == (1, 0, 2)
    assert result.slip.shape == (1, 0, 1)
    assert result.status.shape == (1, 0)
    # Two unknowns, condition 3.
    np.testing.assert_allclose(result.displacement[0], np.linalg.solve(K1, load), 1e-14)
    empty = bp.ReducedProblem(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros(0)).solve()
    assert empty.converged
    assert empty.reaction.shape == (0, 3)


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
