"""The choice of the engine: it belongs to a path, not to what the problem solved before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.contact import tuning
from bipot_rs.contact.path import choice
from support.comparisons import bits, solve_in_parts
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


@pytest.mark.parametrize("seed", [*QUICK, *MORE])
def test_a_path_that_falls_back_has_the_same_bits_again(
    seed: int, tmp_path: Path
) -> None:
    problem_arguments, prescribed = falling_back(seed)
    problem = bp.ContactProblem(**problem_arguments)
    whole = solve_in_parts(problem, tmp_path, prescribed=prescribed)
    fresh = bp.ContactProblem(**problem_arguments)
    last = fresh.solve(prescribed=prescribed[-1:], start=whole[-2])
    assert bits(last, whole[-1:])


def test_the_class_falls_back() -> None:
    """Each of these paths begins with the iterative engine and ends with the direct one."""
    for seed in QUICK:
        problem_arguments, prescribed = falling_back(seed)
        result = bp.ContactProblem(**problem_arguments).solve(prescribed=prescribed)
        direct = ["replaced" in step.stats for step in result]
        assert direct == sorted(direct)
        assert 0 < sum(direct) < len(direct)


@pytest.fixture
def low_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "LEAST_ITERATIVE", 100)
    monkeypatch.setattr(tuning, "DOFS_PER_STEP", 100)


@pytest.mark.usefixtures("low_limits")
def test_each_path_decides() -> None:
    """Neither a long path nor W changes the engine of a short one; a start keeps it."""
    block, prescribed = arrays()
    told: list[Any] = []
    problem = bp.ContactProblem(**block, on_forecast=told.append)
    assert problem.stats["engine"] == "auto"
    assert not told
    short = problem.solve(prescribed=prescribed)
    assert problem.stats["engine"] == "iterative"
    assert [counts["engine"] for counts in told] == ["iterative"]
    other = bp.ContactProblem(**block)
    long = other.solve(prescribed=np.repeat(prescribed, 5, axis=0))
    assert "krylov" not in long[0].stats
    assert other.stats["engine"] == "direct"
    assert "10 load steps" in other.stats["engine_reason"]
    for made in (problem, other):
        assert made.compliance.shape == (75, 75)
        assert bits(made.solve(prescribed=prescribed), short)
        for start, expected in ((long[4], long[5:6]), (short[0], short[1:])):
            rest = made.solve(prescribed=prescribed[1:], start=start)
            assert bits(rest, expected)


def choose(
    free: int,
    contacts: int,
    steps: int | None,
    available: float | None = None,
    **more: Any,
) -> tuple[str, str]:
    return choice.choose_engine("auto", 3, free, contacts, steps, available, **more)


def test_long_paths_and_small_problems_are_direct() -> None:
    least = tuning.LEAST_ITERATIVE
    assert choose(least - 1, 500, 1)[0] == "direct"
    assert choose(least, 500, 10)[0] == "iterative"
    assert choose(least, 500, 11)[0] == "direct"
    assert choose(least, 1000, 11)[0] == "iterative"
    assert choose(least, 1000, None)[0] == "auto"
    plane = choice.choose_engine("auto", 2, least, 1000, None, None)
    assert plane == ("direct", "the problem is plane")
    asked = choice.choose_engine("iterative", 2, 5, 1, 1000, None)
    assert asked == ("iterative", "it was asked for")


def test_a_factor_that_does_not_fit_is_not_made() -> None:
    name, why = choose(500_000, 10_000, 1000, 1e9)
    assert name == "iterative"
    assert "of 1 GB" in why


def test_what_needs_the_compliance_is_direct() -> None:
    """Also contacts without a node of their own, unless the factor does not fit."""
    size = 500_000, 1000, 10
    assert choose(*size) == (
        "iterative",
        "a factorisation would take longer than 10 load steps",
    )
    assert choose(*size, method="uzawa") == ("direct", "the method 'uzawa' needs W")
    given = "loads or working_set is given"
    assert choose(*size, needs_compliance=True) == ("direct", given)
    assert choose(*size, copies=500)[0] == "iterative"
    copied = "most contacts have no node of their own"
    assert choose(*size, copies=501) == ("direct", copied)
    assert choose(*size, 1e9, copies=501)[0] == "iterative"
    for before in ("direct", "iterative"):
        assert choose(*size, before=before, copies=501)[0] == before
    with pytest.raises(ValueError, match="engine='iterative' has only"):
        choice.choose_engine("iterative", *(3, *size), None, method="uzawa")
