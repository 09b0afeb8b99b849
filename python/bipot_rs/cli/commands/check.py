"""``bipot check``: mistakes of a scene, its size, memory and time, without solving."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import NO_ANSWER, SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, print_summary

if TYPE_CHECKING:
    from bipot_rs._lib.types import OpenRecord
    from bipot_rs.scene.case import Case

SUMMARY = (
    "Check a scene: report its mistakes, its size, memory and time. Does not solve."
)
DETAILS = ""


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    shared.add_scene(parser)
    shared.add_settings(parser)
    shared.add_json(parser)


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Print the summary; a body that floats, or that contact cannot hold, has no answer."""
    summary = check(arguments.scene, arguments.settings) | {"scene": arguments.scene}
    floating = summary.pop("floating")
    summary["ok"] = floating is None
    if floating is not None:
        summary["message"] = floating
    print_summary(summary, as_json=arguments.json)
    if floating is None:
        return SOLVED
    if not arguments.json:
        complain(floating)
    return NO_ANSWER


def check(name: str, settings: Sequence[str]) -> OpenRecord:
    """Read, mesh and assemble a scene, and find the cost of condensing it.

    Returns ``title``, sizes (``dofs``, ``prescribed``, ``contacts``, ``steps``, ``bodies``),
    ``forecast`` with the counts of `ContactProblem`'s ``on_forecast``, ``seconds`` and
    ``bytes_run``, the peak of a run, or with the memory of a rank of engine petsc, None where a
    body floats; ``floating``, a message on
    motions that neither supports nor contact can prevent, or on loads that contact cannot
    carry, or None; ``held_by_contact``, names of bodies without support and spring;
    ``remarks``, a list of messages; ``loads``, the area of each traction and pressure; and
    ``lines`` for a terminal.
    """
    from bipot_rs.cli.run import cost_forecast
    from bipot_rs.fem.checks.free_bodies import list_unsupported
    from bipot_rs.petsc.run.ranks import read_launcher
    from bipot_rs.scene.build import bodies
    from bipot_rs.scene.case import assemble
    from bipot_rs.scene.reading import read

    scene = read(name, settings)
    cost_forecast.fits(scene)
    meshed = bodies(scene)
    cost_forecast.fits(scene, meshed)
    case = assemble(scene, meshed, stiffness=False)
    model = case.model
    several = scene.solver.engine == "petsc"
    counts, floating = cost_forecast.counts(case)
    remarks = [remark for remark in case.remarks() if remark not in floating]
    if not floating and (unbalanced := case.describe_unbalanced()):
        floating = [unbalanced]
    loose = list_unsupported(model)
    steps = len(case.parameter)
    loads = _find_loaded_areas(case)
    unit = f" {scene.units.length}²" if scene.units.length else ""
    areas = ", ".join(f"{title} ({area:.6g}{unit})" for title, area in loads)
    title = [scene.title] if scene.title else []
    cost, forecast = [], None
    if several:
        ranks = read_launcher()[1]
        cost = [cost_forecast.of_ranks(model, ranks)]
        each = cost_forecast.rank_bytes(model, ranks)
        forecast = {"engine": "petsc", "ranks": ranks, "bytes_rank": each}
    elif counts:
        cost = cost_forecast.cost(counts, model, steps)
        remarks += cost_forecast.describe_stalling(counts, model)
        forecast = counts | {"seconds": cost_forecast.seconds(counts)}
    return {
        "title": scene.title,
        "bodies": len(model.bodies),
        "dofs": model.n,
        "prescribed": len(model.fixed),
        "contacts": len(model.gap),
        "steps": steps,
        "forecast": forecast,
        "floating": "; ".join(floating) or None,
        "held_by_contact": loose,
        "remarks": remarks,
        "loads": [{"load": title, "area": area} for title, area in loads],
        "lines": [
            *title,
            *cost_forecast.sizes(model, steps),
            *([f"  loads     {areas}"] if areas else []),
            *(
                [f"  loose     {', '.join(loose)}: held by contact alone"]
                if loose
                else []
            ),
            *cost,
            *cost_forecast.list_remarks(remarks),
        ],
    }


def _find_loaded_areas(case: Case) -> list[tuple[str, float]]:
    """Title and area of each traction and pressure, whose components are one."""
    areas = {}
    for load in (acting.load for acting in case.loads):
        if load is not None and load.surface is not None:
            title = f"{load.kind} on {load.body}.{load.surface}"
            body = case.model.numbered[load.body].body
            areas[title, str(load.within)] = load.area(body)
    return [(title, area) for (title, _), area in areas.items()]
