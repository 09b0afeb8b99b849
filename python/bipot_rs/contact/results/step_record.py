"""A step as a record of arrays and numbers, as it stands in a file of results."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bipot_rs._lib.types import Floats, Record
from bipot_rs._lib.validation import floats, frames
from bipot_rs.contact.law.status import Outcome, Status
from bipot_rs.contact.results.solution import Computed, Step

# Fields of a step that a file keeps as they are.
_WRITTEN = (
    "reaction",
    "relative_displacement",
    "status",
    "outcome",
    "residual",
    "tolerance",
    "iterations",
    "work",
    "rigid_motion",
    "history",
    "bipotential_gap",
    "seconds",
    "slip",
    "s",
    "ahead",
    "gap",
    "frame",
    "drag",
    "working_set",
    "working_motion",
    "wear",
    "cycle",
    "broken",
    "dilation",
    "lift",
    "shortening",
    "bolt_force",
    "tightened",
)


def make_record(step: Step, load: float) -> dict[str, object]:
    """What a file keeps of a step; ``load`` is the number that the file gives it."""
    record = {name: getattr(step, name) for name in _WRITTEN}
    record["outcome"] = str(step.outcome)
    record |= step.stats
    record["load"] = load
    record["displacement"] = step.computed.displacement
    # `unique` and `error_estimate` cost a factorisation: only if known already.
    record["unique"] = step.computed.unique
    if step.computed.error_estimate is not None:
        record["error_estimate"] = np.asarray(step.computed.error_estimate)
    return record


def _check_working_set(record: Mapping[str, object], contacts: int) -> None:
    """Refuse a working set or a motion with wrong entries."""
    members = np.asarray(record.get("working_set", np.empty(0, np.int64)))
    bounded = np.concatenate([[-1], members.ravel(), [contacts]])
    if (
        members.ndim != 1
        or members.dtype != np.int64
        or not (np.diff(bounded) > 0).all()
    ):
        raise ValueError("working_set is wrong, expected ascending numbers of contacts")
    motion = np.asarray(record.get("working_motion", np.empty(0)))
    if motion.ndim != 1 or motion.dtype != np.float64 or not np.isfinite(motion).all():
        raise ValueError("working_motion is wrong, expected finite numbers")


def read_step(record: Record, area: Floats | None, shape: tuple[int, int]) -> Step:
    """The step of a record.

    Raises `ValueError`: an entry is missing, or has the wrong shape or values.
    """
    contacts, d = shape
    # Entries that a step must have. The others have defaults.
    shapes: dict[str, tuple[int, ...]] = {
        "reaction": (contacts, d),
        "relative_displacement": (contacts, d),
        "slip": (contacts, max(d - 1, 0)),
        "status": (contacts,),
    } | dict.fromkeys(("residual", "tolerance", "iterations", "work"), ())
    missing = (shapes.keys() | {"outcome"}) - record.keys()
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} missing")
    for name, expected in shapes.items():
        value = np.asarray(record[name])
        if value.shape != expected:
            raise ValueError(f"{name} has shape {value.shape}, expected {expected}")
        if value.dtype.kind not in "if" or not np.isfinite(value).all():
            raise ValueError(f"{name} is wrong, expected finite numbers")
    if "gap" in record and np.shape(record["gap"]) != (contacts, d):
        shape_of_gap = np.shape(record["gap"])
        raise ValueError(f"gap has shape {shape_of_gap}, expected {(contacts, d)}")
    if ("frame" in record) != ("drag" in record):
        raise ValueError("frame or drag missing, expected both or none of them")
    if "frame" in record:
        floats("drag", record["drag"], shape=(contacts, d))
        frames(record["frame"], contacts, d)
    if "wear" in record:
        worn = np.asarray(record["wear"])
        if worn.shape != (contacts,) or not np.isfinite(worn).all():
            raise ValueError(f"wear is wrong, expected ({contacts},) finite numbers")
    if "broken" in record and np.shape(record["broken"]) != (contacts,):
        raise ValueError(f"broken is wrong, expected ({contacts},) values")
    for name in ("dilation", "lift"):
        if name in record:
            floats(name, record[name], shape=(contacts,))
    bolts = np.shape(record.get("shortening", ()))
    for name in ("shortening", "bolt_force", "tightened"):
        if ("shortening" in record) != (name in record):
            raise ValueError(
                f"{name} missing, expected shortenings and forces of bolts"
            )
        if name in record:
            floats(name, np.asarray(record[name]) * 1, shape=bolts)
    _check_working_set(record, contacts)
    status = record["status"]
    if not np.isin(status, list(Status)).all():
        raise ValueError("status is wrong, expected 0, 1 or 2 for each contact")
    written = {name: record[name] for name in _WRITTEN if name in record}
    written["outcome"] = Outcome(written["outcome"])
    for name in written.keys() & {"broken", "tightened"}:
        written[name] = np.asarray(written[name]).astype(np.bool_)
    counts = ("bytes_beside_W", "newton", "krylov", "replaced")
    written["stats"] = {name: int(record[name]) for name in counts if name in record}
    computed = Computed(displacement=record.get("displacement"))
    if "error_estimate" in record:
        of_reaction, of_displacement = map(float, record["error_estimate"])
        computed.error_estimate = of_reaction, of_displacement
    if "unique" in record:
        computed.unique = str(record["unique"])
    traction = None if area is None else written["reaction"] / area[:, None]
    return Step(**written, traction=traction, computed=computed)
