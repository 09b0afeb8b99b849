"""Rules of results and errors that other programs rely on."""

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact.errors import with_message
from bipot_rs.contact.law.contact_law import ContactLaw

pytestmark = pytest.mark.needs_extra

# Two contacts in the plane, normal first, on four degrees of freedom of a held body.
K = np.array(
    [
        [2.0, 0.5, -0.3, 0.0],
        [0.5, 1.0, 0.0, -0.1],
        [-0.3, 0.0, 2.0, 0.5],
        [0.0, -0.1, 0.5, 1.0],
    ]
)
LOAD = np.array([-1.0, 0.2, -1.0, 0.2])
W = np.linalg.inv(K)
Q = (W @ LOAD).reshape(2, 2)


def problem(**changed: Any) -> bp.ContactProblem:
    given = {"K": K, "B": np.eye(4), "gap": np.zeros(2), "mu": 0.3} | changed
    return bp.ContactProblem(**given)


@pytest.mark.parametrize("form", [np.asarray, sparse.csr_array, sparse.csc_array])
def test_the_upper_triangle_is_used(form: Any) -> None:
    """Rounding is no asymmetry."""
    rounding = np.triu(5e-11 * np.random.default_rng(0).uniform(-1, 1, K.shape), 1)
    uneven = problem(K=form(K + rounding)).compliance
    upper = problem(K=form(K + rounding + rounding.T)).compliance
    assert np.array_equal(uneven, upper)
    assert not np.array_equal(uneven, problem(K=form(K)).compliance)


def drift() -> bp.BipotError:
    """One contact under a body free in both directions: pressed, then lifted."""
    free = bp.ContactProblem(np.zeros((2, 2)), np.eye(2), gap=[0.0], mu=0.5, dim=2)
    with pytest.raises(bp.NoEquilibriumError, match="load step 2") as caught:
        free.solve(np.array([[-1.0, 0.3], [1.0, 0.0]]))
    return caught.value


def test_errors_carry_the_steps_before() -> None:
    error = drift()
    assert isinstance(error, bp.BipotError)
    result = error.result
    assert result is not None
    # By statics the reaction is minus the load, to the tolerance of the solver.
    np.testing.assert_allclose(result.reaction, [[[1.0, -0.3]]], rtol=1e-9)
    assert result.status[0, 0] == bp.Status.STICK
    assert not result.success
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(copy.copy(error)) == str(error)
    np.testing.assert_array_equal(again.result.reaction, result.reaction)
    loads = np.array([0 * LOAD, LOAD + np.array([0, 0.5, 0, 0])])
    with pytest.raises(bp.NotConvergedError) as caught:
        problem().solve(loads, method="uzawa", max_iterations=1)
    assert caught.value.result is not None
    # The first step needed nothing.
    assert caught.value.result.reaction.shape == (1, 2, 2)
    assert str(caught.value).startswith("load step 2: not converged")


def core_error(mu: float = 0.5, modes: int = 0) -> Exception:
    """The error of a reduced problem of one contact."""
    rows = np.zeros(3, np.int64), np.zeros(0, np.int64), np.zeros(0)
    law = ContactLaw(np.array([mu]))
    with pytest.raises((ValueError, bp.BipotError)) as caught:
        _core.Reduced(
            [([0], np.eye(2).ravel(), None)], Q[:1], law, rows, np.zeros(modes)
        )
    return caught.value


@pytest.mark.parametrize(
    ("error", "fields"),
    [
        (core_error(mu=-1.0), {"kind": "friction", "node": 0, "mu": -1.0}),
        (core_error(modes=1), {"kind": "dependent_motion", "mode": 0}),
        *(
            (getattr(bp, name)("what went wrong"), {"result": None})
            for name in (
                "BipotError",
                "NoEquilibriumError",
                "FloatingBodyError",
                "NotConvergedError",
            )
        ),
    ],
    ids=repr,
)
def test_fields_of_errors_in_pickles_and_other_words(
    error: Exception, fields: dict[str, object]
) -> None:
    pickled = pickle.loads(pickle.dumps(error))
    reworded = with_message(error, "in other words")
    assert str(reworded) == "in other words"
    assert str(pickled) == str(error) != str(reworded)
    for same in (error, pickled, reworded):
        assert type(same) is type(error)
        assert {name: getattr(same, name) for name in fields} == fields


def test_the_load_step_of_an_error() -> None:
    problem = bp.ContactProblem(
        np.eye(2), np.eye(2), gap=[1.0], mu=0.5, fixed=[0, 1], dim=2
    )
    with pytest.raises(bp.NoEquilibriumError) as caught:
        problem.solve(prescribed=[[0.0, 0.0], [-2.0, 0.0]])
    error = caught.value
    assert (error.step, error.kind, error.node) == (2, "contradictory_contact", 0)
    assert str(error) == f"load step 2: {error.reason}"
    assert error.result is not None
    assert error.result.message == str(error)
    assert error.at_step(5, 9) == f"load step 5 of 9: {error.reason}"


def test_reduced_problems_report_instead() -> None:
    solve = bp.ReducedProblem(W, Q, 0.3).solve
    for limit, outcome in (
        ({"max_iterations": 1}, "iteration_limit"),
        ({"max_seconds": 1e-9}, "time_limit"),
    ):
        solution = solve(method="uzawa", **limit)
        assert not solution.converged
        assert str(solution.outcome) == outcome
        assert solution.residual > solution.tolerance
        assert np.isfinite(solution.reaction).all()
    # A tolerance below rounding is raised, to 4 ε times a modest ratio, and at most 1e-6.
    assert 1e-17 < solve(tol=1e-300).tolerance < 1e-13


def test_arrays_of_results() -> None:
    result = problem().solve(LOAD)
    for array in (result.reaction, result.relative_displacement, result.slip):
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
    assert result.status.dtype == np.int8
    assert result.traction is None
    held = problem(fixed=[3])
    zero = held.solve(LOAD, [0.0])
    np.testing.assert_array_equal(held.solve(LOAD).reaction, zero.reaction)


def test_points_are_found_by_the_name_of_the_argument(tmp_path: Path) -> None:
    places = [[0.0, 0.0], [1.0, 0.0]]
    result = problem(points=places).solve(LOAD)
    result.save(tmp_path / "a.h5")
    again = pickle.loads(pickle.dumps(result))
    for any_result in (result, again, bp.load_result(tmp_path / "a.h5")):
        np.testing.assert_array_equal(any_result.contacts["points"], places)
        np.testing.assert_array_equal(any_result.contacts.get("points"), places)
        # Not a second array: files and loops over the data have it once.
        assert "points" not in list(any_result.contacts)
    with pytest.raises(KeyError, match="'place': the contacts have x, normal"):
        result.contacts["place"]
    assert result.contacts.get("place") is None
    bare = problem().solve(LOAD)
    assert bare.contacts["points"] is None
    with pytest.raises(ValueError, match="points"):
        bare.write(tmp_path / "x.pvd")
