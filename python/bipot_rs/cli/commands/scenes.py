"""``bipot scenes``: list the shipped scenes, or print one."""

from __future__ import annotations

import argparse
import sys
import tomllib

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import tell

SUMMARY = "List the shipped scenes, or print one."
DETAILS = "On a terminal each name has its title; elsewhere there are names only."


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    name = parser.add_argument(
        "name", metavar="NAME", nargs="?", help="Print the TOML of this scene."
    )
    shared.complete_by(name, shared.complete_scenes)


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Print the names or the scene; a `SceneError` if there is no such scene."""
    from bipot_rs.scene.library import shipped, text

    names = shipped()
    if arguments.name is None and sys.stdout.isatty():
        titles = [tomllib.loads(text(name)).get("title", "") for name in names]
        wide = max(map(len, names))
        names = [f"{n:{wide}}  {t}" for n, t in zip(names, titles, strict=True)]
    if arguments.name is None:
        tell("\n".join(names), sys.stdout)
    else:
        tell(text(arguments.name).rstrip(), sys.stdout)
    return SOLVED
