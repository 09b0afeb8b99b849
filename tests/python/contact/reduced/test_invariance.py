"""Solutions do not depend on units, frames, numbering, threads and processes."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.bodies import Body, block

Array = NDArray[np.float64]
MU = 0.3


def pressed_cube() -> tuple[Body, NDArray[np.int64], Array]:
    """A cube held at its top, pressed and then sheared obliquely: all three statuses occur."""
    body = block((1.0, 1.0, 1.0), (4, 4, 4), 200.0, 0.3)
    top = [body.dofs(2, 1.0, component) for component in range(3)]
    count = top[0].size
    path = np.array([[0, 0, -1e-2], [4e-3, 2e-3, -1e-2], [5e-3, -3e-3, -0.8e-2]])
    return body, np.concatenate(top), np.repeat(path, count, axis=1)


def uneven_gap(body: Body) -> Array:
    """The plane slopes away from one corner, so that some nodes stay open."""
    x, y = body.points[:, 0], body.points[:, 1]
    return np.asarray(2e-2 * np.maximum(x + y - 1.2, 0.0))


def solve(
    body: Body,
    fixed: NDArray[np.int64],
    path: Array,
    *,
    stress: float = 1.0,
    length: float = 1.0,
    **options: Any,
) -> Any:
    """The cube in scaled units, forces in 1/(stress length²) and so on: (K, u) scaled."""
    problem = bp.ContactProblem(
        body.K * (stress * length),
        body.B,
        gap=uneven_gap(body) * length,
        mu=MU,
        fixed=fixed,
        **options,
    )
    return problem.solve(None, path * length, tol=1e-12)


@pytest.mark.parametrize(("power_s", "power_l"), [(10, -7), (-30, 3), (0, 30), (17, 0)])
def test_units_that_are_powers_of_two_change_no_bit(power_s: int, power_l: int) -> None:
    stress, length = 2.0**power_s, 2.0**power_l
    body, fixed, path = pressed_cube()
    original = solve(body, fixed, path)
    assert set(original.status.ravel().tolist()) == {0, 1, 2}
    assert np.any(original.status[1] != original.status[2])
    other = solve(body, fixed, path, stress=stress, length=length)
    force = stress * length**2
    units = {"reaction": force} | dict.fromkeys(
        ("relative_displacement", "slip", "displacement"), length
    )
    for name in (*units, "status", "iterations", "residual"):
        scaled = getattr(original, name) * units.get(name, 1)
        assert np.array_equal(getattr(other, name), scaled), name


def test_projection_is_the_same_on_any_number_of_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    tau, mu = rng.normal(size=(100_003, 3)), rng.exponential(size=100_003)
    whole, status = bp.project(tau, mu)
    parts = [bp.project(tau[k::7], mu[k::7]) for k in range(7)]
    for k, (t, s) in enumerate(parts):
        assert np.array_equal(whole[k::7], t)
        assert np.array_equal(status[k::7], s)
    monkeypatch.setenv("BIPOT_NUM_THREADS", "1")
    assert np.array_equal(bp.project(tau, mu)[0], whole)
