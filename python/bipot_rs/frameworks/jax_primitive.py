"""Contact problems in JAX: differentiable in both modes, under ``jit`` and ``vmap``.

The solution is a host callback. Its derivative is one linear primitive, the product with
the derivative of the path, whose transpose is the product with the transpose: forward
mode, reverse mode, `jax.jacfwd` and `jax.jacrev` follow from the two. (`jax.custom_vjp`
has no forward mode, and `jax.custom_derivatives.linear_call` has no ``vmap``.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.optional import missing
from bipot_rs._lib.types import Floats
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.frameworks.host import ARGUMENTS, TWICE, Host, Solved

try:
    import jax
    import jax.numpy as jnp
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir
except ModuleNotFoundError as error:
    raise missing(error, "functions of JAX", "jax", "jax") from None

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike

Shape = tuple[int, ...]


def solve(
    problem: ContactProblem, arguments: Sequence[ArrayLike | None]
) -> Solved[Array]:
    """As `bipot_rs.jax.solve`, with the arguments in the order of `ARGUMENTS`."""
    if not jax.config.jax_enable_x64:
        raise TypeError(
            "JAX computes in float32, and the solution needs float64: call "
            'jax.config.update("jax_enable_x64", True) before the first array'
        )
    arrays_given: dict[str, Array] = {}
    for name, value in zip(ARGUMENTS, arguments, strict=True):
        if value is None:
            continue
        array = jnp.asarray(value)
        if array.dtype == np.float32:
            raise TypeError(f"{name} has type float32, expected float64")
        arrays_given[name] = array.astype(np.float64)
    if not arrays_given:
        raise ValueError("load, prescribed, gap and mu are all missing: give one")
    host = Host(problem, {name: array.shape for name, array in arrays_given.items()})
    return Solved(*_solution(host, *arrays_given.values()))


def _declare(
    shapes: Sequence[Shape], batch: Shape = ()
) -> tuple[jax.ShapeDtypeStruct, ...]:
    return tuple(jax.ShapeDtypeStruct(batch + s, np.float64) for s in shapes)


def _call_host(host: Host, *given: Array) -> Sequence[Array]:
    results: Sequence[Array] = jax.pure_callback(
        lambda *arrays: tuple(host.solve([np.asarray(a) for a in arrays])),
        _declare(host.result_shapes),
        *given,
        vmap_method="broadcast_all",
    )
    return results


_solution = jax.custom_jvp(_call_host, nondiff_argnums=(0,))


def _differentiate(
    host: Host, given: Sequence[Array], tangents: Sequence[Array]
) -> tuple[Sequence[Array], Sequence[Array]]:
    along = _product.bind(*given, *tangents, host=host, batch=(), transposed=False)
    return _solution(host, *given), tuple(along)


_product = Primitive("bipot_derivative")
_product.multiple_results = True


def _shapes(host: Host, transposed: bool) -> list[Shape]:
    return list(host.shapes.values() if transposed else host.result_shapes)


def _evaluate(
    *arrays: Array, host: Host, batch: Shape, transposed: bool
) -> list[Array]:
    count = len(host.shapes)

    def product(*arrays: Array) -> tuple[Floats, ...]:
        every = [np.asarray(a) for a in arrays]
        call = host.vjp if transposed else host.jvp
        return tuple(call(every[:count], every[count:]))

    outputs = jax.pure_callback(
        product,
        _declare(_shapes(host, transposed), batch),
        *arrays,
        vmap_method="sequential",
    )
    return list(outputs)


def _abstract(
    *_: object, host: Host, batch: Shape, transposed: bool
) -> list[jax.core.ShapedArray]:
    shapes = _shapes(host, transposed)
    return [jax.core.ShapedArray(batch + s, np.dtype(np.float64)) for s in shapes]


def _jvp(
    primals: Sequence[Array],
    tangents: Sequence[Array],
    *,
    host: Host,
    batch: Shape,
    transposed: bool,
) -> tuple[Sequence[Array], Sequence[Array]]:
    count = len(host.shapes)
    if any(type(t) is not ad.Zero for t in tangents[:count]):
        raise ValueError(TWICE)
    options = {"host": host, "batch": batch, "transposed": transposed}
    along = [ad.instantiate_zeros(t) for t in tangents[count:]]
    return (
        _product.bind(*primals, **options),
        _product.bind(*primals[:count], *along, **options),
    )


def _transpose(
    cotangents: Sequence[Array],
    *arrays: Array,
    host: Host,
    batch: Shape,
    transposed: bool,
) -> list[Array | None]:
    count = len(host.shapes)
    cots = [ad.instantiate_zeros(c) for c in cotangents]
    options = {"host": host, "batch": batch, "transposed": not transposed}
    return [*[None] * count, *_product.bind(*arrays[:count], *cots, **options)]


def _batch(
    arrays: Sequence[Array],
    axes: Sequence[int | None],
    *,
    host: Host,
    batch: Shape,
    transposed: bool,
) -> tuple[Sequence[Array], list[int]]:
    size = next(
        a.shape[axis] for a, axis in zip(arrays, axes, strict=True) if axis is not None
    )
    whole = [
        jnp.broadcast_to(a, (size, *a.shape))
        if axis is None
        else jnp.moveaxis(a, axis, 0)
        for a, axis in zip(arrays, axes, strict=True)
    ]
    product = _product.bind(
        *whole, host=host, batch=(size, *batch), transposed=transposed
    )
    return product, [0] * len(product)


_solution.defjvp(_differentiate)
_product.def_impl(_evaluate)
_product.def_abstract_eval(_abstract)
mlir.register_lowering(_product, mlir.lower_fun(_evaluate, multiple_results=True))
ad.primitive_jvps[_product] = _jvp
ad.primitive_transposes[_product] = _transpose
batching.primitive_batchers[_product] = _batch
