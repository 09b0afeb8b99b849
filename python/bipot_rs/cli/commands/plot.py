"""``bipot plot``: pictures of a result that is there, without solving."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import meant
from bipot_rs.cli.output_folder import RESULT, SWEEP

# Quantities that are drawn on the surfaces of bodies in space.
_IN_SPACE = ("pressure", "shear", "gap", "slip", "status")
# Pictures of the bodies, which need their mesh.
BODIES = ("deformed", *(f"{quantity}_3d" for quantity in _IN_SPACE))


@dataclass(frozen=True)
class Asked:
    """What is drawn of a result.

    Attributes
    ----------
    where
        Name of a contact surface, ``"body.surface"``; None for all.
    along
        ``"x"``, ``"y"``, ``"z"`` or ``"arc"``; None for what the picture takes.
    step
        The load step that is drawn, from 0; None for the last.
    case
        The bodies, for the picture of them.
    """

    where: str | None = None
    along: str | None = None
    step: int | None = None
    case: Any = None


# Draws a result that `load` has read: the file to write, the result, a title, what of it.
Picture = Callable[[Path, Any, str, Asked], None]


def kinds() -> dict[str, Picture]:
    """Pictures by name: what a run leaves, and those of `bipot_rs.plots`."""
    from bipot_rs import plots

    def one(kind: str, function: Callable[..., Any], *names: str) -> Picture:
        takes = signature(function).parameters

        def draw(path: Path, result: Any, title: str, asked: Asked) -> None:
            chosen = {name: getattr(asked, name) for name in _OPTIONS}
            given = {key: value for key, value in chosen.items() if value is not None}
            for key in given:
                if key not in takes:
                    raise ValueError(
                        f"--{_OPTIONS[key]} does not go with --kind {kind}"
                    )
            bodies = [asked.case] if kind in BODIES else []
            ax = function(*bodies, result, *names, **given)
            if title:
                ax.figure.suptitle(title)
            ax.figure.savefig(path, dpi=150, bbox_inches="tight")

        return draw

    drawn: dict[str, Picture] = {}
    drawn["tractions"] = _tractions(one("tractions", plots.tractions))
    for function in (
        plots.slip,
        plots.status_map,
        plots.resultants,
        plots.status_shares,
        plots.force_displacement,
        plots.dissipation,
        plots.deformed,
    ):
        drawn[function.__name__] = one(function.__name__, function)
    for quantity in ("pressure", "shear", "gap"):
        kind = f"{quantity}_map"
        drawn[kind] = one(kind, plots.surface_map, quantity)
    for quantity in _IN_SPACE:
        kind = f"{quantity}_3d"
        drawn[kind] = one(kind, plots.surface3d, quantity)
    return drawn


# What `Asked` holds, by the options of the command line.
_OPTIONS = {"where": "contact", "along": "along", "step": "step"}
# Words of the pictures in Python, and those of the command line.
_WORDS = {
    "along is missing": "--along is missing",
    "by where=": "by --contact",
    "with where= those": "with --contact those",
    "by surface3d": "by --kind pressure_3d",
    "by surface_map": "by --kind pressure_map",
    "there is no contact": "--contact: there is no contact",
}


def _tractions(line: Picture) -> Picture:
    """What a run leaves; along a direction or of one surface the line alone."""

    def draw(path: Path, result: Any, title: str, asked: Asked) -> None:
        if asked.along is not None:
            line(path, result, title, asked)
            return
        from bipot_rs.plots.data import selection
        from bipot_rs.plots.run_figure import tractions

        known = result.contacts
        chosen = selection(asked.where, len(result[-1].status), known)
        contacts = {
            name: values if name == "surface_names" else values[chosen]
            for name, values in known.items()
        }
        steps = [
            {"reaction": step.reaction[chosen], "status": step.status[chosen]}
            for step in result
        ]
        at = len(steps) - 1 if asked.step is None else asked.step
        tractions(path, contacts, steps, title=title, units=result.units, step=at)

    return draw


def draw(
    name: str,
    kind: str,
    out: Path | None,
    *,
    contact: str | None = None,
    along: str | None = None,
    step: int | None = None,
    scene: str | None = None,
    settings: Sequence[str] = (),
) -> Path:
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
    contact
        The surface to draw, ``"body.surface"``; all if not given.
    along
        What places are: ``"x"``, ``"y"``, ``"z"`` or ``"arc"``.
    step
        The load step to draw, from 1; the last if not given.
    scene, settings
        For the picture of the bodies, the scene of the result and what was set in it;
        those that the file tells if not given.

    Raises
    ------
    OSError, ValueError
        There is no result, it cannot be read or drawn, or the file cannot be written.
    """
    from bipot_rs.contact.result import load
    from bipot_rs.files.export import read_result, writing

    known = kinds()
    if kind not in known:
        raise ValueError(
            f"--kind is {kind!r}, expected one of {', '.join(known)}"
            + meant(kind, known)
        )
    if along is not None and along not in ("x", "y", "z", "arc"):
        raise ValueError(f"--along is {along!r}, expected x, y, z or arc")
    if kind not in BODIES and (scene is not None or settings):
        raise ValueError(
            f"--scene and --set go with --kind {', '.join(BODIES)} alone: the others "
            "need no mesh"
        )
    path = Path(name)
    if path.is_dir():
        if (path / SWEEP).exists() and not (path / RESULT).exists():
            raise ValueError(
                f"{name} is the folder of a sweep, which keeps a table and no results: "
                "bipot run with the --set of a row makes one to draw"
            )
        path = path / RESULT
    if not path.exists():
        raise OSError(f"there is no {path}: bipot run makes one, as out/SCENE/{RESULT}")
    _, steps, attributes = read_result(path)
    if not steps:
        raise ValueError(f"{path} holds no load steps to draw")
    if step is not None and not 1 <= step <= len(steps):
        raise ValueError(f"--step is {step}, expected one from 1 to {len(steps)}")
    result = load(path)
    if contact is not None and "surface" not in result.contacts:
        raise ValueError(
            f"--contact is {contact!r}, but {path} does not tell surfaces: an earlier "
            "version wrote it, or it is of a problem given as arrays"
        )
    title, units = _labels(attributes)
    result.units = units or result.units
    target = path.with_name(f"{kind}.png") if out is None else out
    case = _case(path, attributes, scene, settings) if kind in BODIES else None
    try:
        with writing(target):
            at = None if step is None else step - 1
            known[kind](target, result, title, Asked(contact, along, at, case))
    except ValueError as error:
        said = str(error)
        if "not supported" in said:
            raise ValueError(f"cannot draw {target}: {error}") from error
        for word, own in _WORDS.items():
            said = said.replace(word, own)
        raise ValueError(said) from error
    return target


def _case(
    path: Path,
    attributes: Mapping[str, Any],
    scene: str | None,
    settings: Sequence[str],
) -> Any:
    """The bodies of a result, meshed again; the very scene that was solved, or an error."""
    from bipot_rs.cli.resume import stamps
    from bipot_rs.scene.build import bodies
    from bipot_rs.scene.reading import assemble, read

    told = str(attributes.get("scene", ""))
    if "scene_digest" not in attributes:
        raise ValueError(
            f"{path} is not the result of a scene, whose mesh the picture needs: draw the "
            "contacts by ParaView, and the bodies of a Model by plots.deformed in Python"
        )
    if scene is None:
        settings = [*json.loads(attributes.get("settings", "[]")), *settings]
    name = told if scene is None else scene
    try:
        found = read(name, settings)
    except ValueError as error:
        raise ValueError(
            f"the picture needs the scene of {path}, {told!r} where it was solved: give it "
            f"by --scene, with what was set by --set ({error})"
        ) from error
    digest = stamps(found, "", 0.0)["scene_digest"]
    if digest != attributes["scene_digest"]:
        raise ValueError(
            f"{path} is of another scene than {name!r} as it is now, or of other settings: "
            "give that by --scene, with what was set by --set"
        )
    return assemble(found, bodies(found))


def _labels(attributes: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Title and names of units, where the run has left them."""
    units = attributes.get("units", "")
    return str(attributes.get("title", "")), json.loads(units) if units else {}
