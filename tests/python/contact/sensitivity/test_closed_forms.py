"""Derivatives with a closed form."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bars import BAR, bar_problem, pulled

EA, Q = BAR["stiffness"], BAR["limit"]
NODES, MU = 20, 0.4
H = 1.0 / NODES


def end(result: bp.Result) -> Any:
    """Cotangent of the displacement of the end of the bar after the last step."""
    bar = np.zeros_like(result.displacement)
    bar[-1, -1] = 1.0
    return bar


def test_a_bar_pulled_to_and_fro() -> None:
    """u = P₀²/(2 EA q) - (P₀ - P)²/(4 EA q) after a reversal: the first step is history."""
    problem, load = bar_problem(NODES, MU)
    peak, back = 8 * Q * H, 2 * Q * H
    result = problem.solve(pulled(load, [0.5 * peak, peak, back]), tol=1e-13)
    gradient = result.vjp(displacement=end(result))
    since = (peak - back) / (2 * EA * Q)
    expected = [0.0, peak / (EA * Q) - since, since]
    np.testing.assert_allclose(gradient.load[:, -1], expected, atol=1e-13)
    by_q = gradient.mu.sum() * MU / Q
    exact = -(peak**2) / (2 * EA * Q**2) + (peak - back) ** 2 / (4 * EA * Q**2)
    np.testing.assert_allclose(by_q, exact, rtol=1e-11)
    # The stiffness of the chain: u is proportional to 1/EA.
    chain = sparse.csr_array(problem.stiffness.core.stiffness()[::-1])
    by_tangents = sparse.diags_array(np.tile([0.0, 1.0], NODES))
    by_EA = (gradient.K * (by_tangents @ chain)).sum()
    np.testing.assert_allclose(by_EA, -result.displacement[-1, -1], rtol=1e-11)


@pytest.mark.parametrize("d", [2, 3])
def test_homogeneity(d: int) -> None:
    """Loads and gaps times c give results times c: the derivative there is the result."""
    rng = np.random.default_rng(d)
    n = 5 * d
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = root @ root.T + np.eye(n)
    load = rng.normal(size=(4, n))
    load[:, ::d] -= 1.0
    gap = 0.2 * np.abs(rng.normal(size=5))
    result = bp.ContactProblem(K, np.eye(n), gap=gap, mu=0.3).solve(load, tol=1e-13)
    tangent = result.jvp(load, gap=gap)
    for name in ("reaction", "displacement", "relative_displacement", "slip"):
        change, exact = getattr(tangent, name), getattr(result, name)
        np.testing.assert_allclose(change, exact, atol=1e-12 * np.abs(exact).max())
    # Stiffness and loads times c: the displacements stay, the reactions are times c.
    tangent = result.jvp(load, K=K)
    np.testing.assert_allclose(tangent.reaction, result.reaction, atol=1e-11)
    np.testing.assert_allclose(tangent.displacement, 0.0, atol=1e-11)
