"""Fields of the contacts, with the names of `files.fields`, for files of all kinds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import AnyArray, Floats
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.results.solution import Step
from bipot_rs.files.fields import OF_CONTACTS
from bipot_rs.files.result_mesh import ResultMesh

if TYPE_CHECKING:
    from bipot_rs.contact.results.contact_data import ContactArrays


def make_contact_fields(
    step: Step, contacts: ContactArrays, displacement: Floats | None = None
) -> dict[str, AnyArray]:
    """Fields at the contacts of a step, acting on the body of each: those of `OF_CONTACTS`.

    Without frames there are no components along global axes; without areas no traction and
    pressure; ``displacement (n_c, d)`` is that of the contacts, if known.
    """
    frame, area = contacts.get("frame"), contacts.get("area")
    if frame is not None:
        frame = find_step_frames(step, frame)
    arrays: dict[str, AnyArray | None] = {
        "displacement": displacement,
        "reaction_local": step.reaction,
        "slip_local": step.slip,
        "relative_displacement_local": step.relative_displacement,
        # Without contacts d may be unknown, and there is no first component.
        "gap": step.relative_displacement[:, :1].ravel(),
        "status": step.status,
        "wear_depth": step.wear,
        "broken": None if step.broken is None else step.broken.astype(np.int8),
    }
    if area is not None:
        arrays["pressure"] = step.reaction[:, :1].ravel() / area
    if frame is not None:
        force = np.einsum("ck,ckd->cd", step.reaction, frame)
        arrays["force"] = force
        arrays["slip"] = np.einsum("ck,ckd->cd", step.slip, frame[:, 1:])
        arrays["normal"] = frame[:, 0]
        if area is not None:
            arrays["traction"] = force / area[:, None]
    return {
        name: array for name in OF_CONTACTS if (array := arrays.get(name)) is not None
    }


def make_path_fields(
    steps: Sequence[Step],
    contacts: ContactArrays,
    instants: Sequence[Mapping[str, float]],
    mesh: ResultMesh | None = None,
) -> Callable[[int], dict[str, AnyArray | float]]:
    """Function of the index of a step that returns its `make_contact_fields`.

    The names are the same for all steps: a field that is not known in some step is left
    out in all.

    ``steps, contacts``: as in `make_contact_fields`.
    ``instants``: `list_instants` the steps, which are added to the fields.
    ``mesh``: the mesh, for displacements.
    """
    moved = mesh is not None and all(
        step.computed.displacement is not None for step in steps
    )
    worn = all(step.wear is not None for step in steps)

    def fields(k: int) -> dict[str, AnyArray | float]:
        step = steps[k]
        u = None if mesh is None or not moved else mesh.of_contacts(step.displacement)
        constants: dict[str, AnyArray | float] = dict(
            make_contact_fields(step, contacts, u)
        )
        if not worn:
            constants.pop("wear_depth", None)
        return {**constants, **instants[k]}

    return fields


def list_instants(
    steps: Sequence[Step], loads: Sequence[float] | None = None, first: int = 0
) -> list[dict[str, float]]:
    """``load`` and ``time`` of each step; ``first`` is the number of steps before these.

    ``time`` is the cycle of the step, its place on an adaptive path, or its number from 1. It
    grows from step to step, which ``load``, by default the time, need not do.
    """
    instants = []
    for k, step in enumerate(steps):
        time = float(first + k + 1) if step.s is None else float(step.s)
        if step.cycle is not None:
            time = float(step.cycle)
        instants.append(
            {"load": time if loads is None else float(loads[k]), "time": time}
        )
    return instants
