"""A case whose K is dropped once the iterative engine has its own copy."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from bipot_rs.fem.assembly import assembly
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


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_k_that_is_read_in_parts_has_the_bits_of_the_whole(
    cell: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assembly, "_LEAST_PART", 50)
    case = pressed(5, cell=cell).assemble()
    bare = replace(case, model=replace(case.model, K=None))
    assert bare.with_stiffness("iterative") is bare
    problems = [c.problem(engine="iterative") for c in (case, bare)]
    whole, read = (c.solve(p) for c, p in zip((case, bare), problems, strict=True))
    assert np.array_equal(read.displacement, whole.displacement)
    assert np.array_equal(read.reaction, whole.reaction)
    first, second = (p.remarks for p in problems)
    assert first.at_start == second.at_start
    assert first.strength is not None
    assert second.strength is not None
    assert np.array_equal(first.strength.body, second.strength.body)
    assert np.array_equal(first.strength.force, second.strength.force)
    # What needs W has the whole.
    compliances = [p.stiffness.make_direct().core.compliance() for p in problems]
    assert np.array_equal(*compliances)
    direct = bare.with_stiffness("direct").model.K
    assert (direct != case.model.K).nnz == 0
