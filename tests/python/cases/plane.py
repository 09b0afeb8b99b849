"""A7, A9, A13: half-planes, represented by bodies of 300 or more half-widths.

Lengths are in units of the half-width unless stated. The finite size L of the body
changes results by (a/L)², or by a/L where a punch drags it sideways.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs import analytic, fem
from cases.verification import Refinement
from support.halfspace import body, grid, mirrored
from support.profiles import Profile, mean_square, refine

Array = NDArray[np.float64]
NU, MU = 0.3, 0.3
FAR = 300.0
SIZES, FINE = [0.2, 0.1, 0.05], [0.025]


@cache
def line(
    h: float,
    moduli: tuple[float, float] = (1.0, np.inf),
    radius: float = 250 * np.pi,
    force: float = 1e-3 / (1 - NU**2),
) -> tuple[Profile, float]:
    """Two half-planes (inf: rigid), pressed on each other; as given, a = 1.

    Without friction only half of them, x >= 0. After the profile it returns the half-width
    from the second moment: the mean of x² under a half ellipse is a²/4.
    """
    upper, lower = moduli
    e_star = analytic.contact_modulus(upper, NU, lower, NU)
    a, p0 = analytic.hertz_line(force, radius, e_star)
    side, up = a * grid(h, 1.6, FAR), a * grid(h, 1.0, FAR)
    bodies = [body("upper", [side, up], upper, NU)]
    supports = [fem.Support("upper", "left", [0])]
    obstacle: dict[str, Any] = {"plane": ((0, 0), (0, 1))}
    if np.isfinite(lower):
        bodies.append(body("lower", [side, -up], lower, NU))
        supports.append(fem.Support("lower", "left", [0]))
        supports.append(fem.Support("lower", "bottom", [0, 1]))
        obstacle = {"against": ("lower", "top")}
    contact = fem.Contact(
        "upper",
        "bottom",
        0.0,
        clearance=lambda x: x[:, 0] ** 2 / (2 * radius),
        within={0: (0, 1.6 * a)},
        **obstacle,
    )
    model = fem.assemble(bodies, [contact], supports)
    load = model.traction("upper", "top", [0, -force / 2 / side[-1]])
    result: Any = model.problem().solve(load)
    x, r = model.points[:, 0], result.reaction[0]
    expected = np.zeros_like(r)
    expected[:, 0] = analytic.hertz_pressure(x, a, p0)
    moment = 2 * float(np.sqrt(r[:, 0] @ x**2 / r[:, 0].sum()))
    return Profile(x, model.area, result.traction[0], expected), moment


def a7(fine: bool = False) -> list[Refinement]:
    """A rigid cylinder on a half-plane, without friction."""
    sizes, source = SIZES + FINE * fine, "Hertz, [J85, ch. 4]"
    lines_by_size = [line(h) for h in sizes]
    profiles, widths = (
        [f[0] for f in lines_by_size],
        [(1.0, f[1]) for f in lines_by_size],
    )
    axis = [p.on_axis(0) for p in profiles]
    return [
        # The axis depends on the edges only through their mean.
        refine("pressure on the axis", source, sizes, axis, order=1.8, within=2e-5),
        refine("half-width", source, sizes, widths, order=1.8, within=1e-3),
        mean_square(source, sizes, profiles, 0, order=0.9, within=0.02),
    ]


@cache
def sheared(h: float) -> tuple[Profile, float]:
    """Equal half-planes pressed, then sheared by 3/4 of μP; the half-width of the stick zone.

    The far faces move without rotation. Iteration finds the motions whose forces give a = 1
    and a stick zone of half-width 1/2.
    """
    side, up = mirrored(grid(h, 1.6, FAR)), grid(h, 1.0, FAR)
    bodies = [body("upper", [side, up], 1.0, NU), body("lower", [side, -up], 1.0, NU)]
    e_star = analytic.contact_modulus(1.0, NU, 1.0, NU)
    force = 1e-3
    radius = np.pi * e_star / (4 * force)
    contact = fem.Contact(
        "upper",
        "bottom",
        MU,
        against=("lower", "top"),
        clearance=lambda x: x[:, 0] ** 2 / (2 * radius),
        within={0: (-1.6, 1.6)},
    )
    held = [fem.Support("lower", "bottom", [0, 1]), fem.Support("upper", "top", [0, 1])]
    model = fem.assemble(bodies, [contact], held)
    problem = model.problem()
    down, aside = 3.5 * force, 0.7 * force
    for _ in range(8):  # # each iteration gains a digit
        path = [model.prescribed([[0, 0], [x, -down]]) for x in (0, aside)]
        result: Any = problem.solve(None, np.array(path))
        P, Q = result.reaction[-1].sum(axis=0)
        down, aside = down * force / P, aside * 0.75 * MU * force / -Q
    x = model.points[:, 0]
    a, c, p0 = analytic.cattaneo_mindlin_line(P, Q, radius, e_star, MU)
    expected = np.column_stack(
        [
            analytic.hertz_pressure(x, a, p0),
            # The reaction points against the force.
            -analytic.partial_slip_traction(x, a, c, p0, MU),
        ]
    )
    # Half a cell is added to the last sticking node.
    stuck = float(x[result.status[-1] == 2].max()) + h / 2
    return Profile(x, model.area, result.traction[-1], expected), stuck


def a9(fine: bool = False) -> list[Refinement]:
    """Equal cylinders, pressed and then sheared."""
    sizes, source = SIZES + FINE * fine, "Cattaneo, Mindlin, [J85, ch. 7]"
    profiles = [sheared(h)[0] for h in sizes]
    axis = [p.on_axis(1) for p in profiles]
    return [
        refine("shear on the axis", source, sizes, axis, order=0.9, within=2e-3),
        mean_square(source, sizes, profiles, 0, order=0.9, within=0.02),
        mean_square(source, sizes, profiles, 1, order=0.9, within=0.03),
    ]


@cache
def punch(h: float, mu: float, nu: float = 0.1) -> tuple[Array, Array, Array, float]:
    """A flat rigid punch of half-width 1, sliding to -x: x, area, reactions, β."""
    # The drag rotates the whole body by a/L.
    far = 1e4
    side, up = mirrored(grid(h, 1.2, far)), grid(h, 1.0, far)
    contact = fem.Contact(
        "body", "bottom", mu, plane=((0, 0), (0, 1)), within={0: (-1, 1)}
    )
    top = fem.Support("body", "top", [0, 1])
    model = fem.assemble([body("body", [side, up], 1.0, nu)], [contact], [top])
    # Displacements are linear: moving ten times as far sideways as down slips everywhere.
    moved = model.prescribed([[10.0 * (mu > 0), -1.0]])
    result = model.problem().solve(None, moved)
    beta = (1 - 2 * nu) / (2 * (1 - nu))
    return model.points[:, 0], model.area, result.reaction[0], beta


def within_08(x: Array, r: Array) -> float:
    """Share of the force within |x| < 0.8; nodes on the limit count half."""
    weight = np.where(np.abs(np.abs(x) - 0.8) < 1e-6, 0.5, np.abs(x) < 0.8)
    return float(weight @ r / r.sum())


def closed_share(mu: float, beta: float) -> float:
    """The same share of the closed form; x = sin θ removes the singularity."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    end = np.arcsin(0.8)
    theta = end * nodes
    p = analytic.flat_punch_pressure(np.sin(theta), 1.0, 1.0, mu, beta)
    return float(end * weights @ (p * np.cos(theta)))


def a13(fine: bool = False) -> list[Refinement]:
    """A flat punch, at rest without friction and sliding with μ = 1/2."""
    sizes, source = SIZES + FINE * fine, "[J85, ch. 2]"
    tables = []
    for mu, what in ((0.0, "at rest"), (0.5, "sliding")):
        runs = [punch(h, mu) for h in sizes]
        share = [
            (closed_share(mu, beta), within_08(x, r[:, 0])) for x, _, r, beta in runs
        ]
        # The singular edges are resolved to one cell, which acts like a wider punch.
        what = f"share of the force in abs(x) < 0.8a, {what}"
        tables.append(refine(what, source, sizes, share, order=0.8, within=0.04))
    centre = [
        (2 * np.arctan(mu * beta) / np.pi, float(r[:, 0] @ x / r[:, 0].sum()))
        for x, _, r, beta in runs
    ]
    what = "centre of pressure, sliding"
    tables.append(refine(what, source, sizes, centre, order=0.7, within=0.02))
    return tables


CASES = {"a7": a7, "a9": a9, "a13": a13}
