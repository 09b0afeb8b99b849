"""``bipot check``: what is wrong with a scene, and what it will take, without solving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bipot_rs.scene import Case


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
    from bipot_rs.running import forecast
    from bipot_rs.scene import assemble, bodies, read

    scene = read(name, settings)
    forecast.fits(scene)
    meshed = bodies(scene)
    forecast.fits(scene, meshed)
    case = assemble(scene, meshed)
    model = case.model
    remarks = case.remarks()
    counts = _counts(case)
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
            *forecast.remarked(remarks),
        ],
    }


def _counts(case: Case) -> dict[str, Any]:
    found: dict[str, Any] = {}

    def stop(counts: Mapping[str, Any]) -> None:
        found.update(counts)
        raise _Counted

    with suppress(_Counted):
        case.problem(on_forecast=stop)
    return found
