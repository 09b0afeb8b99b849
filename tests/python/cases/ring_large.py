"""The ring of `pressed_ring` with large displacements, without friction.

A program of its own: St. Venant–Kirchhoff's material by scikit-fem, Newton's method, and an
active set of nodes on the plate. With the mesh of SSNP501 it gives the numbers of code_aster
to ten digits, so that geometry, material and path are those of the test.
"""

from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve
from skfem.helpers import ddot, eye, grad, mul, trace, transpose

from cases.pressed_ring import LAME, LEVELS, OUTSIDE, SHEAR, mesh

Array = NDArray[np.float64]


class Level(NamedTuple):
    """Results of one level; forces upwards, of half the ring [N/cm]."""

    force: float  # on the contacts
    outside: float  # on all nodes of the outer circle, that of the cut included
    side: float  # u_x of the cut, outside [cm]


def _gradient(w: Any) -> Any:
    g = grad(w["u"])
    return g + eye(np.ones(g.shape[2:]), 2)


def _green(a: Any, b: Any) -> Any:
    return 0.5 * (mul(transpose(a), b) + mul(transpose(b), a))


def _stress(strain: Any) -> Any:
    return LAME * eye(trace(strain), 2) + 2 * SHEAR * strain


def _strain(w: Any) -> Any:
    F = _gradient(w)
    return 0.5 * (mul(transpose(F), F) - eye(np.ones(F.shape[2:]), 2))


@skfem.LinearForm  # type: ignore[untyped-decorator]
def _forces(v: Any, w: Any) -> Any:
    return ddot(_stress(_strain(w)), _green(_gradient(w), grad(v)))


@skfem.BilinearForm  # type: ignore[untyped-decorator]
def _stiffness(u: Any, v: Any, w: Any) -> Any:
    F = _gradient(w)
    straining = _green(F, grad(v))
    return ddot(_stress(_green(F, grad(u))), straining) + ddot(
        _stress(_strain(w)), _green(grad(u), grad(v))
    )


def pressed(layers: int, around: int, levels: Array = LEVELS) -> list[Level]:
    """Press the ring without friction; each level is reached in four equal steps."""
    grid = mesh(layers, around)
    basis = skfem.Basis(grid, skfem.ElementVector(skfem.ElementQuad1()), intorder=3)
    dofs = basis.nodal_dofs.T.reshape(layers + 1, around + 1, 2)
    count = 2 * around // 3 + 1
    low, contacts = grid.p[1].reshape(layers + 1, -1)[-1, :count], dofs[-1, :count, 1]
    u, touching = np.zeros(basis.N), np.arange(count) == 0
    results, before = [], 0.0
    for level in levels:
        for cut in np.linspace(before, level, 5)[1:]:
            u, touching = _step(basis, u, touching, dofs, contacts, low, cut)
        force = _forces.assemble(basis, u=basis.interpolate(u))
        outer = dofs[-1, :, 1]
        results.append(
            Level(force[contacts].sum(), force[outer].sum(), u[dofs[-1, -1, 0]])
        )
        before = level
    return results


def _step(
    basis: Any,
    u: Array,
    touching: NDArray[np.bool_],
    dofs: Any,
    contacts: Any,
    low: Array,
    cut: float,
) -> tuple[Array, NDArray[np.bool_]]:
    """Newton's method with the contacts that touch; the set changes after each iteration."""
    for _ in range(60):
        at = basis.interpolate(u)
        wanted = np.full(basis.N, np.nan)
        wanted[dofs[:, 0, 0]] = 0.0
        wanted[dofs[:, -1, 1]] = -cut
        wanted[contacts[touching]] = -OUTSIDE - low[touching]
        held = ~np.isnan(wanted)
        change = np.where(held, wanted - u, 0.0)
        K = _stiffness.assemble(basis, u=at).tocsr()
        right = -_forces.assemble(basis, u=at) - K @ change
        free = np.flatnonzero(~held)
        change[free] = spsolve(K[free][:, free].tocsc(), right[free])
        u = u + change
        force = _forces.assemble(basis, u=basis.interpolate(u))[contacts]
        below = low + u[contacts] < -OUTSIDE * (1 + 1e-9)
        then = np.where(touching, force > 0, below)
        # Quadratic: the next change would be rounding.
        if np.array_equal(then, touching) and np.abs(change).max() < 1e-9 * OUTSIDE:
            return u, touching
        touching = then
    raise AssertionError(f"no equilibrium of the ring for {cut} cm")
