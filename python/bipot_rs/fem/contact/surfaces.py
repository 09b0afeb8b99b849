"""The nodes and facets of a contact: outward normals, clearance, and which are taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.fem.bodies.body import Body, Box, Quadrature
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.mortar.facet_mesh import FacetMesh, drop_rounding, surface, turned_outward


@dataclass(frozen=True)
class ContactSurface:
    """A named surface of a body, with what contacts need of it."""

    body: Body
    name: str
    within: Box | None = None  # ranges of coordinates that select nodes

    @cached_property
    def nodes(self) -> Ints:
        """Nodes in the ranges, ascending."""
        return self.body.nodes(self.name, self.within)

    @cached_property
    def facets(self) -> Quadrature:
        """Quadrature on all facets."""
        return self.body.surface(self.name)

    @cached_property
    def normals(self) -> Floats:
        """Outward normals at all nodes of the body, times area; zero off the surface."""
        components = np.asarray(self.facets.normals)
        nodal = np.stack([self.facets.moment(n) for n in components], axis=1)
        return drop_rounding(nodal)

    @cached_property
    def outward(self) -> Ints:
        """Facets whose nodes are all in the ranges, with normals that point outwards."""
        normals = np.asarray(self.facets.normals).mean(axis=2).T
        facets = turned_outward(self.body.points, self.facets.corners, normals)
        if self.within is None:
            return facets
        facets = facets[np.isin(facets, self.nodes).all(axis=1)]
        if not len(facets):
            raise ValueError(
                f"contact on {self.name!r} has no facets: within contains all nodes of "
                "none of them"
            )
        return facets

    def mesh(self) -> FacetMesh:
        """These facets, for the contact of meshes that do not match."""
        name = f"{self.body.name}.{self.name}"
        made = surface(f"points of {name}", self.body.points, name, self.outward)
        return replace(made, revolved=self.body.axisymmetric)


def refuse_negative_areas(side: ContactSurface) -> None:
    """Refuse faces where a constant pressure gives no positive force at the corners."""
    facet = side.body.kind.facet
    if not facet.lumps:
        face = {"triangle6": "of 6 nodes", "quad8": "of 8 nodes"}[facet.vtk]
        none = "no force" if facet.vtk == "triangle6" else "a negative force"
        raise ValueError(
            f"contact on {side.name!r} of body {side.body.name!r} is at the nodes of faces {face}, "
            f"where a constant pressure gives the corners {none}: use "
            'pairing="mortar", cells of first order, or hexahedra of 27 nodes'
        )


def evaluate_clearance(contact: Contact, points: Floats) -> Floats:
    """The clearance at some nodes or places: a number, or one of each ``(n,)``."""
    extra = contact.clearance
    what = f"clearance of the contact on {contact.surface!r}"
    clearances = floats(what, extra(points) if callable(extra) else extra)
    if clearances.shape not in ((), (1,), (len(points),)):
        raise ValueError(
            f"{what} has shape {clearances.shape}, expected a number or ({len(points)},)"
        )
    return clearances


def split_clearance(
    contact: Contact, side: ContactSurface
) -> tuple[Callable[[Floats], Floats], Floats]:
    """Clearance as a function of the position plus values at nodes; one of them is zero."""
    nodal = np.zeros(len(side.body.points))
    if callable(contact.clearance) or np.ndim(contact.clearance) == 0:
        return lambda places: evaluate_clearance(contact, places), nodal
    nodal[side.nodes] = evaluate_clearance(contact, side.body.points[side.nodes])
    return lambda places: np.zeros(len(places)), nodal
