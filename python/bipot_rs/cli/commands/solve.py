"""``bipot solve``: solve contacts on the stiffness that another program has written."""

from __future__ import annotations

import argparse
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.contact.path.choice import ENGINES

SUMMARY = "Solve a contact problem with a stiffness matrix of another program."
DETAILS = """\
Tables may name degrees of freedom instead of nodes: columns dof_x, dof_y[, dof_z] in
--contacts, dof and force in --load, dof and value in --fixed. Steps and degrees of
freedom count from 0. To name nodes of a Matrix Market file, give --nodes and, if
needed, --order. Writes reactions.csv, displacements.csv, steps.csv, result.h5 and,
with --nodes, contact.pvd and result.pvd for ParaView."""
# Options that name files, whether they are required, and their help.
_FILES = (
    (
        "--stiffness",
        True,
        "A Matrix Market file, or lines node, component, node, component, value of Abaqus.",
    ),
    (
        "--contacts",
        True,
        "CSV table with columns node, nx, ny[, nz], mu[, other, gap, area].",
    ),
    (
        "--nodes",
        False,
        "CSV table with columns node, x, y[, z], or a file with *NODE lines.",
    ),
    ("--load", False, "CSV table with columns node, fx, fy[, fz][, step]."),
    (
        "--fixed",
        False,
        "CSV table with columns node, ux, uy[, uz][, step]; empty where free.",
    ),
)


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    for name, required, told in _FILES:
        parser.add_argument(
            name, type=Path, required=required, metavar="FILE", help=told
        )
    parser.add_argument(
        "--order",
        metavar="node|component",
        help="Order of the degrees of freedom in a Matrix Market file. node (default): "
        "d * row + component, with the rows of --nodes. component: all u_x, then all u_y. "
        "The order is checked with rigid motions.",
    )
    shared.add_out(parser, "Folder for the results. Default: out/STIFFNESS.")
    parser.add_argument(
        "--stiffness-rtol",
        type=shared.read_number,
        metavar="R",
        help="Relative error of the entries of the stiffness: 1e-8 for eight digits. Rigid "
        "motions are restored. Needs --nodes.",
    )
    shared.add_method(parser, of_scene=False)
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default="auto",
        metavar="ENGINE",
        help=f"Engine: {', '.join(ENGINES)}. iterative needs --nodes. Default: auto.",
    )
    shared.add_tol(parser)
    shared.add_json(parser)


def run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    """Carry out the command; returns the exit status."""
    from bipot_rs.cli.run.matrix_job import MatrixOptions, SolveMatrix

    folder = arguments.out or Path("out") / arguments.stiffness.stem
    request = shared.read_options(MatrixOptions, arguments, folder=folder)
    job = SolveMatrix(request, as_json=arguments.json, interrupts=interrupts)
    return job.runner.run()
