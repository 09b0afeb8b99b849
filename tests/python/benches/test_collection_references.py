"""Reference answers against closed forms, exact fractions and an independent program."""

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import reference_solution
from collection.catalogue import PATHS
from collection.reference import CONVERGED, refine
from collection.steps import steps
from collection.system import system
from numpy.typing import NDArray
from problems import Problem

import bipot_rs as bp

Array = NDArray[np.float64]


def reference(W: Array, q: Array, mu: float, near: Array, status: Any) -> Any:
    problem = system(bp.ReducedProblem(W, q, mu))
    return refine(problem, near, np.zeros(0), np.array(status, np.int8))


@pytest.mark.parametrize("start", [bp.Status.SLIP, bp.Status.OPEN, bp.Status.STICK])
def test_one_sliding_contact_in_space_has_a_closed_form(start: bp.Status) -> None:
    """From any status: wrong ones are changed."""
    # r_n = -q_n / w, and the friction is against q_t, along (3, 4) / 5.
    W, q = np.diag([0.5, 0.25, 0.25]), np.array([[-1.0, 3.0, 4.0]])
    near = [[2.1, -0.4, -0.7]] if start is bp.Status.SLIP else [[2.0, -0.6, -0.8]]
    refined = reference(W, q, 0.5, np.array(near), [start])
    # Exact binary numbers, except for the thirds and fifths, which are rounded once.
    np.testing.assert_array_equal(refined.r, [[2.0, -0.6, -0.8]])
    np.testing.assert_array_equal(refined.u, [[0.0, 2.85, 3.8]])
    assert refined.status.tolist() == [bp.Status.SLIP]
    assert refined.correction <= CONVERGED


def test_sliding_in_the_plane_is_rounded_from_exact_fractions() -> None:
    """Two coupled contacts, both sliding: Gaussian elimination in fractions."""
    W = np.diag([2.0, 1.5, 2.0, 1.5])
    for i, j, value in ((0, 1, 0.3), (0, 2, 0.5), (1, 3, 0.2), (2, 3, -0.3)):
        W[i, j] = W[j, i] = value
    q, mu = np.array([[-1.0, 0.9], [-0.5, -1.5]]), 0.25
    near = bp.ReducedProblem(W, q, mu).solve(tol=1e-6)
    assert near.status.tolist() == [bp.Status.SLIP, bp.Status.SLIP]
    refined = reference(W, q, mu, near.reaction, near.status)
    # r_t = -mu sign(u_t) r_n turns u_n = 0 into two equations for r_n.
    w = [[Fraction(x) for x in row] for row in W]
    t = [-Fraction(mu), Fraction(mu)]
    (a, b), (c, d) = (
        [w[2 * i][2 * j] + t[j] * w[2 * i][2 * j + 1] for j in (0, 1)] for i in (0, 1)
    )
    one, half = Fraction(1), Fraction(0.5)
    det = a * d - b * c
    pressed = (one * d - half * b) / det, (a * half - c * one) / det
    exact = [[float(x), float(s * x)] for x, s in zip(pressed, t, strict=True)]
    np.testing.assert_array_equal(refined.r, exact)


def test_without_statuses_near_there_is_no_reference() -> None:
    # A pull on a body that contact alone holds.
    free = bp.ReducedProblem(
        np.zeros((2, 2)), [[0.0, 0.0]], 0.3, rigid=(np.eye(2), [1.0, 0.0])
    )
    with pytest.raises((ArithmeticError, RuntimeError)):
        refine(system(free), np.ones((1, 2)), np.zeros(2), np.array([2], np.int8))


@pytest.mark.parametrize(
    "name",
    [
        "block_2d_9_cyclic",
        "block_3d_9_release",
        "near_sliding_2d_25",
        "pair_3d_49_mortar",
    ],
)
@pytest.mark.slow_variants("pair_3d_49_mortar")
def test_an_independent_program_agrees(name: str) -> None:
    """The reference of the benches: other equations, statuses by projection, longdouble."""
    compared = 0
    for step in steps(PATHS[name].make()):
        (answer,), problem = step.answers, step.problem
        if not (answer.status != bp.Status.OPEN).any():
            np.testing.assert_array_equal(answer.r, 0.0)
            continue
        W = np.asarray(problem.W)
        other = reference_solution.refine(
            Problem(name, W, problem.q, problem.mu, problem.rigid),
            answer.r * (1 + 1e-9),
            answer.y if problem.rigid else None,
            answer.status,
        )
        assert other.trusted
        # The other program stops at corrections of 1e-15.
        close = {"rtol": 0, "atol": 2e-15 * np.abs(answer.r).max()}
        np.testing.assert_allclose(answer.r, other.r.astype(float), **close)
        compared += 1
    assert compared >= 4


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


def test_the_global_form_is_the_same_problem() -> None:
    path = PATHS["block_3d_9_release"].make()
    other = replace(path, form="global")
    for own_step, two in zip(steps(path), steps(other), strict=True):
        # W of the local form is rounded; its condition is below 100.
        size = 1e-13 * max(np.abs(own_step.answers[0].r).max(), 1e-300)
        np.testing.assert_allclose(
            own_step.answers[0].r, two.answers[0].r, rtol=0, atol=size
        )


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


# Names tell the number of contacts; the larger ones take a minute.
def contacts(name: str) -> int:
    return next(int(part) for part in name.split("_") if part.isdigit())


SMALL = [name for name in PATHS if contacts(name) <= 300]


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.slow_variants(
    *("block_2d_129_strong", "block_3d_121", "block_3d_256_turning", "hertz_3d_169"),
    *("pair_3d_100_release", "pair_3d_49_mortar", "pair_3d_81", "rough_2d_257"),
    *("several_2d_9", "stack_3d_32", "twist_3d_49"),
)
def test_the_first_steps_of_a_path_have_references(name: str) -> None:
    for step, _ in zip(steps(PATHS[name].make()), range(3), strict=False):
        assert step.answers or step.proof is not None
