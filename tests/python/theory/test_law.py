"""All forms of the law of [dSF91] agree, with any start state."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.theory import law as laws
from bipot_rs.theory import materials
from support.law_pairs import (
    FORCE,
    LENGTH,
    RHO,
    SPOILED,
    Pairs,
    as_step,
    energy_size,
    off_the_law,
    on_the_law,
    start_state,
    unit,
)

Array = NDArray[np.float64]
FORMS = list(laws.FORMS)
# A dozen operations on numbers of the size that divides the residuals.
ROUNDED = 1e-14


def relative(
    form: str, law: materials.Coulomb, du: Array, dt: Array, rho: Any
) -> Array:
    values = laws.FORMS[form](law, du, dt, rho)
    return np.asarray(values / laws.size(law, du, dt, rho))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("form", FORMS)
def test_zero_on_the_law(form: str, d: int) -> None:
    rng = np.random.default_rng(1)
    pairs = on_the_law(rng, 3000, d)
    step = as_step(pairs, start_state(rng, 3000, d))
    # One step for all contacts, and one for each contact.
    for rho in (RHO, RHO * 10 ** rng.uniform(-1, 1, 3000)):
        assert relative(form, *step, rho).max() <= ROUNDED


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("how", SPOILED)
@pytest.mark.parametrize("form", FORMS)
def test_in_force_off_the_law(form: str, how: str, d: int) -> None:
    rng = np.random.default_rng(2)
    for size in (1e-1, 1e-3):
        pairs = off_the_law(rng, 500, d, how, size)
        law, du, dt = as_step(pairs, start_state(rng, 500, d))
        values = laws.FORMS[form](law, du, dt, RHO)
        # The violation has this size in units of FORCE; forces and slips are 0.3 to 3, μ is at
        # least 0.05. Every residual must be at least 0.02 of it, with the cone of μ = 2 and the
        # quotient of (54) included. In (54) the direction of slip counts squared:
        # μ t_n|v_t|(1 - cos) over the sizes, at least 0.2·0.3·0.3/12 of size²/2.
        lack = size
        if form == "(54)" and how == "slips askew" and d == 3:
            lack = 0.1 * size**2
        assert values.min() >= 0.02 * lack * FORCE
        # No residual is much larger either: all have comparable units.
        whole = 10 * FORCE if how == "slips askew" and d == 2 else 10 * size * FORCE
        assert values.max() <= whole


@pytest.mark.parametrize("d", [2, 3])
def test_all_forms_agree(d: int) -> None:
    """On random pairs, mostly off the law, mixed with pairs on it."""
    rng = np.random.default_rng(3)
    n = 4000
    pairs = on_the_law(rng, n, d)
    other = Pairs(
        rng.normal(size=(n, d)), rng.normal(size=(n, d)), pairs.mu, pairs.status
    )
    wild = rng.random((n, 2)) < 0.4
    t = np.where(wild[:, :1], other.t, pairs.t)
    v = np.where(wild[:, 1:], other.v, pairs.v)
    law, du, dt = as_step(pairs._replace(t=t, v=v), start_state(rng, n, d))
    values = laws.verdicts(law, du, dt, RHO)
    assert list(values) == FORMS
    for name, verdict in values.items():
        np.testing.assert_array_equal(verdict, values["by case"], err_msg=name)
    assert 0.2 * n < values["by case"].sum() < 0.8 * n
    assert values["by case"][~wild.any(axis=1)].all()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("form", FORMS)
def test_units_frames_and_start_states_have_no_effect(form: str, d: int) -> None:
    """Units in powers of two to the bit; a rotation of the tangents; another start state."""
    rng = np.random.default_rng(4)
    n = 300
    pairs = on_the_law(rng, n, d)
    pairs = pairs._replace(
        t=pairs.t + rng.normal(size=(n, d)) * 0.1,
        v=pairs.v + rng.normal(size=(n, d)) * 0.1,
    )
    start = start_state(rng, n, d)
    law, du, dt = as_step(pairs, start)
    values = laws.FORMS[form](law, du, dt, RHO)

    force, metre = 2.0**40, 2.0**-33
    scaled = materials.Start(
        force * start.reaction, metre * start.displacement, metre * start.gap
    )
    other = laws.FORMS[form](
        materials.Coulomb(law.mu, scaled), metre * du, force * dt, RHO * force / metre
    )
    np.testing.assert_array_equal(other, force * values)

    angle = rng.uniform(0, 2 * math.pi)
    turn = np.eye(d)
    turn[1:, 1:] *= -1
    if d == 3:
        c, s = math.cos(angle), math.sin(angle)
        turn[1:, 1:] = [[c, -s], [s, c]]
    turned = materials.Start(start.reaction @ turn, start.displacement, start.gap)
    other = laws.FORMS[form](
        materials.Coulomb(law.mu, turned), du @ turn, dt @ turn, RHO
    )
    size = laws.size(law, du, dt, RHO)
    assert np.all(np.abs(other - values) <= ROUNDED * size)

    elsewhere, *step = as_step(pairs, start_state(rng, n, d))
    other = laws.FORMS[form](elsewhere, *step, RHO)
    size = np.maximum(size, laws.size(elsewhere, *step, RHO))
    assert np.all(np.abs(other - values) <= ROUNDED * size)


def test_the_law_does_not_depend_on_time() -> None:
    """(51): slip in half the time is twice the velocity in the same direction."""
    rng = np.random.default_rng(5)
    pairs = on_the_law(rng, 500, 3)
    law, du, dt = as_step(pairs, start_state(rng, 500, 3))
    for time in (1e-6, 1e6):
        rate = du / [1, time, time]
        # Slips from 3e-7 to 3e7, so rounding is relative to them.
        assert relative("(51)", law, rate, dt, RHO).max() <= ROUNDED


@pytest.mark.parametrize("d", [2, 3])
def test_the_polar_cone_means_no_penetration(d: int) -> None:
    """(58) and (59) are equivalent by (57), with equality off the vertex."""
    rng = np.random.default_rng(6)
    n = 2000
    pairs = on_the_law(rng, n, d)
    step = as_step(pairs, start_state(rng, n, d))
    size = laws.size(*step, RHO)
    assert (laws.penetration(*step, RHO) / size).max() <= ROUNDED
    closed = pairs.t[:, 0] > 0
    assert np.abs(pairs.v[closed, 0]).max() == 0

    any_v = pairs._replace(v=rng.normal(size=(n, d)))
    step = as_step(any_v, start_state(rng, n, d))
    polar, opening = (f(*step, RHO) for f in (laws.polar_lack, laws.penetration))
    assert np.all(np.abs(polar - opening) <= ROUNDED * laws.size(*step, RHO))
    expected = np.maximum(-any_v.v[:, 0], 0) * FORCE
    np.testing.assert_allclose(
        opening, expected, rtol=0, atol=float(ROUNDED * laws.size(*step, RHO).max())
    )
    # The condition is only necessary: a force on an open contact satisfies both.
    lifted = as_step(
        off_the_law(rng, 50, d, "force at a distance", 0.5), start_state(rng, 50, d)
    )
    assert laws.penetration(*lifted, RHO).max() == 0
    assert not any(v.any() for v in laws.verdicts(*lifted, RHO).values())


@pytest.mark.parametrize("d", [2, 3])
def test_gap_and_projection_bound_each_other(d: int) -> None:
    """F² <= ρ t·ṽ <= F (ρ|ṽ| + |t| + F) for t in the cone and no penetration."""
    rng = np.random.default_rng(8)
    n = 5000
    pairs = on_the_law(rng, n, d)
    shift = 10 ** rng.uniform(-8, 0.3, (n, 1))
    t, _ = bp.project(pairs.t + shift * rng.normal(size=(n, d)), pairs.mu)
    v = pairs.v + shift * rng.normal(size=(n, d))
    v[:, 0] = np.abs(v[:, 0])
    law, du, dt = as_step(pairs._replace(t=t, v=v), start_state(rng, n, d))
    F = laws.by_projection(law, du, dt, RHO)
    energy = RHO * np.asarray(materials.gap(law, -du, dt))
    # Rounding of the energy, and of F through its root.
    slack = ROUNDED * RHO * energy_size(law, du, dt)
    tilde = v.copy()
    tilde[:, 0] += pairs.mu * np.linalg.norm(v[:, 1:], axis=1)
    sizes = FORCE * (np.linalg.norm(tilde, axis=1) + np.linalg.norm(t, axis=1))
    assert np.isfinite(energy).all()
    assert np.all(energy + slack >= F**2)
    assert np.all(energy <= F * (sizes + F) + slack)
    # Both bounds are useful: somewhere each is reached within a factor of ten.
    big = energy > 1e3 * slack
    F, energy, sizes = F[big], energy[big], sizes[big]
    assert (F**2 / energy).max() > 0.1
    assert (energy / (F * (sizes + F))).max() > 0.1


def test_normal_and_gap_of_points() -> None:
    """(48) as printed if the points are apart; the given normal if they coincide."""
    rng = np.random.default_rng(9)
    obstacle = rng.normal(size=(50, 3)) * LENGTH
    n, h = unit(rng, 50, 3), LENGTH * rng.uniform(0.1, 2, 50)
    body = obstacle + h[:, None] * n
    normals, gap = laws.normal_and_gap(body, obstacle)
    # Differences of numbers of size 3 with length 0.1: one and a half digits are lost.
    np.testing.assert_allclose(normals, n, atol=1e-14)
    np.testing.assert_allclose(gap, h, rtol=1e-14)
    same, gap = laws.normal_and_gap(body, obstacle, n)
    np.testing.assert_array_equal(same, n)
    np.testing.assert_allclose(gap, h, rtol=1e-14)

    # Behind the obstacle the printed formula reverses the normal: the gap counts as open.
    behind = obstacle - h[:, None] * n
    normals, gap = laws.normal_and_gap(behind, obstacle)
    np.testing.assert_allclose(normals, -n, atol=1e-14)
    assert gap.min() > 0
    _, gap = laws.normal_and_gap(behind, obstacle, n)
    np.testing.assert_allclose(gap, -h, rtol=1e-14)

    # Coincident points define no direction.
    _, gap = laws.normal_and_gap(obstacle, obstacle, n)
    assert np.all(gap == 0)
    touching = body.copy()
    touching[7] = np.nextafter(obstacle[7], 1)
    with pytest.raises(ValueError, match="coincide at pair 7: coincident points"):
        laws.normal_and_gap(touching, obstacle)


LAW = materials.Coulomb(0.3, materials.Start.unloaded([0.0, 0.0], 3))
ZERO = np.zeros((2, 3))


MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: laws.by_case(LAW, np.zeros((2, 2)), ZERO, 1.0), r"du has shape \(2, 2\), exp"),
    (lambda: laws.by_projection(LAW, ZERO, ZERO, [1.0, -1.0]), "rho is -1.0, expected pos"),
    (lambda: laws.in_rates(LAW, ZERO, ZERO, np.ones(3)), r"rho has shape \(3,\), expected a"),
    (lambda: laws.by_reactions(LAW, ZERO, np.nan * ZERO, 1.0), "dt is nan at"),
    (lambda: laws.verdicts(LAW, ZERO, ZERO, 1.0, tol=0), r"tol is 0.0, expected a positive"),
    (lambda: laws.normal_and_gap(ZERO, ZERO, [[1, 0, 0], [0, 2, 0]]),
     "normal of pair 1 has length 2.0"),
    (lambda: laws.normal_and_gap(*np.zeros((2, 2, 4))), r"body has shape \(2, 4\)"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_mistakes_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call()


def test_a_result_without_mu_or_a_step_has_no_law() -> None:
    result = bp.solve(np.eye(2), np.eye(2), [-1.0, 0.1], gap=[0.0], mu=0.4)
    with pytest.raises(ValueError, match=r"k is 1, expected 0 to 0"):
        laws.step_of(result, 1)
    del result.contacts["mu"]
    with pytest.raises(ValueError, match=r"result\.contacts has no .mu."):
        laws.step_of(result, 0)
