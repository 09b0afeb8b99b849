"""Stresses recovered from P1 displacements are in equilibrium at every point."""

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem
from bipot_rs.discretisation import johnson_mercier
from bipot_rs.discretisation.equilibrium import SelfStress, moments
from bipot_rs.discretisation.simplices import (
    Simplices,
    elastic,
    error_energy,
    pairs,
    simplices,
    strain,
)
from support.boxes import placed
from support.comparisons import near, refused

Floats = NDArray[np.float64]
CELLS = {2: "triangle", 3: "tetrahedron"}


def bent(dim: int, n: int = 3, turn: bool = False, poisson: float = 0.3) -> fem.Body:
    """A box of distorted and stretched cells; it stands on its bottom unless rotated."""
    sides = (1.0, 3.0, 2.0)[:dim]
    mesh = fem.box([np.linspace(0, side, n + 1) for side in sides], CELLS[dim])
    p = mesh.p.copy()
    inside = ((p > 0) & (p < p.max(axis=1, keepdims=True))).all(axis=0)
    random = np.random.default_rng(dim)
    p[:, inside] += 0.25 / n * random.uniform(-1, 1, p[:, inside].shape)
    if turn:
        p = np.linalg.qr(np.random.default_rng(7).normal(size=(dim, dim)))[0] @ p
    return fem.Body("it", placed(mesh, p), fem.Material(2.0, poisson))


class Exact:
    """Displacement of second degree, zero on the bottom: stress linear, load constant."""

    def __init__(self, body: fem.Body) -> None:
        self.body, dim = body, body.dim
        # u = h (A x), with h the height over the bottom.
        self.A = np.random.default_rng(11).normal(size=(dim, dim))
        bottom = body.points[body.nodes("bottom")]
        self.origin = bottom.mean(axis=0)
        self.up = np.linalg.svd(bottom - self.origin)[2][-1]
        self.up *= np.sign((body.points - self.origin).mean(axis=0) @ self.up)
        x = np.vstack([self.origin, self.origin + np.eye(dim)])
        s = self.stress(x)
        self.force = -np.einsum("jij->i", s[1:] - s[0])

    def stress(self, x: Floats) -> Floats:
        y = x - self.origin
        gradient = np.einsum("...i,j->...ij", y @ self.A.T, self.up)
        gradient = gradient + (y @ self.up)[..., None, None] * self.A
        return elastic(self.body.material, 0.5 * (gradient + gradient.swapaxes(-1, -2)))


@dataclass
class Recovered:
    """Finite elements and recovery of an exact solution."""

    body: fem.Body
    cells: Simplices
    exact: Exact
    given: Floats
    known: NDArray[np.bool_]
    u: Floats
    stresses: Floats
    force: Floats
    first: Floats
    last: Floats

    def hat(self, tractions: Floats) -> Floats:
        """Stress of the parts of all cells."""
        cells = self.cells
        by_cell = cells.by_cell(tractions)
        return johnson_mercier.stress(cells.edges, cells.gradients, by_cell)


@cache
def recovered(dim: int, turn: bool = False, n: int = 3) -> Recovered:
    body = bent(dim, n, turn)
    cells, exact = simplices(body), Exact(body)
    outside = np.flatnonzero(cells.outside)
    sign = np.ones(len(cells.facets))
    sign[cells.facet_of] = cells.sign
    normal = sign[:, None] * cells.area / cells.size[:, None]
    stress = exact.stress(cells.points[cells.facets])
    traction = np.einsum("faij,fj->fai", stress, normal)
    given = np.zeros((len(cells.facets), dim, dim))
    given[outside] = cells.linear_moments(outside, traction[outside])
    known = np.repeat(cells.outside[:, None], dim, axis=1)
    known[body.facets("bottom")] = False
    f = np.zeros_like(cells.points)
    np.add.at(f, cells.facets, given)
    share = cells.volume[:, None] / (dim + 1) * exact.force
    for a in range(dim + 1):
        np.add.at(f, cells.corners[:, a], share)
    fixed = (dim * body.nodes("bottom")[:, None] + np.arange(dim)).ravel()
    free = np.setdiff1d(np.arange(f.size), fixed)
    u, K = np.zeros(f.size), fem.stiffness(body)
    u[free] = spsolve(K[free][:, free].tocsc(), f.ravel()[free])
    u = u.reshape(-1, dim)
    stresses = elastic(body.material, strain(cells, u))
    force = np.broadcast_to(exact.force, (len(cells.corners), dim))
    first = moments(cells, stresses, force, given, known)
    last = SelfStress(cells, body.material, ~known).relax(first, u, stresses)
    return Recovered(body, cells, exact, given, known, u, stresses, force, first, last)


def parts(cells: Simplices) -> Floats:
    """Corners of the parts, ``(cells, d + 1, d + 1, d)``."""
    x = cells.points[cells.corners]
    corners = np.repeat(x[:, None], x.shape[1], axis=1)
    every = np.arange(x.shape[1])
    corners[:, every, every] = x.mean(axis=1, keepdims=True)
    return corners


CASES = [(2, False), (2, True), (3, False), (3, True)]


@pytest.mark.parametrize(("dim", "turn"), CASES)
def test_equilibrium_in_every_point(dim: int, turn: bool) -> None:
    recovery = recovered(dim, turn)
    cells = recovery.cells
    sign = np.ones(len(cells.facets))
    sign[cells.facet_of] = cells.sign
    corners = parts(cells)
    matrix = np.concatenate([np.ones((*corners.shape[:-1], 1)), corners], axis=-1)
    slopes = np.linalg.inv(matrix)[:, :, 1:].swapaxes(-1, -2)
    # The condition of the reference element is 1e2, of the distorted cells 1e2, and the
    # nodal equations hold to the rounding of a factorisation.
    digits = 1e-11
    for tractions in (recovery.first, recovery.last):
        hat = recovery.hat(tractions)
        size = np.abs(hat).max()
        # Symmetric, because both are sums of the same terms.
        assert np.abs(hat - hat.swapaxes(-1, -2)).max() <= 1e-14 * size
        divergence = np.einsum("cpqij,cpqj->cpi", hat, slopes)
        near(divergence + recovery.exact.force, 0, digits * size * np.abs(slopes).max())
        # Between the parts of a cell.
        for k, m in combinations(range(dim + 1), 2):
            normal = slopes[:, k, m] / np.linalg.norm(slopes[:, k, m], axis=1)[:, None]
            shared = [a for a in range(dim + 1) if a not in (k, m)]
            for a, b in [*((a, a) for a in shared), (k, m)]:
                step = hat[:, k, a] - hat[:, m, b]
                near(np.einsum("cij,cj->ci", step, normal), 0, digits * size)
        # Between cells, and with the outside: tractions at the nodes of facets.
        low = np.full((len(cells.facets), dim, dim), np.inf)
        high = -low
        normals = cells.area / cells.size[:, None]
        for k, a in pairs(dim):
            f = cells.facet_of[:, k]
            traction = np.einsum("cij,cj->ci", hat[:, k, a], normals[f])
            np.minimum.at(low, (f, cells.place[:, k, a]), traction)
            np.maximum.at(high, (f, cells.place[:, k, a]), traction)
        near(high, low, digits * size)
        outside = np.flatnonzero(cells.outside)
        met = sign[outside, None, None] * low[outside]
        rest = cells.linear_moments(outside, met) - recovery.given[outside]
        rest = np.where(recovery.known[outside][:, None], rest, 0.0)
        near(rest, 0, digits * np.abs(recovery.given[outside]).max())


@pytest.mark.parametrize(("dim", "turn"), CASES)
def test_prager_and_synge(dim: int, turn: bool) -> None:
    """``‖σ - σ_h‖² + ‖σ - σ̂‖² = ‖σ̂ - σ_h‖²``, all three integrated exactly."""
    recovery = recovered(dim, turn)
    stresses = recovery.stresses[:, None, None]
    exact = recovery.exact.stress(parts(recovery.cells))
    last = []
    for tractions in (recovery.first, recovery.last):
        hat = recovery.hat(tractions)
        true, dual, all_of_it = (
            error_energy(recovery.cells, recovery.body.material, difference).sum()
            for difference in (exact - stresses, exact - hat, hat - stresses)
        )
        # Differences of stresses of size 1 to a tenth of them, rounded at 1e-11.
        assert true + dual == pytest.approx(all_of_it, rel=1e-9)
        assert min(true, dual) > 0
        last.append(all_of_it / true)
    # Prolongation alone overestimates; the self-stresses reduce the energy.
    assert last[1] < last[0]
    assert np.sqrt(last[1]) < 1.5


def test_unbalanced_nodal_force_is_refused() -> None:
    recovery = recovered(2)
    known = recovery.known.copy()
    known[recovery.body.facets("bottom")] = True
    with refused(r"no tractions balance .* node at \("):
        moments(
            recovery.cells, recovery.stresses, recovery.force, recovery.given, known
        )
