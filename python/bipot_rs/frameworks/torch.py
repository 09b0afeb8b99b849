"""Contact problems as differentiable functions of PyTorch, from the extra ``[torch]``.

Reverse and forward mode work, also by `torch.func`; second derivatives are refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import Solved

if TYPE_CHECKING:
    from torch import Tensor


def solve(
    problem: ContactProblem,
    load: Tensor | ArrayLike | None = None,
    prescribed: Tensor | ArrayLike | None = None,
    gap: Tensor | ArrayLike | None = None,
    mu: Tensor | ArrayLike | None = None,
) -> Solved[Tensor]:
    """Solve a load path; the result is differentiable in all arguments but ``problem``.

    Under `torch.vmap` the paths are solved together by `ContactProblem.solve_many`.

    Parameters
    ----------
    problem, load, prescribed, gap, mu
        As in `bipot_rs.jax.solve`: tensors of float64, or what becomes one.

    Returns
    -------
    Solved
        Tensors of float64 on the CPU.

    Raises
    ------
    ModuleNotFoundError
        PyTorch is not installed.
    TypeError
        A tensor is not of type float64: a residual of 1e-10 needs it.
    ValueError
        Numbers of load steps do not agree.
    """
    # PyTorch is imported by its first use: the plain package does not need it.
    from bipot_rs.frameworks.torch_function import solve as solved

    return solved(problem, (load, prescribed, gap, mu))
