"""Rules of results and errors that other programs rely on."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp

# Two contacts in the plane, normal first, on four degrees of freedom of a held body.
K = np.array(
    [
        [2.0, 0.5, -0.3, 0.0],
        [0.5, 1.0, 0.0, -0.1],
        [-0.3, 0.0, 2.0, 0.5],
        [0.0, -0.1, 0.5, 1.0],
    ]
)
B = sparse.csr_array(np.eye(4))
GAP = np.zeros(2)
LOAD = np.array([-1.0, 0.2, -1.0, 0.2])
W = np.linalg.inv(K)
Q = (W @ LOAD).reshape(2, 2)


def problem(**changed: Any) -> bp.ContactProblem:
    arguments = {"K": K, "B": B, "gap": GAP, "mu": 0.3} | changed
    return bp.ContactProblem(arguments.pop("K"), arguments.pop("B"), **arguments)


def solve(**changed: Any) -> bp.Result:
    arguments = {"load": LOAD} | changed
    return problem().solve(arguments.pop("load"), **arguments)


def reduced(**changed: Any) -> bp.ReducedProblem:
    arguments = {"W": W, "q": Q, "mu": 0.3} | changed
    return bp.ReducedProblem(
        arguments.pop("W"), arguments.pop("q"), arguments.pop("mu"), **arguments
    )


def put(array: Any, index: Any, value: float) -> Any:
    """A copy with one entry changed."""
    array = np.array(array, dtype=float)
    array[index] = value
    return array


def test_rounding_is_not_asymmetry() -> None:
    assert problem(K=put(K, (0, 1), 0.5 * (1 + 4e-16))).solve(LOAD).success


@pytest.mark.parametrize("form", [np.asarray, sparse.csr_array, sparse.csc_array])
def test_the_upper_triangle_is_used(form: Any) -> None:
    rounding = np.triu(5e-11 * np.random.default_rng(0).uniform(-1, 1, K.shape), 1)
    uneven = problem(K=form(K + rounding)).compliance
    upper = problem(K=form(K + rounding + rounding.T)).compliance
    assert np.array_equal(uneven, upper)
    assert not np.array_equal(uneven, problem(K=form(K)).compliance)


def test_indefinite_inside() -> None:
    """The message has the caller's number of a degree of freedom away from contact."""
    inside = np.zeros((5, 5))
    inside[1:, 1:] = K
    inside[0, 0] = -1.0
    wide = sparse.csr_array(np.hstack([np.zeros((4, 1)), np.eye(4)]))
    with pytest.raises(ValueError, match=r"K .*\b0\b"):
        problem(K=inside, B=wide)


def test_nothing_holds_the_interior() -> None:
    """The message names a free node that no contact touches."""
    free = np.zeros((5, 5))
    free[:4, :4] = K
    wide = sparse.csr_array(np.hstack([np.eye(4), np.zeros((4, 1))]))
    with pytest.raises(bp.FloatingBodyError, match=r"\b4\b") as caught:
        problem(K=free, B=wide)
    assert caught.value.result is None


class TestErrorsCarryTheirResult:
    """A path whose second step has no solution keeps the first step."""

    @staticmethod
    def drift() -> bp.BipotError:
        # One contact under a body free in both directions: pressed, then lifted.
        free = bp.ContactProblem(
            np.zeros((2, 2)), np.eye(2), gap=np.zeros(1), mu=0.5, dim=2
        )
        with pytest.raises(bp.NoEquilibriumError, match="load step 2") as caught:
            free.solve(np.array([[-1.0, 0.3], [1.0, 0.0]]))
        return caught.value

    def test_pulled_off(self) -> None:
        error = self.drift()
        assert isinstance(error, bp.BipotError)
        result = error.result
        assert result.reaction.shape == (1, 1, 2)
        # By statics the reaction is minus the load, to the tolerance of the solver.
        np.testing.assert_allclose(result.reaction[0], [[1.0, -0.3]], rtol=1e-9)
        assert result.status[0, 0] == bp.Status.STICK
        assert not result.success
        assert np.isfinite(result.relative_displacement).all()

    def test_no_equilibrium(self) -> None:
        """A node is prescribed to penetrate its obstacle: no reaction can push it out."""
        held = problem(fixed=[0, 1])
        with pytest.raises(bp.NoEquilibriumError, match=r"\b0\b") as caught:
            held.solve(LOAD, np.array([[0.0, 0.0], [-0.1, 0.0]]))
        assert caught.value.result.reaction.shape == (1, 2, 2)

    def test_not_converged(self) -> None:
        with pytest.raises(bp.NotConvergedError) as caught:
            problem().solve(
                np.array([0 * LOAD, LOAD + np.array([0, 0.5, 0, 0])]),
                method="uzawa",
                max_iterations=1,
            )
        result = caught.value.result
        assert result.reaction.shape == (1, 2, 2)  # # the first step needed nothing
        assert not result.success
        assert str(caught.value).startswith("load step 2: not converged")

    def test_reduced_reports_instead(self) -> None:
        solution = reduced().solve(method="uzawa", max_iterations=1)
        assert not solution.converged
        assert str(solution.outcome) == "iteration_limit"
        assert solution.residual > solution.tolerance
        assert np.isfinite(solution.reaction).all()

    def test_time_limit(self) -> None:
        solution = reduced().solve(method="uzawa", max_seconds=1e-9)
        assert not solution.converged
        assert str(solution.outcome) == "time_limit"

    @pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
    def test_pickle(self, protocol: int) -> None:
        error = self.drift()
        again = pickle.loads(pickle.dumps(error, protocol))
        assert type(again) is type(error)
        assert str(again) == str(error)
        np.testing.assert_array_equal(again.result.reaction, error.result.reaction)
        assert str(copy.copy(error)) == str(error)

    @pytest.mark.parametrize(
        "kind",
        ["BipotError", "NoEquilibriumError", "FloatingBodyError", "NotConvergedError"],
    )
    def test_pickle_every_kind(self, kind: str) -> None:
        error = getattr(bp, kind)("what went wrong")
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is getattr(bp, kind)
        assert str(again) == "what went wrong"
        assert again.result is None


class TestSettled:
    """Rules of the API that other programs rely on."""

    def test_a_tolerance_below_rounding_is_raised(self) -> None:
        solution = reduced().solve(tol=1e-300)
        assert solution.converged
        # The floor is 4 eps times a modest ratio, and at most 1e-6.
        assert 1e-17 < solution.tolerance < 1e-13

    def test_nothing_loaded_is_open(self) -> None:
        solution = bp.ReducedProblem(W, np.ones((2, 2)), 0.3).solve()
        assert (solution.reaction == 0).all()
        assert (solution.status == bp.Status.OPEN).all()
        assert solution.residual == 0.0

    def test_frictionless_pressed_is_slip(self) -> None:
        _, status = bp.project(np.array([[1.0, 0.0, 0.0]]), 0.0)
        assert status.tolist() == [bp.Status.SLIP]
        assert status.dtype == np.int8
        solution = bp.ReducedProblem(W, Q, 0.0).solve()
        assert (solution.status == bp.Status.SLIP).all()
        assert (solution.reaction[:, 1] == 0).all()

    def test_a_tie_is_stick(self) -> None:
        _, status = bp.project(np.array([[2.0, 1.0]]), 0.5)
        assert status.tolist() == [bp.Status.STICK]

    def test_the_vertex_is_open(self) -> None:
        for mu in (0.0, 0.5):
            point, status = bp.project(np.array([[0.0, 0.0], [-1.0, 0.0]]), mu)
            assert status.tolist() == [bp.Status.OPEN] * 2
            assert (point == 0).all()

    def test_slip_is_an_increment(self) -> None:
        result = problem().solve(
            np.array([[-1.0, 1.5, -1.0, 1.5], [-1.0, 1.8, -1.0, 1.8]])
        )
        total = result.relative_displacement[..., 1:]
        np.testing.assert_array_equal(result.slip[0], total[0])
        # Two roundings in a difference of numbers of order one.
        np.testing.assert_allclose(result.slip[1], total[1] - total[0], atol=1e-15)
        assert np.abs(result.slip[1]).max() > 1e-3

    def test_writing_needs_places(self, tmp_path: Any) -> None:
        result = problem().solve(LOAD)
        with pytest.raises(ValueError, match="points"):
            result.write(tmp_path / "x.pvd")

    def test_arrays_are_float64_and_c_ordered(self) -> None:
        result = solve()
        for array in (result.reaction, result.relative_displacement, result.slip):
            assert array.dtype == np.float64
            assert array.flags.c_contiguous
        assert result.status.dtype == np.int8
        assert result.traction is None

    def test_one_row_is_repeated(self) -> None:
        held = problem(fixed=[3])
        result = held.solve(LOAD, np.array([[0.0], [0.1]]))
        assert result.reaction.shape == (2, 2, 2)
        result = held.solve(np.array([LOAD, 2 * LOAD]), [0.1])
        assert result.reaction.shape == (2, 2, 2)

    def test_missing_prescribed_is_zero(self) -> None:
        held = problem(fixed=[3])
        np.testing.assert_array_equal(
            held.solve(LOAD).reaction, held.solve(LOAD, [0.0]).reaction
        )
