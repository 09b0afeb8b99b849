"""``bipot plot --x --y``: draw one column of the table of a sweep over another."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, tell
from bipot_rs.cli.run.output_folder import RESULT, SWEEP

SUMMARY = "Draw one column of the table of a sweep over another."
DETAILS = ""


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


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Draw the picture and print the name of its file."""
    from bipot_rs.cli.study.picture import draw

    path = Path(arguments.result)
    if not is_sweep(path):
        raise ValueError(f"--x and --y need the folder of a sweep, but {path} is not")
    target, remark = draw(path, arguments.x, arguments.y, arguments.out)
    complain(remark)
    tell(str(target), sys.stdout)
    return SOLVED


def is_sweep(path: Path) -> bool:
    """Whether a folder or file is a sweep, and not the result of a run."""
    if path.is_dir():
        return (path / SWEEP).exists() and not (path / RESULT).exists()
    return path.name == SWEEP
