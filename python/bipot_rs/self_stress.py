"""Less energy for stresses in equilibrium: forces that a body carries without loads.

Tractions that obey (P) of `equilibrium` are in equilibrium, and few of those that are: on
stretched cells they may hold thousands of times the least energy. What may be added, linear
on facets and in balance on every cell, is spanned by two kinds of functions:

- on one facet, forces at the ends of one of its edges that pull against each other;
- around a ring of cells (about a vertex in the plane, an edge in space), one force and one
  torque that every facet of the ring passes on to the next.

Conjugate gradients in their amounts lower the complementary energy step by step; after any
number of steps equilibrium is as exact as before.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bipot_rs import johnson_mercier
from bipot_rs.elasticity import Floats, Ints, Material
from bipot_rs.simplices import Simplices, elastic, error_energy, pairs

# The energy is asked for two digits: it is done when as many steps as `_LAST` together
# gain less than this.
_ENOUGH, _LAST, _MOST = 0.01, 8, 500
# Forces that a given component of traction would have to carry are either of the size of
# all others or rounding.
_NONE = 1e-12


def relax(
    cells: Simplices,
    material: Material,
    moments: Floats,
    free: NDArray[np.bool_],
    displacement: Floats,
    stress: Floats,
) -> tuple[Floats, int]:
    """Lower ``½ ∫ (σ̂ - σ) : C⁻¹ (σ̂ - σ) dV`` over σ̂ in equilibrium.

    Parameters
    ----------
    cells, material
        The body.
    moments
        Of tractions in equilibrium, ``(facets, d nodes, d)``.
    free
        Components of facets that may change, ``(facets, d)``.
    displacement, stress
        u at the nodes, ``(nodes, d)``, and its σ, ``(cells, d, d)``.

    Returns
    -------
    moments, steps
        Those of less energy, and in how many steps.
    """
    functions = _Functions(cells, free)
    energy = _energy_matrices(cells, material)
    place, sign = cells.local_moments()
    flat = (place[:, :, None] * cells.dim + np.arange(cells.dim)).reshape(len(place), -1)
    sign = np.repeat(sign, cells.dim, axis=1)

    def slope(m: Floats) -> Floats:
        local = sign * np.matmul(energy, (sign * m.ravel()[flat])[..., None])[..., 0]
        total = np.bincount(flat.ravel(), local.ravel(), minlength=m.size)
        return np.asarray(total, dtype=np.float64).reshape(m.shape)

    # ∫ σ̂ : ε(u) dV is what facets outside and loads do on u; inside it cancels.
    outward = np.zeros(len(cells.facets))
    np.add.at(outward, cells.facet_of, cells.sign)
    at_nodes = displacement[cells.facets] * outward[:, None, None]
    work = np.where(cells.outside[:, None, None], at_nodes, 0.0)

    hat = johnson_mercier.stress(cells.edges, cells.gradients, cells.by_cell(moments))
    left = float(error_energy(cells, material, hat - stress[:, None, None]).sum())
    precondition = functions.preconditioner(energy)
    m = moments.copy()
    rest = functions.transposed(work - slope(m))
    direction = better = precondition(rest)
    size = float(rest @ better)
    gains: list[float] = []
    while size > 0 and len(gains) < _MOST:
        change = functions.moments(direction)
        bent = slope(change)
        stiffness = float(np.vdot(change, bent))
        if stiffness <= 0:
            break
        length = size / stiffness
        m += length * change
        gains.append(0.5 * length * size)
        left -= gains[-1]
        if sum(gains[-_LAST:]) <= _ENOUGH * left and len(gains) >= _LAST:
            break
        rest = rest - length * functions.transposed(bent)
        better = precondition(rest)
        size, before = float(rest @ better), size
        direction = better + size / before * direction
    return m, len(gains)


class _Functions:
    """The functions, facet by facet; amounts ``[of facets, of rings]``, flat.

    ``own (facets, d, d, k)`` and ``passed (facets, d rings, d, d, w)`` are moments at the
    nodes by component; ring r of a facet is opposite to its node r.
    """

    def __init__(self, cells: Simplices, free: NDArray[np.bool_]) -> None:
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
        """Moments of a force and a torque about the middle of each ring."""
        cells, dim = self.cells, self.cells.dim
        spins = _spins(dim)
        middle = x.mean(axis=1)
        arms = x - middle[:, None]
        turned = np.einsum("kij,faj->faki", spins, arms)
        inertia = np.einsum("faki,fali->fkl", turned, turned)
        centre = cells.points[names].mean(axis=1)
        size = cells.size ** (1 / (dim - 1))
        count = np.bincount(self.ring.ravel(), minlength=self.rings)
        length = np.bincount(
            self.ring.ravel(), np.repeat(size, dim), minlength=self.rings
        )
        length /= count
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
            # Torques about the middle of the facet that make up those about the ring's.
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

    def _forbid(self, forbidden: NDArray[np.bool_]) -> None:
        """Leave of each ring what all its facets outside let pass."""
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

    def moments(self, amounts: Floats) -> Floats:
        """Moments ``(facets, d nodes, d)`` of amounts."""
        own, passed = self._split(amounts)
        found = np.einsum("faik,fk->fai", self.own, own)
        return found + np.einsum("fraiw,frw->fai", self.passed, passed[self.ring])

    def transposed(self, moments: Floats) -> Floats:
        """What moments do on each function."""
        own = np.einsum("faik,fai->fk", self.own, moments)
        each = np.einsum("fraiw,fai->frw", self.passed, moments)
        return np.concatenate([own.ravel(), self._gather(each).ravel()])

    def preconditioner(self, energy: Floats) -> Callable[[Floats], Floats]:
        """Inverse of the blocks of single facets and rings."""
        cells, dim = self.cells, self.cells.dim
        blocks = energy.reshape(len(energy), dim + 1, dim * dim, dim + 1, dim * dim)
        # Nodes of a facet stand in a cell in the order of its corners.
        corner = [[a for a in range(dim + 1) if a != k] for k in range(dim + 1)]
        facet = np.zeros((len(self.own), self.own.shape[-1], self.own.shape[-1]))
        ring = np.zeros((self.rings, self.passed.shape[-1], self.passed.shape[-1]))
        local = []
        for k in range(dim + 1):
            f, at = cells.facet_of[:, k], cells.place[:, k][:, corner[k]]
            own = np.take_along_axis(self.own[f], at[:, :, None, None], axis=1)
            own = own.reshape(len(f), dim * dim, -1)
            np.add.at(facet, f, own.swapaxes(1, 2) @ blocks[:, k, :, k] @ own)
            passed = np.take_along_axis(
                self.passed[f], at[:, None, :, None, None], axis=2
            )
            passed = passed * cells.sign[:, k, None, None, None, None]
            local.append(passed.reshape(len(f), dim, dim * dim, -1))
        every = np.arange(len(energy))
        for k, m in combinations(range(dim + 1), 2):
            # The ring about all corners but k and m, and its two facets in this cell.
            rk, rm = cells.place[:, k, m], cells.place[:, m, k]
            zk, zm = local[k][every, rk], local[m][every, rm]
            both = np.concatenate([zk, zm], axis=1)
            part = blocks[:, [k, m]][:, :, :, [k, m]].reshape(len(energy), *2 * (2 * dim * dim,))
            at_ring = self.ring[cells.facet_of[:, k], rk]
            np.add.at(ring, at_ring, both.swapaxes(1, 2) @ part @ both)
        inverse = [np.linalg.pinv(b, rcond=1e-10, hermitian=True) for b in (facet, ring)]

        def apply(rest: Floats) -> Floats:
            parts = self._split(rest)
            solved = [
                np.matmul(i, p[..., None]).ravel()
                for i, p in zip(inverse, parts, strict=True)
            ]
            return np.concatenate(solved)

        return apply

    def _split(self, amounts: Floats) -> tuple[Floats, Floats]:
        k = self.own.shape[-1]
        cut = len(self.own) * k
        return amounts[:cut].reshape(-1, k), amounts[cut:].reshape(self.rings, -1)

    def _gather(self, each: Floats) -> Floats:
        total = np.zeros((self.rings, each.shape[-1]))
        np.add.at(total, self.ring, each)
        return total


def _spins(dim: int) -> Floats:
    """Generators of rotations: ``spins[k] @ r`` is the motion of r."""
    spins = np.zeros((1 if dim == 2 else 3, dim, dim))
    for spin, (i, j) in zip(spins, combinations(range(dim), 2), strict=True):
        spin[i, j], spin[j, i] = -1.0, 1.0
    return spins


def _energy_matrices(cells: Simplices, material: Material) -> Floats:
    """``∫ σ̂ : C⁻¹ σ̂ dV`` of each cell as ``mᵀ Q m``, m outward in the order of `pairs`."""
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
    # C⁻¹ by polarisation would lose digits; it is the inverse of `elastic` on the basis.
    lame = np.linalg.inv(_tensor(material, dim))
    flat = stress.reshape(len(stress), len(basis), -1)
    metric = (flat @ lame @ flat.swapaxes(1, 2)) * cells.volume[:, None, None]
    rows = len(k) * dim
    found = metric.reshape(len(stress), -1) @ mass.reshape(len(basis) ** 2, -1)
    found = found.reshape(-1, len(k), dim, len(k), dim)
    found = np.einsum("cim,cpmqn,cjn->cpiqj", *_both(gradients, found), optimize=True)
    return np.ascontiguousarray(found.reshape(-1, rows, rows))


def _both(gradients: Floats, found: Floats) -> tuple[Floats, Floats, Floats]:
    inner = gradients.swapaxes(1, 2)
    return inner, found, inner


def _tensor(material: Material, dim: int) -> Floats:
    """C as a matrix on all d² components, made definite on the antisymmetric ones."""
    unit = np.eye(dim * dim).reshape(-1, dim, dim)
    symmetric = 0.5 * (unit + unit.swapaxes(1, 2))
    return (elastic(material, symmetric) + 2 * material.lame(dim)[1] * (unit - symmetric)).reshape(dim * dim, -1)
