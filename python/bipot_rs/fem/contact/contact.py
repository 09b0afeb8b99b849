"""A named surface, its nodes and facets, and the obstacle or surface that it may touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Never

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import RATIO, floats, friction, number, show_value
from bipot_rs.contact.law.contact_law import BESIDE_MU
from bipot_rs.fem.bodies.body import Body, Box, Quadrature
from bipot_rs.mortar.facet_mesh import FacetMesh, drop_rounding, surface, turned_outward
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.protocol import Obstacle
from bipot_rs.obstacle.shapes import Plane


@dataclass(frozen=True)
class Floating:
    """A rigid obstacle that a force moves: its position is an unknown.

    Contacts with an equal ``floating`` touch the same obstacle.

    Parameters
    ----------
    name
        Name of the obstacle, for its force and its displacement.
    components
        Directions in which it may translate, some of 0 to d - 1; it does not rotate.
    """

    name: str
    components: Sequence[int]


@dataclass(frozen=True)
class Contact:
    """A named surface, and the obstacle or surface that it may touch.

    Give exactly one of ``plane = (point, normal)``, a rigid plane with the normal towards
    the body; ``obstacle``, another rigid obstacle of `bipot_rs.obstacle`; and
    ``against = (body, surface)``, the surface of another body. Rigid obstacles move along
    the load path by ``motion``, a `bipot_rs.obstacle.Motion`. For several obstacles,
    define several contacts on the same surface.

    Contacts are at the nodes of the surface. With ``pairing = "match"`` the nodes of two
    bodies must lie opposite each other, one to one. For other meshes, ``"mortar"``
    transmits constant pressures exactly, and ``"nodes"`` puts each node on the opposite
    facet, as in `bipot_rs.pairs`; this body is the slave. Faces with 6 or 8 nodes, whose
    corners have no positive area, need ``"mortar"`` with rigid obstacles too
    (`bipot_rs.rigid_pairs`).

    ``clearance`` is added to the gap [m]: a number, one number for each node of the
    surface in the order of `Body.nodes`, or a function of the positions ``(nodes, d)``;
    mortar takes the weighted mean. ``within`` selects nodes by position; if meshes do not
    match, facets with all nodes selected. In 3D ``mu`` may be a pair, for the tangents t1
    and t2: t1 is then ``axis (d,)``, a direction of the material such as its grain,
    projected onto the tangent plane; without ``axis``, the tangents are those of `frames`.

    ``cohesion`` is a shear stress [Pa], which is multiplied by the areas of the contacts;
    ``dilatancy`` the opening per slip, up to ``mu``: see `ContactProblem`.

    ``name`` is the title of the contact in tables and files, by default ``"body.surface"``.

    With ``floating``, the force `Assembly.reference_force` moves the rigid obstacle, in
    addition to ``motion``: small translations, with the normals of the start.
    """

    body: str
    surface: str
    mu: float | Sequence[float]
    plane: tuple[ArrayLike, ArrayLike] | None = None
    against: tuple[str, str] | None = None
    clearance: ArrayLike | Callable[[Floats], ArrayLike] = 0.0
    within: Box | None = None
    axis: ArrayLike | None = None
    obstacle: Obstacle | None = None
    motion: Motion | None = None
    pairing: str = "match"
    floating: Floating | None = None
    cohesion: float = 0.0
    dilatancy: float = 0.0
    name: str = ""

    @property
    def title(self) -> str:
        """Its name, else that of its surface, ``"body.surface"``."""
        return self.name or f"{self.body}.{self.surface}"


def both(contact: Contact) -> str:
    """Names of the two surfaces, for messages; the second is "" for an obstacle."""
    return f"{contact.body}.{contact.surface} and {'.'.join(contact.against or ())}"


def refuse_itself(contact: Contact) -> Never:
    """Raise the error of a body in contact with itself."""
    raise ValueError(
        f"body {contact.body!r} is in contact with itself: against must name another "
        "body, or with pairing='match' the other face of a crack"
    )


def check_contact(contact: Contact, dim: int) -> None:
    """Check the arguments that do not depend on a mesh."""
    what = f"mu of the contact on {contact.surface!r}"
    if np.ndim(contact.mu) == 1:
        friction(np.asarray(contact.mu)[None], 1, dim, ratio=RATIO)
    elif not 0 <= number(what, contact.mu) < np.inf:
        raise ValueError(
            f"{what} is {contact.mu}, expected a finite number, zero or positive"
        )
    for name in BESIDE_MU:
        about = f"{name} of the contact on {contact.surface!r}"
        value = getattr(contact, name)
        if not 0 <= number(about, value) < np.inf:
            raise ValueError(
                f"{about} is {value}, expected a finite number, zero or positive"
            )
    opposites = contact.plane, contact.obstacle, contact.against
    if sum(opposite is not None for opposite in opposites) != 1:
        raise ValueError(
            f"contact on {contact.surface!r} needs exactly one of plane, obstacle and "
            "against"
        )
    if contact.obstacle is not None and not callable(
        getattr(contact.obstacle, "closest", None)
    ):
        raise TypeError(
            f"obstacle of the contact on {contact.surface!r} is {show_value(contact.obstacle)}, "
            "expected an obstacle of bipot_rs.obstacle, or an object with closest(points)"
        )
    itself = contact.body, contact.surface
    if contact.against == itself or (
        contact.against is not None
        and contact.against[0] == contact.body
        and contact.pairing != "match"
    ):
        refuse_itself(contact)
    if contact.motion is not None and contact.against is not None:
        raise ValueError(
            f"motion of the contact on {contact.surface!r} was given, but "
            f"{'.'.join(contact.against)} is a surface of another body: move that body by "
            "supports"
        )
    if contact.pairing == "match":
        return
    from bipot_rs.mortar.pairs import METHODS

    if contact.pairing not in METHODS:
        raise ValueError(
            f"pairing of the contact on {contact.surface!r} is {contact.pairing!r}, "
            "expected 'match', " + " or ".join(map(repr, METHODS))
        )


def rigid_obstacle(contact: Contact, dim: int) -> Obstacle:
    """The rigid obstacle of a contact."""
    if contact.obstacle is not None:
        return contact.obstacle
    what = f"plane of the contact on {contact.surface!r}"
    if not isinstance(contact.plane, (Sequence, np.ndarray)) or len(contact.plane) != 2:
        raise ValueError(f"{what} is {contact.plane!r}, expected (point, normal)")
    point, normal = (floats(what, a) for a in contact.plane)
    if point.shape != (dim,) or normal.shape != (dim,):
        raise ValueError(
            f"{what} has shapes {point.shape} and {normal.shape}, expected ({dim},)"
        )
    return Plane(point, normal)


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
