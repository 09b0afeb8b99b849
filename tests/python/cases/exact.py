"""A1–A6, A11, A12, A14: solutions that a discrete problem reproduces exactly."""

import csv
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import analytic
from cases.verification import Row, exact, exactly, near, same
from support.bars import bar_problem, lost, pulled
from support.bodies import Body, block, uniform_shear
from support.contacts import TOL, one_node
from support.places import REFERENCE

Array = NDArray[np.float64]
DATA = REFERENCE


def verdict(body: Body, load: Array, mu: float) -> str:
    """Outcome for a body held by contact alone."""
    try:
        bp.solve(body.K, body.B, load, gap=body.gap, mu=mu, tol=TOL)
    except bp.NoEquilibriumError:
        return "no equilibrium"
    return "held"


def a1() -> list[Row]:
    """Uniform patch with shear."""
    plane = block((3, 1), (3, 3), 10.0, 0.0)
    load = uniform_shear(plane, 2.0, [0.6])
    result: Any = bp.solve(plane.K, plane.B, load, gap=plane.gap, mu=0.4, tol=TOL)
    top = result.displacement[0][plane.basis.nodal_dofs][:, plane.nodes_where(1, 1.0)]
    space = block((2, 1, 1.5), (3, 2, 2), 10.0, 0.0)
    pushed = uniform_shear(space, 2.0, [0.45, -0.6])
    solid: Any = bp.solve(space.K, space.B, pushed, gap=space.gap, mu=0.4, tol=TOL)
    forces = np.outer(space.area, [2.0, -0.45, 0.6])
    beyond = uniform_shear(plane, 2.0, [1.01 * 0.4 * 2.0])
    r, refused = [[1, -0.3], [2, -0.6], [2, -0.6], [1, -0.3]], "no equilibrium"
    pairs = {
        "reactions of the sheared patch [N/m]": (r, result.reaction[0]),
        "u of its top": ([[0.12] * 4, [-0.2] * 4], top),
        "reactions in space [N]": (forces, solid.reaction[0]),
    }
    told = verdict(plane, beyond, 0.4)
    return [
        *exactly("closed form", 1e-10, pairs),
        same("shear 1.01 of the limit", "statics", refused, told),
    ]


def a2() -> list[Row]:
    """Oedometer, for Poisson's ratios up to 1/2."""
    rows = []
    for nu in (0.3, 0.4999, 0.4999999):
        body = block((1, 1), (4, 4), 1.0, nu)
        walls = np.append(body.dofs(0, 0.0, 0), body.dofs(0, 1.0, 0))
        load = body.traction(1, 1.0, [0.0, -1.0])
        result: Any = bp.solve(
            body.K, body.B, load, gap=body.gap, mu=0.3, fixed=np.unique(walls)
        )
        height = body.basis.mesh.p[1]
        u = result.displacement[0][body.basis.nodal_dofs[1]]
        # K contains 1/(1 - 2ν), rounded.
        within = 1e-11 + 1e-15 / (1 - 2 * nu)
        closed = analytic.oedometer(height, 1.0, 1.0, nu)
        rows.append(
            exact(f"u of the column, ν = {nu}", "closed form", closed, u, within)
        )
    return rows


def listed() -> dict[tuple[float, float], list[list[float]]]:
    """Every solution of one contact: (u_n, u_t, r_n, r_t) by (μ, f_t)."""
    branches: dict[tuple[float, float], list[list[float]]] = {}
    with (DATA / "one_contact_branches.csv").open() as file:
        for row in csv.DictReader(file):
            values = [float(row[name]) for name in ("u_n", "u_t", "r_n", "r_t")]
            branches.setdefault((float(row["mu"]), float(row["f_t"])), []).append(
                values
            )
    return branches


def nearest(result: Any, branches: list[list[float]]) -> tuple[list[float], Array]:
    """The nearest listed solution, and the computed one."""
    got = np.array([*result.displacement[0], *result.reaction[0, 0]])
    return min(branches, key=lambda b: float(np.abs(got - b).max())), got


def a3() -> list[Row]:
    """One contact, against all of its answers."""
    loads = listed()
    pairs = [
        nearest(one_node([-1.0, f_t], mu), branches)
        for (mu, f_t), branches in loads.items()
    ]
    want, got = ([pair[k] for pair in pairs] for k in (0, 1))
    u_t, what = one_node([-1.0, 1.5], 0.3).displacement[0, 1], "enumeration"
    return [
        exact(f"one contact, {len(loads)} loads and μ", what, want, got, 1e-9),
        exact("u_t if the answer is unique", what, 1.043478260870, u_t, 1e-10),
    ]


def a4() -> list[Row]:
    """Wedged at zero load."""
    path = [[-1, 8], [0, 0]]
    high: Any = one_node(path, 3.0)
    low: Any = one_node(path, 1.5)
    return [
        exact("wedged, r, μ = 3", "enumeration", [1, 2], high.reaction[1, 0], 1e-10),
        exact("relaxed, r, μ = 1.5", "enumeration", [0, 0], low.reaction[1, 0], 1e-10),
    ]


def a5() -> list[Row]:
    """Path dependence."""
    rows = []
    for what, path, u_t, r in [
        ("normal, then tangential", [[-1, 0], [-1, 0.4]], 0.0, [1, -0.4]),
        ("proportional", [[-0.5, 0.2], [-1, 0.4]], 0.0, [1, -0.4]),
        ("tangential, then normal", [[0, 0.4], [-1, 0.4]], 0.4, [1, 0.0]),
    ]:
        result: Any = one_node(path, 0.5, stiffness=np.eye(2))
        got = [*result.reaction[-1, 0], result.displacement[-1, 1]]
        rows.append(exact(f"(r, u_t), {what}", "enumeration", [*r, u_t], got, 1e-10))
    return rows


def incline(share: float, mu: float = 0.6) -> tuple[Body, Array]:
    """A block of weight 7 on a slope of tangent `share` μ."""
    body = block((3, 1), (4, 3), 1e3, 0.3)
    slope = math.atan(share * mu)
    return body, body.weight([7 * math.sin(slope), -7 * math.cos(slope)])


def a6() -> list[Row]:
    """Block on an incline, held by friction alone."""
    rows = []
    for share in (0.5, 0.99, 0.999999):
        body, load = incline(share)
        slope = math.atan(share * 0.6)
        result: Any = bp.solve(body.K, body.B, load, gap=body.gap, mu=0.6, tol=TOL)
        total = result.reaction[0].sum(axis=0)
        weight = [7 * math.cos(slope), -7 * math.sin(slope)]
        what = f"sum of r on the incline, tan α = {share} μ"
        rows.append(exact(what, "statics", weight, total, 1e-10))
    rows += [
        same(f"tan α = {s} μ", "statics", "no equilibrium", verdict(*incline(s), 0.6))
        for s in (1.000001, 1.01)
    ]
    return rows


def a11() -> list[Row]:
    """Bar on a frictional foundation."""
    table = np.loadtxt(DATA / "bar_cyclic.csv", delimiter=",", skiprows=1)
    problem, load = bar_problem()
    result: Any = problem.solve(pulled(load, table[:, 0]), tol=1e-13)
    end = result.displacement[:, -1]
    cycle = lost(result)[12:].sum()
    return [
        exact("end of the bar over a cycle [m]", "closed form", table[:, 1], end, 1e-9),
        exact("friction work of a cycle [J]", "closed form", 0.36125, cycle, 1e-10),
    ]


def turning(steps: int) -> tuple[float, float]:
    """Slip after six turns of the load, closed form and computed."""
    angle = np.arange(1, 6 * steps + 1) * 2 * math.pi / steps
    normal = np.full_like(angle, -1.0)
    load = np.column_stack([normal, 0.8 * np.cos(angle), 0.8 * np.sin(angle)])
    result: Any = one_node(load, 0.5, stiffness=np.diag([3.0, 2.0, 2.0]))
    radius, _ = analytic.rotating_load(2.0, 0.8, 0.5, steps)
    return radius, float(np.linalg.norm(result.displacement[-1, 1:]))


def a12() -> list[Row]:
    """Rotating load."""
    # The transient shrinks by a fixed factor per radian, to 1e-9 in three turns.
    what = "slip under a turning load, {} steps a turn"
    pairs = {what.format(m): turning(m) for m in (8, 64, 512)}
    return exactly("closed form", 1e-9, pairs)


def a14() -> list[Row]:
    """Slip under an anisotropic W."""
    # W and r for q = (-1, 1.6, 0.9) and a coefficient of 0.4.
    cases = {
        "W = diag(1, 2, 5)": (np.diag([1.0, 2, 5]), [1, -0.38002548, -0.12482241]),
        "full W": (
            np.array([[1.0, 0.2, -0.1], [0.2, 2, 0.5], [-0.1, 0.5, 5]]),
            [1.07652377, -0.42297689, -0.08071613],
        ),
    }
    rows = []
    for what, (W, r) in cases.items():
        problem = bp.ReducedProblem(W, [[-1.0, 1.6, 0.9]], 0.4)
        got, source = problem.solve(tol=TOL).reaction[0], "separate scalar solution"
        # Eight decimals are printed.
        rows.append(near(f"r, {what}", source, r, got, 1e-8))
    return rows


CASES = {f.__name__: f for f in (a1, a2, a3, a4, a5, a6, a11, a12, a14)}
