"""An elastic body: a mesh of scikit-fem with surfaces, volumes and materials.

Shape functions, quadrature and mappings are those of scikit-fem.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import instead, place
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, Floats, Integers, Ints
from bipot_rs._lib.validation import floats, show_value
from bipot_rs.fem.bodies.materials import Elastic, Material
from bipot_rs.mesh.elements import (
    cell_nodes,
    cross,
    facet_nodes,
    inverse,
    jacobian,
    kind_of,
)
from bipot_rs.mesh.kinds import ElementMesh, Kind

# Rounding of coordinates, relative to the extent of a mesh.
ROUNDING = 1e-9

Field: TypeAlias = ArrayLike | Callable[[Floats], ArrayLike]
Box: TypeAlias = Mapping[int, tuple[float, float]]


@dataclass(frozen=True)
class Quadrature:
    """Gauss points on cells or facets, with the shape functions there."""

    corners: Ints  # (parts, c): nodes of each cell or facet
    # (c, q) or (parts, c, q): shape functions at the points, the same on every cell or facet,
    # or of each.
    phi: Floats
    places: Floats  # (d, parts, q): positions of the points [m]
    # (parts, q): weights; their sum is the volume [m³] or the area [m²], in 2D the area or the
    # length, without the thickness; of a body of revolution those of a full turn.
    weights: Floats
    normals: Floats | None  # (d, parts, q) or None: outward unit normals, on facets
    nodes: int  # number of nodes of the body

    __repr__ = short_repr

    def some(self, chosen: Ints) -> Quadrature:
        """That of some of the cells or facets."""
        normals = self.normals
        return replace(
            self,
            corners=self.corners[chosen],
            places=self.places[:, chosen],
            weights=self.weights[chosen],
            normals=None if normals is None else normals[:, chosen],
        )

    def moment(self, density: Floats) -> Floats:
        """∫ φ_i density, ``(nodes,)``, with a density ``(parts, q)`` at the points."""
        terms = "pq,cq->pc" if self.phi.ndim == 2 else "pq,pcq->pc"
        parts = np.einsum(terms, self.weights * density, self.phi)
        total = np.bincount(self.corners.ravel(), parts.ravel(), minlength=self.nodes)
        return np.asarray(total, dtype=np.float64)


@dataclass(frozen=True)
class Body:
    """A mesh with named surfaces (``mesh.boundaries``) and its material.

    Parameters
    ----------
    name
        Unique among the bodies of a model.
    mesh
        A mesh of scikit-fem, such as from `box` or `read_mesh`: triangles,
        quadrilaterals, tetrahedra or hexahedra of first or second order. The boxes of a
        scene have a `BoxMesh`, which has the same arrays.
    material
        One for the whole body, or a mapping from volume names (``mesh.subdomains``) to
        materials. The volumes must cover the body without overlap.
    """

    name: str
    mesh: ElementMesh
    material: Elastic | Mapping[str, Elastic]

    def __post_init__(self) -> None:
        kind_of(self.mesh, f"mesh of body {self.name!r}")
        if isinstance(self.material, Mapping):
            self.material_of_cells  # noqa: B018 - checks the volumes
            kinds = {
                (m.plane_stress, m.thickness, m.axisymmetric) for m in self.materials
            }
            if len(kinds) > 1:
                raise ValueError(
                    f"materials of body {self.name!r} differ in plane_stress, thickness or "
                    "axisymmetric: give all its volumes the same"
                )
        for material in self.materials:
            material.tensor(self.dim)  # refuses axes that do not fit a 2D body
        if any(m.axisymmetric for m in self.materials):
            r = self.mesh.p[0]
            if self.dim == 3 or r.min() < -ROUNDING * np.ptp(r):
                raise ValueError(
                    f"body {self.name!r} is axisymmetric and "
                    + (
                        "in space: its mesh must be in the plane (r, z)"
                        if self.dim == 3
                        else f"has nodes at r = {r.min():g}: r, the first coordinate, is the "
                        "distance from the axis, at least 0"
                    )
                )

    @property
    def kind(self) -> Kind:
        """Kind of the cells: element, quadrature, facets."""
        return kind_of(self.mesh)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.mesh.p.shape[0])

    @property
    def points(self) -> Floats:
        """Positions of the nodes, ``(nodes, d)`` [m]."""
        return np.ascontiguousarray(self.mesh.p.T, dtype=np.float64)

    @property
    def cells(self) -> Ints:
        """Nodes of each cell in the order of the element, ``(cells, c)``."""
        return cell_nodes(self.mesh)

    @property
    def materials(self) -> list[Elastic]:
        """Materials of the volumes, or the only material."""
        if isinstance(self.material, Mapping):
            return list(self.material.values())
        return [self.material]

    @property
    def material_of_cells(self) -> Ints:
        """Index in `materials` of each cell, ``(cells,)``.

        Raises
        ------
        ValueError
            The mesh has no volume of that name, or a cell is in no volume or in two.
        """
        numbers = np.full(int(self.mesh.t.shape[1]), -1, dtype=np.int64)
        if not isinstance(self.material, Mapping):
            return np.zeros_like(numbers)
        for k, volume in enumerate(self.material):
            cells = self.volume_cells(volume)
            twice = cells[numbers[cells] >= 0]
            if twice.size:
                raise ValueError(
                    f"volume {volume!r} of body {self.name!r} shares "
                    f"{len(twice)} cells with another volume that has a material: give "
                    "each cell one material"
                )
            numbers[cells] = k
        if (numbers < 0).any():
            bare = self.mesh.p[:, self.mesh.t[:, np.argmin(numbers)]].mean(axis=1)
            raise ValueError(
                f"material of body {self.name!r} is missing for {(numbers < 0).sum()} cells, "
                f"the first at {place(bare)}: the volumes must cover the body"
            )
        return numbers

    @property
    def isotropic(self) -> Material:
        """The material if it is the only one and isotropic; otherwise `ValueError`."""
        if not isinstance(self.material, Material):
            many = isinstance(self.material, Mapping)
            what_it_is = "several materials" if many else "an orthotropic material"
            raise ValueError(
                f"body {self.name!r} has {what_it_is}, expected one isotropic material"
            )
        return self.material

    @property
    def depth(self) -> float:
        """Thickness in 2D, 1 in 3D and for a body of revolution: factor on quadratures."""
        return self.materials[0].thickness if self.dim == 2 else 1.0

    @property
    def axisymmetric(self) -> bool:
        """Whether the mesh is the half section (r, z) of a body of revolution."""
        return self.materials[0].axisymmetric

    def _revolve(self, weights: Floats, places: Floats) -> Floats:
        """Weights ``(parts, q)``, of a body of revolution times 2 π r."""
        return weights * (2 * np.pi * places[0]) if self.axisymmetric else weights

    def volume(self) -> Quadrature:
        """Quadrature on the cells."""
        corners = self.cells
        x = self.points[corners]
        phi, slopes, weights = self.kind.reference
        _, determinant = inverse(jacobian(x, slopes))
        places = np.einsum("pcd,cq->dpq", x, phi)
        return Quadrature(
            corners=corners,
            phi=phi,
            places=places,
            weights=self._revolve((weights[:, None] * np.abs(determinant)).T, places),
            normals=None,
            nodes=len(self.points),
        )

    def volume_cells(self, volume: str) -> Ints:
        """Cells of a named volume; `ValueError` lists the known names."""
        return self._members("volume", volume, self.mesh.subdomains)

    def facets(self, surface: str) -> Ints:
        """Facets of a named surface; `ValueError` lists the known names."""
        return self._members("surface", surface, self.mesh.boundaries)

    def _members(
        self, kind: str, name: str, sets: Mapping[str, Integers] | None
    ) -> Ints:
        groups = sets or {}
        if name not in groups:
            raise ValueError(
                f"body {self.name!r} has no {kind} {name!r}"
                + instead(name, sorted(groups), f"its mesh has no named {kind}")
            )
        return np.asarray(groups[name], dtype=np.int64)

    def surface(self, name: str, *, inside: bool = False) -> Quadrature:
        """Quadrature on the facets of a named surface; without ``inside`` of the boundary."""
        facets = self.facets(name)
        if not inside and (np.asarray(self.mesh.f2t)[1, facets] >= 0).any():
            raise ValueError(
                f"surface {name!r} lies inside body {self.name!r}, as the section of a bolt "
                "does: name one on the boundary"
            )
        corners = facet_nodes(self.mesh, facets)
        x = self.points[corners]
        phi, slopes, weights = self.kind.facet.reference
        tangents = jacobian(x, slopes).swapaxes(0, 1)
        if self.dim == 2:
            area = np.stack([tangents[0, :, 1], -tangents[0, :, 0]], axis=1)
        else:
            area = cross(*tangents)
        size = np.linalg.norm(area, axis=1)
        cells = self.mesh.t[:, self.mesh.f2t[0, facets]]
        inwards = self.mesh.p[:, cells].mean(axis=1) - x.mean(axis=1).T
        inverted = np.einsum("qdp,dp->qp", area, inwards) > 0
        normals = area * (np.where(inverted, -1.0, 1.0) / size)[:, None]
        places = np.einsum("pcd,cq->dpq", x, phi)
        return Quadrature(
            corners=corners,
            phi=phi,
            places=places,
            weights=self._revolve((weights[:, None] * size).T, places),
            normals=normals.transpose(1, 2, 0),
            nodes=len(self.points),
        )

    def surface_parts(self, name: str, within: Box | None) -> list[Quadrature]:
        """Quadrature on the part of a surface in ranges of coordinates, in pieces.

        Facets that an end of a range cuts are those of their corners: flat, with straight edges.
        """
        whole = self.surface(name)
        if within is None:
            return [whole]
        from bipot_rs.mortar.facet_mesh import surface, turned_outward
        from bipot_rs.mortar.integrals import cut, gauss_points

        nodes_within(self.mesh, within, f"within of surface {name!r}")
        outward = np.asarray(whole.normals).mean(axis=2).T
        facets = turned_outward(self.points, whole.corners, outward)
        title = f"{self.name}.{name}"
        mesh = surface(f"points of {title}", self.points, title, facets)
        inside, over = cut(mesh, within, 1e-9 * np.ptp(self.mesh.p, axis=1))
        parts = [whole.some(inside)] if inside.size else []
        for part, xi, _, weights in gauss_points(mesh, over, None, function=True):
            facet = over.slave[part]
            phi = mesh.kind.shapes(xi)
            places = np.einsum("tqc,tcd->dtq", phi, self.points[facets[facet]])
            normals = np.broadcast_to(mesh.normals[facet].T[..., None], places.shape)
            parts.append(
                Quadrature(
                    corners=facets[facet],
                    phi=phi.swapaxes(1, 2),
                    places=places,
                    weights=self._revolve(weights, places),
                    normals=normals,
                    nodes=len(self.points),
                )
            )
        if not parts:
            low, high = (
                place(end(self.points[facets], axis=(0, 1))) for end in (np.min, np.max)
            )
            raise ValueError(
                f"surface {name!r} of body {self.name!r} has no part within the ranges: it "
                f"extends from {low} to {high}"
            )
        return parts

    def nodes(self, surface: str, within: Box | None = None) -> Ints:
        """Nodes of a named surface, ascending, with ``low ≤ x[axis] ≤ high`` if ``within``."""
        corners = facet_nodes(self.mesh, self.facets(surface))
        nodes = np.unique(corners).astype(np.int64)
        return self._select_within(nodes, within, f"surface {surface!r}")

    def members(
        self,
        part: str | None = None,
        within: Box | None = None,
        at: ArrayLike | None = None,
    ) -> Ints:
        """Nodes of a part of the body, also inside it, ascending.

        Parameters
        ----------
        part
            A named surface or volume; None for the whole body.
        within
            Ranges of coordinates, as in `nodes`.
        at
            A position ``(d,)``: only the node nearest to it, of equally near ones that
            with the least number [m].

        Raises
        ------
        ValueError
            There is no such part, no node is in the ranges, or ``at`` is outside the box
            that contains the body.
        """
        if part is None:
            whose = f"body {self.name!r}"
            nodes = np.arange(len(self.points))
        elif part in (self.mesh.boundaries or {}):
            whose = f"surface {part!r} of body {self.name!r}"
            nodes = self.nodes(part)
        elif part in (self.mesh.subdomains or {}):
            whose = f"volume {part!r} of body {self.name!r}"
            nodes = np.unique(self.cells[self.volume_cells(part)]).astype(np.int64)
        else:
            names = [*(self.mesh.boundaries or {}), *(self.mesh.subdomains or {})]
            raise ValueError(
                f"body {self.name!r} has no surface or volume {part!r}"
                + instead(part, sorted(names), "its mesh names neither")
            )
        nodes = self._select_within(nodes, within, whose)
        if not nodes.size:
            raise ValueError(
                f"{whose} has no nodes: within excludes all of them, widen its ranges"
            )
        if at is None:
            return nodes
        x = floats("at", at, shape=(self.dim,))
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        slack = 1e-6 * (high - low).max()
        if (x < low - slack).any() or (x > high + slack).any():
            raise ValueError(
                f"at is {place(x)}, outside body {self.name!r}, which extends from "
                f"{place(low)} to {place(high)}: choose a position inside"
            )
        apart = np.linalg.norm(self.points[nodes] - x, axis=1)
        # Equally near ones differ by rounding.
        return nodes[np.flatnonzero(apart <= apart.min() + slack)[:1]]

    def _select_within(self, nodes: Ints, within: Box | None, whose: str) -> Ints:
        return nodes[nodes_within(self.mesh, within, f"within of {whose}")[nodes]]


def nodes_within(mesh: ElementMesh, within: Box | None, what: str) -> Bools:
    """Whether nodes are in ranges of coordinates by axis, ``(nodes,)``; ``what`` names these."""
    if within is not None and not isinstance(within, Mapping):
        raise TypeError(
            f"{what} is {show_value(within)}, expected ranges by axis, as in {{0: (0.0, 1.0)}}"
        )
    dim, count = mesh.p.shape
    inside = np.ones(count, np.bool_)
    for axis, ends in (within or {}).items():
        if axis not in range(dim):
            raise ValueError(
                f"{what} has axis {axis}, expected one of {list(range(dim))}"
            )
        low, high = floats(what, ends, shape=(2,), finite=False)
        if not low <= high:
            raise ValueError(
                f"{what} is {ends} along axis {axis}, expected (low, high) with low <= high"
            )
        x = mesh.p[axis]
        # Nodes on the bound belong, whatever the rounding.
        slack = 1e-9 * np.ptp(x)
        inside &= (x >= low - slack) & (x <= high + slack)
    return inside


@dataclass(frozen=True)
class NumberedBody:
    """A body with the degrees of freedom ``first + dim * node + component``."""

    body: Body  # the body
    index: int  # its index in the model
    first: int  # its first degree of freedom

    @property
    def span(self) -> slice:
        """All its degrees of freedom."""
        return slice(self.first, self.first + self.body.points.size)

    @cached_property
    def dofs(self) -> Ints:
        """Degrees of freedom of each node, ``(nodes, d)``."""
        n, d = self.body.points.size, self.body.dim
        return self.first + np.arange(n).reshape(-1, d)

    def nodes_at(self, first: Ints) -> Ints:
        """Nodes with these first degrees of freedom ``(m,)``."""
        return (first - self.first) // self.body.dim


class NumberedBodies(dict[str, NumberedBody]):
    """The bodies of a model by their names, in their order."""

    def __missing__(self, name: str) -> NumberedBody:
        raise ValueError(f"there is no body {name!r}, expected one of {list(self)}")

    def __repr__(self) -> str:
        return repr(self.first_dofs)

    @property
    def first_dofs(self) -> dict[str, int]:
        """First degree of freedom of each body, by name."""
        return {name: numbered.first for name, numbered in self.items()}

    @property
    def dim(self) -> int:
        """2 or 3."""
        return next(iter(self.values())).body.dim

    @property
    def axisymmetric(self) -> bool:
        """Whether the bodies are bodies of revolution."""
        return next(iter(self.values())).body.axisymmetric

    @property
    def axes(self) -> str:
        """Names of the coordinates, a letter each."""
        return "rz" if self.axisymmetric else "xyz"[: self.dim]

    @property
    def n(self) -> int:
        """Number of degrees of freedom of all bodies."""
        return sum(numbered.body.points.size for numbered in self.values())


def number_bodies(bodies: Sequence[Body]) -> NumberedBodies:
    """Number the degrees of freedom, body after body.

    Raises `ValueError`: there is no body, names repeat, or kinds of bodies differ.
    """
    if not bodies:
        raise ValueError("bodies is empty, expected at least one")
    if len({body.dim for body in bodies}) > 1:
        raise ValueError("bodies mix two and three dimensions")
    if len({body.axisymmetric for body in bodies}) > 1:
        other = next(body.name for body in bodies if not body.axisymmetric)
        raise ValueError(
            f"body {other!r} is plane and others are axisymmetric: expected all the same"
        )
    names = [body.name for body in bodies]
    if len(set(names)) < len(names):
        raise ValueError(f"names of bodies repeat: {names}")
    numbered, first = NumberedBodies(), 0
    for index, body in enumerate(bodies):
        numbered[body.name] = NumberedBody(body, index, first)
        first += body.points.size
    return numbered
