"""An elastic ring pressed between two rigid plates, and its exact deformation in a series.

Outer radius 6.35 cm, inner 4.15 cm, E = 407 N/cm², ν = 0.48, plane stress: SSNP501 (μ = 0)
and SSNP502 (μ = 0.4) of code_aster, after Saleeb, Chen and Chang (1994). A quarter of the
ring is modelled, assembled by scikit-fem without the package; forces are those of half the
ring, per cm of thickness.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from skfem.models.elasticity import linear_elasticity

import bipot_rs as bp

Array = NDArray[np.float64]
INSIDE, OUTSIDE = 4.15, 6.35
YOUNG, POISSON = 407.0, 0.48
SHEAR = YOUNG / (2 * (1 + POISSON))
# Lamé's first constant of plane stress.
LAME = YOUNG * POISSON / (1 - POISSON**2)
# Displacements of the cut [cm]: half of the approach of the plates.
LEVELS = 2.225 * np.array([0.25, 0.5, 0.75, 1.0])


@dataclass
class Pressed:
    """Results of each level of a quarter: contacts are sorted from the lowest point on."""

    angle: Array  # of the contacts from the lowest point [rad]
    reaction: Array  # (levels, contacts, 2), upwards and to the right [N/cm]
    cut: Array  # force of the other half ring on the horizontal cut, downwards [N/cm]
    side: Array  # (levels, 2), u_x at the cut, inside and outside [cm]


def mesh(layers: int, around: int) -> skfem.MeshQuad:
    """The quarter x ≥ 0, y ≤ 0, in polar order: inside to outside, lowest point first."""
    radius = np.linspace(INSIDE, OUTSIDE, layers + 1)
    angle = np.linspace(0, np.pi / 2, around + 1)
    points = np.stack(
        [
            np.outer(radius, np.sin(angle)).ravel(),
            -np.outer(radius, np.cos(angle)).ravel(),
        ]
    )
    row, column = np.divmod(np.arange(layers * around), around)
    first = row * (around + 1) + column
    up = around + 1
    return skfem.MeshQuad(
        points, np.stack([first, first + up, first + up + 1, first + 1])
    )


def pressed(
    layers: int, around: int, mu: float, levels: Array = LEVELS, **settings: Any
) -> Pressed:
    """Press the quarter by prescribed displacements of its horizontal cut."""
    basis = skfem.Basis(
        mesh(layers, around), skfem.ElementVector(skfem.ElementQuad1()), intorder=3
    )
    K = sparse.csr_array(linear_elasticity(LAME, SHEAR).assemble(basis))
    dofs = basis.nodal_dofs.T.reshape(layers + 1, around + 1, 2)
    # The outside up to 60°: the largest level closes the lower 45°.
    count = 2 * around // 3 + 1
    contacts = dofs[-1, :count]
    angle = np.linspace(0, np.pi / 2, around + 1)[:count]
    columns = contacts[:, ::-1].ravel()
    rows = np.arange(columns.size)
    B = sparse.csr_array((np.ones(rows.size), (rows, columns)), (rows.size, K.shape[0]))
    middle, cut = dofs[:, 0, 0], dofs[:, -1, 1]
    fixed = np.concatenate([middle, cut])
    values = np.zeros((len(levels), fixed.size))
    values[:, middle.size :] = -np.asarray(levels)[:, None]
    # Friction has no effect on the node of the plane of symmetry.
    friction = np.full(angle.size, mu)
    friction[0] = 0.0
    problem = bp.ContactProblem(
        K, B, gap=OUTSIDE * (1 - np.cos(angle)), mu=friction, fixed=fixed
    )
    loads = np.zeros((len(levels), K.shape[0]))
    settings.setdefault("tol", 1e-13)
    result: Any = problem.solve(loads, values, **settings)
    u = result.displacement
    return Pressed(
        angle,
        result.reaction,
        -(u @ K)[:, cut].sum(axis=1),
        u[:, dofs[[0, -1], -1, 0]],
    )


def side_by_series(angle: Array, reaction: Array, terms: int = 200) -> Array:
    """u_x at the horizontal cut, inside and outside [cm], of the elastic ring (Michell).

    The forces (n, t) of a quarter act as line loads on the full ring, mirrored at both axes.
    Each harmonic cos mθ, sin mθ has the displacements r^p with p = ±m ± 1 that fulfil
    Navier's equations; their factors follow from the tractions of both circles.
    """
    # Along the radius, and towards larger angles.
    n, t = reaction.T
    radial = -(n * np.cos(angle) - t * np.sin(angle))
    hoop = n * np.sin(angle) + t * np.cos(angle)
    side = np.zeros(2)
    for m in range(0, 2 * terms, 2):
        four = 4 / (np.pi * OUTSIDE) * (0.5 if m == 0 else 1.0)
        wanted = four * np.array(
            [0.0, 0.0, radial @ np.cos(m * angle), hoop @ np.sin(m * angle)]
        )
        side += np.cos(m * np.pi / 2) * _harmonic(m, wanted)
    return side


def _harmonic(m: int, wanted: Array) -> Array:
    """Radial displacements inside and outside for tractions (rr, rθ) there."""
    if m == 0:
        powers: list[tuple[float, Array]] = [
            (p, np.array([1.0, 0.0])) for p in (1.0, -1.0)
        ]
    else:
        powers = [(p, _mode(p, m)) for p in (m + 1.0, m - 1.0, 1.0 - m, -m - 1.0)]
    # Growing powers relative to the outside, decaying ones to the inside: no overflow.
    scale = [OUTSIDE if p > 0 else INSIDE for p, _ in powers]
    at = np.array([INSIDE, OUTSIDE])
    columns, moved = [], []
    for (p, mode), c in zip(powers, scale, strict=True):
        rr, rt, _ = _stress(p, m) @ mode
        size = (at / c) ** (p - 1) / c
        columns.append([rr * size[0], rt * size[0], rr * size[1], rt * size[1]])
        moved.append(mode[0] * (at / c) ** p)
    matrix = np.array(columns).T
    order = [0, 2] if m == 0 else [0, 1, 2, 3]
    right = wanted[[0, 2]] if m == 0 else wanted
    return np.asarray(np.linalg.solve(matrix[order], right) @ np.array(moved))


def _stress(p: float, m: int) -> Array:
    """(rr, rθ, θθ) at r = 1 of u = (A cos mθ, B sin mθ) r^p, by (A, B)."""
    return np.array(
        [
            [(LAME + 2 * SHEAR) * p + LAME, LAME * m],
            [-SHEAR * m, SHEAR * (p - 1)],
            [LAME * p + LAME + 2 * SHEAR, (LAME + 2 * SHEAR) * m],
        ]
    )


def _mode(p: float, m: int) -> Array:
    """(A, B) of the power p that is in equilibrium: the null vector of two equations."""
    rr, rt, tt = _stress(p, m)
    equations = np.array([p * rr + m * rt - tt, (p + 1) * rt - m * tt])
    return np.asarray(np.linalg.svd(equations)[2][-1])
