"""The surfaces of contacts: names, facets whose nodes are contacts, and the mesh of files."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import AnyArray, Ints
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.files.result_mesh import Cells, ResultMesh


def surface_names(model: Assembly) -> list[str]:
    """Titles of the contacts, ``"body.surface"`` without a name; equal ones get a number."""
    plain = [contact.title for contact in model.contacts]
    return [
        name if plain.count(name) == 1 else f"{name} {k}"
        for k, name in enumerate(plain)
    ]


def surface_labels(model: Assembly) -> dict[str, AnyArray]:
    """``surface``, ``surface_names``, in 3D ``facets``, with bolts ``bolt_names``."""
    found = {
        "surface": model.group,
        "surface_names": np.array(surface_names(model), str),
    }
    if model.bolts:
        found["bolt_names"] = np.array([bolt.name for bolt in model.bolts], str)
    if model.numbered.axisymmetric:
        found["revolved"] = np.array(True)
    return found | ({"facets": contact_facets(model)} if model.dim == 3 else {})


def contact_facets(model: Assembly) -> Ints:
    """Facets of `contact_surface` as one array of contacts, ``(m, k)``.

    Rows of facets with fewer nodes than others end in -1.
    """
    parts = [nodes for kind, nodes in contact_surface(model) if kind != "vertex"]
    found = np.full(
        (sum(map(len, parts)), max((p.shape[1] for p in parts), default=3)), -1
    )
    first = 0
    for nodes in parts:
        found[first : first + len(nodes), : nodes.shape[1]] = nodes
        first += len(nodes)
    return found.astype(np.int64)


def contact_surface(model: Assembly) -> list[tuple[str, Ints]]:
    """Facets whose corners are all contacts, as cells with contacts as nodes.

    A facet of second order with contacts at its corners but not at all midpoints is linear.

    Returns ``list of (kind, corners)``: kind in VTK's names, such as ``"line"``,
    ``"triangle"``, ``"quad8"``, and indices of contacts ``(m, nodes)`` in the order of VTK; in
    3D counter-clockwise seen from outside the body. Contacts on no such facet follow as
    ``("vertex", (m, 1))``.
    """
    found: dict[str, list[Ints]] = {}
    alone = np.ones(len(model.points), dtype=np.bool_)
    for number, contact in enumerate(model.contacts):
        numbered = model.numbered[contact.body]
        body = numbered.body
        mine = np.flatnonzero(model.group == number)
        of_node = np.full(len(body.points), -1, dtype=np.int64)
        of_node[numbered.nodes_at(model.contact_dofs[mine, 0])] = mine
        nodes = of_node[body.surface(contact.surface).corners]
        kind = body.kind.facet.vtk
        linear = kind.rstrip("0123456789")
        ends = {"line": 2, "triangle": 3, "quad": 4}[linear]
        whole = (nodes >= 0).all(axis=1)
        flat = ~whole & (nodes[:, :ends] >= 0).all(axis=1)
        for shape, corners in ((kind, nodes[whole]), (linear, nodes[flat, :ends])):
            if model.dim == 3:
                a, b, c = model.points[corners[:, :3]].swapaxes(0, 1)
                # Normals of contacts point into the body.
                inwards = model.frame[corners[:, 0], 0]
                inside_out = np.sum(np.cross(b - a, c - b) * inwards, axis=1) > 0
                corners[inside_out] = corners[inside_out][
                    :, _mirror_nodes(corners.shape[1])
                ]
            alone[corners.ravel()] = False
            found.setdefault(shape, []).append(corners)
    cells = [(kind, np.concatenate(parts)) for kind, parts in found.items()]
    rest = np.flatnonzero(alone)[:, None]
    if len(rest):
        cells.append(("vertex", rest))
    return [(kind, corners) for kind, corners in cells if len(corners)]


def result_mesh(model: Assembly) -> ResultMesh:
    """Nodes, cells, degrees of freedom and contact surfaces, as a result file holds them."""
    d = model.dim
    cells = [
        Cells(kind, corners, body.name)
        for (kind, corners), body in zip(model.cells, model.bodies, strict=True)
    ]
    return ResultMesh(
        model.nodes,
        # Those of obstacles that move under a force follow, and belong to no node.
        np.arange(model.nodes.size).reshape(-1, d),
        cells,
        model.contact_dofs[:, 0] // d,
        [Cells(kind, corners) for kind, corners in contact_surface(model)],
    )


def _mirror_nodes(nodes: int) -> list[int]:
    """Order of the nodes that reverses the orientation of a facet in space.

    Nodes are the corners, the midpoints of the edges in their order, and the centre.
    """
    corners = 3 if nodes in (3, 6) else 4
    around = [0, *range(corners - 1, 0, -1)]
    # The edges in reverse, starting from the last.
    edges = range(2 * corners - 1, corners - 1, -1) if nodes > corners else ()
    return [*around, *edges, *range(2 * corners, nodes)]
