"""Summaries of problems and solutions: correct, short, escaped in HTML, and cheap."""

import doctest
import re
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.results import summary

# Two contacts in the plane: one pressed and dragged beyond friction, one pulled off.
PULL = np.array([-2.0, 1.5, 1.0, 0.0])


def two(**more: Any) -> bp.ContactProblem:
    return bp.ContactProblem(np.eye(4), np.eye(4), gap=[0.0, 0.0], mu=0.5, **more)


def rows(told: str) -> dict[str, str]:
    """Names and texts of the lines below the title."""
    lines = [re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in told.split("\n")]
    return dict(lines[1:])


@pytest.mark.needs_extra
def test_examples_of_the_docstrings() -> None:
    assert doctest.testmod(summary).failed == 0


def test_a_result_in_six_lines() -> None:
    result = two().solve(PULL)
    told = str(result)
    assert told.splitlines()[0] == "Result: 1 step converged"
    assert len(told.splitlines()) == 6
    row_of = rows(told)
    assert (
        row_of["contacts"]
        == "2 contacts in the plane, at the end 1 open, 1 slip, 0 stick"
    )
    # Pressed by 2, so friction is 0.5 * 2.
    assert "normal 2 in total, friction 1 (50 % of normal)" in row_of["forces"]
    # The rest of the load stretches the unit spring by 1.5 - 1; friction times this is 0.5.
    assert row_of["path"] == "friction dissipated 0.5 in total"
    assert row_of["residual"].endswith("limit 1e-10")
    assert "condense" in row_of["cost"]
    away = rows(str(two().solve(np.abs(PULL))))
    assert away["contacts"].startswith("2 contacts in the plane, at the end 2 open")
    assert away["remark"].startswith("no contact closes in any load step")
    assert "no contact closes" not in told


@pytest.mark.parametrize("surfaces", [1, 2, 30])
def test_a_result_has_a_row_for_each_surface(surfaces: int) -> None:
    n = 2 * surfaces
    eye = np.eye(2 * n)
    problem = bp.ContactProblem(
        eye, eye, gap=np.zeros(n), mu=0.5, frame=np.tile(np.eye(2), (n, 1, 1))
    )
    result = problem.solve(np.tile(PULL, surfaces))
    result.contacts = {
        **result.contacts,
        "surface": np.arange(n) // 2,
        "surface_names": np.array([f"side{k}" for k in range(surfaces)]),
    }
    row_of = rows(str(result))
    assert len(str(result).splitlines()) <= 20
    assert ("forces" in row_of) == (surfaces == 1)
    if surfaces > 1:
        # As above: pressed by 2, dragged to the limit.
        told = re.sub(r" +", " ", row_of["side1"])
        assert told == (
            "normal 2 friction 1 (100% of its limit) 1 open, 1 slip, 0 stick"
        )
    assert ("..." in row_of) == (surfaces > 10)


def test_a_step_shows_what_was_computed() -> None:
    step = two().solve(PULL)[0]
    assert str(step).startswith("Step: converged in ")
    assert len(str(step).splitlines()) == 6
    assert "see .unique" in str(step)
    assert "forward error" not in str(step)
    assert step.unique == "proved"
    assert step.error_estimate is not None
    assert rows(str(step))["unique"] == "yes, proved"
    assert "forward error" in rows(str(step))["residual"]


def test_a_step_that_did_not_converge() -> None:
    W = np.array([[2.0, 0.9], [0.9, 1.0]])
    solution = bp.ReducedProblem(W, [[-1.0, 1.2]], 0.5).solve(
        "uzawa", max_iterations=1, tol=1e-14
    )
    assert not solution.converged
    assert str(solution).startswith("Solution: iteration_limit after 1 iteration\n")
    assert rows(str(solution))["unique"].startswith("no solution")


def test_html_is_the_same_and_escaped() -> None:
    problem = two()
    result = problem.solve(PULL)
    for it in (problem, result, result[0], problem.reduced(PULL)):
        plain, table = str(it), it._repr_html_()
        assert table.count("<tr>") == len(plain.splitlines()) - 1
        assert plain.splitlines()[0] in table
    result.message = "<script>alert(1)</script> & more"
    assert "<script>" not in result._repr_html_()
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; more" in result._repr_html_()


def test_a_result_without_steps() -> None:
    K, B = np.eye(2), np.eye(2)
    with pytest.raises(bp.NoEquilibriumError) as failed:
        bp.solve(K, B, prescribed=[-1.0], gap=[0.0], mu=0.1, fixed=[0])
    told = str(failed.value.result)
    assert told.startswith("Result: load step 1: contact 0 penetrates")
    assert "1 contact in the plane" in told


def test_nothing_is_computed_for_a_summary(monkeypatch: pytest.MonkeyPatch) -> None:
    """A summary computes no displacements, uniqueness, diagnosis or error."""
    problem = two()
    result = problem.solve(PULL)
    reduced = problem.reduced(PULL)

    def never(*_: object) -> None:
        raise AssertionError("asked")

    step = result[0]
    for name in ("unique", "error_estimate", "error", "diagnosis"):
        monkeypatch.setattr(type(step.inquiry), name, never)
    monkeypatch.setattr(type(step.recovery), "recover", never)
    for it in (problem, result, step, reduced):
        assert str(it)
        assert repr(it)
        assert it._repr_html_()
    assert all(value is None for value in vars(step.computed).values())


def test_resultant_in_global_components() -> None:
    """Frames on both sides of a wedge: the vector sum of the forces equals the load."""
    angle = np.array([0.6, -0.6])
    n = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    frame = np.stack([n, np.stack([n[:, 1], -n[:, 0]], axis=1)], axis=1)
    # One node touches both sides; its spring is weak and carries little.
    K, B = 1e-9 * np.eye(2), frame.reshape(4, 2)
    load = np.array([0.1, -1.0])
    result = bp.solve(K, B, load, gap=np.zeros(2), mu=0.0, frame=frame)
    np.testing.assert_allclose(result.resultant, [-load], atol=1e-8)
    groups = result.resultants(np.array([1, 0]))
    assert groups.shape == (1, 2, 2)
    np.testing.assert_allclose(groups.sum(axis=1), result.resultant, rtol=1e-12)
    # Without friction each side pushes along its own normal.
    np.testing.assert_allclose(
        groups[0, 1], result.reaction[0, 0, 0] * n[0], rtol=1e-12
    )


def test_resultants_of_wrong_groups() -> None:
    result = two().solve(PULL)
    with pytest.raises(TypeError, match="group has entries of type float64"):
        result.resultants(np.zeros(2))
    with pytest.raises(ValueError, match=r"group has shape \(3,\), expected \(2,\)"):
        result.resultants(np.zeros(3, int))
    with pytest.raises(ValueError, match="group of contact 1 is -1"):
        result.resultants(np.array([0, -1]))
