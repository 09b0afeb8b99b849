"""``bipot plot``: draw pictures of a result, without solving."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import meant
from bipot_rs.cli import arguments as shared
from bipot_rs.cli import completion
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import tell
from bipot_rs.cli.run.output_folder import RESULT

SUMMARY = "Draw a picture of a result or of a sweep. Does not solve again."
DETAILS = "For the folder of a sweep see bipot plot --x COLUMN --help."


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "result", metavar="RESULT", help="The folder of a run, or its result.h5."
    )
    kind = parser.add_argument(
        "--kind",
        default="tractions",
        metavar="KIND",
        help="Picture to draw: tractions (the default), slip, status_map, resultants, "
        "status_shares, force_displacement, dissipation, deformed; of a run with wear also "
        "wear. In three dimensions also pressure_3d, shear_3d, gap_3d, slip_3d, status_3d; "
        "for plane surfaces pressure_map, shear_map, gap_map.",
    )
    shared.complete_by(kind, completion.complete_kinds)
    shared.add_out(
        parser,
        "File to write. Default: RESULT/KIND.png. NAME.gif is an animation over the load "
        "steps.",
    )
    parser.add_argument(
        "--contact",
        metavar="BODY.SURFACE",
        help="Contact surface to draw. Default: all.",
    )
    parser.add_argument(
        "--along",
        metavar="x|y|z|arc",
        help="Horizontal axis of a line: a coordinate, or arc for its arc length.",
    )
    parser.add_argument(
        "--step",
        type=int,
        metavar="K",
        help="Load step to draw, counted from 1. Default: the last.",
    )
    parser.add_argument(
        "--near",
        type=shared.read_number,
        metavar="F",
        help="For deformed: only the surroundings of the contacts, up to F times their "
        "extent.",
    )
    parser.add_argument(
        "--scale",
        type=shared.read_number,
        metavar="F",
        help="For deformed: the factor of the displacements.",
    )
    scene = parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="Scene of the result, for deformed and the _3d pictures. Default: the scene "
        "named in the result.",
    )
    shared.complete_by(scene, completion.complete_scenes)
    shared.add_settings(parser, purpose="Keys that were set for the run.")


def run(found: argparse.Namespace, _: Interrupts) -> int:
    """Draw the picture and print the name of its file."""
    made = draw(
        found.result,
        found.kind,
        found.out,
        contact=found.contact,
        along=found.along,
        step=found.step,
        near=found.near,
        scale=found.scale,
        scene=found.scene,
        settings=found.settings,
    )
    tell(str(made), sys.stdout)
    return SOLVED


@dataclass(frozen=True)
class Asked:
    """The part of a result to draw.

    Attributes
    ----------
    where
        Name of a contact surface, ``"body.surface"``; None for all.
    along
        ``"x"``, ``"y"``, ``"z"`` or ``"arc"``; None for the default of the picture.
    step
        The load step to draw, from 0; None for the last.
    near, scale
        As in `plots.deformed`; None for the default.
    case
        The `Case` with the bodies, for pictures that need their mesh.
    """

    where: str | None = None
    along: str | None = None
    step: int | None = None
    near: float | None = None
    scale: float | None = None
    case: Any = None

    def given(self, kind: str, takes: Callable[[str], bool]) -> dict[str, Any]:
        """The options of a picture; an error if it does not take one of them."""
        chosen = {name: getattr(self, name) for name in _OPTIONS}
        given = {key: value for key, value in chosen.items() if value is not None}
        for key in given:
            if not takes(key):
                raise ValueError(f"--{_OPTIONS[key]} cannot be used with --kind {kind}")
        return given


# A function that draws: the file to write, the result, a title, the part to draw.
Picture = Callable[[Path, Any, str, Asked], None]


def kinds() -> dict[str, Picture]:
    """Pictures by name: those of `plots.plot`, and that of ``bipot run --plot``."""
    from bipot_rs.plots.by_name import KINDS, Kind

    def one(name: str, kind: Kind) -> Picture:
        def draw(path: Path, result: Any, title: str, asked: Asked) -> None:
            given = asked.given(name, kind.takes)
            ax = kind(result, asked.case, **given)
            if title:
                ax.figure.suptitle(title)
            ax.figure.savefig(path, dpi=150, bbox_inches="tight")

        return draw

    drawn = {name: one(name, kind) for name, kind in KINDS.items()}
    drawn["tractions"] = _tractions(drawn["tractions"])
    return drawn


def bodies() -> list[str]:
    """Names of the pictures that need the mesh of the bodies."""
    from bipot_rs.plots.by_name import KINDS

    return [name for name, kind in KINDS.items() if kind.bodies]


def _animated(path: Path, result: Any, kind: str, asked: Asked) -> None:
    """Write a GIF, one frame for each load step."""
    from bipot_rs.plots.animation import animate
    from bipot_rs.plots.by_name import KINDS

    if asked.step is not None:
        raise ValueError("--step cannot be used with a GIF, which shows all load steps")
    given = asked.given(kind, KINDS[kind].takes)
    animate(result, path, kind, model=asked.case, **given)


# Attributes of `Asked`, and the options of the command line.
_OPTIONS = {
    "where": "contact",
    "along": "along",
    "step": "step",
    "near": "near",
    "scale": "scale",
}
# Words in messages of `bipot_rs.plots`, and those of the command line.
_WORDS = {
    "along is missing": "--along is missing",
    "near is": "--near is",
    "kind is": "--kind is",
    "scale is": "--scale is",
    "by where=": "by --contact",
    "with where= those": "with --contact those",
    "by surface3d": "by --kind pressure_3d",
    "by surface_map": "by --kind pressure_map",
    "there is no contact": "--contact: there is no contact",
}


def _tractions(line: Picture) -> Picture:
    """The picture of ``bipot run --plot``; with --along the line alone."""

    def draw(path: Path, result: Any, title: str, asked: Asked) -> None:
        if asked.along is not None:
            line(path, result, title, asked)
            return
        from bipot_rs.plots.data import part_of, selection
        from bipot_rs.plots.run_figure import tractions

        known = result.contacts
        chosen = selection(asked.where, len(result[-1].status), known)
        contacts = part_of(known, chosen)
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
    near: float | None = None,
    scale: float | None = None,
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
        File to write, in the format of its suffix; by default ``KIND.png`` in the folder of
        the result. A name that ends in ``.gif`` is an animation over the load steps.
    contact
        The surface to draw, ``"body.surface"``; by default all.
    along
        Horizontal axis of a line: ``"x"``, ``"y"``, ``"z"`` or ``"arc"``.
    step
        The load step to draw, from 1; by default the last.
    near, scale
        The part of the bodies to draw, and the factor of displacements, of ``deformed``.
    scene, settings
        The scene of the result and the keys set in it, for pictures that need the mesh; by
        default those named in the file.

    Raises
    ------
    OSError, ValueError
        There is no result, it cannot be read or drawn, or the file cannot be written.
    """
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.files.drafts import writing
    from bipot_rs.files.export import read_result

    known = kinds()
    if kind not in known:
        raise ValueError(
            f"--kind is {kind!r}, expected one of {', '.join(known)}"
            + meant(kind, known)
        )
    if along is not None and along not in ("x", "y", "z", "arc"):
        raise ValueError(f"--along is {along!r}, expected x, y, z or arc")
    if kind not in bodies() and (scene is not None or settings):
        raise ValueError(
            f"--scene and --set are only for --kind {', '.join(bodies())}: other pictures "
            "need no mesh"
        )
    path = Path(name)
    if path.is_dir():
        path = path / RESULT
    if not path.exists():
        raise OSError(
            f"there is no {path}: bipot run writes one, by default out/SCENE/{RESULT}"
        )
    _, steps, attributes = read_result(path)
    if not steps:
        raise ValueError(f"{path} has no load steps to draw")
    if step is not None and not 1 <= step <= len(steps):
        raise ValueError(f"--step is {step}, expected one from 1 to {len(steps)}")
    result = load(path)
    if contact is not None and "surface" not in result.contacts:
        raise ValueError(
            f"--contact is {contact!r}, but {path} has no names of surfaces: an earlier "
            "version wrote it, or its problem was given as arrays"
        )
    title = str(attributes.get("title", ""))
    result.units = json.loads(attributes.get("units") or "{}") or result.units
    target = path.with_name(f"{kind}.png") if out is None else out
    case = _case(path, attributes, scene, settings) if kind in bodies() else None
    at = None if step is None else step - 1
    asked = Asked(contact, along, at, near, scale, case)
    try:
        with writing(target):
            if target.suffix.lower() == ".gif":
                _animated(target, result, kind, asked)
            else:
                known[kind](target, result, title, asked)
    except ValueError as error:
        message = str(error)
        if "not supported" in message:
            raise ValueError(f"cannot draw {target}: {error}") from error
        for word, own in _WORDS.items():
            message = message.replace(word, own)
        raise ValueError(message) from error
    return target


def _case(
    path: Path,
    attributes: Mapping[str, Any],
    scene: str | None,
    settings: Sequence[str],
) -> Any:
    """Mesh the bodies of a result again; an error if the scene is not the one solved."""
    from bipot_rs.cli.run.resume import stamps
    from bipot_rs.scene.build import bodies as made
    from bipot_rs.scene.case import assemble
    from bipot_rs.scene.reading import read

    solved = str(attributes.get("scene", ""))
    if "scene_digest" not in attributes:
        raise ValueError(
            f"{path} is not the result of a scene, so that its mesh is not known: use "
            "ParaView, or plots.deformed in Python"
        )
    if scene is None:
        settings = [*json.loads(attributes.get("settings", "[]")), *settings]
    name = solved if scene is None else scene
    try:
        found = read(name, settings)
    except ValueError as error:
        raise ValueError(
            f"the picture needs the scene of {path}, which was {solved!r}: give it with "
            f"--scene, and its settings with --set ({error})"
        ) from error
    digest = stamps(found, "", 0.0)["scene_digest"]
    if digest != attributes["scene_digest"]:
        raise ValueError(
            f"{path} was not solved from {name!r} as it is now, or with other settings: "
            "give its scene with --scene, and its settings with --set"
        )
    return assemble(found, made(found))
