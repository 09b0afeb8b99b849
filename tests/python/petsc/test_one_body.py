"""One body, its stiffness in parts: the answers of the direct engine."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import mpi
from support.body_models import floating, on_springs, sliding_freely
from support.pressed_in_space import arrays, pressed


@pytest.mark.parametrize("n", [12, pytest.param(24, marks=pytest.mark.slow)])
def test_a_block_in_space(n: int, tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(n)
    arguments = arrays_of_block | {"prescribed": prescribed, "tol": mpi.TOL}
    on_one_rank, two = (
        mpi.run(tmp_path, "solve", ranks, **arguments) for ranks in (1, 2)
    )
    expected = mpi.solve_directly(arrays_of_block, prescribed=prescribed)
    mpi.compare(on_one_rank, expected)
    mpi.compare(two, expected)
    for name in ("reaction", "displacement"):
        assert mpi.changed(two[name], on_one_rank[name]) <= mpi.SAME, name
    # Slips are differences of displacements.
    apart = np.abs(two["slip"] - on_one_rank["slip"]).max()
    assert apart <= mpi.SAME * np.abs(expected.displacement).max()
    stats = mpi.read_stats(two)
    assert stats["engine"] == "petsc"
    assert stats["preconditioner"] == "gamg"
    assert stats["ranks"] == 2
    # Two steps; each linear system takes some ten iterations.
    assert stats["krylov"] <= 200


def test_three_ranks_of_a_plane_body(tmp_path: Path) -> None:
    arrays_of_model, path = mpi.of_model(pressed(16, dim=2))
    parallel = mpi.run(
        tmp_path, "solve", 3, **arrays_of_model, **path, tol=mpi.TOL, d=2
    )
    mpi.compare(parallel, mpi.solve_directly(arrays_of_model, **path))


@pytest.mark.slow
def test_two_friction_coefficients(tmp_path: Path) -> None:
    arrays_of_model, path = mpi.of_model(
        pressed(5, mu=[0.3, 0.15], axis=[1.0, 0.0, 0.0])
    )
    parallel = mpi.run(tmp_path, "solve", 2, **arrays_of_model, **path, tol=mpi.TOL)
    mpi.compare(parallel, mpi.solve_directly(arrays_of_model, **path))


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


@pytest.mark.parametrize("model", [floating, on_springs])
def test_what_holds_a_body(model: Any, tmp_path: Path) -> None:
    """Contact alone, or springs."""
    arrays_of_model, path = mpi.of_model(model())
    parallel = mpi.run(tmp_path, "solve", 2, **arrays_of_model, **path, tol=mpi.TOL)
    mpi.compare(parallel, mpi.solve_directly(arrays_of_model, **path))


def test_without_coordinates(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(6)
    expected = mpi.solve_directly(arrays_of_block, prescribed=prescribed)
    del arrays_of_block["coordinates"]
    parallel = mpi.run(
        tmp_path, "solve", 2, **arrays_of_block, prescribed=prescribed, tol=mpi.TOL
    )
    mpi.compare(parallel, expected)


@pytest.mark.slow_variants("10000")
@pytest.mark.parametrize("gather", [0, 10_000])
def test_a_motion_without_energy(gather: int, tmp_path: Path) -> None:
    """Nothing resists a motion along x: all else is determined."""
    arrays_of_model, path = mpi.of_model(sliding_freely())
    expected = mpi.solve_directly(arrays_of_model, **path)
    parallel = mpi.run(
        tmp_path, "solve", 2, **arrays_of_model, **path, tol=mpi.TOL, gather=gather
    )
    assert mpi.changed(parallel["reaction"], expected.reaction) <= mpi.CLOSE
    assert np.array_equal(parallel["status"], expected.status)
    steps = len(expected)
    u, other = (
        displacement.reshape(steps, -1, 3)
        for displacement in (parallel["displacement"], expected.displacement)
    )
    shift = (u - other).mean(axis=1, keepdims=True) * [1.0, 0.0, 0.0]
    assert mpi.changed(u - shift, other) <= mpi.CLOSE
