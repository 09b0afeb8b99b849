"""``bipot blocks``: decide whether rigid blocks stand, with a proof."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bipot_rs._lib.messages import place
from bipot_rs.cli import arguments as shared
from bipot_rs.cli.commands.plot import check_format
from bipot_rs.cli.exit_codes import NO_ANSWER, NOT_CONVERGED, SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line, tell
from bipot_rs.cli.text_table import format_table

if TYPE_CHECKING:
    from bipot_rs._lib.types import Floats, OpenRecord
    from bipot_rs.blocks.problem import BlockProblem

SUMMARY = "Decide whether rigid blocks stand, with a proof."
DETAILS = """\
FILE is an assembly in COMPAS JSON, points in JSON, OBJ or STL. Exit status: 0 balanced,
1 no equilibrium, 3 undecided."""
_STATUS = {"balanced": SOLVED, "none": NO_ANSWER, "undecided": NOT_CONVERGED}


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("file", type=Path, metavar="FILE", help="The blocks.")
    parser.add_argument(
        "--mu",
        type=shared.read_number,
        required=True,
        metavar="M",
        help="Friction coefficient of all interfaces.",
    )
    parser.add_argument(
        "--support",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="Blocks that are held, by name or by key of the node, besides those that the "
        "file marks as supports.",
    )
    parser.add_argument(
        "--density",
        type=shared.read_number,
        default=1.0,
        metavar="D",
        help="Density of blocks for which the file has none. Default: 1.",
    )
    parser.add_argument(
        "--gravity",
        type=shared.read_vector,
        metavar="X,Y[,Z]",
        help="Acceleration. Default: 1, downwards along the last axis.",
    )
    parser.add_argument(
        "--push",
        type=shared.read_vector,
        metavar="X,Y[,Z]",
        help="Also find the largest acceleration along this direction, as a multiple of "
        "it.",
    )
    shared.add_flag(
        parser,
        "--ranges",
        "Also print the least and largest normal force of each contact.",
    )
    parser.add_argument(
        "--tolerance",
        type=shared.read_number,
        metavar="T",
        help="Find the interfaces, also if the file has some: largest distance of faces "
        "that touch, relative to the smaller block. Default: those of the file, else 1e-4.",
    )
    shared.add_out(parser, "Picture to draw of the forces, or of the motion.")
    shared.add_json(parser)


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Print the verdict and its proof; returns the exit status."""
    from bipot_rs.blocks.problem import assemble
    from bipot_rs.blocks.readers import read

    if arguments.out is not None:
        check_format(arguments.out)
    file = read(arguments.file, density=arguments.density)
    problem = assemble(
        file.blocks,
        arguments.mu,
        supports=[file.keys.get(name, name) for name in arguments.support],
        gravity=arguments.gravity,
        interfaces=file.interfaces if arguments.tolerance is None else None,
        tolerance=1e-4 if arguments.tolerance is None else arguments.tolerance,
    )
    live = None if arguments.push is None else problem.body_force(arguments.push)
    equilibrium = problem.equilibrium()
    report: OpenRecord = {
        "blocks": len(problem.blocks),
        "interfaces": len(problem.interfaces),
        "contacts": len(problem.points),
        "verdict": equilibrium.verdict,
        "margin": equilibrium.margin,
    }
    stands = equilibrium.verdict == "balanced"
    texts, message = [repr(problem)], ""
    if stands:
        texts.append(f"balanced: {equilibrium.reason}")
    else:
        message = report["message"] = equilibrium.reason
    if equilibrium.motion is not None:
        rows = problem.moves(equilibrium.motion).tolist()
        report["motion"] = dict(zip(problem.names, rows, strict=True))
    if live is not None and stands:
        texts.append(_find_limit(problem, arguments.push, live, report))
    if arguments.ranges and stands:
        texts.append(_find_ranges(problem, report))
    if arguments.out is not None:
        _draw(
            problem,
            equilibrium.reaction if stands else None,
            equilibrium.motion,
            arguments.out,
        )
        report["out"] = str(arguments.out)
        texts.append(str(arguments.out))
    if arguments.json:
        line(**report)
    else:
        tell("\n".join(texts), sys.stdout)
        complain(message)
    return _STATUS[equilibrium.verdict]


def _find_limit(
    problem: BlockProblem,
    push: tuple[float, ...],
    live: Floats,
    report: OpenRecord,
) -> str:
    limit = problem.limit_multiplier(problem.rigid[1], live)
    report["largest_push"] = _bound_of_json(limit.upper)
    if limit.mechanism is None:
        return f"a push along {place(push)} of any size is carried"
    report["mechanism"] = problem.describe(limit.mechanism)
    return (
        f"{place(push)} may be added {limit.upper:.6g} times, not more, because then "
        f"{report['mechanism']}"
    )


def _bound_of_json(bound: float) -> float | None:
    """The bound, or None without one: JSON has no infinite numbers."""
    return bound if math.isfinite(bound) else None


def _find_ranges(problem: BlockProblem, report: OpenRecord) -> str:
    rows, report["ranges"] = [], []
    for k, interface in enumerate(problem.interfaces):
        names = [problem.names[interface.first], problem.names[interface.second]]
        least, largest = problem.normal_range(k)
        ends = {"least": least, "largest": _bound_of_json(largest)}
        report["ranges"].append({"between": names, **ends})
        rows.append([*names, f"{least:.6g}", f"{largest:.6g}"])
    return format_table(["block", "block", "least", "largest"], rows)


def _draw(
    problem: BlockProblem, reaction: Floats | None, motion: Floats | None, out: Path
) -> None:
    from bipot_rs.files.drafts import writing
    from bipot_rs.plots.blocks import blocks
    from bipot_rs.plots.style import figure_of

    with writing(out):
        figure = figure_of(blocks(problem, reaction, motion))
        figure.savefig(out, dpi=150, bbox_inches="tight")
