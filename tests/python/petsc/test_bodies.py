"""Bodies with their stiffness in parts: the answers of the direct engine."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import mpi, two_blocks
from support.body_models import floating, on_springs, sliding_freely
from support.pressed_in_space import arrays, pressed

Case = tuple[dict[str, Any], dict[str, Any]]


def block_in_space(n: int) -> Case:
    known, prescribed = arrays(n)
    return known, {"prescribed": prescribed}


def blocks(*shape: Any) -> Case:
    known, prescribed = two_blocks.arrays(*shape)
    return known, {"prescribed": prescribed}


# Two steps; each linear system takes some ten iterations. Multigrid between bodies that is
# not that of the glued bodies, or no filter, takes over 300.
BODIES = {
    "block": (block_in_space, (12,), 200),
    "larger block": (block_in_space, (24,), 200),
    "matching, stiff upper": (blocks, (10.0, 8, 8), 150),
    "matching, soft upper": (blocks, (0.1, 8, 8), 150),
    "mortar": (blocks, (10.0, 6, 8), 150),
    "larger": (blocks, (10.0, 16, 16), 150),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.slow_variants("larger*")
def test_one_rank_and_two(name: str, tmp_path: Path) -> None:
    """Nodes of contacts between bodies may lie on different ranks."""
    make, shape, most = BODIES[name]
    known, path = make(*shape)
    one, two = (
        mpi.run(tmp_path, "solve", ranks, **known, **path, tol=mpi.TOL)
        for ranks in (1, 2)
    )
    expected = mpi.solve_directly(known, **path)
    for parallel in (one, two):
        mpi.compare(parallel, expected)
        assert mpi.read_stats(parallel)["krylov"] <= most
    assert mpi.changed(two["reaction"], one["reaction"]) <= mpi.SAME
    stats = mpi.read_stats(two)
    assert (stats["engine"], stats["ranks"]) == ("petsc", 2)
    assert stats["preconditioner"] == "gamg"
    if make is block_in_space:
        assert mpi.changed(two["displacement"], one["displacement"]) <= mpi.SAME
        # Slips are differences of displacements.
        apart = np.abs(two["slip"] - one["slip"]).max()
        assert apart <= mpi.SAME * np.abs(expected.displacement).max()


def without_coordinates() -> Case:
    known, path = block_in_space(6)
    del known["coordinates"]
    return known, path


@pytest.mark.parametrize(
    ("make", "ranks", "d"),
    [
        pytest.param(lambda: mpi.of_model(pressed(16, dim=2)), 3, 2, id="plane"),
        pytest.param(
            lambda: mpi.of_model(pressed(5, mu=[0.3, 0.15], axis=[1.0, 0.0, 0.0])),
            2,
            3,
            id="two coefficients",
            marks=pytest.mark.slow,
        ),
        pytest.param(lambda: mpi.of_model(floating()), 2, 3, id="contact alone"),
        pytest.param(lambda: mpi.of_model(on_springs()), 2, 3, id="springs"),
        pytest.param(without_coordinates, 2, 3, id="no coordinates"),
    ],
)
def test_answers_are_those_of_the_direct_engine(
    make: Callable[[], Case], ranks: int, d: int, tmp_path: Path
) -> None:
    known, path = make()
    parallel = mpi.run(tmp_path, "solve", ranks, **known, **path, tol=mpi.TOL, d=d)
    mpi.compare(parallel, mpi.solve_directly(known, **path))


@pytest.mark.slow_variants("0.0")
@pytest.mark.parametrize("beta", [0.0, 0.1])
def test_cohesion_that_breaks(beta: float, tmp_path: Path) -> None:
    """A block is sheared, lifted at one side and pressed again."""
    block, (_, sheared) = arrays(4)
    fixed = block["fixed"]
    along, upwards = block["coordinates"][fixed, 0], fixed % 3 == 2
    press = sheared[upwards].max()
    lift = np.where(upwards, -2.5 * press * along / along.max(), 0.0)
    prescribed = np.stack([sheared, sheared + lift, 0.5 * sheared])
    count = len(block["gap"])
    law = {"cohesion": np.full(count, 0.02), "dilatancy": np.full(count, beta)}
    expected = mpi.solve_directly(block | law, prescribed=prescribed)
    assert 0 < expected.broken[1].sum() < count
    asked = block | law | {"prescribed": prescribed, "tol": mpi.TOL}
    for ranks in (1, 2):
        found = mpi.run(tmp_path, "solve", ranks, **asked)
        mpi.compare(found, expected)
        assert np.array_equal(found["broken"], expected.broken)


@pytest.mark.slow_variants("10000")
@pytest.mark.parametrize("gather", [0, 10_000])
def test_a_motion_without_energy(gather: int, tmp_path: Path) -> None:
    """Nothing resists a motion along x: all else is determined."""
    known, path = mpi.of_model(sliding_freely())
    expected = mpi.solve_directly(known, **path)
    asked = known | path | {"tol": mpi.TOL, "gather": gather}
    parallel = mpi.run(tmp_path, "solve", 2, **asked)
    assert mpi.changed(parallel["reaction"], expected.reaction) <= mpi.CLOSE
    assert np.array_equal(parallel["status"], expected.status)
    u, other = (
        displacement.reshape(len(expected), -1, 3)
        for displacement in (parallel["displacement"], expected.displacement)
    )
    shift = (u - other).mean(axis=1, keepdims=True) * [1.0, 0.0, 0.0]
    assert mpi.changed(u - shift, other) <= mpi.CLOSE
