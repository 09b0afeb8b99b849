"""Read a result that was saved."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs.contact.results.result import OF_STIFFNESS, Result
from bipot_rs.contact.results.step_record import step_of
from bipot_rs.files import export


def load_result(path: str | os.PathLike[str]) -> Result:
    """Read a result that `Result.save` or the command line wrote.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is not a result, or is damaged.
    """
    contacts, records, attributes, mesh = export.read_saved(path)
    area = contacts.get("area")
    shape = _shape(contacts, records)
    steps = []
    for k, record in enumerate(records):
        try:
            steps.append(step_of(record, area, shape))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ValueError(
                f"{path} is not a result that can be read: step {k}: {error}"
            ) from None
    if mesh is not None:
        sizes = [
            np.size(record["displacement"])
            for record in records
            if "displacement" in record
        ]
        if not mesh.fits(shape[0], min(sizes, default=None)):
            raise ValueError(
                f"{path} is not a result that can be read: the mesh does not fit its "
                "contacts or displacements"
            )

    def named(prefix: str) -> dict[str, Any]:
        return {
            k[len(prefix) :]: v for k, v in attributes.items() if k.startswith(prefix)
        }

    found = Result(
        steps,
        contacts=contacts,
        shape=shape,
        seconds=named("seconds_"),
        units=_units(attributes) | named("unit_"),
        remarks=_remarks(attributes),
        success=bool(attributes["complete"]),
        message=str(attributes.get("message", "")),
    )
    found._first = int(attributes.get("first_step", 0))
    found._mesh = mesh
    loads = [record.get("load") for record in records]
    known = tuple(float(load) for load in loads if isinstance(load, int | float))
    found._loads = known if len(known) == len(records) else None
    for name in OF_STIFFNESS:
        if name in attributes:
            setattr(found, name, float(attributes[name]))
    return found


def _remarks(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    """Remarks in the attributes of a file."""
    try:
        return tuple(map(str, json.loads(str(attributes.get("remarks", "[]")))))
    except (ValueError, TypeError):
        return ()


def _units(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Names of units in the attributes of a file of the command line."""
    try:
        units = json.loads(str(attributes.get("units", "{}")))
        return {str(name): str(unit) for name, unit in units.items() if unit}
    except (ValueError, AttributeError):
        return {}


def _shape(
    contacts: Mapping[str, NDArray[Any]], records: Sequence[Mapping[str, Any]]
) -> tuple[int, int]:
    """``(n_c, d)``; zero for sizes that the file does not hold."""
    rows = records[0].get("reaction") if records else contacts.get("x")
    if rows is not None and np.ndim(rows) == 2:
        return rows.shape[0], rows.shape[1]
    return len(contacts.get("gap", ())), 0


# The earlier, promised name.
load = load_result
