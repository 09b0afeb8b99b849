"""A17 to A19: bodies of revolution, of which the mesh is the half section (r, z)."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs import analytic, fem
from bipot_rs.obstacle.shapes import Sphere
from cases.verification import Refinement
from support.profiles import Profile, mean_square, refine

Array = NDArray[np.float64]
E_STAR = 1 / (1 - 0.3**2)
KINDS = {
    "P1": ("triangle", 1),
    "Q1": ("quadrilateral", 1),
    "P2": ("triangle", 2),
    "Q2": ("quadrilateral", 2),
}


def material(young: float = 1.0, nu: float = 0.3) -> fem.Material:
    return fem.Material(young, nu, axisymmetric=True)


def ring(kind: str, n: int, low: float, high: float, length: float) -> Any:
    """A rectangle of n cells along r and half as many along z."""
    cell, order = KINDS[kind]
    along = np.linspace(0, length, max(1, n // 2) + 1)
    mesh: Any = fem.box([np.linspace(low, high, n + 1), along], cell)
    return fem.second_order(mesh) if order == 2 else mesh


def widening(
    inner: float, outer: float, young: float, nu: float, *, bore: bool
) -> float:
    """Lamé, plane strain: displacement of a surface for a pressure of 1 on it."""
    square = outer**2 - inner**2
    r, A, sign = (inner, inner**2, 1) if bore else (outer, -(outer**2), -1)
    steady = (1 - 2 * nu) * A * r + sign * (inner * outer) ** 2 / r
    return (1 + nu) / young * steady / square


def lame_fit(interference: float) -> float:
    """Pressure of the hub on the shaft of `fit`."""
    hub, shaft = (
        widening(2, 4, 0.5, 0.25, bore=True),
        widening(1, 2, 1, 0.3, bore=False),
    )
    return interference / (hub - shaft)


@cache
def fit(
    kind: str, n: int, pairing: str = "mortar", unit: float = 1.0, force: float = 1.0
) -> tuple[Any, Any]:
    """A hub on a hollow shaft between two planes, and the model; meshes differ with mortar."""
    young = force / unit**2
    other = n + n // 2 if pairing == "mortar" else n
    bodies = [
        fem.Body("shaft", ring(kind, n, unit, 2 * unit, unit), material(young)),
        fem.Body(
            "hub",
            ring(kind, other, 2 * unit, 4 * unit, unit),
            material(young / 2, 0.25),
        ),
    ]
    if pairing == "match":
        along = np.linspace(0, unit, n // 2 + 1)
        grid = [np.linspace(2 * unit, 4 * unit, other + 1), along]
        bodies[1] = fem.Body("hub", fem.box(grid, KINDS[kind][0]), bodies[1].material)
    contact = fem.Contact(
        "shaft",
        "right",
        mu=0.0,
        against=("hub", "left"),
        clearance=-1e-3 * unit,
        pairing=pairing,
    )
    supports = [fem.Support(b.name, s, (1,)) for b in bodies for s in ("bottom", "top")]
    model = fem.assemble(bodies, [contact], supports)
    return model.problem().solve(np.zeros(model.n)), model


def mean_pressure(result: Any, area: Array) -> float:
    return float(result.reaction[0, :, 0].sum() / area.sum())


@cache
def quarter(n: int) -> float:
    """Mean pressure of the fit in space, between two more planes of symmetry."""
    bodies, supports = [], []
    for name, low, young, nu in (("shaft", 1, 1.0, 0.3), ("hub", 2, 0.5, 0.25)):
        grids = [np.linspace(low, 2 * low, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1)]
        mesh: Any = fem.box([*grids, [0.0, 1.0]], "hexahedron")
        r, angle, z = mesh.p
        mesh.p[:] = r * np.cos(angle), r * np.sin(angle), z
        bodies.append(fem.Body(name, mesh, fem.Material(young, nu)))
        planes = (("bottom", 2), ("top", 2), ("front", 1), ("back", 0))
        supports += [fem.Support(name, side, (k,)) for side, k in planes]
    contact = fem.Contact(
        "shaft", "right", mu=0.0, against=("hub", "left"), clearance=-1e-3
    )
    model = fem.assemble(bodies, [contact], supports)
    return mean_pressure(model.problem().solve(np.zeros(model.n)), model.area)


def a17(fine: bool = False) -> list[Refinement]:
    """A shrink fit against Lamé; h is the size of the cells of the shaft, a its wall."""
    cells = [4, 8, 16, *[32] * fine]
    sizes, source = [1 / n for n in cells], "Lamé, closed form"
    orders = {"P1": 1.8, "Q1": 1.9, "P2": 3.5, "Q2": 3.8}
    found, exact = [], lame_fit(1e-3)
    for kind, order in orders.items():
        what = f"pressure of a shrink fit, {kind}, mortar"
        within = 1e-3 if kind.endswith("1") else 1e-7
        fits = [fit(kind, n) for n in cells]
        pairs = [(exact, mean_pressure(result, model.area)) for result, model in fits]
        found.append(refine(what, source, sizes, pairs, order=order, within=within))
    pairs, sizes = [(exact, quarter(n)) for n in (2, 4, 8)], [0.5, 0.25, 0.125]
    what = "the same, a quarter in space"
    return [*found, refine(what, source, sizes, pairs, order=1.8, within=3e-3)]


HELD = [fem.Support("base", "bottom", (1,)), fem.Support("base", "right", (0,))]


def base(r: Array) -> fem.Body:
    """A cylinder as high as wide, with fine cells at its top and axis."""
    return fem.Body("base", fem.box([r, -r[::-1]], "quadrilateral"), material())


@cache
def hertz(n: int, engine: str = "auto") -> tuple[float, Profile]:
    """A rigid sphere on a half-space, n cells over the radius a of the contact: force, profile.

    Normals tilt by a/R = 0.002, which changes the answer by as much.
    """
    a = 0.002
    fine = np.linspace(0, 1.5 * a, int(1.5 * n) + 1)
    r = np.concatenate([fine, 1.5 * a + np.geomspace(a / n, 800 * a, 5 * n)])
    contact = fem.Contact(
        "base",
        "top",
        mu=0.0,
        obstacle=Sphere((0.0, 1 - a**2), 1.0),
        within={0: (0.0, 1.4 * a)},
    )
    model = fem.assemble([base(r)], [contact], HELD)
    result: Any = model.problem(engine=engine).solve(np.zeros(model.n))
    force = 4 / 3 * E_STAR * a**3
    _, _, p0 = analytic.hertz_sphere(force, 1.0, E_STAR)
    x = model.points[:, 0]
    expected = np.zeros((len(x), 2))
    expected[:, 0] = analytic.hertz_pressure(x, a, p0)
    along = -float(model.frame[:, 0, 1] @ result.reaction[0, :, 0])
    return along / force, Profile(x, model.area, result.traction[0], expected)


def a18(fine: bool = False) -> list[Refinement]:
    """Hertz: the force and the pressure for an approach of a²/R."""
    cells, source = [4, 8, 16, *[32] * fine], "Hertz, [J85, (4.22)–(4.24)]"
    sizes, found = [1 / n for n in cells], [hertz(n) for n in cells]
    forces = [(1.0, force) for force, _ in found]
    profiles = [profile for _, profile in found]
    axis = [p.on_axis(0) for p in profiles]
    return [
        refine(
            "force over that of Hertz", source, sizes, forces, order=0.8, within=4e-3
        ),
        refine("pressure on the axis", source, sizes, axis, order=0.8, within=2e-2),
        mean_square(source, sizes, profiles, 0, order=0.9, within=0.05),
    ]


@cache
def punch(n: int) -> tuple[float, Profile]:
    """A rigid flat punch of radius 1 on a half-space: force over 2 E* a δ, inner profile."""
    delta = 1e-3
    r = np.concatenate([np.linspace(0, 1, n + 1), 1 + np.geomspace(1 / n, 800, 5 * n)])
    contact = fem.Contact(
        "base",
        "top",
        mu=0.0,
        plane=((0.0, -delta), (0.0, -1.0)),
        within={0: (0.0, 1.0)},
    )
    model = fem.assemble([base(r)], [contact], HELD)
    result: Any = model.problem().solve(np.zeros(model.n))
    force = result.reaction[0, :, 0].sum()
    inner = model.points[:, 0] < 0.7
    x = model.points[inner, 0]
    expected = np.zeros((len(x), 2))
    # The singularity at the edge, from the approach alone.
    expected[:, 0] = E_STAR * delta / (np.pi * np.sqrt(1 - x**2))
    profile = Profile(x, model.area[inner], result.traction[0, inner], expected)
    return float(force / (2 * E_STAR * delta)), profile


def a19(fine: bool = False) -> list[Refinement]:
    """A flat punch: F = 2 E* a δ, and E* δ / (π √(a² - r²)) for r < 0.7 a."""
    cells, source = [8, 16, 32, *[64] * fine], "Boussinesq, [J85, ch. 3]"
    sizes, found = [1 / n for n in cells], [punch(n) for n in cells]
    forces = [(1.0, force) for force, _ in found]
    profiles = [profile for _, profile in found]
    return [
        refine("force of a flat punch", source, sizes, forces, order=0.9, within=2e-2),
        mean_square(source, sizes, profiles, 0, order=0.9, within=0.02),
    ]


CASES = {"a17": a17, "a18": a18, "a19": a19}
