"""Loads and gaps that are rounding errors count as zero, and no larger ones.

A block with a guided top (only its normal displacement is prescribed) can slide. Where nothing
pushes it sideways, the work of its weight on this motion is rounding; where heating closes
the gap exactly, so is the gap that is left.
"""

import itertools
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem


def guided_block(seed: int, clearance: float) -> tuple[fem.Assembly, float, float]:
    """A block on a plane below it by a share of its height; its E and its height."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 4))
    sizes = rng.uniform(0.5, 3.0, d)
    inner = [rng.uniform(0.1, 0.9, rng.integers(1, 4)) for _ in range(d)]
    axes = [s * np.sort(np.r_[0.0, 1.0, x]) for s, x in zip(sizes, inner, strict=True)]
    kinds = ("quadrilateral", "triangle") if d == 2 else ("hexahedron", "tetrahedron")
    material = fem.Material(10 ** rng.uniform(3, 11), rng.uniform(0.0, 0.45))
    body = fem.Body("block", fem.box(axes, str(rng.choice(kinds))), material)
    n = np.eye(d)[-1]
    plane = (tuple(-clearance * axes[-1][-1] * n), tuple(n))
    contact = fem.Contact("block", "bottom", mu=rng.uniform(0.1, 1.0), plane=plane)
    model = fem.assemble([body], [contact], [fem.Support("block", "top", (d - 1,))])
    return model, material.young, float(axes[-1][-1])


def lifted(seed: int, sideways: float) -> tuple[bp.ContactProblem, Any, Any]:
    """Problem, weight with a share of it sideways, lifted top."""
    model, young, height = guided_block(seed, 0.0)
    d = model.B.shape[0] // len(model.gap)
    weight = 1e-4 * young / height * np.eye(d)[-1]
    load = model.body_force(
        "block", tuple(sideways * weight[-1] * np.eye(d)[0] - weight)
    )
    return model.problem(), load, model.prescribed([(1e-3 * height,)])


SEEDS = [*range(8), *(pytest.param(s, marks=pytest.mark.slow) for s in range(8, 100))]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_lifted_block_hangs_without_reactions(seed: int) -> None:
    problem, load, top = lifted(seed, 0.0)
    result = problem.solve(load, top)
    assert not result.reaction.any()
    solution = problem.reduced(load, top).solve()
    assert solution.converged
    assert not solution.reaction.any()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_real_sideways_load_is_kept(seed: int) -> None:
    """ε |K||u| of the lift, 1e-3 of the height, is some 1e-15 E: far below 1e-9 × 1e-4 E."""
    problem, load, top = lifted(seed, 1e-9)
    with pytest.raises((bp.NoEquilibriumError, bp.NotConvergedError)):
        problem.solve(load, top)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.5, 1.0, 1.5])
def test_heating_that_closes_a_gap(seed: int, share: float) -> None:
    """It expands by 1e-4 of its height, over a gap of this share of it."""
    model, _, height = guided_block(seed, 1e-4 * share)
    d = model.B.shape[0] // len(model.gap)
    load = model.initial_strain("block", 1e-4 * np.eye(d))
    result = model.problem().solve(load)
    if share < 1:
        assert result.success
        assert result.reaction[-1, :, 0].sum() > 0
    else:
        assert not result.reaction.any()
        # With a free expansion the bottom moves down by it, to rounding of a few hundred ε.
        opening = (share - 1) * 1e-4 * height
        left = result.relative_displacement[-1, :, 0] - opening
        assert np.abs(left).max() <= 1e-12 * 1e-4 * height


@pytest.mark.parametrize("seed", SEEDS)
def test_an_overlap_without_loads(seed: int) -> None:
    model, *_ = guided_block(seed, -1e-4)
    result = model.problem().solve(np.zeros(model.n))
    assert result.reaction[-1, :, 0].sum() > 0
    assert result.success


def test_reactions_that_carry_the_loads_of_their_own_nodes() -> None:
    """A free truss falls through gaps on three planes: no bar is loaded, it moves rigidly."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        n = int(rng.integers(3, 6))
        nodes = rng.normal(size=(n, 2))
        K, B = np.zeros((2 * n, 2 * n)), np.zeros((6, 2 * n))
        for i, j in itertools.combinations(range(n), 2):
            length = np.linalg.norm(nodes[i] - nodes[j])
            bar = np.zeros((n, 2))
            bar[i] = (nodes[i] - nodes[j]) / length
            bar[j] = -bar[i]
            stiffness = 10 ** rng.uniform(-1, 1) / length
            K += stiffness * np.outer(bar, bar)
        for i, angle in enumerate(0.5 * rng.normal(size=3)):
            normal = np.array([np.sin(angle), np.cos(angle)])
            B[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [normal, [normal[1], -normal[0]]]
        r = np.column_stack([rng.uniform(0.1, 1, 3), np.zeros(3)])
        turned = np.column_stack([-nodes[:, 1], nodes[:, 0]])
        moved = (rng.normal(size=2) + rng.normal() * turned).ravel()
        problem = bp.ContactProblem(K, B, gap=-(B @ moved)[::2], mu=0.0, dim=2)
        step = problem.solve(-B.T @ r.ravel())[0]
        np.testing.assert_allclose(step.reaction, r, rtol=1e-8, atol=1e-8)
        # Planes may cross at a small angle.
        np.testing.assert_allclose(step.displacement, moved, rtol=1e-6, atol=1e-6)
