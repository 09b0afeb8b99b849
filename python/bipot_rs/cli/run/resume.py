"""Continue an interrupted run, bitwise to the same result.

The result file holds everything that determines the numbers of its run. Only a file of
the same run is continued.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.saved_result import load_result
from bipot_rs.files import export
from bipot_rs.mesh.abaqus import list_files
from bipot_rs.scene.schema.root import Scene

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray

# Attributes of the file, and the message if one differs.
_STAMPS = {
    "package": "it was written by version {found} of bipot_rs, this is {expected}",
    "scene_digest": "it belongs to another scene, or the scene or its settings were changed",
    "method": "it was solved with method {found!r}, this run uses {expected!r}",
    "tol": "it was solved with tol {found}, this run uses {expected}",
}


def stamps(
    scene: Scene, method: str | None, tol: float | str | None
) -> dict[str, object]:
    """Attributes of a result file that identify its run; None: settings of the scene."""
    # After defaults and --set, so that two spellings of one scene are the same.
    # The engine does not change the problem.
    text = scene.model_dump_json(by_alias=True, exclude={"solver": {"engine"}})
    digest = hashlib.sha256(text.encode())
    for file in scene.files():
        # A missing file is reported when it is read.
        if file.is_file():
            parts = list_files(file) if file.suffix.lower() == ".inp" else [file]
            for part in parts:
                digest.update(hashlib.sha256(part.read_bytes()).digest())
    return {
        "package": _core.version,
        "scene_digest": digest.hexdigest(),
        "method": scene.solver.method if method is None else method,
        "tol": scene.solver.tol if tol is None else tol,
    }


def earlier(path: Path, expected: Mapping[str, object], count: int | None) -> Result:
    """The result in ``path``, if it belongs to the run with the attributes ``expected``.

    ``path``: a result file that the command line wrote.
    ``expected``: the `stamps` of this run.
    ``count``: load steps of the whole path; None for automatic steps.
    """
    if not path.exists():
        raise ValueError(f"cannot resume: there is no {path}")
    attributes = export.read_attributes(path)
    for name, words in _STAMPS.items():
        if attributes.get(name) != expected[name]:
            why = words.format(found=attributes.get(name), expected=expected[name])
            if name not in attributes:
                why = "it does not name its scene and settings"
            raise ValueError(f"cannot resume {path}: {why}")
    stored = load_result(path)
    if count is not None and len(stored) > count:
        raise ValueError(
            f"cannot resume {path}: it has {count_noun(len(stored), 'load step')}, the path "
            f"{count}"
        )
    return stored


def describe_unfinished(
    path: Path, expected: Mapping[str, object], count: int | None
) -> str:
    """A remark if ``path`` holds an unfinished result of this run; else an empty text."""
    try:
        if not path.exists() or export.read_attributes(path).get("complete"):
            return ""
        stored = earlier(path, expected, count)
    except (OSError, ValueError):
        return ""
    if stored.success or not len(stored):
        return ""
    return (
        f"{path} has {count_noun(len(stored), 'load step')} of this run; it starts again from "
        "the beginning, --resume would continue"
    )


def same_contacts(
    path: Path, earlier: Result, contacts: Mapping[str, AnyArray | None]
) -> None:
    """Refuse a file whose contacts are not bitwise equal to those of this run.

    A file without load steps may have no contacts and is accepted.
    """
    if not len(earlier):
        return
    for name, array in contacts.items():
        stored = earlier.contacts.get(name)
        same = array is stored or (
            array is not None and stored is not None and np.array_equal(array, stored)
        )
        if not same:
            raise ValueError(
                f"cannot resume {path}: {name} of its contacts differs from that "
                "assembled now"
            )
