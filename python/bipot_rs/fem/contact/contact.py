"""A named surface, and the obstacle or surface that it may touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Never

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import RATIO, floats, friction, number, show_value
from bipot_rs.fem.bodies.body import Box
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
    for name in ("cohesion", "dilatancy"):
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
    if contact.plane is None or len(contact.plane) != 2:
        raise ValueError(f"{what} is {contact.plane!r}, expected (point, normal)")
    point, normal = (floats(what, a) for a in contact.plane)
    if point.shape != (dim,) or normal.shape != (dim,):
        raise ValueError(
            f"{what} has shapes {point.shape} and {normal.shape}, expected ({dim},)"
        )
    return Plane(point, normal)
