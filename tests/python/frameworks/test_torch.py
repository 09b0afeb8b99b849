"""Solutions in PyTorch: `gradcheck` in both modes."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import smooth_problem

torch = pytest.importorskip(
    "torch", reason="PyTorch is not installed: pip install 'bipot-rs[torch]'"
)

# PyTorch compiles its own rules with it when forward mode is first used.
pytestmark = pytest.mark.filterwarnings(
    "ignore:.*torch.jit.script.* is deprecated:FutureWarning"
)


@pytest.mark.parametrize("single", [True, False])
def test_gradcheck_in_both_modes(single: bool) -> None:
    problem: Any = smooth_problem.Smooth()
    tensors = [
        torch.tensor(array, dtype=torch.float64, requires_grad=True)
        for array in smooth_problem.arguments(single)
    ]
    assert torch.autograd.gradcheck(
        lambda *own: tuple(bp.torch.solve(problem, *own)),
        tensors,
        check_forward_ad=True,
    )


def three_contacts() -> bp.ContactProblem:
    """In space: one contact of three slides, one sticks, and one is open."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(9, 9)) / 3
    K = root @ root.T + np.eye(9)
    return bp.ContactProblem(K, np.eye(9), gap=[0.0, 0.0, 5.0], mu=0.4)


def test_gradcheck_of_a_path_with_friction() -> None:
    """Two steps, with respect to load, gap and friction; statuses do not change nearby."""
    problem = three_contacts()
    load = np.zeros((2, 9))
    load[:, [0, 3]] = [-2.0, -3.0]
    load[1, 1:3] = [1.5, 0.7]
    tensors = [
        torch.tensor(array, dtype=torch.float64, requires_grad=True)
        for array in (load, [0.0, 0.0, 5.0], [0.4, 0.4, 0.4])
    ]

    def solved(load: Any, gap: Any, mu: Any) -> Any:
        return tuple(bp.torch.solve(problem, load, gap=gap, mu=mu))

    status = problem.solve(load).status[1]
    assert status.tolist() == [bp.Status.SLIP, bp.Status.STICK, bp.Status.OPEN]
    # η of 1e-10 over the step of 1e-4, and h² times a third derivative.
    assert torch.autograd.gradcheck(
        solved, tensors, eps=1e-4, atol=1e-5, rtol=1e-5, check_forward_ad=True
    )


def test_transforms_of_functions() -> None:
    """Jacobians in both modes, and a batch of paths and of gradients."""
    problem: Any = smooth_problem.Smooth()
    load, *rest = map(torch.tensor, smooth_problem.arguments(False))

    def f(load: Any) -> Any:
        return bp.torch.solve(problem, load, *rest).slip

    exact = smooth_problem.MAPS["slip", "load"] * 2 * load.numpy().ravel()
    # A sum of one product each: rounding.
    for jacobian in (torch.func.jacrev, torch.func.jacfwd):
        derivative = jacobian(f)(load).numpy().reshape(exact.shape)
        np.testing.assert_allclose(derivative, exact, rtol=1e-13)
    several = torch.stack([load, 2 * load, -load], dim=1)
    each = torch.stack([f(one) for one in several.unbind(1)])
    np.testing.assert_array_equal(torch.vmap(f, in_dims=1)(several), each)
    gradient = torch.func.grad(lambda one: f(one).sum())
    alone = torch.stack([gradient(one) for one in several.unbind(1)])
    together = torch.vmap(gradient, in_dims=1)(several)
    np.testing.assert_allclose(together, alone, rtol=1e-13)


def test_what_is_refused() -> None:
    problem: Any = smooth_problem.Smooth()
    with pytest.raises(TypeError, match=r"load has type torch\.float32"):
        bp.torch.solve(problem, torch.zeros(5, dtype=torch.float32))
    with pytest.raises(ValueError, match="are all missing"):
        bp.torch.solve(problem)
    load, *rest = map(torch.tensor, smooth_problem.arguments(True))
    load.requires_grad_()

    def total(load: Any) -> Any:
        return sum(field.sum() for field in bp.torch.solve(problem, load, *rest))

    (gradient,) = torch.autograd.grad(total(load), [load], create_graph=True)
    with pytest.raises(ValueError, match="second derivatives"):
        gradient.sum().backward()
    with pytest.raises(ValueError, match="second derivatives"):
        torch.func.jacfwd(torch.func.grad(total))(load.detach())
