"""Signatures and names that an editor completes."""

import inspect

import bipot_rs as bp
from bipot_rs.contact.one_call import _Keywords


def test_solve_takes_every_keyword_of_a_problem_and_its_path() -> None:
    makes = inspect.signature(bp.ContactProblem).parameters.values()
    solves = inspect.signature(bp.ContactProblem.solve).parameters.values()
    keywords = {p.name for p in (*makes, *solves) if p.kind is p.KEYWORD_ONLY}
    keywords = {name for name in keywords if not name.startswith("_")}
    # `gap` and `mu` are parameters of `solve` itself.
    assert keywords - {"gap", "mu"} == set(_Keywords.__annotations__)


def test_dir_shows_public_names_only() -> None:
    shown = dir(bp)
    assert set(bp.__all__) <= set(shown)
    assert [name for name in shown if name.startswith("_")] == ["__version__"]
    assert [name for name in shown if not hasattr(bp, name)] == []
