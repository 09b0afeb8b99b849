"""The choice of the engine, and what it says."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact import tuning
from bipot_rs.contact.path import choice
from support.pressed_in_space import arrays

# What is free on a machine must not choose in a test.
MEMORY = 10**12


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


def test_the_model_of_memory() -> None:
    """The measured factors: 12 GB at 500,000 unknowns, W of 7.2 GB for 10,000 contacts."""
    assert choice.forecast_bytes(500_000, 0) == pytest.approx(12e9, rel=0.1)
    assert choice.forecast_bytes(0, 10_000) == pytest.approx(7.2e9)


def test_each_path_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "LEAST_ITERATIVE", 100)
    monkeypatch.setattr(tuning, "DOFS_PER_STEP", 100)
    arguments, prescribed = arrays()
    told = []
    problem = bp.ContactProblem(
        **arguments, on_forecast=told.append, memory_limit=MEMORY
    )
    assert problem.stats["engine"] == "auto"
    assert not told
    short = problem.solve(prescribed=prescribed)
    assert problem.stats["engine"] == "iterative"
    assert [counts["engine"] for counts in told] == ["iterative"]
    # What needs W condenses; that changes no bit of a later path.
    assert problem.compliance.shape == (75, 75)
    again = problem.solve(prescribed=prescribed)
    assert problem.stats["engine"] == "iterative"
    np.testing.assert_array_equal(again.reaction, short.reaction)
    problem.solve(prescribed=prescribed, method="uzawa", tol=1e-6)
    assert problem.stats["engine"] == "direct"
    assert "uzawa" in problem.stats["engine_reason"]


def test_a_long_first_path_is_direct(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "LEAST_ITERATIVE", 100)
    monkeypatch.setattr(tuning, "DOFS_PER_STEP", 1000)
    arguments, prescribed = arrays()
    problem = bp.ContactProblem(**arguments, memory_limit=MEMORY)
    problem.solve(prescribed=prescribed)
    assert problem.stats["engine"] == "direct"
    assert "2 load steps" in problem.stats["engine_reason"]
