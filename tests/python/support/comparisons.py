"""Whether two results, or two files, hold the same."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

# Every field of a step that does not tell of time. `work` counts the inverse of W where
# it is made, and a failed step may have made it.
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
    """Everything a result file holds, but for times."""
    found: dict[str, Any] = {}

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            found[name] = (node.dtype.str, node.shape, node[()].tobytes())
        for key, value in node.attrs.items():
            if key != "seconds":
                found[f"{name}@{key}"] = value

    with h5py.File(path) as file:
        take("", file)
        file.visititems(take)
    return found
