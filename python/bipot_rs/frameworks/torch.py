"""Contact problems as differentiable functions of PyTorch, from the extra ``[torch]``.

Reverse and forward mode work, also by `torch.func`; second derivatives are refused.
"""

from __future__ import annotations

from typing import Any

from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import Solved


def solve(
    problem: ContactProblem,
    load: Any = None,
    prescribed: Any = None,
    gap: Any = None,
    mu: Any = None,
) -> Solved:
    """Solve a load path; the result is differentiable in all arguments but ``problem``.

    Under `torch.vmap` the paths are solved together by `ContactProblem.solve_many`.

    Parameters
    ----------
    problem
        The problem; it is not differentiated.
    load, prescribed, gap
        As in `ContactProblem.solve`: tensors of float64, or what becomes one.
    mu
        Friction coefficients that replace those of the problem: a number, ``(n_c,)``, or
        ``(n_c, 2)``.

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
