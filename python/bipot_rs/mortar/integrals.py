"""Weighted relative displacements between surfaces whose meshes do not match.

On the part Γ of the slave surface that lies opposite to the master, tractions are
``λ = Σ λ_i ψ_i``. Their work-conjugate displacements are

    v_i = ∫_Γ ψ_i (u_s - u_m) dA / a_i,    a_i = ∫_Γ ψ_i dA > 0,                   (24)

so that ``r_i = a_i λ_i`` is the force conjugate to v_i, and ``B_ij = ∫ ψ_i φ_j / a_i``.
u_m is taken at the opposite point, along the normal of the slave facet (Puso and
Laursen, 2004), and integrals are over the intersections of projected facets.

For any ψ, two properties hold to rounding. Rows of B add up to one for each body, since
shape functions do, so that forces balance. Where ``Σ ψ_i = 1``, a constant traction p
gives each node of both bodies ``p ∫_Γ φ_j``, which is the patch test. Moments balance if
the surfaces are flat and touch.

ψ is dual to the corner functions N of the facet (Wohlmuth, 2000): on each facet e,

    ψ = D M⁻¹ N,    M = ∫_e N Nᵀ dA,    D = diag(∫_e N dA),                        (26)

so that ``∫ ψ_i N_j = δ_ij a_i``: v_i contains one slave node, and the slave's part of B is
a diagonal of ones if the facets are linear. M and D are integrals over the covered part
of e. Three rules make this stable at the rim, all with ``Σ ψ_i = 1``:

- A node with less than 1/20 of its area covered has no contact. Its N is divided equally
  among the other corners of the facet, ``Ñ_k = N_k + N_d/|kept|``, and ψ is dual to Ñ.
  Otherwise v_i would extrapolate u_m over 20 times the covered part.
- A facet without contacts by the first rule keeps its most covered corner.
- If a patch inside a facet is so small that the N are nearly equal on it, ψ oscillates:
  with a mean square above 10 on some facet (1 on a whole segment) ``ψ = Ñ`` there.

Second-order facets have linear multipliers at their corners, and displacements with all
shape functions: the areas ``∫ N`` of corners are positive, while those of quadratic
functions are zero or negative. Positions are on the polygon of the corners, which is
exact for straight edges with nodes at their midpoints.

Integrals are exact in 2D, and in 3D for triangles and parallelograms. In other
quadrilaterals N is not a polynomial of the position: the order of the rule grows with
skewness. The remaining error, about 1e-8, is removed from the resultants ∫ φ_j of each
intersection (`bipot_rs.mortar.polygons`), so that it does not affect forces and
the patch test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.mortar.facet_mesh import FacetMesh, candidates
from bipot_rs.mortar.polygons import (
    clip,
    find_overlapping_boxes,
    keep_half,
    polygon_integrals,
    triangle_rule,
    triangles,
)
from bipot_rs.mortar.shape_functions import (
    CORNER_SHAPES,
    KINDS,
    FacetKind,
    reference,
    skewness,
)
from bipot_rs.mortar.tuning import JOINED, POINTS_AT_ONCE, SWING

Places = Callable[[Floats], object]

# An intersection below this fraction of the smaller facet is rounding.
_SLIVER = 1e-12
# Skewness of a parallelogram, to rounding.
_SKEW = 1e-12


@dataclass(frozen=True)
class Overlaps:
    """Intersections of slave facets with the master facets opposite."""

    # slave, master (k,): facets, ascending by slave; `master` is empty for a rigid obstacle.
    slave: Ints
    master: Ints
    # In the plane of the slave facet, relative to its centre, `(k, v, 2)` [m]; in 2D reference
    # coordinates of the ends, `(k, 2)`.
    polygons: Floats
    # (k, c, d - 1) or None: corners of the master facet in the same plane [m].
    opposite: Floats | None


@dataclass(frozen=True)
class Integrals:
    """Integrals over the covered part of the slave surface, with corner functions N."""

    overlaps: Overlaps  # the intersections
    # mass, own (m, c, c), (m, c, nodes): ∫ N_i N_j and ∫ N_i φ_j with the slave's shape
    # functions, for each slave facet.
    mass: Floats
    own: Floats
    # (k, c, nodes): ∫ N_i φ_j with the master's shape functions, for each intersection.
    coupling: Floats
    clearance: Floats  # (fields, m, c): ∫ N_i c with each of the functions c


@dataclass(frozen=True)
class Weights:
    """Contacts, and the scalar weights of their relative displacements."""

    node: Ints  # (n_c,): slave nodes, ascending
    area: Floats  # (n_c,): a_i > 0
    # slave, master scipy.sparse.csr_array (n_c, nodes): `v = slave u_s - master u_m`; rows add
    # up to one.
    slave: CsrMatrix
    master: CsrMatrix
    # (fields, n_c): ∫ ψ_i c / a_i of each function c; no fields without a function.
    clearance: Floats


def overlaps(slave: FacetMesh, master: FacetMesh, distance: float) -> Overlaps:
    """Intersections of all facets that face each other.

    Raises `ValueError`: a master facet is folded in the projection onto a slave facet, or
    several layers of the master lie opposite to a slave facet.
    """
    s, m = candidates(slave.centre, slave.radius, slave.normals, master, distance)
    offset = master.points[master.corners[m]] - slave.centre[s][:, None]
    theirs, ours = np.einsum("pkd,pcd->pck", slave.bases[s], offset), slave.flat[s]
    meet = (theirs.max(axis=1) > ours.min(axis=1)).all(axis=1)
    meet &= (theirs.min(axis=1) < ours.max(axis=1)).all(axis=1)
    s, m, ours, theirs = s[meet], m[meet], ours[meet], theirs[meet]
    least = _SLIVER * np.minimum(slave.size[s], master.size[m])
    if slave.dim == 2:
        first, last = ours[:, 0, 0], ours[:, 1, 0]
        ends = (theirs[:, :, 0] - first[:, None]) / (last - first)[:, None]
        polygons = np.clip(np.sort(ends, axis=1), 0.0, 1.0)
        size = (polygons[:, 1] - polygons[:, 0]) * slave.size[s]
    else:
        if master.kind.corners == 4:
            _fold_slave(slave, s, master, m, theirs)
        # Seen from the slave's side they run clockwise.
        polygons = clip(ours, theirs[:, ::-1])
        size = _areas(polygons)
    kept = size > least
    kept &= _measure_distance(slave, s, master, m) <= distance
    _one_layer(slave, s[kept], master, m[kept], ours[kept], theirs[kept], least[kept])
    return Overlaps(s[kept], m[kept], polygons[kept], theirs[kept])


def _measure_distance(slave: FacetMesh, s: Ints, master: FacetMesh, m: Ints) -> Floats:
    """Smallest distance of facets along the normals of the slave."""
    between = master.points[master.corners[m]] - slave.centre[s][:, None]
    theirs = np.einsum("pd,pcd->pc", slave.normals[s], between)
    ours = np.einsum("pd,pcd->pc", slave.normals[s], slave.places[s])
    behind = ours.min(axis=1) - theirs.max(axis=1)
    before = theirs.min(axis=1) - ours.max(axis=1)
    return np.asarray(np.maximum(0.0, np.maximum(behind, before)))


def _one_layer(
    slave: FacetMesh,
    s: Ints,
    master: FacetMesh,
    m: Ints,
    ours: Floats,
    theirs: Floats,
    least: Floats,
) -> None:
    """Refuse master facets that lie one behind the other.

    Neighbours at an edge are allowed: in the projection they lie on its two sides, since
    they have the same orientation (`facet_mesh`). Facets that share only a corner are
    checked: they can overlap, as on a spiral ramp.
    """
    for first_side, other in find_overlapping_boxes(s, theirs):
        corners = master.corners
        shared = corners[m[first_side]][:, :, None] == corners[m[other]][:, None, :]
        apart = shared.sum(axis=(1, 2)) < slave.dim - 1
        first_side, other = first_side[apart], other[apart]
        if not first_side.size:
            continue
        if slave.dim == 2:
            low = np.maximum(
                ours[first_side].min(axis=1),
                np.maximum(theirs[first_side].min(axis=1), theirs[other].min(axis=1)),
            )
            high = np.minimum(
                ours[first_side].max(axis=1),
                np.minimum(theirs[first_side].max(axis=1), theirs[other].max(axis=1)),
            )
            size = (high - low)[:, 0]
        else:
            both = clip(theirs[first_side][:, ::-1], theirs[other][:, ::-1])
            size = _areas(both)
        # Neighbours overlap by rounding, and by the last digits of different meshers.
        double = size > np.maximum(1e-6 * slave.size[s[first_side]], least[first_side])
        if double.any():
            at = int(np.argmax(double))
            raise ValueError(
                f"{master.name} lies in several layers opposite to facet {s[first_side[at]]} of "
                f"{slave.name}, with its facets {m[other[at]]} and {m[first_side[at]]}: pass a "
                "distance that excludes the wrong layer, or select fewer facets"
            )


def whole(slave: FacetMesh) -> Overlaps:
    """The whole of each slave facet, for an obstacle without a mesh."""
    s = np.arange(len(slave.facets))
    none = np.zeros(0, dtype=np.int64)
    if slave.dim == 2:
        return Overlaps(s, none, np.tile([0.0, 1.0], (len(s), 1)), None)
    return Overlaps(s, none, slave.flat, None)


def cut(
    slave: FacetMesh, ranges: Mapping[int, tuple[float, float]], slack: Floats
) -> tuple[Ints, Overlaps]:
    """Facets inside ranges of coordinates by axis, and the parts of those that an end cuts.

    ``slack``: distance from an end, along each axis, that is rounding.
    """
    first = slave.points[slave.corners[:, :1]]
    if slave.dim == 2:
        polygons = np.tile([[0.0, 0.0], [1.0, 0.0]], (len(first), 1, 1))
        along = slave.points[slave.corners[:, 1:2]] - first
        axes = np.concatenate([along, np.zeros_like(along)], axis=1)
    else:
        polygons, first, axes = slave.flat, slave.centre[:, None], slave.bases
    inside = np.ones(len(first), np.bool_)
    for axis, ends in ranges.items():
        for end, sign in zip(ends, (1.0, -1.0), strict=True):
            corners = sign * (slave.points[slave.corners, axis] - end)
            inside &= (corners >= -slack[axis]).all(axis=1)
            at = first[..., axis] + np.einsum("mvk,mk->mv", polygons, axes[..., axis])
            height = sign * (at - end)
            height[np.abs(height) <= slack[axis]] = 0.0
            polygons = keep_half(polygons, height)
    none = np.zeros(0, dtype=np.int64)
    if slave.dim == 2:
        polygons = np.sort(polygons[..., 0], axis=1)[:, [0, -1]]
        size = (polygons[:, 1] - polygons[:, 0]) * slave.size
    else:
        size = _areas(polygons)
    s = np.flatnonzero(~inside & (size > _SLIVER * slave.size))
    return np.flatnonzero(inside), Overlaps(s, none, polygons[s], None)


def _areas(polygons: Floats) -> Floats:
    x, y = polygons[..., 0], polygons[..., 1]
    following = np.roll(polygons, -1, axis=1)
    return np.asarray((x * following[..., 1] - y * following[..., 0]).sum(axis=1) / 2)


def _fold_slave(
    slave: FacetMesh, s: Ints, master: FacetMesh, m: Ints, theirs: Floats
) -> None:
    bad = skewness(theirs) >= 1
    if bad.any():
        at = int(np.argmax(bad))
        raise ValueError(
            f"{master.name} has facet {m[at]} folded in the projection along the normal "
            f"of facet {s[at]} of {slave.name}: it is too strongly curved, use smaller "
            "facets"
        )


def integrate(
    slave: FacetMesh,
    over: Overlaps,
    master: FacetMesh | None = None,
    clearance: Places | None = None,
) -> Integrals:
    """Compute the integrals for `weights`."""
    c, count = slave.kind.corners, len(over.slave)
    linear = slave.kind.nodes == c
    # By intersection first.
    mass = np.zeros((count, c, c))
    own_mass = mass if linear else np.zeros((count, c, slave.kind.nodes))
    coupling = np.zeros((count, c, 0 if master is None else master.kind.nodes))
    gap: list[Floats] = []
    corner = CORNER_SHAPES[c]
    for part, xi, eta, weight in gauss_points(
        slave, over, master, clearance is not None
    ):
        N = corner(xi)
        weighted = N * weight[..., None]
        np.add.at(mass, part, np.einsum("tqi,tqj->tij", weighted, N))
        if not linear or clearance is not None:
            phi = slave.kind.shapes(xi)
            if not linear:
                np.add.at(own_mass, part, np.einsum("tqi,tqj->tij", weighted, phi))
            if clearance is not None:
                places = phi @ slave.points[slave.facets[over.slave[part]]]
                # Field by field: each with the same bits as alone.
                for k, field in enumerate(_values(clearance, places)):
                    if k == len(gap):
                        gap.append(np.zeros((count, c)))
                    np.add.at(gap[k], part, np.einsum("tqi,tq->ti", weighted, field))
        if master is not None and eta is not None:
            phi = master.kind.shapes(eta)
            np.add.at(coupling, part, np.einsum("tqi,tqj->tij", weighted, phi))
    if slave.dim == 3:
        _resultants(slave, over, master, mass, own_mass, coupling)

    def by_facet(values: Floats) -> Floats:
        total = np.zeros((len(slave.facets), *values.shape[1:]))
        np.add.at(total, over.slave, values)
        return total

    total = by_facet(mass)
    everything = total if linear else by_facet(own_mass)
    none = np.zeros((0, *total.shape[:2]))
    means = (
        np.stack([by_facet(values_of_gap) for values_of_gap in gap]) if gap else none
    )
    return Integrals(over, total, everything, coupling, means)


def _resultants(
    slave: FacetMesh,
    over: Overlaps,
    master: FacetMesh | None,
    mass: Floats,
    own: Floats,
    coupling: Floats,
) -> None:
    """Correct sums over rows and columns where quadrature is not exact.

    The correction is the same on both bodies for each intersection, so that it does not
    change the moments, which quadrature integrates exactly.
    """
    ours = slave.kind.corners == 4
    theirs = master is not None and master.kind.corners == 4
    skew = np.zeros(1)
    if ours:
        skew = skewness(slave.flat)
    if theirs and over.opposite is not None:
        skew = np.append(skew, skewness(over.opposite))
    if (skew <= _SKEW).all():
        return
    size, corners = _areas(over.polygons), slave.flat[over.slave]

    def exact(kind: FacetKind, corners: Floats) -> Floats:
        return polygon_integrals(kind, corners, over.polygons)

    rows = mass.sum(axis=2)
    if ours:
        rows = exact(KINDS[3, 4], corners)
        _correct(mass, rows, rows, size)
        if own is not mass:
            _correct(own, rows, exact(slave.kind, corners), size)
    if master is not None and over.opposite is not None:
        columns = coupling.sum(axis=1)
        if theirs:
            columns = exact(master.kind, over.opposite)
        _correct(coupling, rows, columns, size)


def _correct(blocks: Floats, rows: Floats, columns: Floats, size: Floats) -> None:
    """Change matrices ``(k, i, j)`` in place to given sums with equal totals."""
    lacks = (rows - blocks.sum(axis=2)) / size[:, None]
    other = (columns - blocks.sum(axis=1)) / size[:, None]
    blocks += lacks[:, :, None] * columns[:, None] + rows[:, :, None] * other[:, None]


def _values(function: Places, places: Floats) -> list[Floats]:
    """Values at places ``(t, q, d)``, for each field that the function returns."""
    flat = places.reshape(-1, places.shape[-1])
    values = floats("the gap at the places", function(flat))
    if values.ndim == 2 and len(values) == len(flat):
        fields = [np.ascontiguousarray(column) for column in values.T]
    elif values.shape in ((), (1,), (len(flat),)):
        fields = [np.broadcast_to(values, (len(flat),))]
    else:
        raise ValueError(
            f"the gap at the places has shape {values.shape}, expected ({len(flat)},)"
        )
    return [field.reshape(places.shape[:-1]) for field in fields]


def gauss_points(
    slave: FacetMesh, over: Overlaps, master: FacetMesh | None, function: bool
) -> Iterator[tuple[Ints, Floats, Floats | None, Floats]]:
    """Gauss points, for a limited number of intersections at a time.

    Yields ``part, xi, eta, weight``: intersection of each row ``(t,)``, reference coordinates
    on slave and master, ``(t, q, d - 1)``, and weights ``(t, q)``.
    """
    # Four more degrees for a clearance function, which is smooth on a facet.
    degree = _degree(slave, over, master) + 4 * function
    for order in np.unique(degree):
        group = np.flatnonzero(degree == order)
        points = order // 2 + 1 if slave.dim == 2 else (order // 2 + 1) ** 2
        polygon = 1 if slave.dim == 2 else over.polygons.shape[1] - 2
        step = max(1, POINTS_AT_ONCE // int(points * polygon))
        for first in range(0, len(group), step):
            part = group[first : first + step]
            if slave.dim == 2:
                yield _segment(slave, over, part, int(order))
            else:
                yield _triangles(slave, over, part, int(order))


def _segment(
    slave: FacetMesh, over: Overlaps, part: Ints, degree: int
) -> tuple[Ints, Floats, Floats | None, Floats]:
    x, w = np.polynomial.legendre.leggauss(degree // 2 + 1)
    low, high = over.polygons[part].T[..., None]
    xi = low + (high - low) * (1 + x) / 2
    size = slave.size[over.slave[part]]
    weight = (high - low) * w / 2 * size[:, None]
    if slave.revolved:
        inner, outer = slave.points[slave.corners[over.slave[part]], 0].T[..., None]
        weight = weight * (2 * np.pi * (inner + xi * (outer - inner)))
    if over.opposite is None:
        return part, xi[..., None], None, weight
    start, end = over.opposite[part, :, 0].T[..., None]
    # Relative to the midpoint of the slave facet, as the corners are.
    eta = ((xi - 0.5) * _turn(slave, over, part)[:, None] - start) / (end - start)
    return part, xi[..., None], eta[..., None], weight


def _turn(slave: FacetMesh, over: Overlaps, part: Ints) -> Floats:
    """Signed length of each slave segment along its axis."""
    facet = over.slave[part]
    along = (
        slave.points[slave.corners[facet, 1]] - slave.points[slave.corners[facet, 0]]
    )
    return np.asarray(np.einsum("pd,pd->p", along, slave.bases[facet, 0]))


def _triangles(
    slave: FacetMesh, over: Overlaps, part: Ints, degree: int
) -> tuple[Ints, Floats, Floats | None, Floats]:
    corners, owner = triangles(over.polygons[part])
    part = part[owner]
    x, w = triangle_rule(degree)
    edges = corners[:, 1:] - corners[:, :1]
    places = corners[:, :1] + x @ edges
    (a, b), (c, d) = np.moveaxis(edges, 0, -1)
    weight = (a * d - b * c)[:, None] * w
    xi = reference(slave.flat[over.slave[part]], places)
    if over.opposite is None:
        return part, xi, None, weight
    return part, xi, reference(over.opposite[part], places), weight


def _degree(slave: FacetMesh, over: Overlaps, master: FacetMesh | None) -> Ints:
    """Degree of exactness of the rule for each intersection, ``(k,)``."""
    corner = 2 if slave.kind.corners == 4 else 1
    other = max(slave.kind.degree, 0 if master is None else master.kind.degree)
    degree = np.full(len(over.slave), corner + other + slave.revolved, np.int64)
    if slave.kind.corners == 4:
        degree += _beyond(skewness(slave.flat))[over.slave]
    if master is not None and master.kind.corners == 4 and over.opposite is not None:
        # In a product of two functions the errors add, not the degrees.
        theirs = corner + other + _beyond(skewness(over.opposite))
        degree = np.maximum(degree, theirs)
    return degree


def _beyond(skew: Floats) -> Ints:
    """Degrees to add for quadrilaterals that are not parallelograms."""
    # The nearest singularity of the shape functions is about 1/skew half widths from the
    # centre: the error decreases by this factor for each degree.
    rate = np.log(2 / np.clip(skew, 1e-12, 0.95))
    beyond = np.ceil(10.0 / rate).astype(np.int64)
    return np.where(skew <= _SKEW, 0, 2 * (beyond // 2 + 1))


def weights(
    slave: FacetMesh, integrals: Integrals, master: FacetMesh | None
) -> Weights:
    """Weights of all contacts, by the three rules of this module."""
    from scipy import sparse

    corners, nodes, over = slave.corners, len(slave.points), integrals.overlaps
    covered = integrals.mass.sum(axis=2)
    kept = _keep_covered(slave, covered)
    dual, area = _dual(integrals.mass, covered, kept[corners])
    total = np.bincount(corners.ravel(), area.ravel(), minlength=nodes)
    contacts = np.flatnonzero(kept)
    number = np.full(nodes, -1)
    number[contacts] = np.arange(len(contacts))

    def assemble(facet: Ints, blocks: Floats, columns: Ints, width: int) -> CsrMatrix:
        row = np.broadcast_to(number[corners[facet]][:, :, None], blocks.shape)
        column = np.broadcast_to(columns[:, None], blocks.shape)
        # ψ of nodes without a contact is zero.
        take = row >= 0
        matrix = sparse.coo_array(
            (blocks[take], (row[take], column[take])), shape=(len(contacts), width)
        )
        return _averages(matrix.tocsr())

    own_weights = assemble(
        np.arange(len(corners)), dual @ integrals.own, slave.facets, nodes
    )
    if master is None:
        other = sparse.csr_array((len(contacts), 0))
    else:
        blocks = dual[over.slave] @ integrals.coupling
        columns, width = master.facets[over.master], len(master.points)
        other = assemble(over.slave, blocks, columns, width)
    means = []
    for field in integrals.clearance:
        gap = np.einsum("mij,mj->mi", dual, field)
        gap = np.bincount(corners.ravel(), gap.ravel(), minlength=nodes)
        means.append(gap[contacts] / total[contacts])
    return Weights(
        node=contacts,
        area=np.asarray(total[contacts]),
        slave=own_weights,
        master=other,
        clearance=np.array(means).reshape(len(means), len(contacts)),
    )


def _keep_covered(slave: FacetMesh, covered: Floats) -> Bools:
    """Nodes that have a contact, ``(n,)``."""
    corners, nodes = slave.corners.ravel(), len(slave.points)
    part = np.bincount(corners, covered.ravel(), minlength=nodes)
    kept = (part > 0) & (part >= JOINED * slave.node_areas)
    bare = (covered.sum(axis=1) > 0) & ~kept[slave.corners].any(axis=1)
    kept[slave.corners[bare, covered[bare].argmax(axis=1)]] = True
    return kept


def _dual(mass: Floats, covered: Floats, kept: Bools) -> tuple[Floats, Floats]:
    """ψ = dual N on each facet, ``(m, c, c)``, and ∫ ψ_i, ``(m, c)``.

    ``mass, covered``: ∫ N_i N_j ``(m, c, c)`` and ∫ N_i ``(m, c)``.
    ``kept``: corners with a contact ``(m, c)``.
    """
    c = mass.shape[1]
    # Ñ = join N.
    share = kept / np.maximum(kept.sum(axis=1, keepdims=True), 1)
    join = np.eye(c) * kept[:, None] + share[:, :, None] * ~kept[:, None]
    joined = join @ mass @ join.swapaxes(1, 2)
    area = np.einsum("mij,mj->mi", join, covered)
    root = np.sqrt(np.einsum("mii->mi", joined))
    here = root > 0
    scale = np.where(here, 1 / np.where(here, root, 1.0), 0.0)
    # Scaled to a unit diagonal; corners without a part get a row of the identity.
    alike = joined * scale[:, :, None] * scale[:, None] + np.eye(c) * ~here[:, None]
    apart = np.linalg.eigvalsh(alike)[:, 0] > 1e-6
    inverse = np.linalg.inv(np.where(apart[:, None, None], alike, np.eye(c)))
    inverse *= scale[:, :, None] * scale[:, None]
    size = covered.sum(axis=1)
    square = area**2 * np.einsum("mii->mi", inverse)
    swings = (square > SWING * size[:, None]).any(axis=1)
    use = (apart & ~swings)[:, None, None]
    return np.where(use, area[:, :, None] * inverse @ join, join), area


def _averages(matrix: CsrMatrix) -> CsrMatrix:
    """Divide rows by their sums, and remove entries that are rounding."""
    from scipy import sparse

    matrix.sum_duplicates()
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    size = np.bincount(rows, np.abs(matrix.data), minlength=matrix.shape[0])
    matrix.data[np.abs(matrix.data) <= 1e-14 * size[rows]] = 0.0
    matrix.eliminate_zeros()
    total = np.asarray(matrix.sum(axis=1)).ravel()
    made: CsrMatrix = sparse.csr_array(diagonal_matrix(1 / total) @ matrix)
    return made
