"""The surface that contacts lie on: facets of the mesh between them."""

from __future__ import annotations

import numpy as np

from bipot_rs.elasticity import Ints
from bipot_rs.fem import Model

# By the number of corners.
_KINDS = {2: "line", 3: "triangle", 4: "quad"}


def contact_surface(model: Model) -> list[tuple[str, Ints]]:
    """Facets all of whose nodes are contacts, as cells over the contacts.

    Returns
    -------
    list of (kind, corners)
        ``"line"``, ``"triangle"`` or ``"quad"``, and numbers of contacts ``(m, corners)``
        in the order of VTK; in space seen from outside of the body against the clock.
        Contacts on no such facet follow as ``("vertex", (m, 1))``.
    """
    names = [body.name for body in model.bodies]
    found: dict[str, list[Ints]] = {}
    alone = np.ones(len(model.points), dtype=np.bool_)
    for number, contact in enumerate(model.contacts):
        index = names.index(contact.body)
        body, first = model.bodies[index], model.offset[index]
        mine = np.flatnonzero(model.group == number)
        of_node = np.full(len(body.points), -1, dtype=np.int64)
        of_node[(model.contact_dofs[mine, 0] - first) // model.dim] = mine
        corners = of_node[body.mesh.facets[:, body.facets(contact.surface)].T]
        corners = corners[(corners >= 0).all(axis=1)]
        if model.dim == 3:
            a, b, c = model.points[corners[:, :3]].swapaxes(0, 1)
            # Normals of contacts point into the body.
            inwards = model.frame[corners[:, 0], 0]
            inside_out = np.sum(np.cross(b - a, c - b) * inwards, axis=1) > 0
            corners[inside_out] = corners[inside_out, ::-1]
        alone[corners.ravel()] = False
        found.setdefault(_KINDS[corners.shape[1]], []).append(corners)
    cells = [(kind, np.concatenate(parts)) for kind, parts in found.items()]
    rest = np.flatnonzero(alone)[:, None]
    if len(rest):
        cells.append(("vertex", rest))
    return [(kind, corners) for kind, corners in cells if len(corners)]
