"""Names in result files: what each holds, its dimension, and the axes of its components.

One name has one meaning in all files for ParaView and in ``/fields`` of a result file:
components are along the axes x, y[, z], except for names that end in ``_local``. The
datasets of ``/steps`` are those of `Result`, with components along the axes n, t1[, t2] of
each contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

GLOBAL, LOCAL = "global", "local"


@dataclass(frozen=True)
class Quantity:
    """What a name in a file means."""

    meaning: str  # one phrase
    # `"length"`, `"area"`, `"force"`, `"stress"`, `"energy"`, `"energy density"`, or `""` for a
    # pure number.
    dimension: str = ""
    # Axes of the components: `"global"` for x, y[, z], `"local"` for n, t1[, t2] of each
    # contact, or `""` for a scalar.
    axes: str = ""


# Fields of the contacts: contact.pvd, `Result.write`, and /fields of a result file.
OF_CONTACTS = {
    "displacement": Quantity("displacement", "length", GLOBAL),
    "force": Quantity("contact force on the body", "force", GLOBAL),
    "reaction_local": Quantity("contact force on the body", "force", LOCAL),
    "traction": Quantity("contact force on the body per area", "stress", GLOBAL),
    "pressure": Quantity("normal part of the traction, positive if pressed", "stress"),
    "slip": Quantity("tangential displacement in the load step", "length", GLOBAL),
    "slip_local": Quantity(
        "tangential displacement in the load step: t1[, t2]", "length", LOCAL
    ),
    "relative_displacement_local": Quantity(
        "total displacement relative to the obstacle, with the initial gap",
        "length",
        LOCAL,
    ),
    "gap": Quantity("remaining gap, positive if open", "length"),
    "status": Quantity("0 open, 1 slip, 2 stick"),
    "normal": Quantity("normal, from the obstacle to the body", "", GLOBAL),
    "wear_depth": Quantity("depth worn off", "length"),
    "broken": Quantity("1 where the contact has lost its cohesion"),
}
# Fields of the nodes of bodies: result.pvd.
OF_NODES = {
    "displacement": OF_CONTACTS["displacement"],
    "contact_pressure": Quantity(
        "pressure of all contacts of the node, on both bodies", "stress"
    ),
    "contact_shear": Quantity(
        "tangential traction of all contacts of the node, on its body", "stress", GLOBAL
    ),
    "contact_status": Quantity("largest status of its contacts, -1 without contact"),
}
# Fields of the cells of bodies: result.pvd.
OF_CELLS = {
    "stress": Quantity("mean stress: xx, yy, zz, xy, yz, xz", "stress", GLOBAL),
    "von_mises": Quantity("von Mises stress of the mean stress", "stress"),
    "error": Quantity("energy of the discretisation error", "energy"),
    "error_density": Quantity(
        "energy of the discretisation error per volume", "energy density"
    ),
}
# Numbers of a step: /fields, and field data of the files for ParaView.
OF_STEPS = {
    "load": Quantity("path parameter of the load step"),
    "time": Quantity(
        "number of the load step, or of the cycle; or its place on the path"
    ),
}
FIELDS = OF_CONTACTS | OF_NODES | OF_CELLS | OF_STEPS
# Datasets of /contacts.
CONTACTS = {
    "x": Quantity("positions of the contacts", "length", GLOBAL),
    "normal": OF_CONTACTS["normal"],
    "frame": Quantity("the axes n, t1[, t2], one a row", "", GLOBAL),
    "area": Quantity("area that belongs to the contact", "area"),
    "gap": Quantity("gap at the start, positive if open", "length"),
    "mu": Quantity("friction coefficient"),
    "cohesion": Quantity("friction force without pressure, until it breaks", "force"),
    "dilatancy": Quantity("opening per slip"),
}
# Datasets of a step in /steps.
STEPS = {
    "reaction": Quantity("contact force on the body", "force", LOCAL),
    "relative_displacement": OF_CONTACTS["relative_displacement_local"],
    "slip": OF_CONTACTS["slip_local"],
    "status": OF_CONTACTS["status"],
    "residual": Quantity("residual of the contact law"),
    "load": OF_STEPS["load"],
    "displacement": Quantity("displacement by degrees of freedom", "length"),
    "gap": Quantity("gaps of this step, if obstacles move", "length", LOCAL),
    "wear": OF_CONTACTS["wear_depth"],
    "broken": OF_CONTACTS["broken"],
    "dilation": Quantity("opening at which the surfaces meet after slip", "length"),
    "lift": Quantity("dilation of this step", "length"),
    "shortening": Quantity("shortening of each bolt since the start", "length"),
    "bolt_force": Quantity("force of each bolt, tension positive", "force"),
    "frame": CONTACTS["frame"],
    "drag": Quantity(
        "displacement of the obstacle under the contact since the start",
        "length",
        GLOBAL,
    ),
    "bipotential_gap": Quantity("error of the contact law as energy", "energy"),
    "error_cells": OF_CELLS["error"],
    "error_contacts": Quantity("energy of the error of the contact law", "energy"),
}
# Datasets of /mesh.
MESH = {
    "nodes": Quantity("positions of the nodes", "length", GLOBAL),
    "dofs": Quantity("degree of freedom of each component of each node, -1 for none"),
    "contact_nodes": Quantity("node of each contact, on its body"),
}
# Units of energy by those of force and length; otherwise their product is written.
_ENERGY = {("N", "m"): "J", ("kN", "m"): "kJ", ("MN", "m"): "MJ"}


def unit(dimension: str, units: Mapping[str, str]) -> str | None:
    """Name of a unit, made from the names of ``"length"``, ``"force"`` and ``"stress"``.

    None if it is not known.

    >>> unit("stress", {"force": "N", "length": "mm"}), unit("energy", {"force": "N"})
    ('N/mm²', None)
    """
    length, force = units.get("length"), units.get("force")
    both = bool(length and force)
    if dimension in ("stress", "energy density"):
        # Energy per volume is force per area.
        return units.get("stress") or (f"{force}/{length}²" if both else None)
    if dimension == "area":
        return f"{length}²" if length else None
    if dimension == "energy":
        named = _ENERGY.get((str(force), str(length)))
        return (named or f"{force}·{length}") if both else None
    return units.get(dimension) or None


def labels(quantity: Quantity, units: Mapping[str, str]) -> dict[str, str]:
    """Attributes of a dataset: ``meaning``, ``dimension``, ``frame``, ``units`` if known."""
    attributes = {"meaning": quantity.meaning, "dimension": quantity.dimension}
    attributes["frame"] = quantity.axes
    attributes["units"] = unit(quantity.dimension, units) or ""
    return {name: text for name, text in attributes.items() if text}


def name_units(names: Iterable[str], units: Mapping[str, str]) -> dict[str, str]:
    """Unit of each field that has a dimension; the dimension if the unit is not known."""
    unit_of_dimension = {}
    for name in names:
        dimension = FIELDS[name].dimension if name in FIELDS else ""
        if dimension:
            unit_of_dimension[name] = unit(dimension, units) or dimension
    return unit_of_dimension


def choose_times(*choices: Sequence[float | None]) -> list[float]:
    """The first choice of times that grow from step to step; else the number of each step.

    ParaView shows files of equal times together, as parts of one step, and sorts the others
    by time: the load of a path that returns cannot be its time.
    """
    for times in choices:
        finite = [t for t in times if t is not None and math.isfinite(t)]
        grows = all(a < b for a, b in pairwise(finite))
        if len(finite) == len(times) and grows:
            return finite
    return [float(k) for k in range(len(choices[0]))]
