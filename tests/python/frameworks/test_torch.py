"""Solutions in PyTorch: `gradcheck` in both modes."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
import smooth_problem

torch = pytest.importorskip(
    "torch", reason="PyTorch is not installed: pip install 'bipot-rs[torch]'"
)


@pytest.mark.parametrize("single", [True, False])
def test_gradcheck_in_both_modes(single: bool) -> None:
    problem: Any = smooth_problem.Smooth()
    given = [
        torch.tensor(one, dtype=torch.float64, requires_grad=True)
        for one in smooth_problem.arguments(single)
    ]
    assert torch.autograd.gradcheck(
        lambda *own: tuple(bp.torch.solve(problem, *own)), given, check_forward_ad=True
    )


def test_a_point_on_springs() -> None:
    """Pressed by P and pulled beyond μ P, its friction is -μ P."""
    problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
    found = bp.torch.solve(problem, [-10.0, 5.0], mu=0.2)
    np.testing.assert_allclose(found.reaction[0, 0].numpy(), [10.0, -2.0], rtol=1e-9)


def test_what_is_refused() -> None:
    problem: Any = smooth_problem.Smooth()
    with pytest.raises(TypeError, match=r"load has type torch\.float32"):
        bp.torch.solve(problem, torch.zeros(5, dtype=torch.float32))
    with pytest.raises(ValueError, match="are all missing"):
        bp.torch.solve(problem)
