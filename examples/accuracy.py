"""Errors compared with closed forms that the discretisation meets exactly.

Prints the table of the README. Each error is the largest difference of a case, relative
to the largest number of the closed form.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

import bipot_rs as bp
from bipot_rs import analytic, fem

TOL = 1e-13


def error(found: ArrayLike, exact: ArrayLike) -> float:
    """Largest difference, relative to the largest exact number."""
    exact = np.asarray(exact)
    return float(np.abs(np.asarray(found) - exact).max() / np.abs(exact).max())


def block(nu: float) -> fem.Body:
    """A block of 3 m × 1 m, 12 × 6 bilinear elements, E = 10 Pa, plane strain."""
    mesh = fem.box([np.linspace(0, 3, 13), np.linspace(0, 1, 7)], "quadrilateral")
    return fem.Body("block", mesh, fem.Material(young=10.0, poisson=nu))


def floor(mu: float) -> fem.Contact:
    """A rigid plane under the block."""
    return fem.Contact("block", "bottom", mu=mu, plane=((0, 0), (0, 1)))


def sheared_patch() -> float:
    """A block with uniform stress, held by friction alone."""
    pressure, shear = 2.0, 0.6
    model = fem.assemble([block(nu=0.0)], [floor(mu=0.5)])
    load = (
        model.traction("block", "top", [shear, -pressure])
        + model.traction("block", "right", [0.0, shear])
        + model.traction("block", "left", [0.0, -shear])
    )
    result = model.problem().solve(load, tol=TOL)
    exact = np.outer(model.area, [pressure, -shear])
    u = result.displacement[0].reshape(-1, 2)
    u_exact = analytic.sheared_patch(model.nodes[:, 1], pressure, shear, young=10.0)
    return max(error(result.reaction[0], exact), error(u, np.stack(u_exact, axis=1)))


def oedometer(nu: float) -> float:
    """A block in uniaxial strain between smooth side walls."""
    model = fem.assemble(
        [block(nu)],
        [floor(mu=0.5)],
        [fem.Support("block", side, [0]) for side in ("left", "right")],
    )
    load = model.traction("block", "top", [0.0, -2.0])
    result = model.problem().solve(load, tol=TOL)
    exact = np.outer(model.area, [2.0, 0.0])
    height = analytic.oedometer(model.nodes[:, 1], 2.0, 10.0, nu)
    return max(
        error(result.reaction[0], exact), error(result.displacement[0][1::2], height)
    )


def one_contact() -> float:
    """A thousand random contacts of two coupled unknowns, with one answer each."""
    random = np.random.default_rng(3)
    worst = 0.0
    for _ in range(1000):
        k_n, k_t = random.uniform(0.5, 2.0, 2)
        k_c = random.uniform(-0.9, 0.9) * np.sqrt(k_n * k_t)
        # The answer is unique for μ below k_t/|k_c|.
        mu = random.uniform(0.0, 0.9) * min(k_t / abs(k_c), 2.0)
        stiffness, load = np.array([[k_n, k_c], [k_c, k_t]]), random.normal(size=2)
        (branch, *_) = analytic.one_contact_branches(stiffness, load, mu)
        result = bp.solve(stiffness, np.eye(2), load, gap=[0.0], mu=mu, tol=TOL)
        found = [*result.reaction[0, 0], *result.relative_displacement[0, 0]]
        worst = max(worst, error(found, [*branch.reaction, *branch.displacement]))
    return worst


def cyclic_bar() -> float:
    """The end displacement of a bar pulled to and fro on a frictional foundation."""
    n, stiffness, limit, peak, mu = 20, 1000.0, 50.0, 30.0, 0.3
    chain = sparse.diags([-1.0, [2.0] * (n - 1) + [1.0], -1.0], [-1, 0, 1], (n, n))
    K = sparse.kron(chain, np.diag([0.0, 1.0])) * stiffness * n
    K = K + sparse.kron(sparse.identity(n), np.diag([100.0, 0.0]))
    press = np.append(np.full(n - 1, 1.0), 0.5) * limit / n / mu
    loads = np.zeros((41, 2 * n))
    loads[:, ::2] = -press
    path = peak * np.sin(np.pi / 2 * np.arange(41)).round()  # 0, +P, 0, -P, 0, ...
    loads[:, -1] = path
    problem = bp.ContactProblem(K, sparse.identity(2 * n), gap=np.zeros(n), mu=mu)
    result = problem.solve(loads, tol=TOL)
    end = result.relative_displacement[1::2, -1, 1]
    return error(end, analytic.bar_end_displacement(path[1::2], stiffness, limit))


def turning_load() -> float:
    """One contact in three dimensions under a rotating force, 16 steps a turn."""
    angle = 2 * np.pi / 16 * np.arange(10 * 16)
    loads = np.stack(
        [-np.ones_like(angle), 0.8 * np.cos(angle), 0.8 * np.sin(angle)], 1
    )
    result = bp.solve(
        np.diag([1.0, 2.0, 2.0]), np.eye(3), loads, gap=[0.0], mu=0.5, tol=TOL
    )
    radius = np.linalg.norm(result.relative_displacement[-16:, 0, 1:], axis=1)
    return error(radius, analytic.rotating_load(2.0, 0.8, 0.5, 16)[0])


CASES: dict[str, Callable[[], float]] = {
    "block pressed and sheared, held by friction alone": sheared_patch,
    "block between smooth walls, ν = 0.3": lambda: oedometer(0.3),
    "the same, ν = 0.4999": lambda: oedometer(0.4999),
    "1000 random contacts of two unknowns": one_contact,
    "bar pulled to and fro on a rough foundation, 10 cycles": cyclic_bar,
    "tangential force that turns, 10 turns": turning_load,
}

if __name__ == "__main__":
    print("| case | largest error |\n|---|---|")
    for name, case in CASES.items():
        print(f"| {name} | {case():.0e} |")
