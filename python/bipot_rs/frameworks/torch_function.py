"""Contact problems in PyTorch: differentiable in reverse and in forward mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bipot_rs._lib.optional import missing
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import ARGUMENTS, Host, Solved

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "functions of PyTorch", "torch", "torch") from None


def solve(problem: ContactProblem, arguments: Sequence[Any]) -> Solved:
    """As `bipot_rs.torch.solve`, with the arguments in the order of `ARGUMENTS`."""
    given: dict[str, Any] = {}
    for name, value in zip(ARGUMENTS, arguments, strict=True):
        if value is None:
            continue
        if isinstance(value, torch.Tensor) and value.dtype != torch.float64:
            raise TypeError(f"{name} has type {value.dtype}, expected torch.float64")
        given[name] = torch.as_tensor(value, dtype=torch.float64)
    if not given:
        raise ValueError("load, prescribed, gap and mu are all missing: give one")
    host = Host(problem, {name: tuple(one.shape) for name, one in given.items()})
    return Solved(*_Solution.apply(host, *given.values()))


def _arrays(tensors: Any) -> list[Any]:
    return [one.detach().cpu().numpy() for one in tensors]


class _Solution(torch.autograd.Function):  # type: ignore[misc]
    """The solution, and the products with its derivative."""

    @staticmethod
    def forward(ctx: Any, host: Host, *given: Any) -> Any:
        ctx.host = host
        ctx.save_for_backward(*given)
        ctx.save_for_forward(*given)
        return tuple(map(torch.from_numpy, host.solve(_arrays(given))))

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, *cotangents: Any) -> Any:
        found = ctx.host.vjp(_arrays(ctx.saved_tensors), _arrays(cotangents))
        return (None, *map(torch.from_numpy, found))

    @staticmethod
    def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
        given = ctx.saved_tensors
        along = [
            torch.zeros_like(one) if tangent is None else tangent
            for one, tangent in zip(given, tangents, strict=True)
        ]
        found = ctx.host.jvp(_arrays(given), _arrays(along))
        return tuple(map(torch.from_numpy, found))
