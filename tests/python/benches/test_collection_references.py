"""Reference answers against closed forms, exact fractions and an independent program."""

from dataclasses import replace
from fractions import Fraction

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


def reference(W: Array, q: Array, mu: float, near: Array, status: list[int]) -> object:
    p = system(bp.ReducedProblem(W, q, mu))
    return refine(p, near, np.zeros(0), np.array(status, np.int8))


def test_one_sliding_contact_in_space_has_a_closed_form() -> None:
    # r_n = -q_n / w, and the friction is against q_t, along (3, 4) / 5.
    W, q = np.diag([0.5, 0.25, 0.25]), np.array([[-1.0, 3.0, 4.0]])
    near = np.array([[2.1, -0.4, -0.7]])
    refined = reference(W, q, 0.5, near, [bp.Status.SLIP])
    # Exact binary numbers, except for the thirds and fifths, which are rounded once.
    np.testing.assert_array_equal(refined.r, [[2.0, -0.6, -0.8]])
    np.testing.assert_array_equal(refined.u, [[0.0, 2.85, 3.8]])
    assert refined.correction <= CONVERGED


@pytest.mark.parametrize("start", [bp.Status.OPEN, bp.Status.STICK])
def test_wrong_statuses_are_changed(start: bp.Status) -> None:
    W, q = np.diag([0.5, 0.25, 0.25]), np.array([[-1.0, 3.0, 4.0]])
    refined = reference(W, q, 0.5, np.array([[2.0, -0.6, -0.8]]), [start])
    assert refined.status.tolist() == [bp.Status.SLIP]
    np.testing.assert_array_equal(refined.r, [[2.0, -0.6, -0.8]])


def test_sliding_in_the_plane_is_rounded_from_exact_fractions() -> None:
    """Two coupled contacts, both sliding: Gaussian elimination in fractions."""
    W = np.diag([2.0, 1.5, 2.0, 1.5])
    for i, j, value in ((0, 1, 0.3), (0, 2, 0.5), (1, 3, 0.2), (2, 3, -0.3)):
        W[i, j] = W[j, i] = value
    q, mu = np.array([[-1.0, 0.9], [-0.5, -1.5]]), 0.25
    near = bp.ReducedProblem(W, q, mu).solve(tol=1e-6)
    assert near.status.tolist() == [bp.Status.SLIP, bp.Status.SLIP]
    refined = refine(
        system(bp.ReducedProblem(W, q, mu)), near.reaction, np.zeros(0), near.status
    )
    # r_t = -mu sign(u_t) r_n turns u_n = 0 into two equations for r_n.
    exact = [[Fraction(x) for x in row] for row in W]
    t = [-Fraction(mu), Fraction(mu)]
    a = [
        [exact[2 * i][2 * j] + t[j] * exact[2 * i][2 * j + 1] for j in (0, 1)]
        for i in (0, 1)
    ]
    b = [Fraction(1), Fraction(0.5)]
    det = a[0][0] * a[1][1] - a[0][1] * a[1][0]
    first = (b[0] * a[1][1] - b[1] * a[0][1]) / det
    second = (a[0][0] * b[1] - a[1][0] * b[0]) / det
    expected = [
        [float(x), float(s * x)] for x, s in zip((first, second), t, strict=True)
    ]
    np.testing.assert_array_equal(refined.r, expected)


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
        status = answer.status
        other = reference_solution.refine(
            Problem(name, np.asarray(problem.W), problem.q, problem.mu, problem.rigid),
            answer.r * (1 + 1e-9),
            answer.y if problem.rigid else None,
            status,
        )
        if not (status != bp.Status.OPEN).any():
            np.testing.assert_array_equal(answer.r, 0.0)
            continue
        assert other.trusted
        # The other program stops at corrections of 1e-15.
        size = np.abs(answer.r).max()
        np.testing.assert_allclose(
            answer.r, other.r.astype(float), rtol=0, atol=2e-15 * size
        )
        compared += 1
    assert compared >= 4


def test_a_path_is_that_of_the_whole_problem() -> None:
    """Slip history enters each file: `ContactProblem.solve` finds the same reactions."""
    path = PATHS["block_2d_9_cyclic"].make()
    whole = bp.ContactProblem(
        path.K, path.B, gap=path.gap, mu=path.mu, fixed=path.fixed
    )
    result = whole.solve(path.load, path.prescribed, tol=1e-12)
    for step, step_of_path in zip(steps(path), result, strict=True):
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
    problem = bp.ContactProblem(
        path.K,
        path.B,
        gap=path.gap,
        mu=path.mu,
        fixed=path.fixed,
        frame=path.frame,
        gaps=path.gaps,
        engine="direct",
    )
    expected = problem.solve(path.load, path.prescribed, tol=1e-13)
    assert expected[1].status.min() < bp.Status.STICK
    # η is 1e-13; the errors are larger by the condition of the contacts.
    size, shift = np.abs(expected.reaction).max(), np.abs(expected.slip).max()
    for step_with_frames, step in zip(steps(path), expected, strict=True):
        answer = step_with_frames.answers[0]
        assert np.abs(answer.r - step.reaction).max() <= 1e-11 * size
        assert np.abs(answer.u[:, 1:] - step.slip).max() <= 1e-11 * shift


# Names tell the number of contacts; the larger ones take a minute.
def contacts(name: str) -> int:
    return next(int(part) for part in name.split("_") if part.isdigit())


SMALL = [name for name in PATHS if contacts(name) <= 300]


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.slow_variants(
    "block_3d_121",
    "block_3d_256_turning",
    "hertz_3d_169",
    "pair_3d_100_release",
    "pair_3d_49_mortar",
    "pair_3d_81",
    "rough_2d_257",
    "twist_3d_49",
)
@pytest.mark.slow_variants("block_2d_129_strong")
def test_the_first_steps_of_a_path_have_references(name: str) -> None:
    first_steps = [
        step for step, _ in zip(steps(PATHS[name].make()), range(3), strict=False)
    ]
    assert all(step.answers or step.proof is not None for step in first_steps)
