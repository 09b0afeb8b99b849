"""``bipot run``: solve a scene and write its tables, pictures and results."""

from __future__ import annotations

import argparse
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.run.runner import ENGINES, ENOUGH

SUMMARY = "Solve a scene. Writes steps.csv, result.h5, and files for ParaView."
DETAILS = """\
result.pvd holds the bodies, contact.pvd the contacts.
Ctrl-C stops it; the load steps solved so far are written."""


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    shared.add_scene(parser)
    shared.add_settings(parser)
    shared.add_out(parser, "Folder for the results. Default: out/SCENE.")
    shared.add_method(parser, of_scene=True)
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        metavar="ENGINE",
        help=f"Engine, instead of the scene's: {', '.join(ENGINES)}; see 'A large model'. "
        "With mpirun -n N before the command, petsc uses N processes: see 'On a cluster'.",
    )
    parser.add_argument(
        "--tol",
        type=read_tol,
        metavar="T",
        help="Residual to reach, instead of the scene's. With 'discretisation': a tenth of "
        "the discretisation error (P1 meshes only).",
    )
    shared.add_json(parser)
    shared.add_flag(
        parser, "--plot", "Also write tractions.png and, with --error, error.png."
    )
    shared.add_flag(
        parser,
        "--fclib",
        "Also write each load step as an FCLIB file, problem-0000.hdf5.",
    )
    shared.add_flag(
        parser,
        "--error",
        "Estimate the discretisation error. Needs --set mesh.element=P1.",
    )
    shared.add_flag(
        parser, "--resume", "Continue this run from its incomplete result.h5."
    )


def read_tol(text: str) -> float | str:
    """A tolerance as an argument: a number, or the word for one that depends on the mesh."""
    if text == ENOUGH:
        return text
    try:
        return shared.read_number(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}, nor {ENOUGH}") from None


def run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    """Carry out the command; returns the exit status."""
    from bipot_rs.cli.run.job import Job, RunOptions

    folder = arguments.out or Path("out") / Path(arguments.scene).stem
    request = shared.read_options(RunOptions, arguments, folder=folder)
    return Job(request, as_json=arguments.json, interrupts=interrupts).runner.run()
