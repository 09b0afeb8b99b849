"""A model, and the same problem from arrays alone."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

import bipot_rs as bp
from bipot_rs import fem


def arguments(model: fem.Assembly) -> dict[str, Any]:
    """Arguments of `ContactProblem` that a solution depends on."""
    return {
        "K": model.K,
        "B": model.B,
        "gap": model.gap,
        "mu": model.mu,
        "fixed": model.fixed,
        "coordinates": np.repeat(model.nodes, model.dim, axis=0),
    }


def of_arrays(model: fem.Assembly) -> bp.ContactProblem:
    """The problem of a model's arrays, made as another program would make it."""
    return bp.ContactProblem(
        **arguments(model), area=model.area, points=model.points, frame=model.frame
    )


def of_models(name: str) -> bool:
    """Whether a dataset of a result differs, or is missing, in that of arrays alone.

    Arrays have no path parameter, no names of surfaces and no nodes.
    """
    only = ("contacts/surface", "mesh/", "fields/displacement")
    return name.endswith("/load") or name.startswith(only)


def datasets(path: Path) -> dict[str, Any]:
    """The datasets of a result by name, without those of /VTKHDF, which show them to VTK."""
    datasets_by_name = {}

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not name.startswith("VTKHDF"):
            datasets_by_name[name] = (node.dtype.str, node.shape, node[()].tobytes())

    with h5py.File(path) as file:
        file.visititems(take)
    return datasets_by_name
