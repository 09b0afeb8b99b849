"""Types that an editor completes: mypy checks a small program that calls the package."""

import inspect
import subprocess
import sys
from pathlib import Path

import bipot_rs as bp
from bipot_rs.contact.one_call import _Keywords

PROGRAM = """
from typing import assert_type
import numpy as np
from matplotlib.axes import Axes
import bipot_rs as bp

K = np.eye(2)
problem = bp.ContactProblem(K, K, gap=[0.0], mu=0.3)
result = problem.solve([-1.0, 0.0])
assert_type(result, bp.Result)
assert_type(problem.follow(lambda s: [-s, 0.0]), bp.Result)
assert_type(problem.solve_many([{"load": [-1.0, 0.0]}]), list[bp.Result])
assert_type(bp.solve(K, K, gap=[0.0], mu=0.3, fixed=[0], tol=1e-9), bp.Result)
assert_type(bp.load("result.h5"), bp.Result)
assert_type(bp.load_result("result.h5"), bp.Result)
assert_type(result[-1], bp.Step)
assert_type(result[1:], tuple[bp.Step, ...])
assert_type([step for step in result], list[bp.Step])
assert_type(result[-1].outcome, bp.Outcome)
assert_type(result[-1].error, bp.ErrorBound)
reduced = problem.reduced([-1.0, 0.0])
assert_type(reduced, bp.ReducedProblem)
assert_type(reduced.solve(), bp.Solution)
assert_type(reduced.answers()[0], bp.Solution)
assert_type(problem.existence([-1.0, 0.0]), bp.Existence)
assert_type(bp.plots.convergence(result), Axes)
assert_type(bp.plots.deformed(result), Axes)
assert_type(bp.plots.dissipation(result), Axes)
assert_type(bp.plots.force_displacement(result), Axes)
assert_type(bp.plots.resultants(result), Axes)
assert_type(bp.plots.sensitivity(result.vjp(), "gap"), Axes)
assert_type(bp.plots.slip(result), Axes)
assert_type(bp.plots.status_map(result), Axes)
assert_type(bp.plots.status_shares(result), Axes)
assert_type(bp.plots.surface_map(result), Axes)
assert_type(bp.plots.tractions(result), Axes)
worn = problem.wear([-1.0, 0.0], coefficient=1e-9, cycles=3)
assert_type(worn, bp.Wear)
assert_type(bp.plots.wear(worn), Axes)
ranges = bp.ReducedProblem([[0, 0], [0, 0]], [[0, 0]], 0, rigid=([[1], [0]], [-1]))
assert_type(ranges.reaction_range(0), bp.ReactionRange)
band = bp.plots.reaction_band(ranges.reaction_ranges(), contacts={"x": [[0, 0]]})
assert_type(band, Axes)
"""
WRONG = {
    "assert_type(result[-1], bp.Result)": "assert-type",
    "bp.solve(K, K, gap=[0.0], mu=0.3, fixd=[0])": "call-arg",
}


def test_types_of_public_names(repository: Path, tmp_path: Path) -> None:
    """mypy accepts each line of the program and refuses the wrong lines after it."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM + "\n".join(WRONG), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-pretty", program],
        capture_output=True,
        text=True,
        cwd=repository,
        check=False,
    )
    first = PROGRAM.count("\n") + 1
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    found = [(int(e.split(":")[1]), e.rpartition("[")[2].strip("]")) for e in errors]
    expected = [(first + k, code) for k, code in enumerate(WRONG.values())]
    assert found == expected, done.stdout + done.stderr


def test_solve_takes_every_keyword_of_a_problem_and_its_path() -> None:
    makes = inspect.signature(bp.ContactProblem).parameters.values()
    solves = inspect.signature(bp.ContactProblem.solve).parameters.values()
    keywords = {p.name for p in (*makes, *solves) if p.kind is p.KEYWORD_ONLY}
    # `gap` and `mu` are parameters of `solve` itself.
    assert keywords - {"gap", "mu"} == set(_Keywords.__annotations__)


def test_dir_shows_public_names_only() -> None:
    shown = dir(bp)
    assert set(bp.__all__) <= set(shown)
    assert [name for name in shown if name.startswith("_")] == ["__version__"]
    assert [name for name in shown if not hasattr(bp, name)] == []
