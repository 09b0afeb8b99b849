"""``bipot check``: what is wrong with a scene, and what it will take, without solving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs.words import counted

if TYPE_CHECKING:
    from bipot_rs.scene import Case
    from bipot_rs.schema import Scene


class _Counted(Exception):
    """Ends the condensation once its cost is known."""


def check(name: str, settings: Sequence[str]) -> dict[str, Any]:
    """Read, mesh and assemble a scene, and count what condensing it will take.

    Returns
    -------
    dict
        ``title``, sizes (``dofs``, ``prescribed``, ``contacts``, ``steps``, ``bodies``),
        ``forecast`` with the counts of `ContactProblem`'s ``on_forecast`` and
        ``seconds``, ``remarks`` a list of sentences, and ``lines`` for a terminal.

    Raises
    ------
    SceneError
        All mistakes of the scene.
    MemoryError
        It would not fit into this machine.
    """
    from bipot_rs import forecast
    from bipot_rs.scene import assemble, bodies, read

    scene = read(name, settings)
    forecast.fits(scene)
    forecast.solver(scene.solver.method, scene.solver.tol)
    case = assemble(scene, bodies(scene))
    model = case.model
    counts = _counts(case)
    remarks = list(_remarks(scene, case))
    steps = len(case.parameter)
    title = [scene.title] if scene.title else []
    return {
        "title": scene.title,
        "bodies": len(model.bodies),
        "dofs": model.n,
        "prescribed": len(model.fixed),
        "contacts": len(model.gap),
        "steps": steps,
        "forecast": counts | {"seconds": forecast.seconds(counts, forecast.cores())},
        "remarks": remarks,
        "lines": [
            *title,
            *forecast.sizes(model, steps),
            *forecast.cost(counts),
            *(f"  remark    {remark}" for remark in remarks),
        ],
    }


def _counts(case: Case) -> dict[str, Any]:
    found: dict[str, Any] = {}

    def stop(counts: Mapping[str, Any]) -> None:
        found.update(counts)
        raise _Counted

    with suppress(_Counted):
        case.model.problem(on_forecast=stop)
    return found


def _remarks(scene: Scene, case: Case) -> list[str]:
    """What may be meant, and more often is not."""
    said = []
    model, unit = case.model, scene.units.length
    length = f" {unit}" if unit else ""
    for k, contact in enumerate(model.contacts):
        gap = model.gap[model.group == k]
        name = f"contact.{k} on {contact.body}.{contact.surface}"
        inside = int((gap < 0).sum())
        if inside:
            said.append(
                f"{name}: {inside} of {counted(len(gap), 'node')} inside the obstacle by "
                f"up to {-gap.min():.3g}{length} before anything moves"
            )
        own = model.nodes[model.offset[_body(model, contact.body)] // model.dim :][
            : _count(model, contact.body)
        ]
        far = float(np.ptp(own, axis=0).max())
        if len(gap) and gap.min() > far:
            said.append(
                f"{name}: the nearest node is {gap.min():.3g}{length} away, more than the "
                "body is large: does the normal of the plane point to the body?"
            )
        if not np.any(contact.mu):
            said.append(f"{name}: mu is zero, there is no friction")
    if case.load is None and not np.any(case.prescribed):
        said.append("nothing moves: no load and no prescribed displacement but zero")
    if not len(model.fixed):
        said.append("no support holds a body: contact alone must balance all loads")
    return said


def _body(model: Any, name: str) -> int:
    return next(k for k, body in enumerate(model.bodies) if body.name == name)


def _count(model: Any, name: str) -> int:
    """Nodes of a body."""
    first = [*model.offset, model.n]
    k = _body(model, name)
    return int((first[k + 1] - first[k]) // model.dim)
