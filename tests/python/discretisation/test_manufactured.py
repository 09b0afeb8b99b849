"""The manufactured solution solves the continuous problem: `cases.manufactured`."""

import numpy as np
import pytest

import bipot_rs as bp
from cases import manufactured
from cases.manufactured import MU, Field
from support.comparisons import near


def places(d: int, count: int = 400) -> np.ndarray:
    return np.random.default_rng(5).uniform(0, 1, (d, count))


@pytest.mark.parametrize("d", [2, 3])
def test_reactions_satisfy_the_law(d: int) -> None:
    """r is the projection (11) of r minus the bipotential's velocity, in all three zones."""
    x = places(d)
    # The normal component is the last one there.
    r = np.roll(manufactured.reaction(x), 1, axis=0).T
    v = np.roll(manufactured.relative(x), 1, axis=0).T
    slip = np.linalg.norm(v[:, 1:], axis=1)
    v[:, 0] += MU * slip
    projected, status = bp.project(r - v, MU)
    # The numbers are below 1, and so is what rounding leaves of their sums.
    near(projected, r, 1e-15)
    s = manufactured.along(x)
    assert (status[s < 1 / 3] == bp.Status.STICK).all()
    assert (status[(s > 1 / 3) & (s < 2 / 3)] == bp.Status.SLIP).all()
    assert (status[s > 2 / 3] == bp.Status.OPEN).all()
    assert np.bincount(status, minlength=3).min() > 50


@pytest.mark.parametrize("d", [2, 3])
def test_stress_and_forces_belong_to_the_displacement(d: int) -> None:
    exact, x, step = Field(d), places(d, 20), 1e-5
    gradient, divergence = np.zeros((d, d, 20)), np.zeros((d, 20))
    for a in range(d):
        ahead, behind = x.copy(), x.copy()
        ahead[a] += step
        behind[a] -= step
        u = exact.displacement(ahead) - exact.displacement(behind)
        gradient[:, a] = u / (2 * step)
        divergence += (exact.stress(ahead) - exact.stress(behind))[:, a] / (2 * step)
    # Central differences: third derivatives are below 1, rounding is 1e-16 / step.
    near(gradient, exact.gradient(x), 1e-10)
    near(divergence, -exact.force(x), 1e-10)
    # Hooke's law by the tensor of the material.
    law = manufactured.ROCK.tensor(d)
    slope = exact.gradient(x)
    strain = (slope + slope.swapaxes(0, 1)) / 2
    stress = np.einsum("abcd,cdp->abp", law, strain)
    near(stress, exact.stress(x), 1e-15)
