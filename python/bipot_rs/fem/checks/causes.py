"""What of a model caused an error of its problem: the support, the body, the cells."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs.contact.errors import (
    NotIterativeError,
    describe_oblique,
    with_message,
    with_reason,
)
from bipot_rs.contact.stiffness.digits import describe_undecided
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.mesh.quality import find_most_slender


def name_cause(model: Assembly, error: ValueError) -> ValueError:
    """The error of a problem with the names of the model, where they tell more."""
    if isinstance(error, NotIterativeError):
        contact = error.contact
        support = None if contact is None else _find_support(model, contact)
        if contact is None or support is None:
            return error
        where = f" at {place(model.points[contact])}"
        return with_reason(error, describe_oblique(support, contact, where))
    dof = getattr(error, "dof", None)
    if getattr(error, "kind", "") != "few_digits" or dof is None:
        return error
    for point in model.references:
        if dof in point.dofs or dof in point.turns:
            whose = f"{point.kind} {point.name!r}"
            return with_message(error, describe_undecided(whose, "motion"))
    b = int(np.searchsorted(model.offset, dof, side="right")) - 1
    body, (node, axis) = model.bodies[b], divmod(dof, model.dim)
    cell, ratio = find_most_slender(body.points[body.cells], body.kind)
    at = place(body.points[body.cells[cell]].mean(axis=0))
    motion = f"motion along {'xyz'[axis]} at {place(model.nodes[node])}"
    cells = f" (the most slender is at {at}, {ratio:.2g} times as long as it is thick)"
    return with_message(error, describe_undecided(f"body {body.name!r}", motion, cells))


def _find_support(model: Assembly, contact: int) -> str | None:
    """``support 'body.surface'`` for a support of the nodes of a contact."""
    rows = model.dim * contact + np.arange(model.dim)
    dofs = model.B[rows].indices
    for support, of_components in zip(model.supports, model.support_dofs, strict=True):
        if any(np.isin(dofs, held).any() for held in of_components):
            surface = "" if support.surface is None else f".{support.surface}"
            return f"support '{support.body}{surface}'"
    return None
