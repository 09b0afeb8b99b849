"""``bipot sweep``: solve one scene with many settings in parallel, into one table."""

from __future__ import annotations

import argparse
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import Ended
from bipot_rs.cli.interrupts import Interrupts

SUMMARY = (
    "Solve a scene for all combinations of settings, in parallel. Writes sweep.csv."
)
DETAILS = """\
A row that fails has its message in the table, and the load steps before the failure in
rows/NNNN/result.h5. Ctrl-C keeps the finished rows.
To join the tables of --part: bipot sweep --join DIR..., see bipot sweep --join --help."""


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    shared.add_scene(parser)
    shared.add_settings(
        parser, metavar="KEY=V1,V2,…", purpose="Values of a key: contact.0.mu=0.1,0.3."
    )
    parser.add_argument(
        "--range",
        dest="ranges",
        action="append",
        default=[],
        metavar="KEY=FROM:TO:COUNT",
        help="COUNT equally spaced values: 0.1:0.5:3 is 0.1, 0.3, 0.5. May be given several "
        "times.",
    )
    shared.add_out(parser, "Folder for sweep.csv. Default: out/SCENE-sweep.")
    shared.add_method(parser, of_scene=True)
    parser.add_argument(
        "--tol",
        type=shared.read_number,
        metavar="T",
        help="Residual to reach, instead of the scene's.",
    )
    parser.add_argument(
        "--jobs",
        type=shared.read_count,
        metavar="N",
        help="Processes with one thread each. Default: one per core.",
    )
    parser.add_argument(
        "--part",
        metavar="I/N",
        help="Solve part I of N only, into the folder part-I-of-N of --out.",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Solve the rows on the workers of this dask.distributed scheduler: "
        "tcp://HOST:8786, or its scheduler file.",
    )
    shared.add_flag(
        parser,
        "--results",
        "Write rows/NNNN/result.h5 of every row, not only of rows that fail.",
    )
    shared.add_flag(parser, "--resume", "Keep finished rows and solve the others.")
    shared.add_json(parser)


def run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    """Carry out the command; returns the exit status."""
    from bipot_rs.cli.study.plan import part
    from bipot_rs.cli.study.solving import StudyOptions, solve_rows

    request = shared.read_options(
        StudyOptions,
        arguments,
        folder=arguments.out or Path("out") / f"{Path(arguments.scene).stem}-sweep",
        part=None if arguments.part is None else part(arguments.part),
        as_json=arguments.json,
    )
    try:
        return solve_rows(request)
    except KeyboardInterrupt:
        message = "interrupted; --resume solves the remaining rows"
        raise Ended(interrupts.status, message) from None


class Join:
    """``bipot sweep --join``: join the parts of a study into one table."""

    SUMMARY = "Join the tables and results of the parts of a sweep. Does not solve."
    DETAILS = ""

    @staticmethod
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

    @staticmethod
    def run(arguments: argparse.Namespace, _: Interrupts) -> int:
        """Carry out the command; returns the worst exit status of the rows."""
        from bipot_rs.cli.study.join import join_into

        return join_into(arguments.folders, arguments.out, as_json=arguments.json)
