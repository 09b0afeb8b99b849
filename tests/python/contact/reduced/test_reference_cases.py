"""Known solutions. Ids: A have closed forms, P are published problems, H are hard cases."""

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import analytic
from support.bars import BAR, bar_problem, lost, pulled
from support.bodies import block, uniform_shear
from support.conditions import violation
from support.contacts import SMALL, TOL, one_node
from support.methods import EVERY_WAY
from support.places import REFERENCE

Array = NDArray[np.float64]
DATA = REFERENCE
SLIP, STICK = bp.Status.SLIP, bp.Status.STICK


def solve_block(body: Any, load: Array, mu: float, engine: str) -> bp.Result:
    return bp.solve(
        body.K,
        body.B,
        load,
        gap=body.gap,
        mu=mu,
        area=body.area,
        tol=TOL,
        coordinates=body.basis.doflocs.T,
        engine=engine,
    )


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("ratio", [0.0, 0.5, -0.9, 0.999])
def test_a1_sheared_patch_in_the_plane(ratio: float, engine: str) -> None:
    young, pressure, mu = 10.0, 2.0, 0.35
    shear = ratio * mu * pressure
    body = block((3, 1), (6, 4), young, 0.0)
    load = uniform_shear(body, pressure, [shear])
    result: Any = solve_block(body, load, mu, engine)
    # Held by contact alone. The error is η times the condition of the block, about 1e2.
    np.testing.assert_allclose(result.traction[0, :, 0], pressure, rtol=1e-9)
    np.testing.assert_allclose(result.traction[0, :, 1], -shear, atol=1e-9 * pressure)
    assert np.all(result.status[0] == STICK)
    u = result.displacement[0][body.basis.nodal_dofs]
    u_x, u_y = analytic.sheared_patch(body.basis.mesh.p[1], pressure, shear, young)
    np.testing.assert_allclose(u, [u_x, u_y], atol=1e-9 * pressure / young)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_a1_sheared_patch_in_space(engine: str) -> None:
    young, pressure, mu, shear = 10.0, 2.0, 0.4, [0.45, -0.6]  # # 0.75 of 0.8
    body = block((2, 1, 1.5), (3, 2, 2), young, 0.0)
    load = uniform_shear(body, pressure, shear)
    result: Any = solve_block(body, load, mu, engine)
    expected = np.broadcast_to([pressure, 0.6 - 1.05, 0.6], (12, 3))
    np.testing.assert_allclose(result.traction[0], expected, atol=1e-9 * pressure)
    assert np.all(result.status[0] == STICK)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_a4_wedged_at_zero_load(engine: str) -> None:
    result = one_node([[-1, 8], [0, 0]], 3.0, engine=engine)
    np.testing.assert_allclose(result.reaction[:, 0], [[2, -6], [1, 2]], atol=SMALL)
    np.testing.assert_allclose(result.displacement, [[0, 2], [0, 2]], atol=SMALL)
    assert result.status[1, 0] == STICK
    # With finer unloading steps the wedge stays.
    path = np.outer(np.linspace(1, 0, 9), [-1, 8])
    np.testing.assert_allclose(
        one_node(path, 3.0, engine=engine).reaction[-1, 0], [1, 2], atol=SMALL
    )


@pytest.mark.parametrize("how", EVERY_WAY, ids=str)
@pytest.mark.parametrize(
    ("path", "u_t", "r_t"),
    [
        ([[-1, 0], [-1, 0.4]], 0.0, -0.4),
        ([[-0.25, 0.1], [-0.5, 0.2], [-1, 0.4]], 0.0, -0.4),
        ([[0, 0.4], [-1, 0.4]], 0.4, 0.0),
    ],
)
def test_a5_path_dependence(
    path: list[list[float]], u_t: float, r_t: float, how: dict[str, str]
) -> None:
    result = one_node(path, 0.5, stiffness=np.eye(2), **how)
    np.testing.assert_allclose(result.displacement[-1], [0, u_t], atol=SMALL)
    np.testing.assert_allclose(result.reaction[-1, 0], [1, r_t], atol=SMALL)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", [0.5, 0.99, 0.999999])
def test_a6_block_on_an_incline_holds(share: float, dim: int) -> None:
    mu, weight, young = 0.6, 7.0, 1e3
    slope = math.atan(share * mu)
    along, down = weight * math.sin(slope), weight * math.cos(slope)
    # tan(slope) < width/height: no tipping. In space the fall line is oblique to the axes.
    body = block((3, 2, 1)[:dim] if dim == 3 else (3, 1), (4, 3, 2)[:dim], young, 0.3)
    direction = [1.0] if dim == 2 else [0.8, -0.6]
    load = body.weight([*(along * x for x in direction), -down])
    result = bp.solve(body.K, body.B, load, gap=body.gap, mu=mu, tol=TOL)
    total = result.reaction[0].sum(axis=0)
    # The balance is part of η; the condition of the rigid motions is about 10.
    np.testing.assert_allclose(
        total, [down, *(-along * x for x in direction)], atol=1e-10 * weight
    )
    r, v = result.reaction[0], result.relative_displacement[0]
    assert violation(r, v, mu, result.displacement[0]) <= 1e-9


def test_a6_smallest_force_that_holds() -> None:
    mu, weight, slope = 0.3, 7.0, math.radians(30)
    s, c = math.sin(slope), math.cos(slope)
    least = weight * (s - mu * c) / (c + mu * s)
    body = block((3, 1), (3, 2), 1e3, 0.0)

    def push(force: float) -> Array:
        # A horizontal body force has a part up the slope and a part into it.
        return body.weight([weight * s - force * c, -(weight * c + force * s)])

    force = least * (1 + 1e-6)
    result = bp.solve(body.K, body.B, push(force), gap=body.gap, mu=mu, tol=TOL)
    pressed = result.reaction[0, :, 0].sum()
    assert pressed == pytest.approx(weight * c + force * s, rel=1e-10)
    with pytest.raises(bp.NoEquilibriumError):
        bp.solve(body.K, body.B, push(least * (1 - 1e-6)), gap=body.gap, mu=mu)


def test_a11_bar_table() -> None:
    rows = np.loadtxt(DATA / "bar_cyclic.csv", delimiter=",", skiprows=1)
    problem, load = bar_problem()
    result = problem.solve(pulled(load, rows[:, 0]), tol=1e-13)
    # Compliance of the chain 1e-3, forces of 30: η gives 1e-14 m per step. The table is
    # printed to ten digits of 0.009.
    np.testing.assert_allclose(result.displacement[:, -1], rows[:, 1], atol=1e-12)
    # Steps 12 to 60 are one full cycle from 30 to 30.
    cycle = lost(result)[12:].sum()
    exact = analytic.bar_cycle_dissipation(30.0, **BAR, element=0.05)
    assert cycle == pytest.approx(exact, rel=1e-10)
    assert exact == pytest.approx(0.36125, rel=1e-14)


def test_a11_bar_monotone() -> None:
    problem, load = bar_problem()
    ends = (
        np.arange(1, 17) * 2.5
    )  # # multiples of q h: nodal values equal the continuum's
    result = problem.solve(pulled(load, ends), tol=1e-13)
    exact = analytic.bar_end_displacement(ends, **BAR)
    np.testing.assert_allclose(result.displacement[:, -1], exact, rtol=1e-10)
    # Between multiples the deviation is at most q h²/(4 EA).
    odd = problem.solve(pulled(load, ends - 0.9), tol=1e-13).displacement[:, -1]
    bound = 50 * 0.05**2 / 4e3
    assert np.abs(odd - analytic.bar_end_displacement(ends - 0.9, **BAR)).max() <= bound
    # The slipped length is P/q, measured from the end: exactly these nodes slip.
    assert np.flatnonzero(np.abs(result.displacement[11, 1::2]) > 1e-12)[0] == 8


@pytest.mark.parametrize("cycles", [20, pytest.param(1000, marks=pytest.mark.slow)])
def test_a11_bar_cycles_do_not_drift(cycles: int) -> None:
    problem, load = bar_problem()
    ends = np.array([30.0] + [-30.0, 30.0] * cycles)
    result = problem.solve(pulled(load, ends), tol=1e-13)
    u = result.displacement[:, -1]
    np.testing.assert_allclose(u, 0.009 * np.sign(ends), rtol=1e-10)
    per_cycle = lost(result)[1:].reshape(cycles, 2).sum(axis=1)
    np.testing.assert_allclose(per_cycle, 0.36125, rtol=1e-9)
    # From the tenth cycle to the last only rounding may add up: errors of 1e-13 per step,
    # each with its own direction.
    assert np.ptp(np.abs(u[20:])) <= 1e-12 * 0.009 * math.sqrt(2 * cycles)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.slow_variants("direct")
def test_h22_rotating_load_step_by_step(engine: str) -> None:
    k, limit, force, turns = 2.0, 0.5, 0.8, 3
    errors = []
    for steps in (8, 16, 32, 64, 128, 256, 512):
        angle = np.arange(1, turns * steps + 1) * 2 * math.pi / steps
        load = np.column_stack(
            [np.full_like(angle, -1.0), force * np.cos(angle), force * np.sin(angle)]
        )
        result = one_node(load, 0.5, stiffness=np.diag([3.0, k, k]), engine=engine)
        radius, loss = analytic.rotating_load(k, force, limit, steps)
        last = np.linalg.norm(result.displacement[-steps:, 1:], axis=1)
        # The transient shrinks by a fixed factor per radian: below 1e-7 after two turns, below
        # the rounding of the table only at the end. So the last step is compared.
        assert last[-1] == pytest.approx(radius, rel=1e-8)
        assert lost(result)[-steps:].sum() == pytest.approx(loss, rel=1e-5)
        errors.append(abs(last[-1] - analytic.rotating_load(k, force, limit)[0]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # First order: the error is -μN D/(2k) + O(D²), so the order tends to 1 like D.
    assert np.all(np.diff(np.abs(orders - 1)) < 0)
    assert orders[-1] == pytest.approx(1, abs=0.01)


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
    data = json.loads((DATA / f"{name}.json").read_text())
    shape = data["nc"], data["dim"]
    W, mu = np.array(data["W"]), np.array(data["mu"])
    q = np.array(data["q"]).reshape(shape)
    reduced = bp.ReducedProblem(W, q, mu)
    solution = reduced.solve(method=method, tol=1e-12)
    assert solution.outcome == "converged" or str(solution.outcome) == "converged"
    assert reduced.residual(solution.reaction) <= solution.tolerance
    v = np.array(data["u_checked"]).reshape(shape)
    size = np.abs(v).max()
    # v equals W r + q for any condition of W: η of r times the sizes in the sum.
    np.testing.assert_allclose(solution.relative_displacement, v, atol=1e-8 * size)
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
