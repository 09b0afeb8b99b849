"""Reference answers of load paths are those of the whole problem."""

from typing import Any

import numpy as np
import pytest
from collection.catalogue import PATHS
from collection.reference import refine
from collection.steps import steps
from collection.system import system

import bipot_rs as bp


def test_without_statuses_near_there_is_no_reference() -> None:
    # A pull on a body that contact alone holds.
    free = bp.ReducedProblem(
        np.zeros((2, 2)), [[0.0, 0.0]], 0.3, rigid=(np.eye(2), [1.0, 0.0])
    )
    with pytest.raises((ArithmeticError, RuntimeError)):
        refine(system(free), np.ones((1, 2)), np.zeros(2), np.array([2], np.int8))


def whole(path: Any, tol: float) -> bp.Result:
    """The answer of `ContactProblem` for all load steps of a path."""
    names = ("gap", "mu", "fixed", "frame", "gaps")
    known = {name: getattr(path, name) for name in names}
    problem = bp.ContactProblem(path.K, path.B, **known, engine="direct")
    return problem.solve(path.load, path.prescribed, tol=tol)


def test_a_path_is_that_of_the_whole_problem() -> None:
    """Slip history enters each file: `ContactProblem.solve` finds the same reactions."""
    path = PATHS["block_2d_9_cyclic"].make()
    for step, step_of_path in zip(steps(path), whole(path, 1e-12), strict=True):
        (answer,) = step.answers
        # The tolerance of the solver times the condition of W, below 100.
        size = 1e-10 * np.abs(answer.r).max()
        np.testing.assert_allclose(answer.r, step_of_path.reaction, rtol=0, atol=size)
        np.testing.assert_array_equal(answer.status, step_of_path.status)


def test_frames_of_each_step_are_those_of_the_load_path() -> None:
    """A roller that rolls: histories carried as `ContactProblem.solve` carries them."""
    path = PATHS["roller_2d_41"].make()
    expected = whole(path, 1e-13)
    assert expected[1].status.min() < bp.Status.STICK
    # η is 1e-13; the errors are larger by the condition of the contacts.
    size, shift = np.abs(expected.reaction).max(), np.abs(expected.slip).max()
    for of_path, step in zip(steps(path), expected, strict=True):
        (answer, *_) = of_path.answers
        assert np.abs(answer.r - step.reaction).max() <= 1e-11 * size
        assert np.abs(answer.u[:, 1:] - step.slip).max() <= 1e-11 * shift
