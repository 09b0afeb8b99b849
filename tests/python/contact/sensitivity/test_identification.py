"""Parameters are recovered from the displacements of a fretting loop, by exact Jacobians."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs._lib.types import Floats

pytestmark = pytest.mark.needs_extra

YOUNG = 3000.0  # MPa, of the stiffness that is factored


class Block:
    """A pressed block that is moved to and fro; its parameters are μ at both ends, E, a depth."""

    def __init__(self) -> None:
        wide, high = np.linspace(0, 20, 17), np.linspace(0, 5, 5)  # mm
        mesh = fem.box([wide, high], "quadrilateral")
        plane = ((0, 0), (0, 1))
        self.model = fem.assemble(
            [fem.Body("block", mesh, fem.Material(YOUNG, 0.35))],
            contacts=[fem.Contact("block", "bottom", mu=0.3, plane=plane)],
            supports=[fem.Support("block", "top", components=(0,))],
        )
        self.problem = self.model.problem()
        x = self.model.points[:, 0]
        self.shape = np.stack([1 - x / 20, x / 20])
        self.recess = np.where(abs(x - 10) < 2.6, 1.0, 0.0)
        self.press = self.model.pressure("block", "top", 10.0)
        loop = (0.0, 0.015, 0.03, 0.0, -0.03, 0.0)
        self.path = np.array([self.model.prescribed([(s,)]) for s in loop])
        self.row = np.flatnonzero(self.model.nodes[:, 1] == high[1])

    def solve(self, p: Floats) -> bp.Result:
        """The path with these parameters; E divides the load instead of scaling K."""
        *ends, young, depth = p
        case: dict[str, Any] = {"load": self.press * YOUNG / young}
        case |= {"prescribed": self.path, "mu": ends @ self.shape}
        case |= {"gap": self.model.gap + depth * self.recess}
        (result,) = self.problem.solve_many([case])
        assert result.success, result.message
        return result

    def seen(self, displacement: Floats) -> Floats:
        """Displacements of a row of nodes, in all steps."""
        at = (2 * self.row[:, None] + [0, 1]).ravel()
        return displacement[:, at].ravel()

    def jacobian(self, result: bp.Result, young: float) -> Floats:
        """Derivatives of `seen`, a column for each parameter."""
        directions: list[dict[str, Any]] = [{"mu": hat} for hat in self.shape]
        directions += [{"load": -self.press * YOUNG / young**2}, {"gap": self.recess}]
        columns = [
            self.seen(result.jvp(**direction).displacement) for direction in directions
        ]
        return np.column_stack(columns)


@pytest.fixture(scope="module")
def block() -> Block:
    return Block()


TRUE = np.array([0.42, 0.3, 3300.0, 4e-3])
GUESS = np.array([0.3, 0.35, YOUNG, 2e-3])


def test_data_without_noise_give_the_true_parameters(block: Block) -> None:
    data = block.seen(block.solve(TRUE).displacement)
    size = abs(data).max()

    def residual(p: Floats) -> Floats:
        return (block.seen(block.solve(p * GUESS).displacement) - data) / size

    def jacobian(p: Floats) -> Floats:
        p = p * GUESS
        return block.jacobian(block.solve(p), p[2]) * GUESS / size

    fit = least_squares(residual, np.ones(4), jac=jacobian, ftol=None, xtol=1e-10)
    # Paths are solved to 1e-10, and the condition of the Jacobian is of the order 10²: the
    # parameters have at least two digits more than asked for.
    assert np.linalg.cond(fit.jac) < 1e3
    assert fit.x * GUESS == pytest.approx(TRUE, rel=1e-6)
    # Gauss–Newton's quadratic convergence, which a wrong column would spoil.
    assert fit.nfev <= 10


def test_the_column_of_the_modulus_is_that_of_the_stiffness(block: Block) -> None:
    """K is proportional to E: the direction K / E of `jvp`, and the gradient of the model."""
    result = block.solve(GUESS)
    column = block.jacobian(result, YOUNG)[:, 2]
    changed = result.jvp(K=block.model.K / YOUNG).displacement
    # Both differ by the residual of the path, 1e-10, times the condition of its systems.
    assert block.seen(changed) == pytest.approx(
        column, rel=1e-7, abs=1e-7 * abs(column).max()
    )
    last = np.zeros_like(result.displacement)
    last[-1, 2 * block.row[3]] = 1.0
    loads = [fem.Load("block", surface="top", pressure=10.0)]
    gradient = result.vjp(displacement=last)
    (slope,) = gradient.fem(block.model, loads).young["block"]
    assert slope == pytest.approx(
        block.seen(changed)[block.seen(last) == 1].item(), rel=1e-7
    )
