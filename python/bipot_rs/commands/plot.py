"""``bipot plot``: pictures of a result that is there, without solving."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bipot_rs.running.folder import RESULT
from bipot_rs.words import meant

# Draws a result that `load` has read: the file to write, the result, a title.
Picture = Callable[[Path, Any, str], None]


def kinds() -> dict[str, Picture]:
    """Pictures by name: what a run leaves, and those of `bipot_rs.plots` by their names."""
    from bipot_rs import plots

    def one(function: Callable[..., Any], *names: str) -> Picture:
        def draw(path: Path, result: Any, title: str) -> None:
            ax = function(result, *names)
            if title:
                ax.figure.suptitle(title)
            ax.figure.savefig(path, dpi=150, bbox_inches="tight")

        return draw

    drawn: dict[str, Picture] = {"tractions": _left_by_run}
    for function in (
        plots.slip,
        plots.status_map,
        plots.resultants,
        plots.status_shares,
        plots.force_displacement,
        plots.dissipation,
    ):
        drawn[function.__name__] = one(function)
    for quantity in ("pressure", "shear", "gap"):
        drawn[f"{quantity}_map"] = one(plots.surface_map, quantity)
    return drawn


def _left_by_run(path: Path, result: Any, title: str) -> None:
    from bipot_rs.plot import tractions

    steps = [{"reaction": step.reaction, "status": step.status} for step in result]
    tractions(path, result.contacts, steps, title=title, units=result.units)


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
    from bipot_rs.result import load

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
    _, steps, attributes = read_result(path)
    if not steps:
        raise ValueError(f"{path} holds no load steps to draw")
    result = load(path)
    title, units = _labels(attributes)
    result.units = units or result.units
    target = path.with_name(f"{kind}.png") if out is None else out
    try:
        with writing(target):
            known[kind](target, result, title)
    except ValueError as error:
        if "not supported" in str(error):
            raise ValueError(f"cannot draw {target}: {error}") from error
        raise
    return target


def _labels(attributes: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Title and names of units, where the run has left them."""
    units = attributes.get("units", "")
    return str(attributes.get("title", "")), json.loads(units) if units else {}
