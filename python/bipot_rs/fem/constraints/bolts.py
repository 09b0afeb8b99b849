"""Bolts: a shank is cut, and its two sides are tied up to one shortening along its axis.

The nodes of the section get copies, which the cells above it use. With the axis a, which points
from the lower to the upper side, and the shortening s, the only unknown that a bolt adds,

    u_copy = u_node - s a.

A force F at s is the tension of the section: the sides are pulled together, and F does the work
F δs. A prescribed s keeps the shortening. Loads, springs and stresses of the cells above act on
the copies, and so on s by Tᵀ: the force of a step is the reaction of a second degree of freedom
that is tied like s, always zero, and on which no F acts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.fem.bodies.body import Body
from bipot_rs.mesh.elements import cell_nodes, facet_nodes, kind_of, make_mesh
from bipot_rs.mesh.kinds import ElementMesh


@dataclass(frozen=True)
class Bolt:
    """A bolt whose force determines its shortening in some load steps.

    Parameters
    ----------
    name
        Unique among bolts, remotes and floating obstacles.
    body
        Name of the body, of which the shank is a part.
    section
        A named surface through the shank, whose facets are inside the body; or a plane, its
        point and its normal, near which the shank is cut along facets.
    share
        Part of the bolt that is modelled: 0.5 if a plane of symmetry divides it. The force at
        the shortening is this part of the force of the bolt.
    """

    name: str
    body: str
    section: str | tuple[Sequence[float], Sequence[float]]
    share: float = 1.0


@dataclass(frozen=True)
class Cut:
    """The section of a bolt in the body that was cut: nodes, their copies, axis and centre."""

    bolt: Bolt
    nodes: Ints
    copies: Ints
    axis: Floats
    centre: Floats


def cut_bodies(
    bodies: Sequence[Body], bolts: Sequence[Bolt]
) -> tuple[list[Body], list[Cut]]:
    """Cut the shanks of bolts.

    Raises `ValueError`: a name does not exist or repeats, or a section does not cut one shank
    in two.
    """
    if not bolts:
        return list(bodies), []
    whole = {body.name: body for body in bodies}
    cuts: list[Cut] = []
    for bolt in bolts:
        if bolt.body not in whole:
            raise ValueError(
                f"section of the bolt {bolt.name!r}: there is no body {bolt.body!r}, expected "
                f"one of {', '.join(whole)}"
            )
        whole[bolt.body], number, cut = _cut(whole[bolt.body], bolt)
        # Earlier sections of the same body have other numbers now.
        cuts = [
            replace(c, nodes=number[c.nodes], copies=number[c.copies])
            if c.bolt.body == bolt.body
            else c
            for c in cuts
        ]
        cuts.append(cut)
    return [whole[body.name] for body in bodies], cuts


def _cut(body: Body, bolt: Bolt) -> tuple[Body, Ints, Cut]:
    """The body with copies of the nodes of a section, new numbers of its nodes, the section."""
    mesh, count = body.mesh, len(body.points)
    facets, upper, axis = _find_section(body, bolt)
    above = _find_upper_part(mesh, facets, upper, bolt)
    nodes = np.unique(facet_nodes(mesh, facets)).astype(np.int64)
    copy = np.arange(count)
    copy[nodes] = count + np.arange(len(nodes))
    cells = cell_nodes(mesh).copy()
    cells[above] = copy[cells[above]]
    kind, points = kind_of(mesh), np.vstack([body.points, body.points[nodes]])
    made, old = make_mesh(kind.vtk, points, cells[:, kind.order_of_vtk])
    number = np.argsort(old)
    made = made.with_subdomains(dict(mesh.subdomains or {}))
    surfaces = {
        name: _renumber_facets(mesh, made, np.asarray(at, np.int64))
        for name, at in (mesh.boundaries or {}).items()
        if name != bolt.section
    }
    made = made.with_boundaries(surfaces)
    centre = np.asarray(body.points[nodes].mean(axis=0), np.float64)
    cut = Cut(bolt, number[nodes], number[copy[nodes]], axis, centre)
    return Body(body.name, made, body.material), number, cut


def _find_section(body: Body, bolt: Bolt) -> tuple[Ints, Ints, Floats]:
    """Facets of a section, the cell above each of them, and the axis."""
    mesh = body.mesh
    sides = np.asarray(mesh.f2t, np.int64)
    middle = mesh.p[:, mesh.t].mean(axis=1).T
    if isinstance(bolt.section, str):
        facets = body.facets(bolt.section)
        outer = facets[sides[1, facets] < 0]
        if outer.size:
            at = place(mesh.p[:, mesh.facets[:, outer[0]]].mean(axis=1))
            why = f"is on the boundary of the body at {at}: choose one across the shank"
            raise _refuse(bolt, why)
        points = body.surface(bolt.section, inside=True)
        areas = np.einsum("dpq,pq->pd", np.asarray(points.normals), points.weights)
        # The side of a facet that its normal points to depends on the numbers of the cells.
        axis = (np.sign(areas @ areas[0])[:, None] * areas).sum(axis=0)
        high = np.diff(middle[sides[:, facets]], axis=0)[0] @ axis > 0
    else:
        point, axis = (np.asarray(part, np.float64) for part in bolt.section)
        if not point.shape == axis.shape == (body.dim,) or not axis.any():
            why = f"needs a point and a normal of {body.dim} numbers, not all zero"
            raise _refuse(bolt, why)
        # Cells whose middle is on the plane up to rounding are below it.
        slack = 1e-9 * np.ptp(mesh.p) * np.linalg.norm(axis)
        over = (middle - point) @ axis > slack
        facets = np.flatnonzero((sides[1] >= 0) & (over[sides[0]] != over[sides[1]]))
        if not facets.size:
            ends = " to ".join(place(end(mesh.p, axis=1)) for end in (np.min, np.max))
            why = f"does not meet body {body.name!r}, which extends from {ends}"
            raise _refuse(bolt, why)
        high = over[sides[1, facets]]
    upper = np.where(high, sides[1, facets], sides[0, facets])
    return facets, upper, np.asarray(axis / np.linalg.norm(axis), np.float64)


def _find_upper_part(mesh: ElementMesh, facets: Ints, upper: Ints, bolt: Bolt) -> Bools:
    """The cells above a section, ``(cells,)``."""
    corners = np.asarray(mesh.facets, np.int64)[:, facets]
    pairs = np.tile(corners[0], len(corners) - 1), corners[1:].ravel()
    patches = _core.connected(mesh.p.shape[1], *pairs)
    apart = np.flatnonzero(patches[corners[0]] != patches[corners[0, 0]])
    if apart.size:
        ends = (place(mesh.p[:, corners[:, k]].mean(axis=1)) for k in (0, apart[0]))
        raise _refuse(
            bolt,
            f"cuts the body at several places, near {' and '.join(ends)}: make each shank a "
            "body of its own, or name the section of one shank as a surface",
        )
    sides = np.asarray(mesh.f2t, np.int64)
    inner = sides[1] >= 0
    inner[facets] = False
    parts = _core.connected(mesh.nelements, *np.ascontiguousarray(sides[:, inner]))
    lower = sides[:, facets].sum(axis=0) - upper
    if np.intersect1d(parts[upper], parts[lower]).size:
        at = place(mesh.p[:, corners].mean(axis=(1, 2)))
        raise _refuse(
            bolt,
            f"does not go through the shank at {at}: cells on both sides are still "
            "connected; choose a section that cuts the bolt in two",
        )
    above: Bools = np.isin(parts, parts[upper])
    return above


def _refuse(bolt: Bolt, why: str) -> ValueError:
    section = bolt.section
    where = f"{bolt.body}.{section}" if isinstance(section, str) else "plane"
    return ValueError(f"section of the bolt {bolt.name!r}: the {where} {why}")


def _renumber_facets(mesh: ElementMesh, made: ElementMesh, facets: Ints) -> Ints:
    """Numbers of facets in a mesh whose cells are at the same places in the same order."""
    cells = np.asarray(mesh.f2t, np.int64)[0, facets]
    at = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    sides = np.asarray(made.t2f, np.int64)[:, cells]
    there = made.p[:, made.facets[:, sides]].mean(axis=1)
    nearest = np.argmin(np.sum((there - at[:, None]) ** 2, axis=0), axis=0)
    numbers: Ints = np.unique(sides[nearest, np.arange(len(facets))]).astype(np.int64)
    return numbers
