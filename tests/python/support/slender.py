"""Slender bodies, and their displacements for given statuses in doubled precision.

The stiffness of a strip with aspect ratio 1000 spans sixteen digits, so a direct solve in
doubles has no correct digit. Here a band matrix is eliminated with pairs of doubles
(`twice`), which carry 32 digits. The package is not used.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import reverse_cuthill_mckee

import bipot_rs as bp
from bipot_rs import fem
from support.twice import Array, Pair, add, exactly, product, two_product, two_sum

STEEL = 2.1e5, 0.3, 7.7e-5
"""Young's modulus [N/mm²], Poisson's ratio, weight [N/mm³]."""


def times(a: Pair, b: Pair) -> Pair:
    """Product of two pairs."""
    high, low = two_product(a[0], b[0])
    return two_sum(high, low + (a[0] * b[1] + a[1] * b[0]))


def less(a: Pair, b: Pair) -> Pair:
    """Difference of two pairs."""
    return add(a, (-b[0], -b[1]))


def over(a: Pair, b: Pair) -> Pair:
    """Quotient of two pairs, by one Newton step from the quotient of doubles."""
    first = a[0] / b[0]
    rest = less(a, times(exactly(first), b))
    return two_sum(first, rest[0] / b[0])


class Band:
    """`L D Lᵀ` of a symmetric positive definite matrix, with all numbers as pairs."""

    def __init__(self, K: Any) -> None:
        K = sparse.csr_array(K)
        n = K.shape[0]
        self.order = np.asarray(reverse_cuthill_mckee(K, symmetric_mode=True))
        P = sparse.coo_array(K[self.order][:, self.order])
        below = P.row >= P.col
        row, col, value = P.row[below], P.col[below], P.data[below]
        w = int((row - col).max(initial=0))
        # Entry (j + k, j) is at [j, k]; w empty columns follow the last one.
        self.pairs = np.zeros((2, n + w, w + 1))
        self.pairs[0, col, row - col] = value
        flat = self.pairs.reshape(2, -1)
        a, b = np.tril_indices(w)
        # (j + 1 + a, j + 1 + b) is at [j + 1 + b, a - b].
        offset = (1 + b) * (w + 1) + a - b
        for j in range(n):
            pivot = self.pairs[:, j, :1]
            if not pivot[0, 0] > 0:
                raise ArithmeticError(f"pivot {pivot[0, 0]} at {j}")
            column = self.pairs[:, j, 1:].copy()
            ratio = np.array(over(column, pivot))
            self.pairs[:, j, 1:] = ratio
            at = j * (w + 1) + offset
            flat[:, at] = less(flat[:, at], times(ratio[:, a], column[:, b]))
        self.n, self.w = n, w

    def solve(self, b: Pair) -> Pair:
        """`K⁻¹ b` for one column."""
        n, w, L = self.n, self.w, self.pairs
        x = np.zeros((2, n + w))
        x[:, :n] = np.array(b)[:, self.order]
        for j in range(n):
            behind = slice(j + 1, j + 1 + w)
            x[:, behind] = less(x[:, behind], times(L[:, j, 1:], x[:, j : j + 1]))
        x[:, :n] = over(x[:, :n], L[:, :n, 0])
        for j in reversed(range(n)):
            terms = np.array(times(L[:, j, 1:], x[:, j + 1 : j + 1 + w]))
            while terms.shape[1] > 1:
                half = terms.shape[1] // 2
                paired = add(terms[:, :half], terms[:, half : 2 * half])
                terms = np.concatenate([paired, terms[:, 2 * half :]], axis=1)
            if w:
                x[:, j : j + 1] = less(x[:, j : j + 1], terms)
        out = np.zeros((2, n))
        out[:, self.order] = x[:, :n]
        return out[0], out[1]


@dataclass
class Reference:
    """Displacements of all degrees of freedom and reactions `(n_c, d)`.

    `loads_alone` is the largest displacement without contact. It multiplies the rounding of
    the reactions that cancel it.
    """

    u: Array
    r: Array
    loads_alone: float


def known(model: fem.Assembly, load: Array, result: bp.Result) -> Reference:
    """The solution for the statuses of the last step, with contacts along the axes.

    Every row of `B` has one entry, 1 or −1: a contact that presses or sticks prescribes a
    degree of freedom. A slipping contact must be frictionless.
    """
    B = sparse.csr_array(model.B)
    assert (np.diff(B.indptr) == 1).all()
    assert (abs(B.data) == 1.0).all()
    n, d = model.K.shape[0], model.dim
    status = result.status[-1]
    held = np.zeros((len(status), d), bool)
    held[:, 0] = status != bp.Status.OPEN
    held[:, 1:] = (status == bp.Status.STICK)[:, None]
    rows = np.flatnonzero(held)
    value = np.zeros(n)
    offset = np.zeros((len(status), d))
    offset[:, 0] = model.gap
    # ±u + gap = 0.
    value[B.indices[rows]] = -B.data[rows] * offset.ravel()[rows]
    fixed = np.zeros(n, bool)
    fixed[model.fixed] = True
    value[fixed] = 0.0
    pinned = fixed.copy()
    pinned[B.indices[rows]] = True
    free = np.flatnonzero(~pinned)
    K = sparse.csr_array(model.K)
    pushed = product(K, exactly(value[:, None]))
    right = less(exactly(load), (pushed[0][:, 0], pushed[1][:, 0]))
    inside = Band(K[free][:, free]).solve((right[0][free], right[1][free]))
    u = value.copy(), np.zeros(n)
    u[0][free], u[1][free] = inside
    forces = product(K, (u[0][:, None], u[1][:, None]))
    left = add((forces[0][:, 0], forces[1][:, 0]), exactly(-load))[0]
    r = np.zeros(len(status) * d)
    at_free = rows[~fixed[B.indices[rows]]]
    r[at_free] = B.data[at_free] * left[B.indices[at_free]]
    loose = np.flatnonzero(~fixed)
    alone = Band(K[loose][:, loose]).solve(exactly(load[loose]))[0]
    return Reference(u[0], r.reshape(-1, d), np.abs(alone).max())


CELLS = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}


def strip(
    lengths: tuple[float, ...],
    cells: tuple[int, ...],
    *,
    cell: str = "quadrilateral",
    second: bool = True,
    rise: float = 0.0,
) -> fem.Body:
    """A box along x, bent into a parabola of height `rise` if given."""
    axes = [np.linspace(0, s, c + 1) for s, c in zip(lengths, cells, strict=True)]
    mesh: Any = fem.box(axes, cell)
    if second:
        mesh = fem.second_order(mesh)
    if rise:
        p = mesh.doflocs.copy()
        p[-1] += 4 * rise * p[0] / lengths[0] * (1 - p[0] / lengths[0])
        mesh = type(mesh)(p, mesh.t).with_boundaries(mesh.boundaries)
    young, nu, _ = STEEL
    return fem.Body("strip", mesh, fem.Material(young, nu, plane_stress=True))


HOLDS = {
    "clamped": [("left", None)],
    "both ends": [("left", None), ("right", None)],
    "rolling": [("left", None), ("right", (-1,))],
    "guided": [("left", (0,)), ("right", None)],
}


def supports(how: str, dim: int) -> list[fem.Support]:
    """Faces held in all components or in some."""
    every = tuple(range(dim))
    made = []
    for surface, components in HOLDS[how]:
        chosen = every if components is None else tuple(c % dim for c in components)
        made.append(fem.Support("strip", surface, chosen))
    return made


def floor(body: fem.Body, mu: float) -> fem.Contact:
    """A rigid plane under the bottom face."""
    dim = body.dim
    origin, up = np.zeros(dim), np.eye(dim)[-1]
    return fem.Contact("strip", "bottom", mu=mu, plane=(origin, up))


def weight(model: fem.Assembly) -> Array:
    """Weight of steel, downwards."""
    return model.body_force("strip", -STEEL[2] * np.eye(model.dim)[-1])


def lifted(model: fem.Assembly, traction: float) -> Array:
    """An upward traction on the right end."""
    return model.traction("strip", "right", traction * np.eye(model.dim)[-1])


def problem(model: fem.Assembly, coordinates: bool) -> bp.ContactProblem:
    """The problem, with or without the coordinates that a mesh gives."""
    if coordinates:
        return model.problem()
    return bp.ContactProblem(
        model.K, model.B, gap=model.gap, mu=model.mu, fixed=model.fixed
    )


def off(a: Array, b: Array) -> float:
    """Largest difference of `a` and `b`, relative to the largest entry of `b`."""
    return float(np.abs(a - b).max() / np.abs(b).max())


# Displacements and reactions are exact to ε times an amplification by the contacts of 1e4
# to 1e6 for slender strips on a floor. A motion wrongly taken as free costs 1e-4 to 1.
EXACT = 1e-9


def deflection(slenderness: float, length: float = 1000.0) -> float:
    """Traction [N/mm²] on the end of a strip that lifts it by 5 mm, by beam theory."""
    height = length / slenderness
    return 5.0 * STEEL[0] * height**2 / (4 * length**3)


def is_right(model: fem.Assembly, load: Array, result: bp.Result) -> None:
    there = known(model, load, result)
    assert result.converged.all()
    largest = EXACT * np.abs(there.u).max()
    # Reactions have sixteen digits, whatever displacement they cancel.
    largest += 64 * np.finfo(float).eps * there.loads_alone
    assert np.abs(result.displacement[-1] - there.u).max() <= largest
    largest = np.abs(there.r).max()
    if largest == 0.0:
        assert not result.reaction[-1].any()
    else:
        assert off(result.reaction[-1], there.r) <= EXACT
        assert there.r[:, 0].min() >= -EXACT * largest
    gaps = model.B @ there.u
    gaps = gaps.reshape(len(model.gap), -1)[:, 0] + model.gap
    assert gaps.min() >= -EXACT * np.abs(there.u).max()


def drawn(rng: np.random.Generator) -> tuple[fem.Assembly, Array, bool]:
    """A random slender body and its load."""
    slenderness = 10 ** rng.uniform(1.0, np.log10(5000.0))
    dim = int(rng.choice([2, 2, 3]))
    cell = str(rng.choice(CELLS[dim]))
    second = bool(rng.integers(2)) and dim != 3
    height = 1000.0 / slenderness
    size = (
        (1000.0, height) if dim == 2 else (1000.0, rng.uniform(1, 50) * height, height)
    )
    count = int(rng.integers(6, 60 if dim == 2 else 24))
    cells = (count, int(rng.integers(1, 3))) if dim == 2 else (count, 1, 1)
    body = strip(size, cells, cell=cell, second=second, rise=rng.choice([0.0, 20.0]))
    how = str(rng.choice(list(HOLDS)))
    model = fem.assemble([body], [floor(body, 0.0)], supports(how, dim))
    load = rng.uniform(0, 1) * weight(model)
    load += rng.uniform(-1, 1) * lifted(model, deflection(slenderness))
    return model, load, bool(rng.integers(2))


def held(seeds: Iterable[int]) -> Counter[str]:
    """Checks the solution, and that no body with supports is called free."""
    met: Counter[str] = Counter()
    for seed in seeds:
        model, load, coordinates = drawn(np.random.default_rng(seed))
        try:
            result = problem(model, coordinates).solve(load)
        except ValueError as refused:
            if "too few digits" not in str(refused):
                raise
            met["refused"] += 1
        except bp.NotConvergedError:
            met["refused"] += 1
        else:
            is_right(model, load, result)
            met["solved"] += 1
    return met
