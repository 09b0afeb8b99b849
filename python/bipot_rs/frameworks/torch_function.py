"""Contact problems in PyTorch: both modes of differentiation, also in `torch.func`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from bipot_rs._lib.optional import missing
from bipot_rs._lib.types import Floats
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import ARGUMENTS, TWICE, Host, Solved

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "functions of PyTorch", "torch", "torch") from None

if TYPE_CHECKING:
    from torch import Tensor
    from torch._functorch.autograd_function import VmapInfo
    from torch.autograd.function import FunctionCtx as Context

# Results of a `torch.vmap`, and their batch dimensions.
Batched = tuple[tuple["Tensor", ...], tuple[int, ...]]


def solve(
    problem: ContactProblem, arguments: Sequence[Tensor | ArrayLike | None]
) -> Solved[Tensor]:
    """As `bipot_rs.torch.solve`, with the arguments in the order of `ARGUMENTS`."""
    tensors_given: dict[str, Tensor] = {}
    for name, value in zip(ARGUMENTS, arguments, strict=True):
        if value is None:
            continue
        if isinstance(value, torch.Tensor) and value.dtype != torch.float64:
            raise TypeError(f"{name} has type {value.dtype}, expected torch.float64")
        tensors_given[name] = torch.as_tensor(value, dtype=torch.float64)
    if not tensors_given:
        raise ValueError("load, prescribed, gap and mu are all missing: give one")
    host = Host(
        problem, {name: tuple(tensor.shape) for name, tensor in tensors_given.items()}
    )
    return Solved(*_Solution.apply(host, *tensors_given.values()))


def _to_arrays(tensors: Sequence[Tensor]) -> list[Floats]:
    return [tensor.detach().cpu().numpy() for tensor in tensors]


def _to_tensors(arrays: Sequence[Floats]) -> tuple[Tensor, ...]:
    return tuple(map(torch.from_numpy, arrays))


def _move_batch(
    info: VmapInfo, dims: Sequence[int | None], tensors: Sequence[Tensor]
) -> list[Tensor]:
    """The tensors of a `torch.vmap`, each with its dimension first."""
    return [
        tensor.expand(info.batch_size, *tensor.shape)
        if dim is None
        else tensor.movedim(dim, 0).contiguous()
        for tensor, dim in zip(tensors, dims, strict=True)
    ]


class _Solution(torch.autograd.Function):  # type: ignore[misc]
    """The solution; `_Product` is the product with its derivative."""

    @staticmethod
    def forward(host: Host, *given: Tensor) -> tuple[Tensor, ...]:
        return _to_tensors(host.solve(_to_arrays(given)))

    @staticmethod
    def setup_context(
        ctx: Context, inputs: tuple[Host, *tuple[Tensor, ...]], _: object
    ) -> None:
        ctx.host, *arguments = inputs
        ctx.save_for_backward(*arguments)
        ctx.save_for_forward(*arguments)

    @staticmethod
    def backward(ctx: Context, *cotangents: Tensor) -> tuple[Tensor | None, ...]:
        return None, *_Product.apply(ctx.host, True, *ctx.saved_tensors, *cotangents)

    @staticmethod
    def jvp(ctx: Context, _: object, *tangents: Tensor | None) -> tuple[Tensor, ...]:
        arguments = ctx.saved_tensors
        along = [
            torch.zeros_like(tensor) if tangent is None else tangent
            for tensor, tangent in zip(arguments, tangents, strict=True)
        ]
        derivatives: tuple[Tensor, ...] = _Product.apply(
            ctx.host, False, *arguments, *along
        )
        return derivatives

    @staticmethod
    def vmap(
        info: VmapInfo, dims: Sequence[int | None], host: Host, *given: Tensor
    ) -> Batched:
        outputs = _Solution.apply(host, *_move_batch(info, dims[1:], given))
        return outputs, (0,) * len(outputs)


class _Product(torch.autograd.Function):  # type: ignore[misc]
    """The product with the derivative of a solution, or with its transpose."""

    @staticmethod
    def forward(host: Host, transposed: bool, *tensors: Tensor) -> tuple[Tensor, ...]:
        arrays, count = _to_arrays(tensors), len(host.shapes)
        product = host.vjp if transposed else host.jvp
        return _to_tensors(product(arrays[:count], arrays[count:]))

    @staticmethod
    def setup_context(*_: object) -> None:
        """Nothing is kept: there are no second derivatives."""

    @staticmethod
    def backward(*_: object) -> None:
        raise ValueError(TWICE)

    @staticmethod
    def jvp(*_: object) -> None:
        raise ValueError(TWICE)

    @staticmethod
    def vmap(
        info: VmapInfo,
        dims: Sequence[int | None],
        host: Host,
        transposed: bool,
        *tensors: Tensor,
    ) -> Batched:
        product = _Product.apply(
            host, transposed, *_move_batch(info, dims[2:], tensors)
        )
        return product, (0,) * len(product)
