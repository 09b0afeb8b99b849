"""Accuracy with a nearly incompressible K, or with large differences of stiffness.

References are the closed form of the oedometer with smooth walls and any friction,
`shortening = p H / M`, `M = E (1 - ν)/((1 + ν)(1 - 2ν))`, and dense solves in extended
precision.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy import sparse
from skfem.models.elasticity import lame_parameters, linear_elasticity

import bipot_rs as bp
from support.bodies import Body, block
from support.conditions import violation

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
MU = 0.3
STICK, SLIP, OPEN = bp.Status.STICK, bp.Status.SLIP, bp.Status.OPEN


class Column(NamedTuple):
    """A column pressed between smooth walls, with its solution: `u` and normal `press`."""

    K: Any
    B: Any
    load: Array
    fixed: NDArray[np.int64]
    u: Array
    press: Array


def per_stress(young: float, nu: float) -> float:
    return (1 + nu) * (1 - 2 * nu) / (young * (1 - nu))


def walls(body: Body) -> NDArray[np.int64]:
    last, sizes = body.dim - 1, body.basis.mesh.p.max(axis=1)
    faces = [body.dofs(k, end, k) for k in range(last) for end in (0.0, sizes[k])]
    return np.unique(np.concatenate(faces))


def lowered(body: Body, by: Array) -> Array:
    """The displacement that lowers each node by a given amount."""
    u = np.zeros(body.K.shape[0])
    u[body.basis.nodal_dofs[-1]] = -by
    return u


def oedometer(dim: int, nu: float, cells: int) -> Column:
    body = block([1.0] * dim, [cells] * dim, 1.0, nu)
    load = body.traction(dim - 1, 1.0, [0.0] * (dim - 1) + [-1.0])
    u = lowered(body, body.basis.mesh.p[-1] * per_stress(1.0, nu))
    return Column(body.K, body.B, load, walls(body), u, body.area)


def two_bodies(youngs: Sequence[float], cells: int = 4, nu: float = 0.3) -> Column:
    """One unit square on another, the lower one on the plane: held by contact alone."""
    lower, upper = (block([1.0, 1.0], [cells] * 2, young, nu) for young in youngs)
    face = [lower.dofs(1, 1.0, component) for component in (1, 0)]
    columns = np.stack(face, axis=1).ravel()
    n = lower.K.shape[0]
    ones = (np.ones(columns.size), (np.arange(columns.size), columns))
    under = sparse.csr_array(ones, (columns.size, n))
    at = lower.basis.mesh.p[0, lower.nodes_where(1, 1.0)]
    assert np.array_equal(at, upper.points[:, 0])  # node on node
    first, second = (per_stress(young, nu) for young in youngs)
    height = upper.basis.mesh.p[1]
    return Column(
        sparse.block_diag([lower.K, upper.K], format="csr"),
        sparse.block_array([[lower.B, None], [-under, upper.B]], format="csr"),
        np.append(np.zeros(n), upper.traction(1, 1.0, [0.0, -1.0])),
        np.append(walls(lower), n + walls(upper)),
        np.append(
            lowered(lower, lower.basis.mesh.p[1] * first),
            lowered(upper, first + height * second),
        ),
        np.append(lower.area, upper.area),
    )


def bonded(youngs: Sequence[float], cells: int = 4, nu: float = 0.3) -> Column:
    """The same squares as one body of two materials."""
    body = block([1.0, 2.0], [cells, 2 * cells], 1.0, nu)
    mesh, element = body.basis.mesh, body.basis.elem
    above = mesh.p[1][mesh.t].mean(axis=0) > 1
    parts = [
        linear_elasticity(*lame_parameters(young, nu)).assemble(
            skfem.Basis(mesh, element, elements=np.flatnonzero(above == half))
        )
        for half, young in enumerate(youngs)
    ]
    first, second = (per_stress(young, nu) for young in youngs)
    height = mesh.p[1]
    by = np.minimum(height, 1) * first + np.maximum(height - 1, 0) * second
    load = body.traction(1, 2.0, [0.0, -1.0])
    return Column(sum(parts), body.B, load, walls(body), lowered(body, by), body.area)


def solve(
    column: Column, length: float = 1.0, force: float = 1.0, mu: float = MU
) -> Any:
    K = column.K * (force / length)
    gap = np.zeros(column.press.size)
    return bp.solve(
        K, column.B, column.load * force, gap=gap, mu=mu, fixed=column.fixed
    )


def misses(u: Array, r: Array, column: Column) -> tuple[float, float]:
    """Errors of displacement and reaction, relative to the largest value of each."""
    exact = np.zeros_like(r)
    exact[:, 0] = column.press
    of_u = np.abs(u - column.u).max() / np.abs(column.u).max()
    return float(of_u), float(np.abs(r - exact).max() / column.press.max())


PRINTED = {0.3: "-0.742857142857", 0.4999: "-5.99840032e-4", 0.4999999: "-5.9999984e-7"}


@pytest.mark.parametrize(
    ("dim", "cells"), [(2, 2), (2, 16), (3, 2), (3, 5)], ids=lambda x: str(x)
)
@pytest.mark.parametrize("nu", sorted(PRINTED))
@pytest.mark.parametrize("mu", [0.0, MU])
def test_a2_oedometer(mu: float, nu: float, dim: int, cells: int) -> None:
    column = oedometer(dim, nu, cells)
    result = solve(column, mu=mu)
    digits, _, power = PRINTED[nu].partition("e")
    half = 0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    u, r = result.displacement[0], result.reaction[0]
    assert abs(u.min() - float(PRINTED[nu])) <= half
    # Entries of K are as large as 1/(1 - 2ν). Their rounding, and that of the factor,
    # changes the problem to one with a slightly different ν.
    of_u, of_r = misses(u, r, column)
    assert of_u <= 1e-12 + 2 * EPS / (1 - 2 * nu)
    assert of_r <= 1e-12 + 2 * EPS / (1 - 2 * nu)


@pytest.mark.parametrize("cells", [2, 10])
@pytest.mark.parametrize(
    ("make", "youngs"),
    [(two_bodies, (1.0, 1e8)), (two_bodies, (1e8, 1.0)), (bonded, (1e8, 1.0))],
)
def test_h13_two_halves(
    make: Callable[..., Column], youngs: tuple[float, float], cells: int
) -> None:
    column = make(youngs, cells)
    result = solve(column)
    of_u, of_r = misses(result.displacement[0], result.reaction[0], column)
    assert of_u <= 1e-10
    assert of_r <= 1e-10


@pytest.mark.parametrize("cells", [2, 4])
def test_h13_bonded_with_the_stiff_half_above(cells: int) -> None:
    # Entries of K in the stiff half are rounded by ε E₂, as if a spring of that size
    # tied each of its cells² nodes to the ground, compared with the modulus E₁ that really
    # holds it. The exact solution of this K is off by 5e-9 at 4 cells, 1.6e-7 at 10.
    stiff = 1e8
    column = bonded((1.0, stiff), cells)
    rounding = EPS * stiff * cells**2
    assert rounding < 1e-6
    result = solve(column)
    of_u, of_r = misses(result.displacement[0], result.reaction[0], column)
    assert of_u <= rounding
    assert of_r <= rounding


COLUMNS = {
    "nearly incompressible": lambda: oedometer(2, 0.4999999, 4),
    "in space": lambda: oedometer(3, 0.4999, 3),
    "two bodies, soft below": lambda: two_bodies((1.0, 1e8)),
    "two bodies, stiff below": lambda: two_bodies((1e8, 1.0)),
    "bonded": lambda: bonded((1e8, 1.0)),
}


@pytest.mark.parametrize(("power_s", "power_f"), [(30, -30), (-12, 25), (7, 7)])
@pytest.mark.parametrize("name", COLUMNS)
def test_h14_powers_of_two_change_no_bit(name: str, power_s: int, power_f: int) -> None:
    s, c = 2.0**power_s, 2.0**power_f
    column = COLUMNS[name]()
    original, other = solve(column), solve(column, s, c)
    assert np.array_equal(other.reaction, original.reaction * c)
    assert np.array_equal(other.displacement, original.displacement * s)
    assert np.array_equal(other.status, original.status)
    assert np.array_equal(other.iterations, original.iterations)
    assert np.array_equal(other[0].history, original[0].history)


@pytest.mark.parametrize(
    ("s", "c"), [(1e-9, 1e9), (1e9, 1e-9), (1e9, 1e9), (1e-3, 1.0)]
)
@pytest.mark.parametrize("name", COLUMNS)
def test_h14_other_units_keep_the_digits(name: str, s: float, c: float) -> None:
    column = COLUMNS[name]()
    original, other = solve(column), solve(column, s, c)
    assert np.array_equal(other.status, original.status)
    assert np.array_equal(other.iterations, original.iterations)
    # K is rounded again in other units, by as much as the first time.
    of_u, of_r = misses(other.displacement[0] / s, other.reaction[0] / c, column)
    assert of_u <= 1e-10
    assert of_r <= 1e-10


def triangle(nu: float, edges: tuple[float, float]) -> Array:
    """Stiffness (u_n, u_t) of the corner of a right triangle, its other nodes held.

    Plane strain, `½ l_x l_y [(λ + G) g gᵀ + G |g|² I]`, `g = -(1/l_x, 1/l_y)`.
    """
    corners = np.array([[0.0, edges[0], 0.0], [0.0, 0.0, edges[1]]])
    mesh = skfem.MeshTri(corners, np.array([[0], [1], [2]]))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    K = linear_elasticity(*lame_parameters(1.0, nu)).assemble(basis).toarray()
    corner = basis.nodal_dofs[[1, 0], 0]
    return np.asarray(K[np.ix_(corner, corner)])


@pytest.mark.parametrize("nu", [0.4999999, 0.5 - 1e-9, 0.5 - 1e-12])
@pytest.mark.parametrize(
    ("mu", "f_t"), [(0.3, 1.5), (0.3, -1.5), (0.3, 0.1), (0.0, 1.0), (0.45, 2.0)]
)
def test_h12_one_triangle(mu: float, f_t: float, nu: float) -> None:
    K = triangle(nu, (1.0, 2.0))
    B = sparse.eye_array(2, format="csr")
    r = bp.solve(K, B, np.array([-1.0, f_t]), gap=[0.0], mu=mu).reaction[0, 0]
    k_c, k_t = Fraction(K[0, 1]), Fraction(K[1, 1])

    def slip(k_t: Fraction, k_c: Fraction) -> list[float]:
        side = 1 if f_t > 0 else -1
        limit = side * Fraction(mu)
        r_n = 1 + k_c * (Fraction(f_t) - limit) / (k_t + limit * k_c)
        return [float(r_n), float(-limit * r_n)]

    if abs(f_t) <= mu:
        np.testing.assert_allclose(r, [1.0, -f_t], rtol=1e-8)
        return
    # K is used as given; its closed form has no cancellation.
    np.testing.assert_allclose(r, slip(k_t, k_c), rtol=1e-8)
    # As ν → 1/2, K tends to a multiple of g gᵀ and k_t/k_c to l_y/l_x = 2. The difference
    # is 1 - 2ν times a coefficient of order one.
    limit = slip(Fraction(2), Fraction(1))
    np.testing.assert_allclose(r, limit, rtol=1e-8 + 10 * (1 - 2 * nu))


def extended(body: Body, load: Array, fixed: NDArray[np.int64], step: Any) -> Array:
    """Reactions for known statuses in 2D, by dense elimination in extended precision."""
    K = body.K.toarray().astype(np.longdouble)
    n, contacts = K.shape[0], len(step.status)
    B = body.B.toarray().astype(np.longdouble)
    rows = np.zeros((n + 2 * contacts, n + 2 * contacts), np.longdouble)
    right = np.append(load, np.zeros(2 * contacts)).astype(np.longdouble)
    rows[:n, :n], rows[:n, n:] = K, -B.T
    rows[fixed], right[fixed] = 0, 0
    rows[fixed, fixed] = K.max()
    for i, status in enumerate(step.status):
        normal, tangent = n + 2 * i, n + 2 * i + 1
        # v = 0 in the scale of forces; r = 0; or r_t against the slip.
        rows[normal, :n] = B[2 * i] * K.max()
        rows[tangent, :n] = B[2 * i + 1] * K.max()
        if status == OPEN:
            rows[[normal, tangent]] = 0
            rows[normal, normal] = rows[tangent, tangent] = 1
        elif status == SLIP:
            rows[tangent] = 0
            rows[tangent, tangent] = 1
            side = np.sign(step.relative_displacement[i, 1])
            rows[tangent, normal] = np.longdouble(MU) * side
    x = eliminate(rows, right)
    return np.asarray(x[n:].reshape(contacts, 2), float)


def eliminate(rows: Any, right: Any) -> Any:
    """Gaussian elimination with partial pivoting; NumPy's solvers round to doubles."""
    rows, x = rows.copy(), right.copy()
    for k in range(len(x)):
        best = k + int(np.argmax(np.abs(rows[k:, k])))
        rows[[k, best]], x[[k, best]] = rows[[best, k]], x[[best, k]]
        factors = rows[k + 1 :, k] / rows[k, k]
        rows[k + 1 :, k:] -= factors[:, None] * rows[k, k:]
        x[k + 1 :] -= factors * x[k]
    for k in reversed(range(len(x))):
        x[k] = (x[k] - rows[k, k + 1 :] @ x[k + 1 :]) / rows[k, k]
    return x


@pytest.mark.parametrize("nu", [0.4999, 0.4999999])
@pytest.mark.parametrize("shear", [0.0, 0.1, 0.35, 0.7])
def test_h12_nearly_incompressible_block(shear: float, nu: float) -> None:
    body = block([2.0, 1.0], [4, 2], 1.0, nu)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in (0, 1)])
    load = body.weight([2 * shear, -2.0]) + body.traction(0, 2.0, [0.2, 0.0])
    result = bp.solve(body.K, body.B, load, gap=body.gap, mu=MU, fixed=fixed)
    step = result[0]
    exact = extended(body, load, fixed, step)
    # With 64 bits of mantissa the reference has 12 digits here, as rational numbers show.
    # The rounding of K, of size 1/(1 - 2ν), or of u leaves an error of 1e-9 in r.
    np.testing.assert_allclose(
        step.reaction, exact, rtol=0, atol=1e-8 * np.abs(exact).max()
    )
    v = step.relative_displacement
    assert violation(exact, v, MU, step.displacement) <= 1e-8
