"""The installed package: its names, its version, its core."""

import inspect
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import pytest

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact.one_call import _Keywords
from support.programs import child

# Names, their leading arguments, and keywords.
PROMISED: dict[str, tuple[str, str]] = {
    "Status": ("", ""),
    "project": ("tau mu base", ""),
    "ContactProblem": ("K B", "gap mu fixed area dim num_threads points"),
    "ContactProblem.solve": (
        "self",
        "method tol max_iterations max_seconds start on_step",
    ),
    "ContactProblem.reduced": ("self", "prescribed start"),
    "solve": ("K B load", ""),
    "ReducedProblem": ("W q mu", "rigid"),
    "ReducedProblem.solve": ("self", "tol max_iterations max_seconds start"),
    "ReducedProblem.residual": ("self", "a"),
    "load": ("path", ""),
    "BipotError": ("", ""),
    "NoEquilibriumError": ("", ""),
    "FloatingBodyError": ("", ""),
    "NotConvergedError": ("", ""),
}


@pytest.mark.parametrize("name", PROMISED)
def test_promised_names_arguments_and_keywords(name: str) -> None:
    first, keywords = map(str.split, PROMISED[name])
    assert name.partition(".")[0] in bp.__all__
    thing = attrgetter(name)(bp)
    if first:
        parameters = list(inspect.signature(thing).parameters)
        assert parameters[: len(first)] == first
        assert [k for k in keywords if k not in parameters] == []


def test_public_names_exist_and_are_listed_once() -> None:
    assert len(set(bp.__all__)) == len(bp.__all__)
    shown = dir(bp)
    assert set(bp.__all__) <= set(shown)
    assert [name for name in shown if name.startswith("_")] == ["__version__"]
    assert [name for name in shown if not hasattr(bp, name)] == []
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = bp.no_such_name
    statuses = [(s.name, int(s)) for s in bp.Status]
    assert statuses == [("OPEN", 0), ("SLIP", 1), ("STICK", 2)]
    for kind in (bp.NoEquilibriumError, bp.FloatingBodyError, bp.NotConvergedError):
        assert issubclass(kind, bp.BipotError)
    assert bp.BipotError.__mro__[1] is Exception


def test_core_is_a_release_build() -> None:
    """An editable install must not give the slow core of a debug build."""
    assert _core.build_profile == "release"


def test_import_starts_no_thread(tmp_path: Path) -> None:
    """A thread pool made at import would hang in every forked child."""
    count = "len(os.listdir('/proc/self/task'))"
    code = (
        f"import os, numpy; before = {count}; import bipot_rs; print({count} - before)"
    )
    assert child(code, cwd=tmp_path).stdout == "0\n"


def test_earlier_names_still_work() -> None:
    assert bp.load is bp.load_result
    parameter = inspect.getattr_static(bp.Step, "path_parameter")
    assert parameter.fget(SimpleNamespace(s=0.25)) == 0.25


def test_solve_takes_every_keyword_of_a_problem_and_its_path() -> None:
    makes = inspect.signature(bp.ContactProblem).parameters.values()
    solves = inspect.signature(bp.ContactProblem.solve).parameters.values()
    keywords = {p.name for p in (*makes, *solves) if p.kind is p.KEYWORD_ONLY}
    keywords = {name for name in keywords if not name.startswith("_")}
    # `gap` and `mu` are parameters of `solve` itself.
    assert keywords - {"gap", "mu"} == set(_Keywords.__annotations__)
