"""Surfaces of a body by geometry, and what acts there: foundations, symmetry, loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats, number, shaped
from bipot_rs.fem.bodies.body import Body, Box, Field, nodes_within
from bipot_rs.fem.bodies.elasticity import nodal_forces, surface_stiffness
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.fem.bodies.stress_recovery import Initial, initial_forces
from bipot_rs.mesh.elements import facet_nodes, kind_of
from bipot_rs.mesh.kinds import ElementMesh

# Tolerance of a plane surface: files give coordinates with seven digits.
_FLAT = 1e-6
# Any material: normals do not depend on it.
_ANY = Material(1.0, 0.0)


@dataclass(frozen=True)
class Spring:
    """An elastic foundation: a traction proportional to the displacement of a surface.

    Parameters
    ----------
    body, surface
        Names.
    stiffness
        Stiffness per area, zero or positive: one number for all directions, or one for
        each component ``(d,)`` [N/m³].
    normal, tangential
        Instead of ``stiffness``: along the normal of the surface and orthogonal to it
        [N/m³].
    """

    body: str
    surface: str
    stiffness: ArrayLike | None = None
    normal: float | None = None
    tangential: float | None = None

    def __post_init__(self) -> None:
        by_direction = self.normal is not None or self.tangential is not None
        if by_direction == (self.stiffness is not None):
            raise ValueError(
                f"spring on {self.surface!r} of body {self.body!r} needs either stiffness, "
                "or normal and tangential"
            )
        for name in ("stiffness", "normal", "tangential"):
            value = getattr(self, name)
            if value is None:
                continue
            what = f"{name} of the spring on {self.surface!r}"
            stiffness = floats(what, value)
            if stiffness.ndim > (name == "stiffness") or (stiffness < 0).any():
                raise ValueError(f"{what} is {value}, expected zero or positive")


@dataclass(frozen=True)
class Symmetry:
    """A plane of symmetry: the nodes of a plane surface move only within the plane."""

    body: str
    surface: str


def spring_stiffness(body: Body, spring: Spring) -> CsrMatrix:
    """Stiffness ``∫ φ_i k φ_j`` of a spring, in the form of `elasticity.stiffness`."""
    points = body.surface(spring.surface)
    unit = np.eye(body.dim)[:, :, None, None]
    if spring.stiffness is not None:
        what = f"stiffness of the spring on {spring.surface!r}"
        foundation = shaped(what, spring.stiffness, (), (body.dim,))
        density = unit * np.broadcast_to(foundation, (body.dim,))[:, None, None, None]
    else:
        n = np.asarray(points.normals)
        across = n[:, None] * n
        tangential, normal = spring.tangential or 0.0, spring.normal or 0.0
        density = tangential * unit + (normal - tangential) * across
    whole = np.broadcast_to(density, (*density.shape[:2], *points.weights.shape))
    return surface_stiffness(body, points, whole)


def plane_of(body: Body, symmetry: Symmetry) -> tuple[Ints, int | None, Floats]:
    """Nodes of a plane of symmetry, the axis of its normal or None, and its unit normal.

    Raises `ValueError`: the surface is not plane.
    """
    nodes = body.nodes(symmetry.surface)
    places = body.points[nodes]
    centre = places.mean(axis=0)
    # The normal is the direction in which the positions differ least.
    _, _, directions = np.linalg.svd(places - centre, full_matrices=False)
    size = np.ptp(body.points, axis=0).max()
    spread = np.ptp(places, axis=0)
    axis = int(np.argmin(spread))
    if spread[axis] <= _FLAT * size:
        return nodes, axis, np.eye(body.dim)[axis]
    n = directions[-1]
    off = np.ptp((places - centre) @ n)
    if off > _FLAT * size:
        raise ValueError(
            f"symmetry on {symmetry.surface!r} of body {symmetry.body!r}: the surface is "
            f"not plane, its nodes lie up to {off:g} apart along the normal "
            f"({', '.join(f'{x:.3g}' for x in n)}): choose a plane surface"
        )
    return nodes, None, np.asarray(n, np.float64)


def surface(
    mesh: ElementMesh,
    within: Box | None = None,
    normal: ArrayLike | None = None,
    angle: float = 30.0,
    *,
    inside: bool = False,
) -> Ints:
    """Select boundary facets of a mesh by position and direction, ascending.

    Parameters
    ----------
    mesh
        A mesh of scikit-fem.
    within
        Closed ranges of coordinates by axis, such as ``{2: (0.0, 0.0)}``, that contain
        all nodes of a facet; ``inf`` for an open end.
    normal
        Direction of the outward normal ``(d,)``, of any length.
    angle
        Largest angle between ``normal`` and the mean normal of a facet, in (0, 180)
        [degrees].
    inside
        Select facets between cells instead, for the section of a bolt.

    Raises
    ------
    ValueError
        No facet remains; the message gives the extent of the mesh.
    """
    dim = kind_of(mesh).dim
    if within is None and normal is None:
        raise ValueError("surface needs within or normal")
    facets = np.flatnonzero((np.asarray(mesh.f2t)[1] >= 0) == inside)
    keep = nodes_within(mesh, within, "within")[facet_nodes(mesh, facets)].all(axis=1)
    if normal is not None:
        direction = floats("normal", normal, shape=(dim,))
        length = np.linalg.norm(direction)
        if length == 0:
            raise ValueError("normal is zero, expected a direction")
        if not 0 < number("angle", angle) < 180:
            raise ValueError(f"angle is {angle}, expected degrees between 0 and 180")
        body = Body("it", mesh.with_boundaries({"it": facets}), _ANY)
        points = body.surface("it", inside=inside)
        mean = np.einsum("dpq,pq->dp", np.asarray(points.normals), points.weights)
        cosine = direction @ mean / (length * np.linalg.norm(mean, axis=0))
        # Facets at exactly this angle belong, whatever the rounding.
        keep &= cosine >= np.cos(np.deg2rad(angle)) - 1e-9
    if not keep.any():
        kind = "inner" if inside else "boundary"
        low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
        ranges = ", ".join(
            f"{'xyz'[k]} from {low[k]:g} to {high[k]:g}" for k in range(dim)
        )
        raise ValueError(
            f"no {kind} facet matches: the mesh has {ranges}, and {len(facets)} "
            f"{kind} facets"
        )
    return facets[keep]


def with_surfaces(mesh: ElementMesh, surfaces: Mapping[str, Ints]) -> ElementMesh:
    """Add named surfaces to those of the mesh."""
    return mesh.with_boundaries({**(mesh.boundaries or {}), **surfaces})


_KINDS = ("traction", "pressure", "force", "strain")


@dataclass(frozen=True)
class Load:
    """One load of a body, in proportion to a factor of each load step.

    Give exactly one of ``traction``, ``pressure``, ``force`` and ``strain``.

    Parameters
    ----------
    body
        Name of the body.
    surface
        Name of the surface of a traction or a pressure.
    traction, pressure, force, strain
        As ``value`` of `Assembly.traction`, `Assembly.pressure` and
        `Assembly.body_force`, and ``strain`` of `Assembly.initial_strain`.
    factors
        Multiplies the load in each step, ``(steps,)``; a number for all steps.
    within
        Ranges of coordinates by axis, such as ``{0: (0.0, 1.0)}``: the part of the surface
        that a traction or a pressure loads, also a part of a facet.
    """

    body: str
    surface: str | None = None
    traction: Field | None = None
    pressure: float | None = None
    force: Field | None = None
    strain: Initial | None = None
    factors: ArrayLike = 1.0
    within: Box | None = None

    def __post_init__(self) -> None:
        kinds_given = [name for name in _KINDS if getattr(self, name) is not None]
        if len(kinds_given) != 1:
            raise ValueError(
                f"load of body {self.body!r} has {' and '.join(kinds_given) or 'no value'}, "
                "expected exactly one of traction, pressure, force and strain"
            )
        (kind,) = kinds_given
        if (self.surface is None) == (kind in ("traction", "pressure")):
            raise ValueError(
                f"load of body {self.body!r} is a {kind}, and surface is "
                f"{self.surface!r}: a traction or a pressure needs a surface, others none"
            )
        if self.within is not None and self.surface is None:
            raise ValueError(
                f"load of body {self.body!r} is a {kind} and has within: only a traction or a "
                "pressure has"
            )
        if self.pressure is not None:
            number("pressure", self.pressure)
        floats(f"factors of the load of body {self.body!r}", self.factors)

    @property
    def kind(self) -> str:
        """``"traction"``, ``"pressure"``, ``"force"`` or ``"strain"``."""
        return next(name for name in _KINDS if getattr(self, name) is not None)

    def of_steps(self, steps: int) -> Floats:
        """The factor of each step, ``(steps,)``; `ValueError` for another number."""
        what = f"factors of the load of body {self.body!r}"
        factors = shaped(what, self.factors, (), (steps,))
        return np.broadcast_to(factors, (steps,))

    def forces(self, body: Body) -> Floats:
        """Nodal forces ``(dim * nodes,)`` of the body for a factor of 1 [N]."""
        if self.strain is not None:
            return initial_forces(body, self.strain)
        if self.force is not None:
            return nodal_forces(body, body.volume(), self.force)
        forces = np.zeros(body.points.size)
        for points in body.surface_parts(str(self.surface), self.within):
            value = self.traction
            if value is None:
                value = -float(self.pressure or 0.0) * np.asarray(points.normals)
            forces += nodal_forces(body, points, value)
        return forces

    def area(self, body: Body) -> float:
        """Area that a traction or a pressure loads [m²]; in 2D times the thickness."""
        parts = body.surface_parts(str(self.surface), self.within)
        return body.depth * float(sum(points.weights.sum() for points in parts))


@dataclass(frozen=True)
class PointLoad:
    """A force and a moment at the reference point of an obstacle or a remote.

    ``name``: a floating obstacle, which takes no moment, or a remote.
    ``force, moment``: ``(d,)`` [N], and about the point ``(3,)``, in the plane a number [N m].
    """

    name: str
    force: ArrayLike | None = None
    moment: ArrayLike | None = None
