"""Solutions in JAX: both modes of differentiation, ``jit`` and ``vmap``.

`smooth_problem` stands for a problem with known derivatives, so that the transposition, batching
and reduction to shapes are tested alone; a frictional contact follows.
"""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import smooth_problem
from support.smooth_problem import MAPS, Smooth

jax = pytest.importorskip(
    "jax", reason="JAX is not installed: pip install 'bipot-rs[jax]'"
)
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp  # noqa: E402
from jax.test_util import check_grads  # noqa: E402


def arguments(single: bool) -> list[Any]:
    return list(map(jnp.asarray, smooth_problem.arguments(single)))


@pytest.mark.parametrize("single", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_both_modes_agree_with_differences(single: bool) -> None:
    def f(*given: Any) -> Any:
        return bp.jax.solve(Smooth(), *given)  # type: ignore[arg-type]

    # Results are quadratic: central differences have rounding errors alone, ε/h.
    check_grads(
        f, arguments(single), order=1, modes=("fwd", "rev"), atol=1e-7, rtol=1e-7
    )


def test_jacobians_under_jit_and_vmap() -> None:
    def f(load: Any) -> Any:
        values = (load, *arguments(False)[1:])
        return bp.jax.solve(Smooth(), *values).slip  # type: ignore[arg-type]

    load = arguments(False)[0]
    forward, reverse = jax.jacfwd(f)(load), jax.jit(jax.jacrev(f))(load)
    exact = MAPS["slip", "load"] * 2 * np.asarray(load).ravel()
    # A sum of one product each: rounding.
    np.testing.assert_allclose(forward.reshape(exact.shape), exact, rtol=1e-13)
    np.testing.assert_allclose(reverse.reshape(exact.shape), exact, rtol=1e-13)
    several = jnp.stack([load, 2 * load, -load])
    each = jnp.stack([f(one) for one in several])
    np.testing.assert_array_equal(jax.vmap(f)(several), each)
    total = jax.vmap(jax.grad(lambda one: f(one).sum()))(several)
    alone = jnp.stack([jax.grad(lambda one: f(one).sum())(one) for one in several])
    np.testing.assert_allclose(total, alone, rtol=1e-13)


def test_a_gradient_solves_once() -> None:
    problem = Smooth()
    jax.grad(lambda x: bp.jax.solve(problem, x, *arguments(False)[1:]).slip.sum())(  # type: ignore[arg-type]
        arguments(False)[0]
    )
    assert problem.solved == 1


def one_contact() -> bp.ContactProblem:
    return bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)


def test_derivatives_of_a_point_on_springs() -> None:
    """The friction of a sliding point is -μ P: d/dμ = -P and d/dP = -μ."""
    load = jnp.array([-10.0, 5.0])

    def friction(load: Any, mu: Any) -> Any:
        return bp.jax.solve(one_contact(), load, mu=mu).reaction[0, 0, 1]

    for grad in (jax.grad, jax.jacfwd):
        of_load, of_mu = grad(friction, argnums=(0, 1))(load, 0.3)
        np.testing.assert_allclose(of_load, [0.3, 0.0], atol=1e-10)
        np.testing.assert_allclose(of_mu, -10.0, rtol=1e-10)


def test_what_is_refused() -> None:
    load = jnp.array([-10.0, 5.0])
    for given, known, error, said in (
        ((load.astype(np.float32),), {}, TypeError, "load has type float32"),
        ((), {}, ValueError, "are all missing"),
        ((jnp.zeros((2, 2)),), {"gap": jnp.zeros((3, 1))}, ValueError, "has 2 rows"),
    ):
        with pytest.raises(error, match=said):
            bp.jax.solve(one_contact(), *given, **known)
    problem: Any = Smooth()

    def f(x: Any) -> Any:
        return bp.jax.solve(problem, x, *arguments(False)[1:]).slip.sum()

    with pytest.raises(ValueError, match="second derivatives"):
        jax.jacfwd(jax.grad(f))(arguments(False)[0])
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(TypeError, match="jax_enable_x64"):
            bp.jax.solve(one_contact(), load)
    finally:
        jax.config.update("jax_enable_x64", True)
