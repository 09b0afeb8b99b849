"""The response of a plastic point: the law of a contact behind springs, in any dimension."""

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs._core as _core

Array = NDArray[np.float64]
DIMENSIONS = [2, 3, 4, 6]


def draw(d: int, seed: int = 0, count: int = 400) -> tuple[Array, Array]:
    """Stresses without flow, and points: cones, cones with a frozen limit, discs."""
    rng = np.random.default_rng([seed, d])
    tau = rng.normal(size=(count, d))
    tau[:, 1:] /= np.sqrt(d - 1)
    points = np.zeros((count, 7))
    points[:, :2] = 10 ** rng.uniform(-1, 1, (count, 2))
    points[:, 2] = rng.uniform(0.1, 1.0, count)
    points[:, 4] = points[:, 2] * rng.choice([0.0, 1.0, 0.4], count)
    points[count // 2 :, 3] = rng.uniform(0, 1, count - count // 2)
    points[3 * count // 4 :, [2, 4]] = 0.0
    return tau, points


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_pair_is_on_the_law(d: int, seed: int) -> None:
    tau, points = draw(d, seed)
    normal, tangential, mu, cohesion, beta = points[:, :5].T
    r, v, _ = _core.respond_points(tau, points)
    springs = np.column_stack([normal, *[tangential] * (d - 1)])
    # A few roundings of stresses of order one, divided by springs down to 0.1.
    assert r == pytest.approx(tau + springs * v, abs=1e-14)
    slip, drag = (np.linalg.norm(x[:, 1:], axis=1) for x in (v, r))
    assert (r[:, 0] >= 0).all()
    assert (drag <= cohesion + mu * r[:, 0] + 1e-14).all()
    # The length of v_t is a rounded sum.
    assert (v[:, 0] >= beta * slip * (1 - 1e-15)).all()
    # The gap of the bipotential, a sum of terms that are not negative.
    gap = r[:, 0] * (v[:, 0] - beta * slip) + (cohesion + mu * r[:, 0]) * slip
    gap += np.sum(r[:, 1:] * v[:, 1:], axis=1)
    assert np.abs(gap).max() < 1e-14
    # Each way of a point to move occurs: none, sliding, opening.
    opens = (r[:, 0] == 0) & (v[:, 0] > 0)
    assert min((slip == 0).sum(), (opens & (slip > 0)).sum()) > 20
    assert ((slip > 0) & ~opens).sum() > 20


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_jacobian_is_the_derivative(d: int, hardening: float) -> None:
    tau, points = draw(d)
    points[:, 5] = hardening
    _, _, J = _core.respond_points(tau, points)
    jacobian = J.reshape(-1, d, d)
    step = 1e-6
    for k in range(d):
        ends = [
            _core.respond_points(tau + way * step * np.eye(d)[k], points)[0]
            for way in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        # Points within a step of a kink have no derivative: a few of 400.
        wrong = np.abs(slope - jacobian[:, :, k]).max(axis=1) > 1e-6
        assert wrong.sum() <= 2


def test_hardening_raises_the_limit_by_the_slip() -> None:
    tau, points = draw(4)
    points[:, 5], points[:, 6] = 0.3, 0.1
    points[:, 3] += 0.3  # the limit stays positive
    r, v, _ = _core.respond_points(tau, points)
    slip = np.linalg.norm(v[:, 1:], axis=1)
    limit = points[:, 3] + points[:, 2] * r[:, 0] + 0.3 * (slip - 0.1)
    drag = np.linalg.norm(r[:, 1:], axis=1)
    assert (drag <= limit + 1e-14).all()
    assert (slip > 0).sum() > 50
    assert drag[slip > 0] == pytest.approx(limit[slip > 0], abs=1e-14)


def test_bits_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    tau = np.random.default_rng(0).normal(size=(5000, 4))
    points = np.tile([2.0, 1.0, 0.5, 0.1, 0.2, 0.0, 0.0], (5000, 1))
    wholes = set()
    for count in ("1", "2"):
        monkeypatch.setenv("BIPOT_NUM_THREADS", count)
        parts = _core.respond_points(tau, points)
        wholes.add(b"".join(part.tobytes() for part in parts))
    assert len(wholes) == 1


def test_components_of_no_law_are_refused() -> None:
    with pytest.raises(ValueError, match="points have 5 components, expected 2, 3, 4"):
        _core.respond_points(np.zeros((1, 5)), np.ones((1, 7)))
    with pytest.raises(ValueError, match="points"):
        _core.respond_points(np.zeros((2, 3)), np.ones((1, 7)))
