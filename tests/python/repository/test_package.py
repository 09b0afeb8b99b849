"""The installed package: its names, its version, its core."""

import inspect
import subprocess
import sys
from types import SimpleNamespace

import pytest

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact.one_call import _Keywords

PROMISED = {
    "Status": (),
    "project": ("tau", "mu", "base"),
    "ContactProblem": ("K", "B"),
    "solve": ("K", "B", "load"),
    "ReducedProblem": ("W", "q", "mu"),
    "load": ("path",),
    "BipotError": (),
    "NoEquilibriumError": (),
    "FloatingBodyError": (),
    "NotConvergedError": (),
}


@pytest.mark.parametrize("name", PROMISED)
def test_promised_names_and_leading_arguments(name: str) -> None:
    thing = getattr(bp, name)
    assert name in bp.__all__
    if PROMISED[name]:
        parameters = tuple(inspect.signature(thing).parameters)
        assert parameters[: len(PROMISED[name])] == PROMISED[name]


@pytest.mark.parametrize(
    ("name", "keywords"),
    [
        (
            "ContactProblem",
            ["gap", "mu", "fixed", "area", "dim", "num_threads", "points"],
        ),
        (
            "ContactProblem.solve",
            [
                "method",
                "tol",
                "max_iterations",
                "max_seconds",
                "start",
                "on_step",
            ],
        ),
        ("ReducedProblem", ["rigid"]),
        ("ReducedProblem.solve", ["tol", "max_iterations", "max_seconds", "start"]),
        ("ReducedProblem.residual", ["a"]),
        ("ContactProblem.reduced", ["prescribed", "start"]),
    ],
)
def test_promised_keywords(name: str, keywords: list[str]) -> None:
    thing = bp
    for part in name.split("."):
        thing = getattr(thing, part)
    parameters = inspect.signature(thing).parameters
    assert [k for k in keywords if k not in parameters] == []


def test_public_names_exist_and_are_listed_once() -> None:
    assert len(set(bp.__all__)) == len(bp.__all__)
    assert [name for name in bp.__all__ if not hasattr(bp, name)] == []


def test_status_values() -> None:
    assert [(s.name, int(s)) for s in bp.Status] == [
        ("OPEN", 0),
        ("SLIP", 1),
        ("STICK", 2),
    ]


def test_errors_have_one_base() -> None:
    for kind in (bp.NoEquilibriumError, bp.FloatingBodyError, bp.NotConvergedError):
        assert issubclass(kind, bp.BipotError)
    assert issubclass(bp.BipotError, Exception)
    assert not issubclass(bp.BipotError, ValueError)


def test_core_is_a_release_build() -> None:
    """An editable install must not give the slow core of a debug build."""
    assert _core.build_profile == "release"


def test_unknown_attribute_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = bp.no_such_name


def test_import_starts_no_thread() -> None:
    """A thread pool made at import would hang in every forked child."""
    script = """
import os
import numpy
before = len(os.listdir("/proc/self/task"))
import bipot_rs
print(len(os.listdir("/proc/self/task")) - before)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == 0


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


def test_dir_shows_public_names_only() -> None:
    shown = dir(bp)
    assert set(bp.__all__) <= set(shown)
    assert [name for name in shown if name.startswith("_")] == ["__version__"]
    assert [name for name in shown if not hasattr(bp, name)] == []
