"""A block that is pressed onto a plane and sheared: as a model, and as arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp
from support.models_and_arrays import arguments
from support.rollers import block

Array = NDArray[np.float64]


def pressed(
    n: int = 4,
    *,
    dim: int = 3,
    mu: Any = 0.3,
    cell: str = "",
    axis: Any = None,
    gap: float = 0.0,
    **body: Any,
) -> bp.Model:
    """A block pressed onto a plane by its held top, then sheared; ``body`` has its own axes."""
    m = block(n, dim, cell, **body)
    point, normal = [0.0] * (dim - 1) + [gap], [0.0] * (dim - 1) + [-1.0]
    m.obstacle("table", plane={"point": point, "normal": normal})
    direction = {} if axis is None else {"axis": axis}
    m.contact("block.top", against="table", mu=mu, **direction)
    m = m.with_(support=[])
    last = "xyz"[dim - 1]
    m.support("block.bottom", **dict.fromkeys("xyz"[:dim], 0.0) | _moves(m, last))
    m.path(press=[0.6, 1.0], shear=[0.0, 1.0])
    return m


def _moves(m: bp.Model, last: str) -> dict[str, Any]:
    return {"x": m.times(0.012, "shear"), last: m.times(0.02, "press")}


def arrays(n: int = 4, factor: float = 1.0) -> tuple[dict[str, Any], Array]:
    """Arguments of `ContactProblem`, and the prescribed displacements of two steps."""
    case = pressed(n).assemble()
    arrays_of_model = arguments(case.model)
    return arrays_of_model | {"K": factor * arrays_of_model["K"]}, case.prescribed
