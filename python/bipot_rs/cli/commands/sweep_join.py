"""``bipot sweep --join``: join the parts of a study into one table."""

from __future__ import annotations

import argparse
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.interrupts import Interrupts

SUMMARY = "Join the tables and results of the parts of a sweep. Does not solve."
DETAILS = ""


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "folders",
        metavar="DIR",
        nargs="+",
        type=Path,
        help="Folders of parts, or folders that hold them.",
    )
    shared.add_flag(parser, "--join", "Join the parts.")
    shared.add_out(
        parser, "Folder for sweep.csv. Default: the folder that the parts are in."
    )
    shared.add_json(parser)


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Carry out the command; returns the worst exit status of the rows."""
    from bipot_rs.cli.study.join import join_into

    return join_into(arguments.folders, arguments.out, as_json=arguments.json)
