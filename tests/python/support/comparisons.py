"""Arrays close to each other, refused calls, results and files of the same content."""

import pickle
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import bipot_rs as bp

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


def close(found: Any, wanted: Any, part: float) -> None:
    """Each entry differs by at most ``part`` of the largest wanted entry."""
    near(found, wanted, part * np.abs(wanted).max())


def near(found: Any, wanted: Any, limit: Any) -> None:
    """Each entry differs by at most ``limit``."""
    np.testing.assert_allclose(found, wanted, rtol=0, atol=limit)


def refused(message: str) -> Any:
    """The block raises a ``ValueError`` with this message, a regular expression."""
    return pytest.raises(ValueError, match=message)


def bits(one: Any, other: Any, fields: tuple[str, ...] = FIELDS) -> bool:
    return len(one) == len(other) and all(
        np.asarray(getattr(a, name)).tobytes() == np.asarray(getattr(b, name)).tobytes()
        for a, b in zip(one, other, strict=True)
        for name in fields
    )


def solve_in_parts(
    problem: bp.ContactProblem,
    folder: Path,
    fields: tuple[str, ...] = FIELDS,
    **path: Any,
) -> bp.Result:
    """The path, which has the same bits in two parts: from a result, a file, in a copy of the
    problem, and beside another path.
    """
    whole = problem.solve(**path)
    whole.save(folder / "whole.h5")
    again = pickle.loads(pickle.dumps(problem))
    for k in range(1, len(whole)):
        rest = {name: x[k:] for name, x in path.items()}
        for made, results in (
            (problem, whole),
            (again, bp.load_result(folder / "whole.h5")),
        ):
            start = results[k - 1]
            assert bits(made.solve(**rest, start=start), whole[k:], fields)
        first = {name: x[:k] for name, x in path.items()}
        one, other = problem.solve_many([first, rest | {"start": start}])
        assert bits(one, whole[:k], fields)
        assert bits(other, whole[k:], fields)
    return whole


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
