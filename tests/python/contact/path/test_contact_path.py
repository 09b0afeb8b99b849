"""The Newton loop of the core with the long vectors and linear systems of a Python object."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import _core
from support.numpy_engine import NumpyEngine, force_of, variables_of
from support.pressed_in_space import pressed

Array = NDArray[np.float64]
SETTINGS = _core.Settings("newton", 1e-12, None, None)
# η is 1e-12, and the answers of two methods differ by the condition of the contacts.
CLOSE = 1e-10


class Case:
    def __init__(self, model: bp.Model) -> None:
        case = model.assemble()
        self.model = case.model
        self.prescribed = case.prescribed
        self.K = self.model.K.toarray()
        self.gap = np.zeros((len(self.model.gap), self.model.dim))
        self.gap[:, 0] = self.model.gap
        self.variables = variables_of(
            self.K, self.model.B, self.gap, self.model.mu, self.model.fixed
        )

    def engine(self) -> NumpyEngine:
        return NumpyEngine(self.K, self.variables, self.model.fixed)

    def step(
        self, path: _core.ContactPath, engine: Any, y: Array, k: int
    ) -> tuple[_core.NewtonStep, Array]:
        fixed, moved = self.model.fixed, self.prescribed[k]
        zero = np.zeros(len(self.K))
        force = force_of(self.K, self.variables, zero, fixed, moved)
        return path.step(engine, y, force, moved, None, SETTINGS)

    def direct(self) -> bp.Result:
        m = self.model
        problem = bp.ContactProblem(
            m.K, m.B, gap=m.gap, mu=m.mu, fixed=m.fixed, engine="direct"
        )
        return problem.solve(prescribed=self.prescribed, tol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow_variants("3")
def test_the_answers_of_the_direct_engine(dim: int) -> None:
    case = Case(pressed(4 if dim == 3 else 8, dim=dim))
    engine, path = case.engine(), _core.ContactPath(case.variables)
    expected = case.direct()
    y = np.zeros(len(case.K))
    for k in range(2):
        step, y = case.step(path, engine, y, k)
        assert step.solution.outcome == "converged"
        scale = np.abs(expected.reaction).max()
        assert (
            np.abs(step.solution.reaction - expected[k].reaction).max() <= CLOSE * scale
        )
        assert np.array_equal(step.solution.status, expected[k].status)
        slip = np.abs(expected[k].relative_displacement).max()
        assert np.abs(step.slip - expected[k].slip).max() <= CLOSE * max(slip, 1e-300)
        u = y.copy()
        case.variables.to_displacements(u)
        u[case.model.fixed] = case.prescribed[k]
        size = np.abs(expected[k].displacement).max()
        assert np.abs(u - expected[k].displacement).max() <= CLOSE * size
    # Newton with exact linear systems takes few of them.
    assert engine.calls <= 16


def test_variables_are_those_of_their_matrix() -> None:
    case = Case(pressed(3))
    variables, n = case.variables, len(case.K)
    T = case.engine().T
    free = np.setdiff1d(np.arange(n), case.model.fixed)
    y = np.zeros(n)
    y[free] = np.random.default_rng(5).standard_normal(len(free))
    u, f, back = y.copy(), y.copy(), y.copy()
    variables.to_displacements(u)
    # Sums of three products of numbers of size 1.
    assert np.abs(u - T @ y).max() <= 1e-14
    variables.forces_to_local(f)
    assert np.abs(f - T.T @ y).max() <= 1e-14
    back = u.copy()
    variables.to_local(back)
    assert np.abs(back - y).max() <= 1e-14
    assert variables.places == n
    assert not variables.join
    assert set(np.flatnonzero(variables.absent)) == set(case.model.fixed)


class Broken(NumpyEngine):
    def product(self, _y: Array) -> Array:
        raise ZeroDivisionError("out of products")


class Short(NumpyEngine):
    def at_places(self, y: Array) -> Array:
        return y[1:]


class Late(NumpyEngine):
    def agreed(self, _decision: bool) -> bool:
        return True


@pytest.mark.parametrize(
    ("kind", "error", "said"),
    [
        (Broken, ZeroDivisionError, "out of products"),
        (Short, ValueError, "values by places has length"),
        (Late, None, "time_limit"),
    ],
)
def test_what_goes_wrong_in_the_engine(kind: Any, error: Any, said: str) -> None:
    """Exceptions reach the caller; the engine decides that time is over."""
    case = Case(pressed(2))
    start = np.zeros(len(case.K))
    path = _core.ContactPath(case.variables)
    engine = kind(case.K, case.variables, case.model.fixed)
    if error is None:
        assert case.step(path, engine, start, 0)[0].solution.outcome == said
        return
    with pytest.raises(error, match=said):
        case.step(path, engine, start, 0)
    # The path did not move.
    step, _ = case.step(path, case.engine(), start, 0)
    assert step.solution.outcome == "converged"
