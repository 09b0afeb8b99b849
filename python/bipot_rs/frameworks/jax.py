"""Contact problems as differentiable functions of JAX, from the extra ``[jax]``.

Both modes of differentiation work, under ``jit`` and ``vmap``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import Solved

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike


def solve(
    problem: ContactProblem,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
    gap: ArrayLike | None = None,
    mu: ArrayLike | None = None,
) -> Solved[Array]:
    """Solve a load path; the result is differentiable in all arguments but ``problem``.

    Under ``vmap`` the paths are solved together by `ContactProblem.solve_many`.

    Parameters
    ----------
    problem
        The problem; it is not differentiated.
    load, prescribed, gap
        As in `ContactProblem.solve`.
    mu
        Friction coefficients that replace those of the problem: a number, ``(n_c,)``, or
        ``(n_c, 2)``.

    Returns
    -------
    Solved
        Arrays of JAX.

    Raises
    ------
    ModuleNotFoundError
        JAX is not installed.
    TypeError
        JAX computes in float32: a residual of 1e-10 needs float64.
    ValueError
        Numbers of load steps do not agree.
    """
    # JAX is imported by its first use: the plain package does not need it.
    from bipot_rs.frameworks.jax_primitive import solve as solved

    return solved(problem, (load, prescribed, gap, mu))
