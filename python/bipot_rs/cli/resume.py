"""Going on with a load path that a run left unfinished, to the same bits.

What decides the numbers of a run is stamped on its result file; only the file of
the very same run is continued.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.messages import counted
from bipot_rs.contact import result
from bipot_rs.contact.result import Result
from bipot_rs.files import export
from bipot_rs.scene.schema.root import Scene

# Attribute of the file, and what it is called when it differs.
_STAMPS = {
    "package": "version {found} of this package wrote it, this is {expected}",
    "scene_digest": "it is of another scene, or of other settings of it",
    "method": "it was solved by method {found!r}, this run asks for {expected!r}",
    "tol": "it was solved to tol {found}, this run asks for {expected}",
}


def stamps(scene: Scene, method: str, tol: float | str) -> dict[str, Any]:
    """Attributes by which the file of a run is known again."""
    from importlib.metadata import version

    # After defaults and --set: two spellings of one scene are one scene.
    text = scene.model_dump_json(by_alias=True)
    digest = hashlib.sha256(text.encode())
    for file in scene.files():
        # One that is not there is told when it is read.
        if file.is_file():
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return {
        "package": version("bipot-rs"),
        "scene_digest": digest.hexdigest(),
        "method": method,
        "tol": tol,
    }


def earlier(path: Path, expected: Mapping[str, Any], count: int | None) -> Result:
    """The steps that ``path`` holds of the run known by ``expected``.

    Parameters
    ----------
    path
        A result file that the command line wrote.
    expected
        The `stamps` of this run.
    count
        Load steps of the whole path; None where they are automatic.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        There is no file, it is damaged, or it is of another run; one sentence.
    """
    if not path.exists():
        raise ValueError(f"nothing to resume: there is no {path}")
    _, _, attributes = export.read_result(path)
    for name, words in _STAMPS.items():
        if attributes.get(name) != expected[name]:
            told = words.format(found=attributes.get(name), expected=expected[name])
            if name not in attributes:
                told = "it does not say of which scene and settings it is"
            raise ValueError(f"cannot resume {path}: {told}")
    found = result.load(path)
    if count is not None and len(found) > count:
        raise ValueError(
            f"cannot resume {path}: it holds {counted(len(found), 'load step')} of {count}"
        )
    return found


def left_off(path: Path, expected: Mapping[str, Any], count: int | None) -> str:
    """What to say to one who begins anew what ``path`` holds a part of; or nothing."""
    try:
        found = earlier(path, expected, count)
    except (OSError, ValueError):
        return ""
    if found.success or not len(found):
        return ""
    return (
        f"{path} has {counted(len(found), 'load step')} of this very run, which was left "
        "off: --resume goes on from there, this begins anew"
    )


def same_contacts(
    path: Path, found: Result, contacts: Mapping[str, NDArray[Any] | None]
) -> None:
    """Refuse a file whose contacts are not, to the bit, those of this run.

    A file without load steps, of a run that ended before it had contacts, holds
    nothing that could differ.

    Raises
    ------
    ValueError
        Other versions of the libraries that mesh and assemble, most likely.
    """
    if not len(found):
        return
    for name, array in contacts.items():
        known = found.contacts.get(name)
        same = array is known or (
            array is not None and known is not None and np.array_equal(array, known)
        )
        if not same:
            raise ValueError(
                f"cannot resume {path}: its contacts have another {name} than those "
                "assembled now"
            )
