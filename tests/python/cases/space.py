"""A8, A10: half-spaces, represented by boxes of 8 contact radii.

Their far faces are moved by the closed forms of point forces. Boxes twice as large
change the force by 5e-4.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import analytic, fem
from cases.verification import Refinement
from support.halfspace import body, boussinesq, cerutti, grid
from support.profiles import Profile, mean_square, refine

Array = NDArray[np.float64]
FAR = 8.0
SIZES, FINE = [0.4, 0.2, 0.1], [1 / 15]
# The sphere of ANSYS VM63, mm and N; its approach under 60π N.
VM63 = {"radius": 8.0, "young": 1000.0, "nu": 0.3, "delta": 0.127420}


def quarter(
    h: float,
    a: float,
    constants: tuple[float, float],
    radius: float,
    planes: tuple[list[int], list[int]],
) -> fem.Assembly:
    """x, y >= 0 of a box over a paraboloid; components held on x = 0 and on y = 0."""
    side, up = a * grid(h, 1.4, FAR), a * grid(h, 0.6, FAR)
    contact = fem.Contact(
        "body",
        "bottom",
        0.0,
        plane=((0, 0, 0), (0, 0, 1)),
        clearance=lambda x: np.sum(x[:, :2] ** 2, axis=1) / (2 * radius),
        within={0: (0, 1.3 * a), 1: (0, 1.3 * a)},
    )
    supports = [
        fem.Support("body", "left", planes[0]),
        fem.Support("body", "front", planes[1]),
        *(fem.Support("body", far, [0, 1, 2]) for far in ("right", "back", "top")),
    ]
    return fem.assemble(
        [body("body", [side, side, up], *constants)], [contact], supports
    )


def moved(model: fem.Assembly, field: Array) -> Array:
    """Prescribed values: the displacement field on the far faces."""
    on_far = (model.nodes == model.nodes.max(axis=0)).any(axis=1)
    return np.where(on_far[:, None], field, 0.0).ravel()[model.fixed]


@cache
def sphere(h: float) -> tuple[Profile, float, float, float]:
    """A rigid sphere on a half-space: force, expected and computed, and the radius.

    The radius comes from the second moment: the mean of x² under the half ellipsoid is 2a²/5.
    """
    radius, young, nu, delta = VM63.values()
    e_star = analytic.contact_modulus(young, nu)
    force = 4 / 3 * e_star * np.sqrt(radius) * delta**1.5
    a, _, p0 = analytic.hertz_sphere(force, radius, e_star)
    model = quarter(h, a, (young, nu), radius, ([0], [1]))
    far = boussinesq(model.nodes, force, young, nu) - [0, 0, delta]
    result: Any = model.problem().solve(None, moved(model, far))
    r, x = result.reaction[0], np.linalg.norm(model.points, axis=1)
    expected = np.zeros_like(r)
    expected[:, 0] = analytic.hertz_pressure(x, a, p0)
    moment = float(np.sqrt(2.5 * (r[:, 0] @ x**2) / r[:, 0].sum()))
    profile = Profile(x, model.area, result.traction[0], expected)
    return profile, force, 4 * float(r[:, 0].sum()), moment


def a8(fine: bool = False) -> list[Refinement]:
    """A rigid sphere on a half-space, without friction."""
    sizes, source = SIZES + FINE * fine, "Hertz, [J85, (4.22)–(4.24)]"
    spheres = [sphere(h) for h in sizes]
    profiles, forces = [f[0] for f in spheres], [f[1:3] for f in spheres]
    axis = [p.on_axis(0) for p in profiles]
    return [
        refine("force for the approach", source, sizes, forces, order=1.8, within=2e-3),
        refine("pressure on the axis", source, sizes, axis, order=1.8, within=2e-3),
        mean_square(source, sizes, profiles, 0, order=0.9, within=0.05),
    ]


@cache
def sheared(h: float, nu: float, mu: float = 0.3) -> tuple[Profile, float, float]:
    """Equal spheres, pressed and then sheared by 7/8 of μP; Q expected and computed.

    The lower body is the mirror image of the upper one. So normal forces move the two apart
    by twice the motion of one and do not shear them, and the same holds for tangential
    forces: the compliance of the pair is twice that of one body without its coupling. In
    each quarter the normal part is even in x, the tangential part odd.
    """
    delta, radius, young = 1e-3, 1e3, 1.0  # a = 1
    e_star = analytic.contact_modulus(young, nu, young, nu)
    force = 4 / 3 * e_star * np.sqrt(radius) * delta**1.5
    Q = 7 / 8 * mu * force
    m = analytic.mindlin_sphere(force, Q, radius, e_star, mu, 4 * (2 - nu) * (1 + nu))
    parts = []
    for planes in (([0], [1]), ([1, 2], [1])):
        model = quarter(h, m.a, (young, nu), 2 * radius, planes)
        if planes[0] == [0]:
            far = boussinesq(model.nodes, force, young, nu) - [0, 0, delta / 2]
        else:
            # Friction holds this body back.
            far = [m.shift / 2, 0, 0] - cerutti(model.nodes, Q, young, nu)
        parts.append(model.problem().reduced(prescribed=moved(model, far)))
    normal, aside = parts
    row = np.arange(len(normal.q.ravel())) % 3 == 0
    W = np.where(np.outer(row, row), normal.W, 0) + np.where(
        np.outer(~row, ~row), aside.W, 0
    )
    q = np.column_stack([normal.q[:, 0], aside.q[:, 1:]])
    # Pressing alone causes no shear, so the shearing step has no history.
    solution = bp.ReducedProblem(2 * W, 2 * q, mu).solve()
    r, x = solution.reaction, np.linalg.norm(model.points, axis=1)
    expected = np.zeros_like(r)
    expected[:, 0] = analytic.hertz_pressure(x, m.a, m.p0)
    expected[:, 1] = -analytic.partial_slip_traction(x, m.a, m.c, m.p0, mu)
    profile = Profile(x, model.area, r / model.area[:, None], expected)
    return profile, Q, -4 * float(r[:, 1].sum())


def a10(fine: bool = False) -> list[Refinement]:
    """Equal spheres with ν = 0, pressed and then sheared."""
    sizes, source = SIZES + FINE * fine, "Mindlin, [J85, ch. 7]"
    shears = [sheared(h, 0.0) for h in sizes]
    profiles, forces = [f[0] for f in shears], [f[1:] for f in shears]
    axis = [p.on_axis(1) for p in profiles]
    return [
        refine("force for the shift", source, sizes, forces, order=1.8, within=2e-3),
        refine("shear on the axis", source, sizes, axis, order=1.8, within=5e-3),
        mean_square(source, sizes, profiles, 1, order=0.8, within=0.06),
    ]


CASES = {"a8": a8, "a10": a10}
