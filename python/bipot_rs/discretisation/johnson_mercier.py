"""Symmetric stresses on a simplex split at its centre, from the forces on its facets.

The element of Johnson and Mercier (1978) for triangles, of Krizek (1982) for tetrahedra. The
stress is linear on each of the d + 1 parts between a facet and the centre, with continuous
tractions between the parts. Facet forces that balance a constant body force f determine it
uniquely, with ``div σ + f = 0`` in every part (docs/paper/10-discretisation-error.md).
"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import numpy as np

from bipot_rs._lib.types import Floats


def stress(edges: Floats, gradients: Floats, moments: Floats) -> Floats:
    """Stress of each simplex from the moments of its facet tractions.

    ``edges``: ``(cells, d, d)``, column k the edge from corner 0 to corner k + 1 [m].
    ``gradients``: ``(cells, d + 1, d)``, of the barycentric coordinates [1/m].
    ``moments``: ``(cells, d + 1, d + 1, d)``, entry ``[k, a]`` the integral of φ_a times the
    outward traction over the facet opposite to corner k; ``[k, k]`` is not read. They must
    balance a constant body force.
    Returns ``stress (cells, d + 1, d + 1, d, d)``: entry ``[k, a]``: in part k, at the facet
    opposite to corner k, the value at corner a; for a = k the value at the centre.
    """
    # σ = J Ŝ Jᵀ/det J preserves symmetry, continuity of tractions and divergence; a force
    # on a facet is multiplied by J.
    there = np.einsum("cij,ckaj->ckai", gradients[:, 1:], moments)
    stresses = np.einsum("pqijkam,ckam->cpqij", operator(edges.shape[-1]), there)
    scaled = edges / np.abs(np.linalg.det(edges))[:, None, None]
    there = np.einsum("cim,cpqmn,cjn->cpqij", scaled, stresses, edges)
    return np.asarray(there, dtype=np.float64)


@cache
def operator(d: int) -> Floats:
    """Linear map from facet moments to stress on the reference simplex, as in `stress`."""
    places = np.vstack([np.zeros(d), np.eye(d)])
    gradient = np.vstack([-np.ones(d), np.eye(d)])
    volume = 1 / np.prod(np.arange(1, d + 1))
    components = [(i, j) for i in range(d) for j in range(i, d)]
    unknowns = np.arange((d + 1) ** 2 * len(components)).reshape(d + 1, d + 1, -1)
    # Parts: corner k replaced by the centre; their own gradients.
    parts = []
    for k in range(d + 1):
        corners = places.copy()
        corners[k] = places.mean(axis=0)
        parts.append(np.linalg.inv(np.column_stack([np.ones(d + 1), corners]))[1:].T)

    rows: list[Floats] = []
    sides: list[Floats] = []

    def add(terms: list[tuple[int, int, Floats]], right: Floats) -> None:
        """Σ S[part][corner] vector = right, component by component."""
        for i in range(d):
            row = np.zeros(unknowns.size)
            for part, corner, vector in terms:
                for unknown, (m, n) in zip(
                    unknowns[part, corner], components, strict=True
                ):
                    if m == i:
                        row[unknown] += vector[n]
                    elif n == i:
                        row[unknown] += vector[m]
            rows.append(row)
            sides.append(right[i].ravel())

    inputs = np.eye((d + 1) ** 2 * d).reshape(d + 1, d + 1, d, d + 1, d + 1, d)
    for k in range(d + 1):
        area = -d * volume * gradient[k]
        others = [a for a in range(d + 1) if a != k]
        for a in others:
            # ∫ φ_a φ_b over a facet is its area times (1 + δ_ab)/(d (d + 1)).
            mass = [(1 + (a == b)) / (d * (d + 1)) for b in others]
            add(
                [(k, b, m * area) for b, m in zip(others, mass, strict=True)],
                inputs[k, a],
            )
    for k, other in combinations(range(d + 1), 2):
        # The facet between two parts has all corners except these two, and the centre. Its
        # normal is the gradient, in part k, of the corner that only part k has.
        normal = parts[k][other]
        for a in range(d + 1):
            if a in (k, other):
                continue
            add([(k, a, normal), (other, a, -normal)], np.zeros((d, d + 1, d + 1, d)))
        add([(k, k, normal), (other, other, -normal)], np.zeros((d, d + 1, d + 1, d)))
    mean = sum(
        (inputs[k, a] for k in range(d + 1) for a in range(d + 1) if a != k),
        start=np.zeros((d, d + 1, d + 1, d)),
    )
    for k in range(d + 1):
        add([(k, a, parts[k][a]) for a in range(d + 1)], mean / volume)
    # More equations than unknowns; they are consistent if forces and torques balance.
    solved = np.linalg.pinv(np.array(rows)) @ np.array(sides)
    operator = np.empty((d + 1, d + 1, d, d, d + 1, d + 1, d))
    for part in range(d + 1):
        for corner in range(d + 1):
            for unknown, (i, j) in zip(unknowns[part, corner], components, strict=True):
                entry = solved[unknown].reshape(d + 1, d + 1, d)
                operator[part, corner, i, j] = operator[part, corner, j, i] = entry
    return operator
