"""Adaptive load steps: where they end, how long they are, and results equal to given steps."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.bars import bar_problem
from support.comparisons import FIELDS, bits


def spring(mu: float = 0.5, k: float = 4.0) -> bp.ContactProblem:
    """A node on two springs, 3 along the normal and k along the tangent."""
    return bp.ContactProblem(np.diag([3.0, k]), np.eye(2), gap=[0.0], mu=mu)


def pair() -> bp.ContactProblem:
    """Two nodes joined by a spring of stiffness 1, held by contact alone; mu = 0.5."""
    K = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
    return bp.ContactProblem(K, np.eye(4), gap=[0.0, 0.0], mu=0.5)


def towed(s: float) -> Any:
    """Pressed by 2, pulled by 2.4 s: friction holds 1, the limit is s = 5/12."""
    return [-1.0, 2.4 * s, -1.0, 0.0]


@pytest.mark.parametrize("floor", [0.05, 1e-3, 1e-7])
def test_a_limit_load_is_found_to_within_the_smallest_step(floor: float) -> None:
    with pytest.raises(bp.NoEquilibriumError, match="the path ends at s = ") as refused:
        pair().follow(towed, smallest=floor)
    reached = refused.value.result
    assert reached is not None
    assert not reached.success
    assert f"smallest = {floor:g}" in str(refused.value)
    assert "contact cannot carry the loads" in str(refused.value)
    assert f"s = {reached.s[-1]:.10g}" in str(refused.value)
    # η of 1e-10 accepts a load that is too large by that amount.
    assert reached.s[-1] <= 5 / 12 * (1 + 1e-9)
    assert reached.s[-1] + floor >= 5 / 12
    assert refused.value.direction is not None
    # Bisection, and one more attempt at each new start.
    assert len(reached) <= 2 + np.log2(1 / floor)


def test_slip_divides_sliding_and_leaves_stick() -> None:
    """Pulled by 4 s against a limit of 1: stick to s = 1/4, then a slip of 4 ds / k a step."""
    result = spring(mu=0.5).follow(
        lambda s: [-2.0, 4.0 * s], largest=0.125, slip=0.04, tol=1e-13
    )
    sizes = np.diff(result.s, prepend=0.0)
    stuck = result.s <= 0.25
    np.testing.assert_array_equal(sizes[stuck], 0.125)
    # The largest of 1/8, 1/16, … that slips by at most 0.04 is 1/32.
    np.testing.assert_array_equal(sizes[~stuck], 0.03125)
    # tol, for numbers of order one.
    np.testing.assert_allclose(result.slip[~stuck, 0, 0], 0.03125, rtol=1e-11)
    assert not result.slip[stuck].any()
    assert result.s[-1] == 1.0


def test_slip_scales_with_the_unit_of_length() -> None:
    def sizes(unit: float) -> Any:
        problem = bp.ContactProblem(
            np.diag([3.0, 4.0]) / unit, np.eye(2), gap=[0.0], mu=0.5
        )
        load = [-2.0, 4.0]
        return problem.follow(load, largest=0.5, slip=0.1 * unit).s

    # A power of two, so that rounding is the same.
    np.testing.assert_array_equal(sizes(1.0), sizes(2.0**-10))


def tugged(load: Any) -> Any:
    """The bar of A11 under its normal load, with its end pulled to and fro."""

    def at(s: float) -> Any:
        now = np.array(load)
        now[-1] += 30 * np.sin(4 * s)
        return now

    return at


def test_the_steps_are_those_of_the_same_load_points() -> None:
    problem, load = bar_problem(12)
    at = tugged(load)
    automatic = problem.follow(at, first=0.25, largest=0.5, slip=2e-3)
    sizes = np.diff(automatic.s, prepend=0.0)
    # Steps were halved and grew again: the comparison is not trivial.
    assert sizes.min() < 0.25
    assert np.any(np.diff(sizes) > 0)
    fixed = bar_problem(12)[0].solve(np.array([at(s) for s in automatic.s]))
    assert bits(automatic, fixed)
    assert fixed.s is None


def test_an_interrupted_path_continues(tmp_path: Path) -> None:
    problem, load = bar_problem(12)
    options: dict[str, Any] = {"first": 0.25, "largest": 0.5, "slip": 2e-3}
    options["stops"] = [0.3, 1.0, 1.7]
    whole = problem.follow(tugged(load), **options)
    assert {0.3, 1.0, 1.7} <= set(whole.s.tolist())
    fields = (*FIELDS, "s", "ahead")
    for k in (0, len(whole) // 2, len(whole) - 2):
        steps: list[Any] = []

        def stop(number: int, step: Any, k: int = k, steps: Any = steps) -> None:
            steps.append(step)
            if number == k:
                raise KeyError

        fresh = bar_problem(12)[0]
        with pytest.raises(KeyError):
            fresh.follow(tugged(load), **options, on_step=stop)
        assert bits(steps, whole[: k + 1], fields)
        rest = fresh.follow(tugged(load), **options, start=steps[-1])
        assert bits(rest, whole[k + 1 :], fields)
    # Through a file: nothing but the file connects it with the first part.
    with pytest.raises(bp.NotConvergedError) as refused:
        problem.follow(tugged(load), **(options | {"slip": 1e-9, "smallest": 0.2}))
    refused.value.result.save(tmp_path / "some.h5")
    assert bp.load(tmp_path / "some.h5").message == str(refused.value)
    whole.save(tmp_path / "path.h5")
    read = bp.load(tmp_path / "path.h5")
    assert read.s.tobytes() == whole.s.tobytes()
    rest = bar_problem(12)[0].follow(tugged(load), **options, start=read[2])
    assert bits(rest, whole[3:], fields)
    assert len(problem.follow(tugged(load), **options, start=read)) == 0


def test_a_step_that_does_not_converge_is_halved() -> None:
    """The slip front moves only a few nodes within so many iterations."""
    problem, load = bar_problem(40)

    def at(s: float) -> Any:
        now = np.array(load)
        now[-1] += 20 * s
        return now

    # One step from the pressed bar needs more iterations than allowed.
    limit = 12
    pressed = problem.solve(at(0.0))
    with pytest.raises(bp.NotConvergedError):
        problem.solve(at(1.0), start=pressed, max_iterations=limit)
    result = problem.follow(at, max_iterations=limit, start=pressed, smallest=1e-6)
    assert result.s[-1] == 1.0
    # The step was halved more than once.
    assert np.diff(result.s, prepend=0.0).min() <= 0.25
    assert (result.iterations <= limit).all()
    assert bits(
        result, bar_problem(40)[0].solve([at(s) for s in result.s], start=pressed)
    )


def test_too_much_slip_in_the_smallest_step() -> None:
    with pytest.raises(bp.NotConvergedError, match="contact 0 slips by") as refused:
        spring().follow(
            lambda s: [-2.0, 4.0 * s], largest=0.25, slip=1e-3, smallest=0.125
        )
    # The part up to the end of stick was reached.
    np.testing.assert_array_equal(refused.value.result.s, [0.25])


def test_an_array_grows_in_proportion() -> None:
    load = np.array([-2.0, 3.0])
    result = spring().follow(load, stops=2.0, largest=0.5)
    np.testing.assert_array_equal(result.s, [0.5, 1.0, 1.5, 2.0])
    steps = np.outer(result.s / 2, load)
    steps[-1] = load
    assert bits(result, spring().solve(steps))
