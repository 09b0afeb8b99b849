"""Read a result that was saved."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence

import numpy as np

from bipot_rs._lib.types import AnyArray, OpenRecord, Record
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.step_record import read_step
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
    shape = _find_shape(contacts, records)
    steps = []
    for k, record in enumerate(records):
        try:
            steps.append(read_step(record, area, shape))
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

    def with_prefix(prefix: str) -> OpenRecord:
        return {
            k[len(prefix) :]: v for k, v in attributes.items() if k.startswith(prefix)
        }

    def optional_number(name: str) -> float | None:
        return float(attributes[name]) if name in attributes else None

    loads = [record.get("load") for record in records]
    parameters = [float(load) for load in loads if isinstance(load, int | float)]
    return Result(
        steps,
        contacts=contacts,
        shape=shape,
        seconds={"condense": 0.0, "solve": 0.0, "recover": 0.0}
        | with_prefix("seconds_"),
        units=_read_units(attributes) | with_prefix("unit_"),
        remarks=_read_remarks(attributes),
        success=bool(attributes["complete"]),
        message=str(attributes.get("message", "")),
        first_step=int(attributes.get("first_step", 0)),
        mesh=mesh,
        path_parameters=parameters if len(parameters) == len(records) else None,
        stiffness_rtol=optional_number("stiffness_rtol"),
        rigid_motions_off=optional_number("rigid_motions_off"),
    )


def _read_remarks(attributes: Mapping[str, object]) -> tuple[str, ...]:
    """Remarks in the attributes of a file."""
    try:
        return tuple(map(str, json.loads(str(attributes.get("remarks", "[]")))))
    except (ValueError, TypeError):
        return ()


def _read_units(attributes: Mapping[str, object]) -> dict[str, str]:
    """Names of units in the attributes of a file of the command line."""
    try:
        units = json.loads(str(attributes.get("units", "{}")))
        return {str(name): str(unit) for name, unit in units.items() if unit}
    except (ValueError, AttributeError):
        return {}


def _find_shape(
    contacts: Mapping[str, AnyArray], records: Sequence[Record]
) -> tuple[int, int]:
    """``(n_c, d)``; zero for sizes that the file does not hold."""
    rows = records[0].get("reaction") if records else contacts.get("x")
    if rows is not None and np.ndim(rows) == 2:
        return rows.shape[0], rows.shape[1]
    return len(contacts.get("gap", ())), 0


# The earlier, promised name.
load = load_result
