"""Slender bodies: a small stiffness does not make a motion rigid.

References are eliminations in doubled precision (`slender`) with the statuses found.
The statuses are right if the displacements agree, nothing penetrates and no contact
pulls.
"""

from dataclasses import replace

import numpy as np
import pytest

from bipot_rs import fem
from support.slender import (
    deflection,
    floor,
    held,
    known,
    lifted,
    off,
    problem,
    strip,
    supports,
    weight,
)

pytestmark = pytest.mark.needs_extra


@pytest.mark.parametrize("coordinates", [True, False])
@pytest.mark.parametrize("height", [2.0, 1.0, 0.5])
@pytest.mark.quick_variants("2.0-*")
def test_a_clamped_strip_is_not_free(height: float, coordinates: bool) -> None:
    """A fine mesh with a lifting traction only: agrees with beam theory to the theory's error."""
    body = strip((1000.0, height), (160, 2))
    model = fem.assemble([body], [floor(body, 0.0)], supports("clamped", 2))
    load = lifted(model, deflection(1000.0 / height))
    made = problem(model, coordinates)
    assert made.rigid_motions == ()
    result = made.solve(load)
    assert not result.reaction.any()
    tip = result.displacement[-1].reshape(-1, 2)[body.nodes("right"), 1]
    estimate = result[-1].error_estimate
    assert estimate is not None
    # The clamp prevents contraction across the strip over less than a height of length.
    # The rounding of K's entries moves the tip of the thinnest strip by 4 %.
    np.testing.assert_allclose(tip, 5.0, rtol=3 * height / 1000.0 + 1e-3 + estimate[1])


def on_two_ends(slenderness: float, cells: int, mu: float) -> fem.Assembly:
    """A strip held only by the floor under its two ends."""
    length = 1000.0
    body = strip((length, length / slenderness), (cells, 2))
    parts = []
    for x in (0.0, length):
        near = {0: (x - 30.0, x + 30.0)}
        parts.append(replace(floor(body, mu), within=near))
    return fem.assemble([body], parts, [])


@pytest.mark.parametrize("slenderness", [20, 170, 500, 1000])
def test_forces_on_a_free_strip_balance(slenderness: float) -> None:
    """The contacts carry the whole load at the right places, however the strip bends."""
    model = on_two_ends(slenderness, 80, 0.3)
    assert model.problem().stats["rigid_motions"] == 3
    x = model.nodes[:, 0]
    load = weight(model)
    # More weight on the left, and a push that friction holds.
    load.reshape(-1, 2)[:, 1] *= 1.5 - x / 1000.0
    load.reshape(-1, 2)[:, 0] += 0.1 * load.reshape(-1, 2)[:, 1]
    result = model.problem().solve(load, tol=1e-13)
    r, f = result.reaction[-1], load.reshape(-1, 2)
    whole = np.abs(f).sum()
    # The tolerance of the residual, and sums of some hundred terms, each rounded once.
    assert abs(r[:, 0].sum() + f[:, 1].sum()) <= 1e-12 * whole
    t = model.frame[:, 1, 0] * r[:, 1]
    assert abs(t.sum() + f[:, 0].sum()) <= 1e-12 * whole
    moment = (model.points[:, 0] * r[:, 0]).sum()
    moment += (x * f[:, 1] - model.nodes[:, 1] * f[:, 0]).sum()
    assert abs(moment) <= 1e-12 * whole * 1000.0


@pytest.mark.parametrize(
    ("seeds", "solved"),
    [(range(8), 7), pytest.param(range(8, 420), 390, marks=pytest.mark.slow)],
)
def test_slender_bodies_at_random(seeds: range, solved: int) -> None:
    """Held in four ways, straight or curved, with and without coordinates."""
    # The most slender bodies with many cells may be refused: K has no digits for them.
    assert held(seeds)["solved"] >= solved


def bimetal(height: float, how: str) -> fem.Assembly:
    """Steel below and bronze above, 1000 mm long, on a smooth floor."""
    axes = [np.linspace(0, 1000.0, 81), np.linspace(0, height, 3)]
    mesh = fem.box(axes, "quadrilateral")
    middle = mesh.p[:, mesh.t].mean(axis=1)[1]
    halves = {"low": middle < height / 2, "high": middle > height / 2}
    mesh = mesh.with_subdomains(
        {name: np.flatnonzero(at) for name, at in halves.items()}
    )
    materials = {
        "low": fem.Material(2.1e5, 0.3, plane_stress=True),
        "high": fem.Material(1.1e5, 0.34, plane_stress=True),
    }
    body = fem.Body("strip", fem.second_order(mesh), materials)
    held = {
        "clamped": [fem.Support("strip", "left", (0, 1))],
        "both": [fem.Support("strip", side, (0, 1)) for side in ("left", "right")],
        "roll": [fem.Support("strip", "left", (0,))],
    }[how]
    floor = fem.Contact("strip", "bottom", mu=0.0, plane=((0, 0), (0, 1)))
    return fem.assemble([body], [floor], held)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["clamped", "both", "roll"])
@pytest.mark.parametrize("height", [1.0, 2.0, 5.0])
def test_bimetal_strips(height: float, how: str) -> None:
    """A frictionless problem is convex: each one has exactly one solution."""
    model = bimetal(height, how)
    contact = model.problem()
    for low, high in ((1.2e-5, 1.9e-5), (1.9e-5, 1.2e-5)):
        for degrees in (5, 20, 80, 300):
            strain = {
                "low": fem.thermal(low, degrees),
                "high": fem.thermal(high, degrees),
            }
            load = model.initial_strain("strip", strain)
            load += model.body_force("strip", (0, -7.9e-5))
            result = contact.solve(load)
            assert result.converged.all()
            if how == "roll":
                # The floor alone carries the weight, on 161 nodes with η = 1e-10 each.
                pressed = result.reaction[-1, :, 0].sum()
                assert pressed == pytest.approx(7.9e-5 * 1000.0 * height, rel=2e-8)
                continue
            there, estimate = known(model, load, result), result[-1].error_estimate
            assert estimate is not None
            if there.r.any():
                assert off(result.reaction[-1], there.r) <= 1e-10
            # The estimate includes the rounding that the strip amplifies.
            assert off(result.displacement[-1], there.u) <= max(1e-9, estimate[1])
