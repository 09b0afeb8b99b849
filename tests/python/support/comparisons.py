"""Whether two results, or two files, have the same content."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

# Every field of a step except times. `work` counts the inverse of W in the step that makes
# it, and a failed step may have made it.
FIELDS = (
    "reaction",
    "relative_displacement",
    "slip",
    "status",
    "residual",
    "tolerance",
    "iterations",
    "bipotential_gap",
    "displacement",
)


def bits(one: Any, other: Any, fields: tuple[str, ...] = FIELDS) -> bool:
    return len(one) == len(other) and all(
        np.asarray(getattr(a, name)).tobytes() == np.asarray(getattr(b, name)).tobytes()
        for a, b in zip(one, other, strict=True)
        for name in fields
    )


def content(path: Path) -> dict[str, Any]:
    """Everything in a result file except times."""
    content_by_name: dict[str, Any] = {}

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            content_by_name[name] = (node.dtype.str, node.shape, node[()].tobytes())
        for key, value in node.attrs.items():
            if key != "seconds":
                plain = value.tolist() if isinstance(value, np.ndarray) else value
                content_by_name[f"{name}@{key}"] = plain

    with h5py.File(path) as file:
        take("", file)
        file.visititems(take)
    return content_by_name
