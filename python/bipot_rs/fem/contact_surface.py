"""The surfaces of contacts: names, facets whose nodes are contacts, and the mesh of files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bipot_rs._lib.types import AnyArray, Bools, Floats, Ints
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.contact.contact import ContactSurface
from bipot_rs.files.result_mesh import Cells, ResultMesh
from bipot_rs.mortar.shape_functions import CORNER_SHAPES, kind_of, reference

# Share of the area of a node that no picture shows.
_SEEN = 0.02


def surface_names(model: Assembly) -> list[str]:
    """Titles of the contacts, ``"body.surface"`` without a name; equal ones get a number."""
    plain = [contact.title for contact in model.contacts]
    return [
        name if plain.count(name) == 1 else f"{name} {k}"
        for k, name in enumerate(plain)
    ]


def surface_labels(model: Assembly) -> dict[str, AnyArray]:
    """``surface``, ``surface_names``, with bolts ``bolt_names``, in 3D facets and patches."""
    arrays = {
        "surface": model.group,
        "surface_names": np.array(surface_names(model), str),
    }
    if model.bolts:
        arrays["bolt_names"] = np.array([bolt.name for bolt in model.bolts], str)
    if model.numbered.axisymmetric:
        arrays["revolved"] = np.array(True)
    if model.dim == 3:
        patches, cut = find_patches(model)
        arrays |= {"facets": contact_facets(model, cut), **patches}
    return arrays


def find_patches(model: Assembly) -> tuple[dict[str, AnyArray], list[Bools]]:
    """Triangles of surfaces in 3D that do not end at their own contacts.

    Where a structure repeats itself, facets have the contacts of the images of their nodes.
    Mortar surfaces end where the other surface does; as in `bipot_rs.mortar.integrals`, corners
    without a contact have the mean of the others.

    Returns corners ``patch_x (t, 3, 3)``, their contacts ``patch_of (t, 3, 4)`` and the weights
    of these, ``patch_weight``; and for each contact which facets of its surface they replace.
    """
    patches: list[tuple[Floats, Ints, Floats]] = []
    cut: list[Bools] = []
    for number, contact in enumerate(model.contacts):
        numbered = model.numbered[contact.body]
        body, mine = numbered.body, np.flatnonzero(model.group == number)
        side = ContactSurface(body, contact.surface, contact.within)
        nodes = side.facets.corners[:, : 3 if "tri" in body.kind.facet.vtk else 4]
        of_dof = np.full(model.n, -1)
        of_dof[model.contact_dofs[mine, 0]] = mine
        at_nodes = of_dof[numbered.dofs[:, 0]]
        if contact.pairing == "mortar" and contact.against is not None:
            from bipot_rs.mortar.integrals import overlaps

            mesh, against = side.mesh(), model.numbered[contact.against[0]].body
            area = np.where(at_nodes >= 0, model.area[at_nodes], 0.0)
            partly = np.abs(area - mesh.node_areas) > _SEEN * mesh.node_areas
            inside = np.isin(side.facets.corners, side.nodes).all(axis=1)
            cut.append(np.logical_and(inside, partly[nodes].any(axis=1)))
            mesh = mesh.some(cut[-1][inside])
            other = ContactSurface(against, contact.against[1]).mesh()
            over = overlaps(mesh, other, np.inf)
            x = mesh.centre[over.slave, None] + over.polygons @ mesh.bases[over.slave]
            shapes = CORNER_SHAPES[mesh.kind.corners]
            weight = shapes(reference(mesh.flat[over.slave], over.polygons))
            of = at_nodes[mesh.corners[over.slave]]
        else:
            for pairs in model.images:
                onto = of_dof[pairs.onto]
                of_dof[pairs.onto] = np.where(onto < 0, of_dof[pairs.on], onto)
            of = of_dof[numbered.dofs[:, 0]][nodes]
            cut.append(
                np.logical_and((of >= 0).all(axis=1), (at_nodes[nodes] < 0).any(axis=1))
            )
            x, of = body.points[nodes[cut[-1]]], of[cut[-1]]
            weight = np.broadcast_to(np.eye(of.shape[1]), (len(of), *2 * of.shape[1:]))
        if len(of):
            patches.append(_split_polygons(x, of, weight))
    names = ("patch_x", "patch_of", "patch_weight")
    arrays = map(np.concatenate, zip(*patches, strict=True))
    return dict(zip(names, arrays, strict=bool(patches))), cut


def _split_polygons(x: Floats, of: Ints, weight: Floats) -> tuple[Floats, Ints, Floats]:
    """Triangles of polygons ``(k, v, 3)`` whose contacts ``of (k, c)`` have weights."""
    has = (of >= 0)[:, None]
    count = np.maximum(has.sum(axis=2, keepdims=True), 1)
    rest = np.sum(weight * ~has, axis=2, keepdims=True)
    weight = np.where(has, weight + rest / count, 0.0)
    weight = np.pad(weight, ((0, 0), (0, 0), (0, 4 - of.shape[1])))
    most = of.max(axis=1, keepdims=True)
    of = np.column_stack([np.where(of < 0, most, of), most])[:, None, None, :4]
    fans = np.array([[0, k, k + 1] for k in range(1, x.shape[1] - 1)])
    x, weight = x[:, fans].reshape(-1, 3, 3), weight[:, fans].reshape(-1, 3, 4)
    # Polygons with fewer corners repeat the last one.
    real = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]).any(axis=1)
    of = np.broadcast_to(of, (len(of), len(fans), 3, 4)).reshape(-1, 3, 4)
    return x[real], of[real], weight[real]


def contact_facets(model: Assembly, cut: Sequence[Bools] | None = None) -> Ints:
    """Facets of `contact_surface` as one array of contacts, ``(m, k)``.

    Rows of facets with fewer nodes than others end in -1.
    """
    surfaces = contact_surface(model, cut)
    parts = [nodes for kind, nodes in surfaces if kind != "vertex"]
    facets = np.full(
        (sum(map(len, parts)), max((p.shape[1] for p in parts), default=3)), -1
    )
    first = 0
    for nodes in parts:
        facets[first : first + len(nodes), : nodes.shape[1]] = nodes
        first += len(nodes)
    return facets.astype(np.int64)


def contact_surface(
    model: Assembly, cut: Sequence[Bools] | None = None
) -> list[tuple[str, Ints]]:
    """Facets whose corners are all contacts, as cells with contacts as nodes.

    ``cut``: facets of the surface of each contact to leave out.

    A facet of second order with contacts at its corners but not at all midpoints is linear.

    Returns ``list of (kind, corners)``: kind in VTK's names, such as ``"line"``,
    ``"triangle"``, ``"quad8"``, and indices of contacts ``(m, nodes)`` in the order of VTK; in
    3D counter-clockwise seen from outside the body. Contacts on no such facet follow as
    ``("vertex", (m, 1))``.
    """
    blocks: dict[str, list[Ints]] = {}
    alone = np.ones(len(model.points), dtype=np.bool_)
    for number, contact in enumerate(model.contacts):
        numbered = model.numbered[contact.body]
        body = numbered.body
        mine = np.flatnonzero(model.group == number)
        of_node = np.full(len(body.points), -1, dtype=np.int64)
        of_node[numbered.nodes_at(model.contact_dofs[mine, 0])] = mine
        nodes = of_node[body.surface(contact.surface).corners]
        if cut is not None:
            nodes = nodes[~cut[number]]
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
                mirror = list(kind_of("facets", 3, corners.shape[1]).mirror)
                corners[inside_out] = corners[inside_out][:, mirror]
            alone[corners.ravel()] = False
            blocks.setdefault(shape, []).append(corners)
    cells = [(kind, np.concatenate(parts)) for kind, parts in blocks.items()]
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
