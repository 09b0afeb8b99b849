"""The nodes and facets of a contact: outward normals, clearance, and which are taken."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.fem.bodies.body import Body, Quadrature
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.mortar.facet_mesh import turned_outward


def outward(body: Body, surface: str) -> Floats:
    """Outward normals at all nodes ``(nodes, d)``, times area; zero off the surface."""
    return nodal_normals(body.surface(surface))


def nodal_normals(facets: Quadrature) -> Floats:
    """Outward normals at the nodes of a surface ``(nodes, d)``, times area."""
    normal = np.asarray(facets.normals)
    nodal = np.stack([facets.moment(component) for component in normal], axis=1)
    # A component of rounding size on a coordinate plane would couple B to
    # displacements that the contact does not feel.
    small = 1e-14 * np.abs(nodal).max(axis=1, keepdims=True)
    return np.where(np.abs(nodal) <= small, 0.0, nodal)


def facets_outward(body: Body, surface: str) -> Ints:
    """Facets of a surface, numbered so that their normals point outwards."""
    facets = body.surface(surface)
    normals = np.asarray(facets.normals).mean(axis=2).T
    return turned_outward(body.points, facets.corners, normals)


def facets_of(contact: Contact, body: Body) -> Ints:
    """Facets of a surface, outward, whose nodes are all within ``contact.within``."""
    facets = facets_outward(body, contact.surface)
    if contact.within is None:
        return facets
    nodes = body.nodes(contact.surface, contact.within)
    facets = facets[np.isin(facets, nodes).all(axis=1)]
    if not len(facets):
        raise ValueError(
            f"contact on {contact.surface!r} has no facets: within contains all nodes of "
            "none of them"
        )
    return facets


def refuse_negative_areas(body: Body, surface: str) -> None:
    """Refuse faces where a constant pressure gives no positive force at the corners."""
    facet = body.kind.facet
    if not facet.lumps:
        face = {"triangle6": "of 6 nodes", "quad8": "of 8 nodes"}[facet.vtk]
        none = "no force" if facet.vtk == "triangle6" else "a negative force"
        raise ValueError(
            f"contact on {surface!r} of body {body.name!r} is at the nodes of faces {face}, "
            f"where a constant pressure gives the corners {none}: use "
            'pairing="mortar", cells of first order, or hexahedra of 27 nodes'
        )


def evaluate_clearance(contact: Contact, points: Floats) -> Floats:
    """The clearance at some nodes or places: a number, or one of each ``(n,)``."""
    extra = contact.clearance
    what = f"clearance of the contact on {contact.surface!r}"
    found = floats(what, extra(points) if callable(extra) else extra)
    if found.shape not in ((), (1,), (len(points),)):
        raise ValueError(
            f"{what} has shape {found.shape}, expected a number or ({len(points)},)"
        )
    return found


def split_clearance(
    contact: Contact, body: Body
) -> tuple[Callable[[Floats], Floats], Floats]:
    """Clearance as a function of the position plus values at nodes; one of them is zero."""
    nodal = np.zeros(len(body.points))
    if callable(contact.clearance) or np.ndim(contact.clearance) == 0:
        return lambda places: evaluate_clearance(contact, places), nodal
    nodes = body.nodes(contact.surface, contact.within)
    nodal[nodes] = evaluate_clearance(contact, body.points[nodes])
    return lambda places: np.zeros(len(places)), nodal
