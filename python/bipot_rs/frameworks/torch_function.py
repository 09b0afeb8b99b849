"""Contact problems in PyTorch: both modes of differentiation, also in `torch.func`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bipot_rs._lib.optional import missing
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import ARGUMENTS, TWICE, Host, Solved

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


def _batched(info: Any, dims: Sequence[Any], tensors: Sequence[Any]) -> list[Any]:
    """The tensors of a `torch.vmap`, each with its dimension first."""
    return [
        one.expand(info.batch_size, *one.shape)
        if dim is None
        else one.movedim(dim, 0).contiguous()
        for one, dim in zip(tensors, dims, strict=True)
    ]


class _Solution(torch.autograd.Function):  # type: ignore[misc]
    """The solution; `_Product` is the product with its derivative."""

    @staticmethod
    def forward(host: Host, *given: Any) -> Any:
        return tuple(map(torch.from_numpy, host.solve(_arrays(given))))

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, _: Any) -> None:
        ctx.host, *given = inputs
        ctx.save_for_backward(*given)
        ctx.save_for_forward(*given)

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> Any:
        return None, *_Product.apply(ctx.host, True, *ctx.saved_tensors, *cotangents)

    @staticmethod
    def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
        given = ctx.saved_tensors
        along = [
            torch.zeros_like(one) if tangent is None else tangent
            for one, tangent in zip(given, tangents, strict=True)
        ]
        return _Product.apply(ctx.host, False, *given, *along)

    @staticmethod
    def vmap(info: Any, dims: Any, host: Host, *given: Any) -> Any:
        found = _Solution.apply(host, *_batched(info, dims[1:], given))
        return found, (0,) * len(found)


class _Product(torch.autograd.Function):  # type: ignore[misc]
    """The product with the derivative of a solution, or with its transpose."""

    @staticmethod
    def forward(host: Host, transposed: bool, *tensors: Any) -> Any:
        arrays, count = _arrays(tensors), len(host.shapes)
        product = host.vjp if transposed else host.jvp
        found = product(arrays[:count], arrays[count:])
        return tuple(map(torch.from_numpy, found))

    @staticmethod
    def setup_context(*_: Any) -> None:
        """Nothing is kept: there are no second derivatives."""

    @staticmethod
    def backward(*_: Any) -> Any:
        raise ValueError(TWICE)

    @staticmethod
    def jvp(*_: Any) -> Any:
        raise ValueError(TWICE)

    @staticmethod
    def vmap(info: Any, dims: Any, host: Host, transposed: bool, *tensors: Any) -> Any:
        found = _Product.apply(host, transposed, *_batched(info, dims[2:], tensors))
        return found, (0,) * len(found)
