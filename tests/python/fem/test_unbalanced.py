"""Loads that contact cannot carry are named before solving, and no others."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.checks.free_bodies import describe_unbalanced
from support.boxes import box, placed

pytestmark = pytest.mark.needs_extra


def stack(mu: list[float], dim: int, *, springs: bool = False) -> fem.Assembly:
    """Blocks on each other, the lowest on a rigid plane, with these frictions."""
    bodies, contacts, cells = [], [], box({2: "quadrilateral", 3: "hexahedron"}[dim], 2)
    up = np.eye(dim)[-1]
    for k, friction in enumerate(mu):
        mesh = placed(cells, cells.p + k * up[:, None])
        bodies.append(fem.Body(f"b{k}", mesh, fem.Material(7e4, 0.3)))
        on: Any = {"against": (f"b{k - 1}", "top")} if k else {"plane": (0 * up, up)}
        contacts.append(fem.Contact(f"b{k}", "bottom", friction, **on))
    held = [fem.Spring(body.name, "left", stiffness=1.0) for body in bodies]
    return fem.assemble(bodies, contacts, springs=held if springs else [])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0])
def test_a_slope(dim: int, mu: float) -> None:
    """A block slides if the slope is steeper than friction, or if it is too tall and tips."""
    model = stack([mu], dim)
    for share in (-1.01, -0.99, 0.0, 0.99, 1.01):
        push = share * mu if mu else share - np.sign(share) * 0.99
        force = np.zeros(dim)
        force[0], force[-1] = push, -1.0
        words = describe_unbalanced(model, model.body_force("b0", force)[None])
        # A cube tips at a slope of one.
        slides = abs(push) > min(mu, 1.0) * (1 + 1e-9)
        assert (words is not None) == slides, (share, words)
        assert words is None or "load step 1 of 1" in words
        assert words is None or "body 'b0'" in words


def test_the_first_step_that_cannot_be_carried() -> None:
    model = stack([0.3], 2)
    pushes = ([0.05, -0.5], [0.1, -1.0], [0.2, -1.0], [0.4, -1.0], [0.5, -1.0])
    steps = np.array([model.body_force("b0", push) for push in pushes])
    words = describe_unbalanced(model, steps)
    assert words is not None
    began = "load step 4 of 5: no solution exists: contact cannot carry"
    assert words.startswith(began)
    assert describe_unbalanced(model, steps[:3]) is None
    # Springs hold the block; supports do too.
    assert describe_unbalanced(stack([0.3], 2, springs=True), steps) is None


@pytest.mark.parametrize("seed", range(320))
@pytest.mark.quick_variants(*map(str, range(20)))
def test_it_agrees_with_solve(seed: int) -> None:
    """What `solve` refuses is named, and what it solves is not."""
    rng = np.random.default_rng(seed)
    dim, count = int(rng.integers(2, 4)), int(rng.integers(1, 4))
    if dim == 3:
        count = min(count, 2)
    model = stack(rng.choice([0.0, 0.2, 0.6], count).tolist(), dim)
    load = np.zeros(model.n)
    for k in range(count):
        force = rng.choice([0.0, 0.1, 0.4]) * rng.standard_normal(dim)
        force[-1] -= rng.choice([-0.2, 0.5, 1.0])
        load += model.body_force(f"b{k}", force)
    words = describe_unbalanced(model, load[None])
    try:
        result = model.problem().solve(load)
    except bp.NoEquilibriumError:
        assert words is not None
    else:
        assert not result.success or words is None, words
