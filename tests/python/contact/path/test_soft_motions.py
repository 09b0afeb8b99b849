"""The iterative engine and motions that only soft springs hold: its errors and estimates."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.contact.errors import NotIterativeError
from support.fixed_statuses import solve_exactly
from support.models_and_arrays import arguments
from support.pressed_in_space import arrays

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]

QUICK = range(6)
MORE = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 66)]

# The displacements change by no more in one more correction.
SETTLED = 1e-9


def on_springs(seed: int, *, held: bool = True) -> tuple[dict[str, Any], Array, Array]:
    """A block pressed onto a plane, pushed sideways against springs of 1e-12 to 1e-4 of it.

    Without springs if it is not ``held``. Returns its arguments with coordinates, the load, and
    the prescribed displacements.
    """
    rng = np.random.default_rng(seed)
    dim = int(rng.choice([2, 3]))
    n = int(rng.integers(3, 5)) if dim == 3 else int(rng.integers(6, 12))
    mu = float(rng.choice([0.0, 0.0, 0.2, 0.5]))
    m = bp.Model("Block on soft springs")
    m.material("soft", young=1.0, poisson=0.3)
    sides = dict.fromkeys("xyz"[:dim], np.linspace(0.0, 1.0, n + 1))
    cell = "quadrilateral" if dim == 2 else "hexahedron"
    m.body("block", material="soft", cell=cell, **sides)
    m.support("block.top", **{"xyz"[dim - 1]: 0.0})
    plane = {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    m.contact("block.bottom", plane=plane, mu=mu)
    model = m.assemble().model
    left, right = (np.flatnonzero(model.nodes[:, 0] == x) for x in (0.0, 1.0))
    # In the plane, one spring holds the block: it cannot turn between top and plane. In space,
    # two at different places do.
    left = rng.choice(left, size=int(rng.integers(2, 1 + len(left))), replace=False)
    spring = 10.0 ** rng.uniform(-12.0, -4.0)
    springs, load = np.zeros(model.nodes.shape), np.zeros(model.nodes.shape)
    sideways = slice(0, dim - 1)
    springs[left, sideways] = spring * rng.uniform(0.5, 2.0, (len(left), dim - 1))
    # Without friction the springs carry the load, and move by less than the block is pressed.
    push = spring if mu == 0 else 0.01 * mu
    push *= 10.0 ** rng.uniform(-3.0, 0.0) / len(right)
    load[right, sideways] = push * rng.uniform(-1.0, 1.0, (len(right), dim - 1))
    known = arguments(model)
    if held:
        known["K"] = sparse.csr_array(known["K"] + sparse.diags_array(springs.ravel()))
    return known, load.ravel(), np.full(len(model.fixed), -0.01)


@pytest.mark.parametrize("seed", [*QUICK, *MORE])
def test_the_estimate_holds_the_softest_motion(seed: int) -> None:
    known, load, prescribed = on_springs(seed)
    del known["coordinates"]
    try:
        problem = bp.ContactProblem(**known, engine="iterative")
    except NotIterativeError:
        return  # without coordinates it is not seen that the springs hold the block
    step = problem.solve(load, prescribed, tol=1e-12)[0]
    right = solve_exactly(known, load, prescribed, step)
    errors = [
        np.linalg.norm(step.reaction - right.reaction) / np.linalg.norm(right.reaction),
        np.abs(step.displacement - right.displacement).max()
        / np.abs(right.displacement).max(),
    ]
    v = right.relative_displacement
    off = np.linalg.norm(step.relative_displacement - v)
    # A contact that sticks has v = 0: what is left of it is rounding of the displacements.
    if off > 4 * np.finfo(float).eps * np.abs(right.displacement).max():
        errors.append(off / np.linalg.norm(v))
    assert step.error_estimate is not None
    of_reaction, of_displacement = step.error_estimate
    if "krylov" not in step.stats:
        return  # the direct engine, whose estimate is about r and v alone
    # The estimate is the correction by a linear system with an exact residual, which loses less
    # than a factor of ten. The system is solved to 1e-8 of a residual whose norm is the rounding
    # of hundreds of rows, and the estimate holds that of one: another ten.
    assert errors[0] <= 10 * of_reaction
    assert max(errors) <= 100 * of_displacement
    assert errors[1] <= 2 * SETTLED


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_free_slide_has_no_estimate(seed: int) -> None:
    """Without springs and friction v is not determined; with friction it is."""
    known, _, prescribed = on_springs(seed, held=False)
    for mu, determined in ((0.0, False), (0.3, True)):
        block = known | {"mu": mu}
        ours, direct = (
            bp.ContactProblem(**block, engine=engine).solve(prescribed=prescribed)[0]
            for engine in ("iterative", "direct")
        )
        assert "krylov" in ours.stats
        for step in (ours, direct):
            assert step.converged
            assert (step.error_estimate is not None) == determined
        assert (
            np.abs(ours.reaction - direct.reaction).max()
            <= 1e-9 * np.abs(direct.reaction).max()
        )


def test_without_contact_the_estimate_of_the_reaction_is_zero() -> None:
    """As that of the direct engine: a reaction that is zero has no error."""
    known, prescribed = arrays()
    known["gap"] = known["gap"] + 1.0
    for engine in ("iterative", "direct"):
        step = bp.ContactProblem(**known, engine=engine).solve(prescribed=prescribed)[0]
        assert not step.reaction.any()
        assert step.error_estimate is not None
        assert step.error_estimate[0] == 0.0
        assert step.error_estimate[1] <= SETTLED
