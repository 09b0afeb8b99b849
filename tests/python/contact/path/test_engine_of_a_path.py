"""The engine of a step belongs to its path, not to what the problem solved before."""

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.contact import tuning
from support.models_and_arrays import arguments
from support.pressed_in_space import arrays, pressed

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]

QUICK = range(3)
MORE = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 15)]


def falling_back(seed: int) -> tuple[dict[str, Any], Array]:
    """A nearly incompressible plane block, pressed and sheared to and fro in five steps.

    With ν near a half the statuses do not settle in some of these steps, which the direct
    engine then takes.
    """
    rng = np.random.default_rng(seed)
    model = pressed(int(rng.integers(6, 13)), dim=2, mu=float(rng.uniform(0.1, 0.9)))
    poisson = 0.5 - 10.0 ** rng.uniform(-4.0, -2.0)
    case = model.with_(**{"material.soft.poisson": poisson}).assemble()
    press, sheared = case.prescribed
    to_and_fro = rng.uniform(-1.5, 1.5, (4, 1))
    path = np.concatenate([[0.5 * press], press + to_and_fro * (sheared - press)])
    return arguments(case.model) | {"engine": "iterative"}, path


def assert_same_bits(ours: Sequence[bp.Step], right: Sequence[bp.Step]) -> None:
    for a, b in zip(ours, right, strict=True):
        for what in ("reaction", "relative_displacement", "status", "displacement"):
            np.testing.assert_array_equal(getattr(a, what), getattr(b, what), what)


@pytest.mark.parametrize("seed", [*QUICK, *MORE])
def test_a_path_that_falls_back_has_the_same_bits_again(
    seed: int, tmp_path: Path
) -> None:
    problem_arguments, prescribed = falling_back(seed)
    problem = bp.ContactProblem(**problem_arguments)
    whole = problem.solve(prescribed=prescribed)
    assert_same_bits(problem.solve(prescribed=prescribed), whole)
    fresh = bp.ContactProblem(**problem_arguments)
    saved = tmp_path / "whole.h5"
    whole.save(saved)
    reread = bp.load_result(saved)
    again = pickle.loads(pickle.dumps(problem))
    for first in range(1, len(prescribed)):
        for other, results in ((problem, whole), (fresh, whole), (again, reread)):
            start = results[first - 1]
            rest = other.solve(prescribed=prescribed[first:], start=start)
            assert_same_bits(rest, whole[first:])


def test_the_class_falls_back() -> None:
    """Each of these paths begins with the iterative engine and ends with the direct one."""
    for seed in QUICK:
        problem_arguments, prescribed = falling_back(seed)
        result = bp.ContactProblem(**problem_arguments).solve(prescribed=prescribed)
        direct = ["replaced" in step.stats for step in result]
        assert direct == sorted(direct)
        assert 0 < sum(direct) < len(direct)


def test_what_the_problem_did_before_does_not_choose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither a long path nor W changes the engine of a short one; a start keeps it."""
    monkeypatch.setattr(tuning, "LEAST_ITERATIVE", 100)
    monkeypatch.setattr(tuning, "DOFS_PER_STEP", 100)
    block, prescribed = arrays()
    # What is free on a machine must not choose in a test.
    block["memory_limit"] = 10**12
    short = bp.ContactProblem(**block).solve(prescribed=prescribed)
    assert "krylov" in short[0].stats
    problem = bp.ContactProblem(**block)
    long = problem.solve(prescribed=np.repeat(prescribed, 5, axis=0))
    assert "krylov" not in long[0].stats
    assert problem.compliance.shape == (75, 75)
    assert_same_bits(problem.solve(prescribed=prescribed), short)
    rest = problem.solve(prescribed=prescribed[1:], start=long[4])
    assert_same_bits(rest, long[5:6])
    rest = problem.solve(prescribed=prescribed[1:], start=short[0])
    assert_same_bits(rest, short[1:])
