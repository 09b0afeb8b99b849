"""``bipot plot``: pictures of a result that is there, without solving."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bipot_rs.folder import RESULT
from bipot_rs.words import meant

Picture = Callable[..., None]


def kinds() -> dict[str, Picture]:
    """Pictures by name: each takes a file, contacts, steps, ``title`` and ``units``."""
    from bipot_rs.plot import tractions

    return {"tractions": tractions}


def draw(name: str, kind: str, out: Path | None) -> Path:
    """Draw a picture of a result; returns its file.

    Parameters
    ----------
    name
        The folder of a run, or a result file.
    kind
        One of `kinds`.
    out
        File to write, the suffix chooses the format; ``KIND.png`` beside the result if
        not given.

    Raises
    ------
    OSError, ValueError
        There is no result, it cannot be read or drawn, or the file cannot be written.
    """
    from bipot_rs.export import read_result, writing

    known = kinds()
    if kind not in known:
        raise ValueError(
            f"--kind is {kind!r}, expected one of {', '.join(known)}"
            + meant(kind, known)
        )
    path = Path(name)
    if path.is_dir():
        path = path / RESULT
    if not path.exists():
        raise OSError(f"there is no {path}: bipot run makes one, as out/SCENE/{RESULT}")
    contacts, steps, attributes = read_result(path)
    if not steps:
        raise ValueError(f"{path} holds no load steps to draw")
    target = path.with_name(f"{kind}.png") if out is None else out
    try:
        with writing(target):
            known[kind](target, contacts, steps, **_labels(attributes))
    except ValueError as error:
        if "not supported" in str(error):
            raise ValueError(f"cannot draw {target}: {error}") from error
        raise
    return target


def _labels(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Title and names of units, where the run has left them."""
    units = attributes.get("units", "")
    found = json.loads(units) if units else {}
    return {"title": str(attributes.get("title", "")), "units": found}
