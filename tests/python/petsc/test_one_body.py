"""One body, its stiffness in parts: the answers of the direct engine."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi
from support.body_models import floating, on_springs, sliding_freely
from support.models_and_arrays import arguments
from support.pressed_in_space import arrays, pressed

# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
CLOSE = 1e-10
# Between numbers of ranks only the order of sums and the aggregates differ.
SAME = 1e-11
TOL = 1e-12


def direct(known: dict[str, Any], **path: Any) -> bp.Result:
    return bp.ContactProblem(**known, engine="direct").solve(**path, tol=TOL)


def compare(found: dict[str, Any], expected: bp.Result) -> None:
    assert mpi.changed(found["reaction"], expected.reaction) <= CLOSE
    assert np.array_equal(found["status"], expected.status)
    assert mpi.changed(found["displacement"], expected.displacement) <= CLOSE
    assert (found["residual"] <= 10 * TOL).all()


def of(model: bp.Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the problem, and of its load path."""
    case = model.assemble()
    loads = {"load": case.load, "prescribed": case.prescribed}
    return arguments(case.model), loads


@pytest.mark.parametrize("n", [12, pytest.param(24, marks=pytest.mark.slow)])
def test_a_block_in_space(n: int, tmp_path: Path) -> None:
    known, prescribed = arrays(n)
    given = known | {"prescribed": prescribed, "tol": TOL}
    one, two = (mpi.run(tmp_path, "solve", ranks, **given) for ranks in (1, 2))
    expected = direct(known, prescribed=prescribed)
    compare(one, expected)
    compare(two, expected)
    for name in ("reaction", "displacement"):
        assert mpi.changed(two[name], one[name]) <= SAME, name
    # Slips are differences of displacements.
    apart = np.abs(two["slip"] - one["slip"]).max()
    assert apart <= SAME * np.abs(expected.displacement).max()
    stats = json.loads(str(two["stats"]))
    assert stats["engine"] == "petsc"
    assert stats["preconditioner"] == "gamg"
    assert stats["ranks"] == 2
    # Two steps; each linear system takes some ten iterations.
    assert stats["krylov"] <= 200


def test_three_ranks_of_a_plane_body(tmp_path: Path) -> None:
    known, path = of(pressed(16, dim=2))
    found = mpi.run(tmp_path, "solve", 3, **known, **path, tol=TOL, d=2)
    compare(found, direct(known, **path))


def test_two_friction_coefficients(tmp_path: Path) -> None:
    known, path = of(pressed(5, mu=[0.3, 0.15], axis=[1.0, 0.0, 0.0]))
    found = mpi.run(tmp_path, "solve", 2, **known, **path, tol=TOL)
    compare(found, direct(known, **path))


@pytest.mark.parametrize("model", [floating, on_springs])
def test_what_holds_a_body(model: Any, tmp_path: Path) -> None:
    """Contact alone, or springs."""
    known, path = of(model())
    found = mpi.run(tmp_path, "solve", 2, **known, **path, tol=TOL)
    compare(found, direct(known, **path))


def test_without_coordinates(tmp_path: Path) -> None:
    known, prescribed = arrays(6)
    expected = direct(known, prescribed=prescribed)
    del known["coordinates"]
    found = mpi.run(tmp_path, "solve", 2, **known, prescribed=prescribed, tol=TOL)
    compare(found, expected)


@pytest.mark.parametrize("gather", [0, 10_000])
def test_a_motion_without_energy(gather: int, tmp_path: Path) -> None:
    """Nothing resists a motion along x: all else is determined."""
    known, path = of(sliding_freely())
    expected = direct(known, **path)
    found = mpi.run(tmp_path, "solve", 2, **known, **path, tol=TOL, gather=gather)
    assert mpi.changed(found["reaction"], expected.reaction) <= CLOSE
    assert np.array_equal(found["status"], expected.status)
    steps = len(expected)
    u, other = (
        one.reshape(steps, -1, 3)
        for one in (found["displacement"], expected.displacement)
    )
    shift = (u - other).mean(axis=1, keepdims=True) * [1.0, 0.0, 0.0]
    assert mpi.changed(u - shift, other) <= CLOSE
