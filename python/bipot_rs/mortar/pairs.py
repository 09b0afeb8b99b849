"""Contacts of surfaces whose meshes do not match, from arrays.

B of (2), gaps and areas for any finite-element program, by mortar integrals
(`bipot_rs.mortar.integrals`) or node to surface. Only NumPy and SciPy are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats, integers, number, shaped, show_value
from bipot_rs.contact.law.frames import frames
from bipot_rs.mortar.facet_mesh import FacetMesh, bases, candidates, surface
from bipot_rs.mortar.shape_functions import reference

# A contact of matching nodes imports this module, but not the integrals.
if TYPE_CHECKING:
    from bipot_rs.mortar.integrals import Weights

METHODS = ("mortar", "nodes")
# A node this far outside a facet, in reference coordinates, counts as on its edge: two
# meshers write the same point with different last digits.
_RIM = 1e-7


@dataclass(frozen=True)
class Pairs:
    """Contacts between two surfaces, or a surface and a rigid obstacle.

    To solve: ``ContactProblem(K, pairs.B, gap=pairs.gap, mu=mu, area=pairs.area,
    points=pairs.points, frame=pairs.frame)``.

    Attributes
    ----------
    B : scipy.sparse.csr_array (d n_c, n)
        ``B u`` is the displacement of the slave relative to the master, ``(n, t1[, t2])``.
    gap, area : (n_c,)
        Normal gap [m], negative where the surfaces overlap; tributary area > 0 [m²], in
        2D a length [m]. ``reaction / area`` is the traction.
    points : (n_c, d)
        Positions of the slave nodes of the contacts [m].
    frame : (n_c, d, d)
        Rows n, t1[, t2], n from the master towards the slave.
    node : (n_c,)
        Indices of these nodes in ``points_slave``, ascending.
    slave, master : scipy.sparse.csr_array (n_c, nodes)
        Weights of ``v = slave u_s - master u_m``, in global components; rows add up to
        one. ``master`` has no columns for a rigid obstacle.
    facets : (m, k)
        Facets of the slave whose corners all have contacts, as numbers of contacts, for
        pictures: ``result.contacts["facets"] = pairs.facets``. Midpoints of edges have
        contacts with ``"mortar"`` on some facets only; they are -1 where they have none.
    """

    B: CsrMatrix = field(repr=False)
    gap: Floats
    area: Floats
    points: Floats = field(repr=False)
    frame: Floats = field(repr=False)
    node: Ints = field(repr=False)
    slave: CsrMatrix = field(repr=False)
    master: CsrMatrix = field(repr=False)
    facets: Ints = field(repr=False, default_factory=lambda: np.empty((0, 3), np.int64))

    def __repr__(self) -> str:
        return (
            f"Pairs({len(self.gap)} contacts, area {self.area.sum():g}, gap "
            f"{self.gap.min():g} to {self.gap.max():g})"
        )


def nodal_areas(points: ArrayLike, facets: ArrayLike) -> Floats:
    """Area that belongs to each node, ∫ N over the facets, for ``area`` of a problem.

    Parameters
    ----------
    points
        Positions of all nodes of a body, or of its surface only, ``(nodes, d)`` [m].
    facets
        Nodes of linear facets, ``(facets, c)``, as in `pairs`.

    Returns
    -------
    ndarray
        ``(nodes,)`` [m²], in 2D lengths [m]; zero at nodes that belong to no facet.

    Raises
    ------
    ValueError
        Facets are quadratic, degenerate, folded or out of range; the message names them.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> bp.nodal_areas([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]], [[0, 1], [1, 2]])
    array([0.5, 1.5, 1. ])
    """
    mesh = surface("points", points, "facets", facets)
    _require_linear(mesh, "give the facets of their corners")
    return mesh.node_areas


def _require_linear(mesh: FacetMesh, remedy: str) -> None:
    if mesh.kind.nodes > mesh.kind.corners:
        raise ValueError(
            f"{mesh.name} has facets of the kind {mesh.kind.name}, whose corners have zero "
            f"or negative areas: {remedy}"
        )


def pairs(
    points_slave: ArrayLike,
    facets_slave: ArrayLike,
    points_master: ArrayLike,
    facets_master: ArrayLike,
    *,
    method: str = "mortar",
    distance: float | None = None,
    clearance: ArrayLike | Callable[[Floats], ArrayLike] = 0.0,
    axis: ArrayLike | None = None,
    dofs_slave: ArrayLike | None = None,
    dofs_master: ArrayLike | None = None,
    n: int | None = None,
) -> Pairs:
    """Contacts of two surfaces whose meshes need not match.

    ``"mortar"`` passes the contact patch test: it transmits a constant pressure exactly,
    whichever surface is the slave. ``"nodes"`` puts each slave node on the master facet
    that its normal meets. Forces balance, and moments if there is no gap, but a constant
    pressure acts on the master as point forces of the slave nodes, with errors of some
    tens of per cent from node to node, on every mesh. Either surface may be the slave:
    pressures are smoother with the coarser mesh, penetration between nodes is smaller with
    the finer mesh. Parts of the slave without a master opposite have no contacts.

    Parameters
    ----------
    points_slave, points_master
        Positions of all nodes of a body, or of its surface only, ``(nodes, d)`` [m].
    facets_slave, facets_master
        Nodes of the facets that may touch, ``(facets, c)``: lines of 2 or 3 nodes in 2D,
        triangles of 3 or 6 and quadrilaterals of 4, 8 or 9 nodes in 3D; corners first,
        then midpoints of edges. Normals point out of the body: the body is on the left of
        a line, and triangles and quadrilaterals are counter-clockwise seen from outside.
    method
        ``"mortar"`` or ``"nodes"``. ``"nodes"`` needs linear slave facets: on quadratic
        ones the areas of corners are zero or negative.
    distance
        Largest distance along the normal of the slave at which facets may touch [m];
        default no limit. Facets face each other if their normals are opposite to within
        60°.
    clearance
        Added to the gap [m]: a number, one for each of ``points_slave``, or a function of
        positions ``(m, d)`` on the slave that returns ``(m,)``. Mortar takes the weighted
        mean; values at nodes are interpolated by the shape functions.
    axis
        In 3D, the direction of the tangents t1, as in `fem.frames`.
    dofs_slave, dofs_master, n
        Degrees of freedom ``(nodes, d)`` of the nodes, and their total number. Default
        ``d * node + component``, with the master after the slave.

    Raises
    ------
    ValueError
        Surfaces do not overlap, do not face each other, or are the same; facets are
        degenerate, folded or out of range. The message gives the argument and position.

    Examples
    --------
    >>> upper = [[0, 0], [0.5, 0], [1, 0]]
    >>> lower = [[0, 0], [0.4, 0], [1, 0]]
    >>> found = pairs(upper, [[0, 1], [1, 2]], lower, [[1, 0], [2, 1]])
    >>> found.area
    array([0.25, 0.5 , 0.25])
    """
    if method not in METHODS:
        raise ValueError(
            f"method is {show_value(method)}, expected one of {list(METHODS)}"
        )
    if distance is not None and not number("distance", distance) > 0:
        raise ValueError(f"distance is {distance:g}, expected a number > 0")
    slave = surface("points_slave", points_slave, "facets_slave", facets_slave)
    columns = np.shape(points_master)[1:]
    if columns != (slave.dim,) and len(columns) == 1:
        raise ValueError(
            f"points_master has {columns[0]} coordinates, but points_slave has {slave.dim}"
        )
    master = surface("points_master", points_master, "facets_master", facets_master)
    if not callable(clearance):
        clearance = _clearance(clearance, len(slave.points))
    columns = _columns(slave, dofs_slave, master, dofs_master, n)
    return pair_surfaces(
        slave,
        master,
        method=method,
        distance=distance,
        clearance=clearance,
        axis=axis,
        columns=columns,
    )


def pair_surfaces(
    slave: FacetMesh,
    master: FacetMesh,
    *,
    method: str,
    distance: float | None = None,
    clearance: Floats | Callable[[Floats], ArrayLike],
    axis: ArrayLike | None,
    columns: tuple[Ints, Ints, int],
) -> Pairs:
    """As `pairs`, of checked surfaces, whose names messages take.

    ``columns`` are the degrees of freedom of both, and their total number.
    """
    limit = np.inf if distance is None else distance
    _apart(slave, master)
    function, added = None, np.zeros(())
    if callable(clearance):
        function = clearance
    else:
        added = clearance
    if method == "mortar":
        from bipot_rs.mortar.integrals import integrate, overlaps, weights

        over = overlaps(slave, master, limit)
        if not len(over.slave):
            raise ValueError(_describe_no_pair(slave, master, distance))
        nodal_weights = weights(slave, integrate(slave, over, master, function), master)
    else:
        nodal_weights = _nodes(slave, master, limit, function)
        if not len(nodal_weights.node):
            raise ValueError(_describe_no_pair(slave, master, distance))
    _own_dofs(slave, columns[0], master, columns[1])
    return _assemble_pairs(
        nodal_weights,
        frames(_normals(slave, nodal_weights.node), axis),
        slave,
        master,
        nodal_weights.slave @ added if added.ndim else float(added),
        columns,
    )


def rigid_pairs(
    points: ArrayLike,
    facets: ArrayLike,
    gap: Callable[[Floats], ArrayLike],
    *,
    normal: ArrayLike | Callable[[Floats], ArrayLike] | None = None,
    axis: ArrayLike | None = None,
    dofs: ArrayLike | None = None,
    n: int | None = None,
) -> Pairs:
    """Contacts of a surface with a rigid obstacle, by weighted gaps.

    One contact for each corner of the facets, with the area ``∫ N`` of its corner
    function, which is positive on second-order facets too. Displacements and gaps are
    means weighted by the dual functions of `bipot_rs.mortar.integrals`, so that a constant
    pressure gives consistent nodal forces on facets of every kind.

    Parameters
    ----------
    points, facets
        As ``points_slave``, ``facets_slave`` of `pairs`.
    gap
        Function of positions ``(m, d)`` that returns distances ``(m,)`` from the obstacle
        [m], negative inside it.
    normal
        From the obstacle towards the body: ``(d,)``, or a function of the positions that
        returns ``(m, d)``; default opposite to the normals of the surface.
    axis, dofs, n
        As in `pairs`.
    """
    if not callable(gap):
        raise TypeError(
            f"gap is {show_value(gap)}, expected a function of positions that returns distances"
        )
    slave = surface("points", points, "facets", facets)
    weights_of_nodes = weigh_surface(slave, gap)
    places = slave.points[weights_of_nodes.node]
    if normal is None:
        normals = _normals(slave, weights_of_nodes.node)
    else:
        given = normal(places) if callable(normal) else normal
        given = shaped("normal", given, (slave.dim,), places.shape)
        normals = np.broadcast_to(given, places.shape)
    return make_rigid_pairs(
        slave, weights_of_nodes, normals, axis, _columns(slave, dofs, None, None, n)
    )


def weigh_surface(
    slave: FacetMesh, fields: Callable[[Floats], ArrayLike] | None = None
) -> Weights:
    """The contacts of a surface with a rigid obstacle, and weighted means of fields.

    ``fields`` is a function of positions ``(m, d)`` that returns ``(m,)`` or, for several
    fields, ``(m, fields)``.
    """
    from bipot_rs.mortar.integrals import integrate, weights, whole

    return weights(slave, integrate(slave, whole(slave), None, fields), None)


def make_rigid_pairs(
    slave: FacetMesh,
    weighed: Weights,
    normals: Floats,
    axis: ArrayLike | None,
    columns: tuple[Ints, Ints, int],
) -> Pairs:
    """The pairs of `weigh_surface`, whose first field is the gap.

    ``normals (n_c, d)`` point from the obstacle to the nodes of the contacts.
    """
    return _assemble_pairs(weighed, frames(normals, axis), slave, None, 0.0, columns)


def _clearance(value: ArrayLike, nodes: int) -> Floats:
    clearances = floats("clearance", value)
    if clearances.shape not in ((), (nodes,)):
        raise ValueError(
            f"clearance has shape {clearances.shape}, expected a number, or ({nodes},): one "
            "for each of points_slave"
        )
    return clearances


def _own_dofs(slave: FacetMesh, ours: Ints, master: FacetMesh, theirs: Ints) -> None:
    """Refuse a degree of freedom shared by two nodes at different positions."""
    own_nodes, other = np.unique(slave.facets), np.unique(master.facets)
    number_of = np.full(max(int(ours.max()), int(theirs.max())) + 1, -1, np.int64)
    number_of[ours[own_nodes]] = own_nodes[:, None]
    same = number_of[theirs[other]]
    at = np.argwhere(same >= 0)
    if not at.size:
        return
    node, partner = other[at[:, 0]], same[tuple(at.T)]
    apart = np.linalg.norm(master.points[node] - slave.points[partner], axis=1)
    # At the end of a slit the two surfaces of one body share a node.
    size = max(slave.radius.max(), master.radius.max())
    wrong = apart > _RIM * size
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"dofs_master gives node {node[k]} the degree of freedom "
            f"{theirs[node[k], at[k, 1]]}, which dofs_slave gives node {partner[k]} at "
            f"another position, {apart[k]:g} away: number them separately"
        )


def _normals(slave: FacetMesh, node: Ints) -> Floats:
    """Normals from the obstacle towards the slave, at slave nodes."""
    normals = -slave.node_normals[node]
    size = slave.node_areas[node]
    # The mean normal of opposite facets is rounding.
    thin = np.linalg.norm(normals, axis=1) <= 1e-8 * size
    if thin.any():
        at = int(node[np.argmax(thin)])
        raise ValueError(
            f"{slave.name} has no normal at node {at}: its facets there have opposite "
            "normals; leave out those of one side"
        )
    return np.asarray(normals)


def _apart(slave: FacetMesh, master: FacetMesh) -> None:
    """Refuse a surface in contact with itself."""
    if not np.array_equal(slave.points, master.points):
        return
    ours = {tuple(sorted(f)): i for i, f in enumerate(slave.facets.tolist())}
    for i, facet in enumerate(master.facets.tolist()):
        if tuple(sorted(facet)) in ours:
            raise ValueError(
                f"{master.name} has facet {i}, which is facet {ours[tuple(sorted(facet))]} "
                f"of {slave.name} on the same points: a surface cannot meet itself"
            )


def _describe_no_pair(
    slave: FacetMesh, master: FacetMesh, distance: float | None
) -> str:
    """Message: why no facet of the slave meets a facet of the master."""
    from scipy.spatial import cKDTree

    far, which = cKDTree(master.centre).query(slave.centre)
    at = int(np.argmin(far))
    cosine = np.einsum("kd,kd->k", slave.normals, master.normals[which])
    near = (
        f"the nearest facets are {at} of {slave.name}, at {place(slave.centre[at])}, "
        f"and {which[at]} of {master.name}, {far[at]:g} apart"
    )
    if (cosine > -1e-9).all():
        return (
            f"{slave.name} and {master.name} do not face each other: {near}, and the "
            f"cosine of their normals is {cosine[at]:.2f}, expected about "
            "-1; normals must point out of the bodies"
        )
    along = slave.normals[at] @ (master.centre[which[at]] - slave.centre[at])
    if distance is not None and abs(along) > distance:
        return (
            f"{slave.name} and {master.name} are farther apart than distance {distance:g}: "
            f"{near}, {abs(along):g} along the normal"
        )
    return (
        f"{slave.name} and {master.name} do not overlap: {near}, and no normal of one "
        "meets the other; check positions and the choice of facets"
    )


def _nodes(
    slave: FacetMesh,
    master: FacetMesh,
    limit: float,
    clearance: Callable[[Floats], ArrayLike] | None,
) -> Weights:
    """Put each slave node on the first master facet that its normal meets."""
    from scipy import sparse

    from bipot_rs.mortar.integrals import Weights

    _require_linear(slave, "use method='mortar', or linear facets")
    area = slave.node_areas
    node = np.flatnonzero(area > 0)
    normals = slave.node_normals[node]
    length = np.linalg.norm(normals, axis=1)
    seen = length > 1e-8 * area[node]
    node, normals = node[seen], normals[seen] / length[seen, None]
    places = slave.points[node]
    k, m = candidates(places, np.zeros(len(node)), normals, master, limit)
    offset = master.points[master.corners[m]] - places[k][:, None]
    flat = np.einsum("pkd,pcd->pck", bases(normals)[k], offset)
    if slave.dim == 2:
        start, end = flat[:, 0], flat[:, 1]
        xi = -start / (end - start)
        inside = ((xi >= -_RIM) & (xi <= 1 + _RIM)).all(axis=1)
    else:
        # Far outside a quadrilateral its reference coordinates are meaningless.
        box = (np.abs(flat).max(axis=2) >= 0).all(axis=1)
        box &= (flat.min(axis=1) <= _RIM * master.radius[m, None]).all(axis=1)
        box &= (flat.max(axis=1) >= -_RIM * master.radius[m, None]).all(axis=1)
        k, m, flat = k[box], m[box], flat[box]
        xi = reference(flat, np.zeros((len(flat), 1, 2)))[:, 0]
        if master.kind.corners == 3:
            inside = (xi >= -_RIM).all(axis=1) & (xi.sum(axis=1) <= 1 + _RIM)
        else:
            inside = (np.abs(xi) <= 1 + _RIM).all(axis=1)
    k, m, xi = k[inside], m[inside], xi[inside]
    phi = master.kind.shapes(xi)
    opposite = np.einsum("pj,pjd->pd", phi, master.points[master.facets[m]])
    away = np.abs(np.einsum("pd,pd->p", normals[k], opposite - places[k]))
    near = away <= limit
    k, m, phi, away = k[near], m[near], phi[near], away[near]
    order = np.lexsort([m, away, k])
    _, first = np.unique(k[order], return_index=True)
    k, m, phi = (x[order[first]] for x in (k, m, phi))
    rows = np.broadcast_to(np.arange(len(k))[:, None], phi.shape)
    other = sparse.coo_array(
        (phi.ravel(), (rows.ravel(), master.facets[m].ravel())),
        shape=(len(k), len(master.points)),
    ).tocsr()
    other.eliminate_zeros()
    own_part = sparse.csr_array(
        (np.ones(len(k)), (np.arange(len(k)), node[k])),
        shape=(len(k), len(slave.points)),
    )
    means = np.zeros((0, len(k)))
    if clearance is not None:
        what = "clearance at the places"
        means = floats(what, clearance(places[k]), shape=(len(k),))[None]
    return Weights(node[k], np.asarray(area[node[k]]), own_part, other, means)


def _columns(
    slave: FacetMesh,
    dofs_slave: ArrayLike | None,
    master: FacetMesh | None,
    dofs_master: ArrayLike | None,
    n: int | None,
) -> tuple[Ints, Ints, int]:
    """Degrees of freedom of slave and master nodes, and their total number."""
    d, count = slave.dim, len(slave.points)
    others = 0 if master is None else len(master.points)
    are_given = [dofs_slave is not None, dofs_master is not None or master is None]
    if dofs_slave is None and (dofs_master is None or master is None) and n is None:
        everything = np.arange(d * (count + others)).reshape(-1, d)
        return everything[:count], everything[count:], d * (count + others)
    if not all(are_given) or n is None:
        names = "dofs" if master is None else "dofs_slave, dofs_master"
        raise ValueError(
            f"degrees of freedom are given in part, expected {names} of all nodes and their "
            "total number n"
        )
    ours = _dofs("dofs_slave" if master else "dofs", dofs_slave, (count, d), n)
    if master is None:
        return ours, np.zeros((0, d), np.int64), n
    return ours, _dofs("dofs_master", dofs_master, (others, d), n), n


def _dofs(what: str, value: object, shape: tuple[int, int], n: int) -> Ints:
    dofs = integers(what, value)
    if dofs.shape != shape:
        raise ValueError(f"{what} has shape {dofs.shape}, expected {shape}")
    if dofs.size and not (dofs.min() >= 0 and dofs.max() < n):
        bad = int(dofs.max() if dofs.min() >= 0 else dofs.min())
        raise ValueError(f"{what} has entry {bad}, expected 0 to {n - 1}")
    return np.array(dofs, dtype=np.int64)


def _assemble_pairs(
    weighed: Weights,
    frame: Floats,
    slave: FacetMesh,
    master: FacetMesh | None,
    clearance: Floats | float,
    columns: tuple[Ints, Ints, int],
) -> Pairs:
    """Components along the frames, and the gaps of the undeformed positions."""
    dofs_slave, dofs_master, n = columns
    # Relative to one of the points: far from the origin the gap would lose digits.
    origin = slave.points[weighed.node[0]]
    gap = clearance + (weighed.clearance[0] if len(weighed.clearance) else 0.0)
    B = expand(weighed.slave, frame, dofs_slave, n)
    if master is not None:
        apart = weighed.slave @ (slave.points - origin)
        apart = apart - weighed.master @ (master.points - origin)
        gap = gap + np.einsum("cd,cd->c", frame[:, 0], apart)
        B = (B - expand(weighed.master, frame, dofs_master, n)).tocsr()
    return Pairs(
        B=B,
        gap=np.asarray(gap),
        area=weighed.area,
        points=np.ascontiguousarray(slave.points[weighed.node]),
        frame=frame,
        node=weighed.node,
        slave=weighed.slave,
        master=weighed.master,
        facets=_facets(slave, weighed.node),
    )


def _facets(slave: FacetMesh, node: Ints) -> Ints:
    """Facets of the slave in numbers of contacts ``(m, k)``; -1 for other nodes."""
    number = np.full(len(slave.points), -1, np.int64)
    number[node] = np.arange(len(node))
    facets = number[slave.facets]
    corners = slave.kind.corners
    facets = facets[(facets[:, :corners] >= 0).all(axis=1)]
    # Some midpoints alone would be no facet of any kind.
    facets[(facets < 0).any(axis=1), corners:] = -1
    return facets


def expand(weights: CsrMatrix, frame: Floats, dofs: Ints, n: int) -> CsrMatrix:
    """CSR ``(d n_c, n)`` with blocks ``w_ij frame_i`` from weights ``(n_c, nodes)``."""
    from scipy import sparse

    count, d = frame.shape[:2]
    entries = weights.tocoo()
    row, column = entries.row.astype(np.int64), entries.col
    blocks = entries.data[:, None, None] * frame[row]
    rows = np.broadcast_to(d * row[:, None, None] + np.arange(d)[:, None], blocks.shape)
    columns = np.broadcast_to(dofs[column][:, None], blocks.shape)
    matrix: CsrMatrix = sparse.coo_array(
        (blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(d * count, n)
    ).tocsr()
    matrix.eliminate_zeros()
    return matrix
