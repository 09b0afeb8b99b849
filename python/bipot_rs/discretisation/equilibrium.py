"""Stresses in exact equilibrium with the loads on each element.

Facet tractions are computed from a displacement of linear triangles or tetrahedra, node by node, by
the prolongation condition of Ladeveze and Leguillon (1983): on every cell T with corners i

    Σ_F ∫_F φ_i t_T dA  =  ∫_T σ_h ∇φ_i dV - ∫_T φ_i f dV,                            (P)

over the facets of T with corner i, where ``t_T = ± t_F`` and t_F is the traction of the
facet. The sum of (P) over the corners, weighted by a rigid motion, is the equilibrium of
forces and torques of T. The sum over the cells around i is the finite-element equation of
node i; therefore a solution exists. The one nearest to the mean traction of the two cells
is used.

On elongated cells the energy of these tractions may be thousands of times the minimum.
Self-stresses that are linear on facets and in equilibrium on every cell are spanned by two
kinds of functions:

- on one facet, two opposite forces along one of its edges;
- around a ring of cells (about a vertex in 2D, an edge in 3D), one force and one torque that
  each facet of the ring transmits to the next.

Conjugate gradients in their amplitudes reduce the complementary energy. Equilibrium stays
exact after any number of iterations.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from scipy import sparse

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs.discretisation import johnson_mercier
from bipot_rs.discretisation.simplices import Simplices, elastic, error_energy, pairs
from bipot_rs.discretisation.tuning import ENOUGH, MOST_ITERATIONS, WINDOW
from bipot_rs.fem.bodies.materials import Material


def moments(
    cells: Simplices, stress: Floats, body_force: Floats, given: Floats, known_at: Bools
) -> Floats:
    """Moments ``∫_F φ_i t_F`` of tractions that satisfy (P), ``(facets, d nodes, d)``.

    ``cells``: the body.
    ``stress``: stress of the finite elements, ``(cells, d, d)``, in equilibrium at the nodes
    with the following loads.
    ``body_force``: ``(cells, d)``, force per volume.
    ``given``: moments of the tractions on boundary facets, ``(facets, d nodes, d)``.
    ``known_at``: mask of given components, ``(facets, d)``: false for prescribed displacements and
    for interior facets.
    Raises `ValueError`: no tractions can balance the force at a node: a component is prescribed
    at the node, but on no facet with this node.
    """
    dim = cells.dim
    # Right-hand side of (P).
    asked = cells.volume[:, None, None] * (
        np.einsum("cij,caj->cai", stress, cells.gradients)
        - body_force[:, None] / (dim + 1)
    )
    size = cells.size
    guess = np.zeros((len(size), dim))
    # Mean traction of the two cells of an interior facet; that of the cell of a boundary one.
    np.add.at(
        guess,
        cells.facet_of,
        np.einsum("cij,ckj->cki", stress, cells.area[cells.facet_of]),
    )
    guess *= np.where(cells.outside, 1.0, 0.5)[:, None] / dim
    values = np.where(known_at[:, None], given, guess[:, None])
    local = pairs(dim)
    key, sign = cells.local_moments()
    facet, at = np.divmod(key, dim)
    rest = asked.copy()
    for p, (_, a) in enumerate(local):
        rest[:, a] -= sign[:, p, None] * values[facet[:, p], at[:, p]]

    # Minimise the squared changes of moments over the area, as those of tractions.
    free = np.where(known_at, 0.0, size[:, None])
    shift = _potentials(cells, free, rest)
    for p, (_, a) in enumerate(local):
        # An interior facet is visited from both its cells, and gets the difference.
        change = sign[:, p, None] * free[facet[:, p]] * shift[:, a]
        np.add.at(values, (facet[:, p], at[:, p]), change)
    _check(cells, asked, values)
    return values


def _potentials(cells: Simplices, free: Floats, rest: Floats) -> Floats:
    """Multipliers of (P) at the corners of cells, ``(cells, d + 1, d)``.

    The cells around a node form a graph, with an edge for each facet between two of them
    and an open end for each boundary facet. A change of moment is ``free`` times the
    difference of the multipliers of its cells; the changes of a cell add up to ``rest``.
    """
    dim, corners = cells.dim, cells.corners
    corner = np.array([a for _, a in pairs(dim)])
    facet_node, _ = cells.local_moments()
    flat = corners.ravel()
    order = np.argsort(flat, kind="stable")
    many = np.bincount(flat, minlength=len(cells.points))
    start = np.concatenate([[0], np.cumsum(many)])[:-1]
    # Number of each cell in the graph of each of its corners.
    rank = np.empty(flat.size, dtype=np.int64)
    rank[order] = np.arange(flat.size) - np.repeat(start, many)
    mine = rank.reshape(corners.shape)[:, corner].ravel()
    # The other cell of a facet is the sum of both minus this one.
    ends = facet_node.ravel()
    total = np.bincount(ends, mine, minlength=cells.facets.size)
    shared = ~cells.outside[ends // dim]
    other = np.where(shared, total[ends] - mine, mine).astype(np.int64)
    node = corners[:, corner].ravel()
    potentials = np.zeros((flat.size, dim))
    # Graphs of equal size are solved together.
    for n in np.unique(many[many > 0]):
        nodes = np.flatnonzero(many == n)
        index = np.full(len(many), -1)
        index[nodes] = np.arange(len(nodes))
        here = np.flatnonzero(many[node] == n)
        which = index[node[here]]
        row = (which * n + mine[here]) * n
        whose = order[(start[nodes][:, None] + np.arange(n)).ravel()]
        right = rest.reshape(-1, dim)[whose].reshape(len(nodes), n, dim)
        for k in range(dim):
            weight = free[ends[here] // dim, k]
            inside = np.where(shared[here], weight, 0.0)
            entries = len(nodes) * n * n
            graph = np.bincount(row + mine[here], weight, entries)
            graph -= np.bincount(row + other[here], inside, entries)
            graph = graph.reshape(len(nodes), n, n)
            open_ends = np.bincount(which, weight - inside, len(nodes))
            # Without an open end the equations add up to that of the node; a common shift
            # of all multipliers is then free.
            scale = np.trace(graph, axis1=1, axis2=2) / n
            scale = np.where(scale > 0, scale, 1.0)
            graph += np.where(open_ends > 0, 0.0, scale)[:, None, None] / n
            potentials[whose, k] = np.linalg.solve(graph, right[:, :, k, None]).ravel()
    return potentials.reshape(*corners.shape, dim)


def _check(cells: Simplices, asked: Floats, of_facets: Floats) -> None:
    left, terms = asked.copy(), np.abs(asked)
    for k, a in pairs(cells.dim):
        moment = of_facets[cells.facet_of[:, k], cells.place[:, k, a]]
        left[:, a] -= cells.sign[:, k, None] * moment
        terms[:, a] += np.abs(moment)
    # Equations of nodes are satisfied up to the rounding of a factorisation, while an
    # unbalanced force leaves a residual of its own size. The reference is the largest
    # moment: it determines the rounding in all cells.
    bad = np.abs(left).max(axis=2)
    worst = np.unravel_index(int(np.argmax(bad)), bad.shape)
    if bad[worst] > 1e-6 * terms.max():
        where = place(cells.points[cells.corners[worst]])
        raise ValueError(
            f"no tractions balance the forces at the node at {where}: a displacement is "
            "prescribed at this node, but on no whole facet with this node; support a facet"
        )


# A force on a given component of traction is either of the size of the others or rounding.
_NONE = 1e-12
# Added to the diagonal, scaled to one, of a singular matrix to make it definite.
_SLACK = 1e-10
_TINY = np.finfo(np.float64).tiny


class SelfStress:
    """Self-stresses of one body, and their energy.

    ``cells, material``: the body.
    ``free``: mask of components of facets that may change, ``(facets, d)``.
    """

    def __init__(self, cells: Simplices, material: Material, free: Bools) -> None:
        self.cells, self.material = cells, material
        functions = _Functions(cells, free)
        energy = _energy_matrices(cells, material)
        self._H, self._Z = _assemble_energy(cells, energy), functions.matrix()
        self._precondition = (
            _factor(self._Z, self._H)
            if cells.dim == 2
            else functions.preconditioner(energy)
        )

    def relax(self, moments: Floats, displacement: Floats, stress: Floats) -> Floats:
        """Reduce ``½ ∫ (σ̂ - σ) : C⁻¹ (σ̂ - σ) dV`` over σ̂ in equilibrium.

        ``moments``: moments of tractions in equilibrium, ``(facets, d nodes, d)``.
        ``displacement, stress``: u at the nodes, ``(nodes, d)``, and its σ, ``(cells, d, d)``.
        Returns ``moments``: moments of tractions in equilibrium with the same loads, with less
        energy.
        """
        cells, H, Z = self.cells, self._H, self._Z
        # ∫ σ̂ : ε(u) dV is the work of boundary tractions and loads on u; the work on
        # interior facets cancels.
        outward = np.zeros(len(cells.facets))
        np.add.at(outward, cells.facet_of, cells.sign)
        at_nodes = displacement[cells.facets] * outward[:, None, None]
        work = np.where(cells.outside[:, None, None], at_nodes, 0.0)

        hat = johnson_mercier.stress(
            cells.edges, cells.gradients, cells.by_cell(moments)
        )
        missing = hat - stress[:, None, None]
        left = float(error_energy(cells, self.material, missing).sum())
        # In 2D the preconditioner is a factorisation: one iteration is almost exact.
        last = 1 if cells.dim == 2 else WINDOW
        m = moments.ravel().copy()
        rest = Z.T @ (work.ravel() - H @ m)
        direction = better = self._precondition(rest)
        size = float(rest @ better)
        gains: list[float] = []
        while size > 0 and len(gains) < MOST_ITERATIONS:
            change = Z @ direction
            bent = H @ change
            stiffness = float(change @ bent)
            if stiffness <= 0:
                break
            length = size / stiffness
            m += length * change
            gains.append(0.5 * length * size)
            left -= gains[-1]
            if len(gains) >= last and sum(gains[-last:]) <= ENOUGH * left:
                break
            rest = rest - length * (Z.T @ bent)
            better = self._precondition(rest)
            size, before = float(rest @ better), size
            direction = better + size / before * direction
        return m.reshape(moments.shape)


def _assemble_energy(cells: Simplices, energy: Floats) -> CsrMatrix:
    """``∫ σ̂ : C⁻¹ σ̂ dV`` of the body as a matrix of all moments."""
    place, sign = cells.local_moments()
    flat = (place[:, :, None] * cells.dim + np.arange(cells.dim)).reshape(
        len(place), -1
    )
    sign = np.repeat(sign, cells.dim, axis=1)
    n = cells.facets.size * cells.dim
    data = energy * sign[:, :, None] * sign[:, None, :]
    row = np.repeat(flat, flat.shape[1], axis=1)
    column = np.tile(flat, (1, flat.shape[1]))
    made: CsrMatrix = sparse.coo_array(
        (data.ravel(), (row.ravel(), column.ravel())), shape=(n, n)
    ).tocsr()
    return made


def _factor(Z: CsrMatrix, H: CsrMatrix) -> Callable[[Floats], Floats]:
    """Approximate inverse of ``Zᵀ H Z``, whose columns may be linearly dependent."""
    from scipy.sparse.linalg import splu

    S = (Z.T @ (H @ Z)).tocsc()
    diagonal = S.diagonal()
    # Columns are scaled to one; a zero column gets the pivot 1.
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.maximum(diagonal, _TINY)), 0.0)
    D = diagonal_matrix(scale)
    pivot = np.where(scale > 0, _SLACK, 1.0)
    factor = splu(
        (D @ S @ D + diagonal_matrix(pivot)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return lambda rest: scale * factor.solve(scale * rest)


class _Functions:
    """The self-stress functions by facet; amplitudes are ``[facets, rings]``, flat.

    ``own (facets, d, d, k)`` and ``passed (facets, d rings, d, d, w)`` are the moments at
    the nodes by component; ring r of a facet is opposite to its node r.
    """

    def __init__(self, cells: Simplices, free: Bools) -> None:
        self.cells = cells
        dim, facets, x = cells.dim, cells.facets, cells.points[cells.facets]
        ends = list(combinations(range(dim), 2))
        self.own = np.zeros((len(facets), dim, dim, len(ends)))
        for e, (a, b) in enumerate(ends):
            along = x[:, a] - x[:, b]
            along /= np.linalg.norm(along, axis=1)[:, None]
            self.own[:, a, :, e], self.own[:, b, :, e] = along, -along
        forbidden = ~free
        pull = np.abs(np.where(forbidden[:, None, :, None], self.own, 0.0))
        self.own *= (pull.max(axis=(1, 2)) <= _NONE)[:, None, None]
        self.own[np.broadcast_to(forbidden[:, None, :, None], self.own.shape)] = 0.0

        rings = np.stack([np.delete(facets, r, axis=1) for r in range(dim)], axis=1)
        rings = np.sort(rings, axis=2)
        names, ring = np.unique(rings.reshape(-1, dim - 1), axis=0, return_inverse=True)
        self.ring: Ints = ring.reshape(len(facets), dim)
        self.rings = len(names)
        self.passed = self._wrenches(names, x)
        self._forbid(forbidden)

    def _wrenches(self, names: Ints, x: Floats) -> Floats:
        """Moments of a force and of a torque about the centre of each ring."""
        cells, dim = self.cells, self.cells.dim
        spins = _spins(dim)
        middle = x.mean(axis=1)
        arms = x - middle[:, None]
        turned = np.einsum("kij,faj->faki", spins, arms)
        inertia = np.einsum("faki,fali->fkl", turned, turned)
        centre = cells.points[names].mean(axis=1)
        size = cells.size ** (1 / (dim - 1))
        total = np.bincount(
            self.ring.ravel(), np.repeat(size, dim), minlength=self.rings
        )
        length = total / np.bincount(self.ring.ravel(), minlength=self.rings)
        passed = np.zeros((len(x), dim, dim, dim, dim + len(spins)))
        for r in range(dim):
            at = self.ring[:, r]
            out = x[:, r] - centre[at]
            if dim == 2:
                around = np.einsum("ij,fj->fi", spins[0], out)
            else:
                axis = cells.points[names[at, 1]] - cells.points[names[at, 0]]
                around = np.cross(axis, out)
            sense = np.where(np.einsum("fi,fi->f", around, cells.area) > 0, 1.0, -1.0)
            # Torques about the centre of the facet for a wrench about that of the ring.
            offset = np.einsum("kij,fj->fki", spins, middle - centre[at])
            torque = np.concatenate(
                [
                    -offset,
                    np.broadcast_to(np.eye(len(spins)), (len(x),) + 2 * (len(spins),))
                    * length[at][:, None, None],
                ],
                axis=2,
            )
            rate = np.linalg.solve(inertia, torque)
            field = np.einsum("faki,fkw->faiw", turned, rate)
            field[..., :dim] += np.eye(dim) / dim
            passed[:, r] = sense[:, None, None, None] * field
        return passed

    def _forbid(self, forbidden: Bools) -> None:
        """Remove the functions of rings that act on given components of tractions."""
        bounded = np.flatnonzero(forbidden.any(axis=1))
        if not bounded.size:
            return
        rows = np.where(
            forbidden[bounded][:, None, None, :, None], self.passed[bounded], 0.0
        )
        count = rows.shape[-1]
        at = self.ring[bounded]
        blocks = np.einsum("fraiw,fraiv->frwv", rows, rows)
        gram = np.zeros((self.rings, count, count))
        np.add.at(gram, at, blocks)
        touched = np.unique(at)
        _, basis = np.linalg.eigh(gram[touched])
        turn = np.broadcast_to(np.eye(count), gram.shape).copy()
        turn[touched] = basis
        self.passed = np.einsum("fraiw,frwv->fraiv", self.passed, turn[self.ring])
        held = np.where(
            forbidden[bounded][:, None, None, :, None], self.passed[bounded], 0.0
        )
        worst = np.zeros((self.rings, count))
        np.maximum.at(worst, at, np.abs(held).max(axis=(2, 3)))
        self.passed *= (worst <= _NONE)[self.ring][:, :, None, None]
        shape = self.passed.shape
        self.passed[np.broadcast_to(forbidden[:, None, None, :, None], shape)] = 0.0

    def matrix(self) -> CsrMatrix:
        """Matrix from amplitudes to moments, flat."""
        dim, count = self.cells.dim, len(self.own)
        size = dim * dim
        row = np.arange(count * size).reshape(count, size, 1)
        k, w = self.own.shape[-1], self.passed.shape[-1]
        functions = self.own.reshape(count, size, k)
        column = np.arange(count * k).reshape(count, 1, k)
        parts = [(functions, row, column)]
        for r in range(dim):
            column = count * k + self.ring[:, r, None, None] * w + np.arange(w)
            parts.append((self.passed[:, r].reshape(count, size, w), row, column))
        data, rows, columns = (
            np.concatenate([np.broadcast_to(p[i], p[0].shape).ravel() for p in parts])
            for i in range(3)
        )
        shape = (count * size, count * k + self.rings * w)
        matrix: CsrMatrix = sparse.coo_array(
            (data, (rows, columns)), shape=shape
        ).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def preconditioner(self, energy: Floats) -> Callable[[Floats], Floats]:
        """Block-diagonal preconditioner: the blocks of single facets and rings, inverted."""
        cells, dim = self.cells, self.cells.dim
        blocks = energy.reshape(len(energy), dim + 1, dim * dim, dim + 1, dim * dim)
        # Corners of the facet opposite to corner k, in the order of the cell.
        corner = [[a for a in range(dim + 1) if a != k] for k in range(dim + 1)]
        facet = np.zeros((len(self.own), self.own.shape[-1], self.own.shape[-1]))
        ring = np.zeros((self.rings, self.passed.shape[-1], self.passed.shape[-1]))
        local = []
        for k in range(dim + 1):
            f, at = cells.facet_of[:, k], cells.place[:, k][:, corner[k]]
            functions = np.take_along_axis(self.own[f], at[:, :, None, None], axis=1)
            functions = functions.reshape(len(f), dim * dim, -1)
            np.add.at(
                facet, f, functions.swapaxes(1, 2) @ blocks[:, k, :, k] @ functions
            )
            passed = np.take_along_axis(
                self.passed[f], at[:, None, :, None, None], axis=2
            )
            passed = passed * cells.sign[:, k, None, None, None, None]
            local.append(passed.reshape(len(f), dim, dim * dim, -1))
        every = np.arange(len(energy))
        for k, m in combinations(range(dim + 1), 2):
            # The ring about all corners except k and m has two facets in this cell.
            rk, rm = cells.place[:, k, m], cells.place[:, m, k]
            zk, zm = local[k][every, rk], local[m][every, rm]
            both = np.concatenate([zk, zm], axis=1)
            part = blocks[:, [k, m]][:, :, :, [k, m]].reshape(
                len(energy), *2 * (2 * dim * dim,)
            )
            at_ring = self.ring[cells.facet_of[:, k], rk]
            np.add.at(ring, at_ring, both.swapaxes(1, 2) @ part @ both)
        inverse = [
            np.linalg.pinv(b, rcond=1e-10, hermitian=True) for b in (facet, ring)
        ]

        def apply(rest: Floats) -> Floats:
            k = self.own.shape[-1]
            cut = len(self.own) * k
            parts = rest[:cut].reshape(-1, k), rest[cut:].reshape(self.rings, -1)
            solved = [
                np.matmul(i, p[..., None]).ravel()
                for i, p in zip(inverse, parts, strict=True)
            ]
            return np.concatenate(solved)

        return apply


def _spins(dim: int) -> Floats:
    """Generators of rotations: ``spins[k] @ r`` is the velocity at r."""
    spins = np.zeros((1 if dim == 2 else 3, dim, dim))
    for spin, (i, j) in zip(spins, combinations(range(dim), 2), strict=True):
        spin[i, j], spin[j, i] = -1.0, 1.0
    return spins


def _energy_matrices(cells: Simplices, material: Material) -> Floats:
    """Q with ``∫ σ̂ : C⁻¹ σ̂ dV = mᵀ Q m`` for each cell, m outward in the order of `pairs`."""
    dim = cells.dim
    basis = [(i, j) for i in range(dim) for j in range(i, dim)]
    unit = np.zeros((len(basis), dim, dim))
    for matrix, (i, j) in zip(unit, basis, strict=True):
        matrix[i, j] = matrix[j, i] = 1.0
    k, a = np.array(pairs(dim)).T
    operator = johnson_mercier.operator(dim)[..., k, a, :]
    operator = np.stack([operator[:, :, i, j] for i, j in basis])
    operator = operator.reshape(len(basis), dim + 1, dim + 1, -1)
    mean = operator.sum(axis=2)
    mass = np.einsum("xpqm,ypqn->xymn", operator, operator)
    mass += np.einsum("xpm,ypn->xymn", mean, mean)
    mass /= (dim + 1) ** 2 * (dim + 2)
    edges, gradients = cells.edges, cells.gradients[:, 1:]
    stress = np.einsum("cij,xjk,clk->cxil", edges, unit, edges)
    stress /= np.abs(np.linalg.det(edges))[:, None, None, None]
    soft = np.linalg.inv(_tensor(material, dim))
    flat = stress.reshape(len(stress), len(basis), -1)
    metric = (flat @ soft @ flat.swapaxes(1, 2)) * cells.volume[:, None, None]
    rows = len(k) * dim
    energies = metric.reshape(len(stress), -1) @ mass.reshape(len(basis) ** 2, -1)
    energies = energies.reshape(-1, len(k), dim, len(k), dim)
    # Forces on the reference cell are J⁻¹ times the physical forces.
    energies = np.einsum(
        "cmi,cpmqn,cnj->cpiqj", gradients, energies, gradients, optimize=True
    )
    return np.ascontiguousarray(energies.reshape(-1, rows, rows))


def _tensor(material: Material, dim: int) -> Floats:
    """C as a matrix for d² components, extended to be definite on antisymmetric ones."""
    unit = np.eye(dim * dim).reshape(-1, dim, dim)
    symmetric = 0.5 * (unit + unit.swapaxes(1, 2))
    turned = 2 * material.lame(dim)[1] * (unit - symmetric)
    return (elastic(material, symmetric) + turned).reshape(dim * dim, -1)
