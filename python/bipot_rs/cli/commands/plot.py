"""``bipot plot``: draw pictures of a result, without solving."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bipot_rs._lib.messages import meant
from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, tell
from bipot_rs.cli.run.output_folder import RESULT, SWEEP

if TYPE_CHECKING:
    from bipot_rs._lib.types import Record
    from bipot_rs.scene.case import Case

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
    shared.complete_by(kind, shared.complete_kinds)
    shared.add_out(
        parser,
        "File to write. Default: RESULT/KIND.png. NAME.gif is an animation over the load "
        "steps.",
    )
    parser.add_argument(
        "--contact",
        "--on",
        metavar="NAME",
        help="Contact to draw, by its name or its BODY.SURFACE. Default: all.",
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
    parser.add_argument(
        "--over",
        metavar="SURFACE",
        help="For force_displacement: the surface, BODY.SURFACE, over whose mean displacement "
        "the force is drawn. Default: the slip of the contacts.",
    )
    parser.add_argument(
        "--backend",
        choices=("matplotlib", "pyvista"),
        help="For the _3d pictures: the library that draws them. Default: matplotlib.",
    )
    scene = parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="Scene of the result, for deformed, the _3d pictures and --over. Default: the scene "
        "named in the result.",
    )
    shared.complete_by(scene, shared.complete_scenes)
    shared.add_settings(parser, purpose="Keys that were set for the run.")


# Arguments of the pictures, and the options of the command line.
_OPTIONS = {
    "on": "--contact",
    "along": "--along",
    "step": "--step",
    "near": "--near",
    "scale": "--scale",
    "displacement": "--over",
    "backend": "--backend",
}


def run(asked: argparse.Namespace, _: Interrupts) -> int:
    """Draw the picture and print the name of its file."""
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.files.drafts import writing
    from bipot_rs.files.export import read_saved
    from bipot_rs.plots.by_name import KINDS, animate, plot
    from bipot_rs.plots.run_figure import write_figure
    from bipot_rs.plots.style import figure_of

    kind, step, scene, settings = asked.kind, asked.step, asked.scene, asked.settings
    if kind not in KINDS:
        raise ValueError(
            f"--kind is {kind!r}, expected one of {', '.join(KINDS)}{meant(kind, KINDS)}"
        )
    if asked.along not in (None, "x", "y", "z", "arc"):
        raise ValueError(f"--along is {asked.along!r}, expected x, y, z or arc")
    with_bodies = [name for name, picture in KINDS.items() if picture.bodies]
    with_mesh = kind in with_bodies or asked.over is not None
    if not with_mesh and (scene is not None or settings):
        raise ValueError(
            f"--scene and --set are only for --over and --kind {', '.join(with_bodies)}: "
            "other pictures need no mesh"
        )
    path = Path(asked.result)
    if path.is_dir():
        path = path / RESULT
    if not path.exists():
        raise OSError(
            f"there is no {path}: bipot run writes one, by default out/SCENE/{RESULT}"
        )
    steps, attributes = read_saved(path)[1:3]
    if not steps:
        raise ValueError(f"{path} has no load steps to draw")
    if step is not None and not 1 <= step <= len(steps):
        raise ValueError(f"--step is {step}, expected one from 1 to {len(steps)}")
    result = load(path)
    if asked.contact is not None and "surface" not in result.contacts:
        raise ValueError(
            f"--contact is {asked.contact!r}, but {path} has no names of surfaces: an earlier "
            "version wrote it, or its problem was given as arrays"
        )
    title = str(attributes.get("title", ""))
    result.units = json.loads(attributes.get("units") or "{}") or result.units
    target = asked.out or path.with_name(f"{kind}.png")
    case = _case(path, attributes, scene, settings) if with_mesh else None
    options: dict[str, Any] = {}
    for name, option in _OPTIONS.items():
        value = getattr(asked, option.removeprefix("--"))
        if value is not None:
            if not KINDS[kind].takes(name):
                raise ValueError(f"{option} cannot be used with --kind {kind}")
            options[name] = value
    if step is not None:
        options["step"] = step - 1
    with writing(target):
        if target.suffix.lower() == ".gif":
            if step is not None:
                raise ValueError("--step cannot be used with a GIF of all load steps")
            animate(result, target, kind, model=case, **options)
        else:
            check_format(target)
            if kind == "tractions" and asked.along is None:
                write_figure(target, result, title=title, **options)
            elif asked.backend == "pyvista":
                plotter: Any = plot(result, kind, model=case, **options)
                plotter.screenshot(str(target))
            else:
                figure = figure_of(plot(result, kind, model=case, **options))
                if title:
                    figure.suptitle(title)
                figure.savefig(target, dpi=150, bbox_inches="tight")
    tell(str(target), sys.stdout)
    return SOLVED


def check_format(target: Path) -> None:
    """Refuse a suffix for which matplotlib has no format, before drawing."""
    from bipot_rs.plots import mpl

    formats = mpl.FigureCanvasBase.get_supported_filetypes()
    if target.suffix.lower().removeprefix(".") not in formats:
        raise ValueError(
            f"cannot draw {target}, expected a suffix of {', '.join(formats)}"
        )


def _case(
    path: Path,
    attributes: Record,
    scene: str | None,
    settings: Sequence[str],
) -> Case:
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
        scene_read = read(name, settings)
    except ValueError as error:
        raise ValueError(
            f"the picture needs the scene of {path}, which was {solved!r}: give it with "
            f"--scene, and its settings with --set ({error})"
        ) from error
    digest = stamps(scene_read, "", 0.0)["scene_digest"]
    if digest != attributes["scene_digest"]:
        raise ValueError(
            f"{path} was not solved from {name!r} as it is now, or with other settings: "
            "give its scene with --scene, and its settings with --set"
        )
    return assemble(scene_read, made(scene_read))


class OfSweep:
    """``bipot plot --x --y``: draw one column of the table of a sweep over another."""

    SUMMARY = "Draw one column of the table of a sweep over another."
    DETAILS = ""

    @staticmethod
    def add_arguments(parser: shared.Parser) -> None:
        """Add the arguments of the command."""
        parser.add_argument("result", metavar="SWEEP", help="The folder of a sweep.")
        parser.add_argument(
            "--x",
            metavar="COLUMN",
            help="Column of the table on the horizontal axis. contact.0.mu may be shortened to "
            "mu.",
        )
        parser.add_argument(
            "--y",
            metavar="COLUMN",
            help="Column on the vertical axis. 'max_pressure of body.surface' may be shortened "
            "to max_pressure.",
        )
        shared.add_out(parser, "File to write. Default: SWEEP/Y_over_X.png.")

    @staticmethod
    def run(arguments: argparse.Namespace, _: Interrupts) -> int:
        """Draw the picture and print the name of its file."""
        from bipot_rs.cli.study.picture import draw

        path = Path(arguments.result)
        if not is_sweep(path):
            raise ValueError(
                f"--x and --y need the folder of a sweep, but {path} is not"
            )
        target, remark = draw(path, arguments.x, arguments.y, arguments.out)
        complain(remark)
        tell(str(target), sys.stdout)
        return SOLVED


def is_sweep(path: Path) -> bool:
    """Whether a folder or file is a sweep, and not the result of a run."""
    if path.is_dir():
        return (path / SWEEP).exists() and not (path / RESULT).exists()
    return path.name == SWEEP
