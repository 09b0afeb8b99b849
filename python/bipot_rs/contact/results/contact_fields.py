"""Data and fields of the contacts of a load path, and how far they have slid.

Fields have the names of `files.fields`, for files of all kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import AnyArray, Floats, Integers
from bipot_rs.contact import tuning
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.results.solution import Step
from bipot_rs.files.fields import OF_CONTACTS
from bipot_rs.files.result_mesh import ResultMesh

# Names of arguments, and those of the data that they become.
_ARGUMENTS = {"points": "x"}


# The name decides on the type of the entries.
ContactArray: TypeAlias = NDArray[Any]
ContactArrays: TypeAlias = Mapping[str, ContactArray | None]


class ContactData(dict[str, ContactArray | None]):
    """Arrays by name, with the names of the arguments that they came from.

    ``data["points"]`` is ``data["x"]``. The mapping itself has each array once.

    >>> data = ContactData(x=None, mu=None)
    >>> list(data), data["points"] is data["x"]
    (['x', 'mu'], True)
    """

    def __missing__(self, name: str) -> ContactArray | None:
        if name in _ARGUMENTS and _ARGUMENTS[name] in self:
            return self[_ARGUMENTS[name]]
        names = ", ".join(self)
        raise KeyError(f"{name!r}: the contacts have {names}")

    def __repr__(self) -> str:
        shapes = (f"{k}: {None if a is None else a.shape}" for k, a in self.items())
        return f"ContactData({', '.join(shapes)})"

    def get(self, name: str, default: Any = None) -> Any:
        """As of any dictionary."""
        return super().get(name, super().get(_ARGUMENTS.get(name, name), default))


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


def measure_distances(points: Floats) -> Floats:
    """Distance of each point to its nearest neighbour, ``(m,)``.

    >>> measure_distances(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]]))
    array([1., 1., 2.])
    """
    if len(points) < 2:
        return np.full(len(points), np.inf)
    if len(points) <= tuning.ALL_PAIRS:
        square = np.zeros((len(points), len(points)))
        for x in points.T:
            square += (x[:, None] - x) ** 2
        np.fill_diagonal(square, np.inf)
        nearest = np.sqrt(square.min(axis=1))
    else:
        from scipy.spatial import cKDTree

        pairs, _ = cKDTree(points).query(points, k=2)
        nearest = np.asarray(pairs[:, 1], np.float64)
    # Two contacts of one node are not a distance in the mesh.
    return np.where(nearest > 0, nearest, np.inf)


def measure_displacement(step: Step, at: Integers | np.integer) -> Floats:
    """How far contacts are from where their geometry was taken, ``(m, d - 1)``.

    The geometry of a step with frames of its own is that of the moved obstacle: its motion
    does not count.
    """
    moved: Floats = step.relative_displacement[at, 1:]
    if step.frame is None or step.drag is None:
        return moved
    carried = np.einsum("...kd,...d->...k", step.frame[at, 1:], step.drag[at])
    return np.asarray(moved + carried, np.float64)


def find_farthest(
    steps: Iterable[Step], apart: Floats, at: Integers
) -> tuple[int, int, float]:
    """Largest `measure_displacement` distance of a closed contact, relative to ``apart (m,)``.

    ``steps`` are the steps of a `Result`, and ``at (m,)`` are the contacts to check.
    Returns the number of the step, the index into ``at``, and the ratio.
    """
    farthest = 0, 0, 0.0
    for k, step in enumerate(steps):
        along = np.linalg.norm(measure_displacement(step, at), axis=1)
        ratio = np.where(step.reaction[at, 0] > 0, along / apart, 0.0)
        node = int(np.argmax(ratio))
        if ratio[node] > farthest[2]:
            farthest = k, node, float(ratio[node])
    return farthest
