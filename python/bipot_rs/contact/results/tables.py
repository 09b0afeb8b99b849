"""Tables of a load path: a row for each load step, or for each contact in each step.

They are the rows of steps.csv and of `Result.table`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.types import AnyArray, Floats, Ints, Record
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.law.resultants import list_resultants
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.results.summary import describe_statuses

if TYPE_CHECKING:
    from bipot_rs.contact.results.contact_fields import ContactArrays

COLUMNS = ("step", "load", *STATUS_NAMES, "residual", "iterations", "seconds")
# Number of contacts that have lost their cohesion.
BROKEN = "broken"
# Columns of a cycle of wear.
WEAR = ("cycle", "worn_volume", "largest_depth")
# Columns of each contact surface. A curved surface also has COMPONENTS.
FORCES = ("normal_force", "tangential_force", "friction_used")
COMPONENTS = ("force_x", "force_y", "force_z")
# Its moment on its body about the origin, in 2D the last; of a flat surface in 3D also TORQUE,
# about its normal through its centre.
MOMENTS = ("moment_x", "moment_y", "moment_z")
TORQUE = "torque"
# Columns of each bolt.
BOLTS = ("bolt_force", "shortening")
# Most rows of surfaces and bolts in a summary, which has at most 20 lines.
_MOST_SURFACES = 11


def make_row(k: int, parameter: float | None, step: Step) -> dict[str, float | None]:
    """The row of a load step in --json, in the table and in steps.csv."""
    load = {} if parameter is None else {"load": parameter}
    status = {
        name: int((step.status == k).sum()) for k, name in enumerate(STATUS_NAMES)
    }
    broken = {} if step.broken is None else {BROKEN: int(step.broken.sum())}
    return {
        "step": k,
        **load,
        **status,
        **broken,
        "residual": step.residual,
        "iterations": step.iterations,
        "seconds": step.seconds,
    }


def measure_wear(step: Step, area: Floats) -> dict[str, float | None]:
    """`WEAR` of the end of a cycle; empty without wear."""
    if step.wear is None:
        return {}
    figures = step.cycle, float(step.wear @ area), float(step.wear.max(initial=0.0))
    return dict(zip(WEAR, figures, strict=True))


def list_surface_forces(
    step: Step,
    frame: Floats,
    mu: Floats,
    group: Ints,
    names: Sequence[str],
    cohesion: Floats | None = None,
    x: Floats | None = None,
    area: Floats | None = None,
) -> dict[str, float | None]:
    """`FORCES` of named surfaces; ``group (n_c,)`` is the surface number of each contact.

    ``frame`` are those of B. ``cohesion`` is that of unbroken contacts, which adds to the limit
    ``Σ μ r_n``.

    They are those of `Resultant`. Flat surface: ``Σ r_n``, ``‖Σ r_t‖`` and
    ``‖Σ r_t‖ / Σ μ r_n``. Curved surface: ``Σ r_n``, ``Σ ‖r_t‖``, ``Σ ‖r_t‖ / Σ μ r_n``,
    and `COMPONENTS` of the force on the body of the contacts, in global axes. With places ``x``
    also `MOMENTS` and `TORQUE`.
    """
    forces: dict[str, float | None] = {}
    if cohesion is not None and step.broken is not None:
        cohesion = np.where(step.broken, 0.0, cohesion)
    frame = find_step_frames(step, frame)
    each = list_resultants(
        step.reaction, frame, mu, group, len(names), cohesion, x, area
    )
    for name, force in zip(names, each, strict=True):
        columns: list[tuple[str, float | None]] = list(
            zip(FORCES, (force.normal, force.tangential, force.used), strict=True)
        )
        if force.curved:
            columns += zip(COMPONENTS, force.force.tolist(), strict=False)
        if force.moment is not None:
            about = MOMENTS[-len(force.moment) :]
            columns += zip(about, force.moment.tolist(), strict=True)
        if force.torque is not None:
            columns.append((TORQUE, force.torque))
        for key, value in columns:
            forces[f"{key} of {name}"] = value
    return forces


def list_bolts(step: Step, names: Sequence[str]) -> dict[str, float | None]:
    """`BOLTS` of the bolts with these names; empty without bolts."""
    if step.bolt_force is None or step.shortening is None:
        return {}
    return {
        f"{kind} of {name}": float(value)
        for name, *figures in zip(names, step.bolt_force, step.shortening, strict=True)
        for kind, value in zip(BOLTS, figures, strict=True)
    }


def list_columns(
    rows: Sequence[Mapping[str, object]], more: Sequence[str] = ()
) -> list[str]:
    """The columns of a table of load steps: forces after the statuses, ``more`` at the end."""
    names = rows[0] if rows else ("load",)
    of_surfaces = (*FORCES, *COMPONENTS, *MOMENTS, TORQUE, *BOLTS)
    forces = [key for key in names if key.startswith(of_surfaces)]
    first = [name for name in COLUMNS[:5] if name != "load" or name in names]
    first += [BROKEN] if BROKEN in names else []
    return [*first, *forces, *COLUMNS[5:], *more]


def list_steps(
    steps: Sequence[Step], loads: Sequence[float], contacts: ContactArrays
) -> dict[str, list[float | None]]:
    """Columns of a table with a row for each load step.

    ``steps, loads``: the load steps, and the load parameter at their ends.
    ``contacts``: as `Result.contacts`. Without frames there are no forces, because their sums
    would depend on the frames.
    """
    rows = []
    for k, (step, load) in enumerate(zip(steps, loads, strict=True)):
        area = contacts.get("area")
        columns = make_row(k, load, step) | (
            measure_wear(step, area) if area is not None else {}
        )
        rows.append(columns | list_forces(step, contacts))
    names = list_columns(rows, [name for name in WEAR if rows and name in rows[0]])
    return {name: [row.get(name) for row in rows] for name in names}


def list_forces(step: Step, contacts: Record) -> dict[str, float | None]:
    """`list_surface_forces` of all surfaces, and `list_bolts`; no forces without frames."""
    frame, mu = contacts.get("frame"), contacts.get("mu")
    named = contacts.get("bolt_names")
    bolts = {} if named is None else list_bolts(step, list(named))
    if frame is None or mu is None:
        return bolts
    group, cohesion = contacts.get("surface"), contacts.get("cohesion")
    # Around an axis of revolution moments cancel.
    revolved = contacts.get("revolved") is not None
    places = (None, None) if revolved else (contacts.get("x"), contacts.get("area"))
    if group is not None:
        names = list(contacts["surface_names"])
        forces = list_surface_forces(step, frame, mu, group, names, cohesion, *places)
        return forces | bolts
    group = np.zeros(len(mu), np.int64)
    name = ["contacts"]
    whole = list_surface_forces(step, frame, mu, group, name, cohesion, *places)
    return {key.removesuffix(" of contacts"): value for key, value in whole.items()}


def describe_surfaces(step: Step, contacts: Record) -> list[tuple[str, str]]:
    """A row for each of several contact surfaces, and for each bolt, for a summary."""
    names = contacts.get("surface_names")
    if names is None or len(names) < 2 or contacts.get("frame") is None:
        return []
    values, rows = list_forces(step, contacts), [("by surface", "forces at the end")]
    for k, name in enumerate(names):
        normal, friction, used = (values[f"{kind} of {name}"] or 0 for kind in FORCES)
        forces = f"normal {normal:<10.5g} friction {friction:<10.5g}"
        status = describe_statuses(step.status[contacts["surface"] == k])
        rows.append((str(name), f"{forces} ({used:4.0%} of its limit)  {status}"))
    rows += [
        (key.removeprefix(f"{BOLTS[0]} of "), f"tension {force:.5g}")
        for key, force in values.items()
        if key.startswith(BOLTS[0])
    ]
    if len(rows) > _MOST_SURFACES:
        rows[_MOST_SURFACES:] = [
            ("...", f"{len(rows) - _MOST_SURFACES} more: .table()")
        ]
    return rows


def list_contacts(steps: Sequence[Step], contacts: Record) -> dict[str, AnyArray]:
    """Columns of a table with a row for each contact in each load step, step by step."""
    if not steps:
        return {}
    n, d = steps[0].reaction.shape
    count = len(steps)
    parts = ("n", "t1", "t2")[:d]
    every: dict[str, AnyArray] = {
        "step": np.repeat(np.arange(count), n),
        "contact": np.tile(np.arange(n), count),
    }
    if contacts.get("surface") is not None:
        names = np.asarray(contacts["surface_names"], str)
        every["surface"] = np.tile(names[contacts["surface"]], count)
    if contacts.get("x") is not None:
        every |= {a: np.tile(contacts["x"][:, k], count) for k, a in _list_axes(d)}
    for name in ("area", "mu"):
        values = contacts.get(name)
        if values is not None and np.ndim(values) == 1:
            every[name] = np.tile(values, count)
        elif values is not None:
            every |= {f"mu_t{k + 1}": np.tile(values[:, k], count) for k in range(2)}
    status = np.concatenate([step.status for step in steps])
    every["status"] = np.array(STATUS_NAMES)[status]
    for name in ("reaction", "traction", "relative_displacement", "slip"):
        values = [getattr(step, name) for step in steps]
        if values[0] is None:
            continue
        columns = parts[1:] if name == "slip" else parts
        stacked = np.concatenate(values)
        every |= {f"{name}_{part}": stacked[:, k] for k, part in enumerate(columns)}
    for name in (BROKEN, "wear"):
        values = [getattr(step, name) for step in steps]
        if all(value is not None for value in values):
            every[name] = np.concatenate(values)
    return every


def _list_axes(d: int) -> list[tuple[int, str]]:
    return list(enumerate("xyz"[:d]))


def make_frame(columns: Record) -> Any:
    """A DataFrame of columns if pandas is installed, else a structured array."""
    try:
        import pandas
    except ModuleNotFoundError:
        # None, which has no number, is NaN as in pandas.
        arrays = {
            name: np.array([np.nan if v is None else v for v in values])
            for name, values in columns.items()
        }
        kinds = [(name, array.dtype) for name, array in arrays.items()]
        rows = np.empty(len(next(iter(arrays.values()), ())), kinds)
        for name, array in arrays.items():
            rows[name] = array
        return rows
    return pandas.DataFrame(dict(columns))
