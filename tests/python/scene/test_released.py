"""A case whose K is dropped once the iterative engine has its own copy."""

import pickle

import numpy as np
import pytest

from support.pressed_in_space import pressed


def test_the_iterative_engine_solves_without_k() -> None:
    case = pressed(5).assemble()
    expected = case.solve(case.problem(engine="iterative"))
    problem = case.problem(engine="iterative")
    released = case.released(problem)
    assert released.model.K is None
    assert case.model.K is not None
    result = released.solve(problem)
    assert np.array_equal(result.reaction, expected.reaction)
    assert np.array_equal(result.displacement, expected.displacement)


def test_what_needs_k_has_it_once_more() -> None:
    case = pressed(5).assemble()
    problem = case.problem(engine="iterative")
    case.released(problem)
    copy = pickle.loads(pickle.dumps(problem))
    expected = case.problem(engine="direct").compliance
    # The engine that takes over if this one stalls.
    assert np.array_equal(problem.stiffness.make_direct().core.compliance(), expected)
    assert np.array_equal(copy.stiffness.make_direct().core.compliance(), expected)


@pytest.mark.parametrize("engine", ["direct", "auto"])
def test_k_stays_where_it_is_needed(engine: str) -> None:
    """The direct engine has made its factor; ``auto`` has not chosen yet, or chosen it."""
    case = pressed(5).assemble()
    assert case.released(case.problem(engine=engine)).model.K is case.model.K
