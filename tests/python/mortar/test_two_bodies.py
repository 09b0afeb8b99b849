"""Two bodies with non-matching meshes: patch tests, Hertz, Cattaneo–Mindlin, rings."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import analytic, fem
from bipot_rs.fem.contact.contact import ContactSurface
from support.boxes import placed
from support.comparisons import near, refused
from support.halfspace import body, grid, mirrored
from support.profiles import Profile

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
PLANE, SPACE = ("triangle", "quadrilateral"), ("tetrahedron", "hexahedron")
MIXED = [(a, b) for cells in (PLANE, SPACE) for a in cells for b in cells]
# In space, bodies of second order are in test_second_order_bodies.
SECOND = [("triangle6", "triangle"), ("triangle", "quadrilateral9")]
SECOND += [("quadrilateral9", "triangle6")]
NU, P = 0.3, 1e-3


def block(
    name: str,
    cell: str,
    n: int,
    *,
    low: float = 0.0,
    high: float = 1.0,
    slope: float = 0.0,
    seed: int = 0,
) -> fem.Body:
    """A unit block above ("up") or below z = slope x, with randomly moved inner nodes.

    Nodes of the contact surface stay on it, nodes of the sides stay on the sides.
    """
    up = 1.0 if name == "up" else -1.0
    corners = cell.rstrip("69")
    dim = 2 if corners in PLANE else 3
    height = np.linspace(0, up, n + 1)
    mesh = fem.box([np.linspace(low, high, n + 1)] * (dim - 1) + [height], corners)
    x = mesh.p.copy()
    random = np.random.default_rng(seed)
    inside = ((x[:-1] > low) & (x[:-1] < high)).all(axis=0) & (abs(x[-1]) < 1)
    amount = 0.2 / n * random.uniform(-1, 1, x.shape)
    amount[:-1] *= high - low
    amount[-1, x[-1] == 0] = 0
    x[:, inside] += amount[:, inside]
    x[-1] += slope * x[0] * (1 - abs(x[-1]))
    mesh = type(mesh)(x, mesh.t).with_boundaries(mesh.boundaries)
    if cell != corners:
        mesh = fem.second_order(mesh)
    return fem.Body(name, mesh, fem.Material(1.0, NU))


def uniform(x: Array) -> Array:
    """Displacement for the stress -P along the last axis; z = -1 and x = 0 stay."""
    dim = x.shape[1]
    along, aside = (1 - NU**2, NU * (1 + NU)) if dim == 2 else (1.0, NU)
    return P * np.column_stack([aside * x[:, :-1], -along * (x[:, -1] + 1)])


def pressed(
    cells: tuple[str, str],
    slave: str,
    *,
    slope: float = 0.0,
    mu: float = 0.3,
    overhang: tuple[float, float] = (0.0, 1.0),
    close: float = 1e-12,
) -> tuple[fem.Assembly, Any]:
    """Two blocks pressed by P on top, with n = 4 and 3 cells a side; result of one step.

    The displacement is linear, to the condition of some hundred unknowns times rounding.
    """
    low, high = overhang
    bodies = [
        block("up", cells[0], 4, slope=slope, seed=1),
        block("low", cells[1], 3, low=low, high=high, slope=slope, seed=2),
    ]
    names = [("up", "bottom"), ("low", "top")][:: 1 if slave == "up" else -1]
    contact = fem.Contact(*names[0], mu, against=names[1], pairing="mortar")
    dim = bodies[0].dim
    if slope:
        # Held sides would carry part of the shear.
        supports = [
            fem.Support("low", "bottom", range(dim)),
            fem.Support("up", "top", range(dim - 1)),
        ]
    else:
        supports = [fem.Support("low", "bottom", [dim - 1])]
        for k, side in enumerate(("left", "front")[: dim - 1]):
            supports += [fem.Support(name, side, [k]) for name in ("up", "low")]
    model = fem.assemble(bodies, [contact], supports)
    load = model.pressure("up", "top", P)
    if overhang != (0.0, 1.0):
        # The part of the lower block that the upper one does not cover gets the pressure as a load.
        up, down = (
            (body.points, ContactSurface(body, side).outward)
            for body, side in zip(bodies, ("bottom", "top"), strict=True)
        )
        covered = bp.pairs(*down, *up)
        load += model.pressure("low", "top", P)
        pushed = covered.slave.T @ covered.area
        load[model.offset[1] + dim - 1 :: dim] += P * pushed
    exact = uniform(model.nodes)
    result: Any = model.problem().solve(load, exact.ravel()[model.fixed], tol=1e-15)
    u = result.displacement[-1].reshape(exact.shape)
    assert abs(u - exact).max() < close * abs(exact).max()
    return model, result


def fields_of(model: fem.Assembly, result: Any) -> dict[str, Array]:
    step = result[-1]
    return model.fields(step.displacement, step.reaction, step.status)


@pytest.mark.parametrize("slave", ["up", "low"])
@pytest.mark.parametrize("cells", MIXED + SECOND)
def test_patch(cells: tuple[str, str], slave: str) -> None:
    model, result = pressed(cells, slave)
    np.testing.assert_allclose(result.traction[-1][:, 0], P, rtol=1e-12)
    fields = fields_of(model, result)
    meets = model.nodes[:, -1] == 0
    np.testing.assert_allclose(fields["contact_pressure"][meets], P, rtol=1e-12)
    assert (fields["contact_pressure"][~meets] == 0).all()
    assert ((fields["contact_status"] >= 0) == meets).all()


@pytest.mark.parametrize("slave", ["up", "low"])
@pytest.mark.parametrize("cells", MIXED)
def test_patch_on_an_incline_that_friction_holds(
    cells: tuple[str, str], slave: str
) -> None:
    """Uniform normal and shear traction: slope 0.3 below μ = 0.5, all nodes stick."""
    model, result = pressed(cells, slave, slope=0.3, mu=0.5)
    assert (result.status[-1] == bp.Status.STICK).all()
    cosine = 1 / np.hypot(1, 0.3)
    t = result.traction[-1]
    shear = np.linalg.norm(t[:, 1:], axis=1)
    np.testing.assert_allclose(t[:, 0], P * cosine**2, rtol=1e-11)
    np.testing.assert_allclose(shear, 0.3 * P * cosine**2, rtol=1e-11)
    shear = fields_of(model, result)["contact_shear"]
    meets = np.linalg.norm(shear, axis=1) > 0
    above = np.arange(len(meets)) < model.offset[1] // model.dim
    # The lower body is pushed down the slope, the upper one is held.
    n, e = np.zeros(model.dim), np.eye(model.dim)[-1]
    n[0], n[-1] = -0.3 * cosine, cosine
    push = P * cosine * (e - cosine * n)
    for side, sign in ((above, 1.0), (~above, -1.0)):
        near(sign * shear[meets & side] - push, 0, 1e-11 * P)


@pytest.mark.parametrize("slave", ["up", "low"])
@pytest.mark.parametrize("cells", MIXED)
def test_patch_with_an_overhang(cells: tuple[str, str], slave: str) -> None:
    """Facets of the lower block are partly covered, with either block as the slave."""
    _, result = pressed(cells, slave, mu=0.0, overhang=(-0.31, 1.27), close=1e-11)
    np.testing.assert_allclose(result.traction[-1][:, 0], P, rtol=1e-11)


FAR, FORCE = 300.0, 1e-3
E_STAR = analytic.contact_modulus(1.0, NU, 1.0, NU)
RADIUS = np.pi * E_STAR / (4 * FORCE)  # of cylinders with the half-width 1


def cylinders(
    h: float,
    ratio: float,
    slave: str,
    across: Any,
    low: float,
    held: list[tuple[str, str, list[int]]],
    mu: float,
) -> fem.Assembly:
    """Equal bodies of 300 half-widths, with cells of h and `ratio` h at the contact."""
    bodies = [
        body(name, [across(grid(k, 1.6, FAR)), sign * grid(k, 1.0, FAR)], 1.0, NU)
        for name, k, sign in (("upper", h, 1), ("lower", ratio * h, -1))
    ]
    names = [("upper", "bottom"), ("lower", "top")][:: 1 if slave == "upper" else -1]
    pair = fem.Contact(
        *names[0],
        mu,
        against=names[1],
        pairing="mortar",
        clearance=lambda x: x[:, 0] ** 2 / (2 * RADIUS),
        within={0: (low, 1.6)},
    )
    return fem.assemble(bodies, [pair], [fem.Support(*s) for s in held])


@pytest.mark.parametrize(
    ("ratio", "slave"), [(1.37, "upper"), (1.37, "lower"), (0.77, "upper")]
)
@pytest.mark.quick_variants("1.37-upper")
def test_hertz(ratio: float, slave: str) -> None:
    """Cylinders, a = 1: order 1 in the mean square, 2 for the width, as for matching meshes.

    Each mesh has its own bounds, because the constants depend on the position of the edge
    within a cell.
    """
    a, p0 = analytic.hertz_line(FORCE, RADIUS, E_STAR)
    held = [("upper", "left", [0]), ("lower", "left", [0]), ("lower", "bottom", [0, 1])]
    for h in (0.2, 0.1, 0.05):
        model = cylinders(h, ratio, slave, np.array, 0, held, 0.0)
        load = model.traction("upper", "top", [0, -FORCE / 2 / FAR])
        result: Any = model.problem().solve(load)
        x, r = model.points[:, 0], result.reaction[0]
        expected = np.zeros_like(r)
        expected[:, 0] = analytic.hertz_pressure(x, a, p0)
        profile = Profile(x, model.area, result.traction[0], expected)
        assert profile.error(0) < 0.6 * h
        width = 2 * np.sqrt(r[:, 0] @ x**2 / r[:, 0].sum())
        assert abs(width - a) < 0.6 * h**2


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.slow_variants("upper")
def test_cattaneo_mindlin(slave: str) -> None:
    """Pressed, then sheared by 3/4 of μP, as in case A9.

    Order 1, as above; the radius of the stick zone adds a second edge.
    """
    mu, sign = 0.3, 1.0 if slave == "upper" else -1.0
    held = [("lower", "bottom", [0, 1]), ("upper", "top", [0, 1])]
    for h in (0.2, 0.1, 0.05):
        model = cylinders(h, 1.37, slave, mirrored, -1.6, held, mu)
        problem = model.problem()
        down, aside = 3.5 * FORCE, 0.7 * FORCE
        for _ in range(8):  # each iteration gains a digit
            path = [model.prescribed([[0, 0], [x, -down]]) for x in (0, aside)]
            result: Any = problem.solve(None, np.array(path))
            P, Q = result.reaction[-1].sum(axis=0)
            down *= FORCE / P
            aside *= 0.75 * mu * FORCE / (-sign * Q)
        x = model.points[:, 0]
        a, c, p0 = analytic.cattaneo_mindlin_line(P, abs(Q), RADIUS, E_STAR, mu)
        shear = -sign * analytic.partial_slip_traction(x, a, c, p0, mu)
        expected = np.column_stack([analytic.hertz_pressure(x, a, p0), shear])
        profile = Profile(x, model.area, result.traction[-1], expected)
        assert profile.error(0) < 0.6 * h
        assert profile.error(1) < 0.6 * h


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_rings(slave: str) -> None:
    """Lamé's cylinder as two rings with different meshes: pressure between them, order 2.

    A quarter, pressed from inside, without friction. Displacements converge with order 2. A
    finer slave sees the kinks of the master, gaps of h² over lengths of h, as pressures of
    order 1.
    """
    a, b, c, p = 1.0, 1.5, 2.0, 0.5
    exact = p * a**2 / (c**2 - a**2) * (c**2 / b**2 - 1)
    errors, moved = [], []
    for n in (4, 8, 16):
        bodies = []
        for name, k, ends in (("inner", n, (a, b)), ("outer", round(1.4 * n), (b, c))):
            axes = [np.linspace(*ends, k // 2 + 1), np.linspace(0, np.pi / 2, k + 1)]
            mesh = fem.box(axes, "quadrilateral")
            r, angle = mesh.p
            x = np.stack([r * np.cos(angle), r * np.sin(angle)])
            # The quarter ends on the axis.
            x[0, angle == np.pi / 2] = 0
            bodies.append(fem.Body(name, placed(mesh, x), fem.Material(1.0, NU)))
        names = [("inner", "right"), ("outer", "left")]
        names = names[:: 1 if slave == "inner" else -1]
        contact = fem.Contact(*names[0], 0.0, against=names[1], pairing="mortar")
        supports = [
            fem.Support(name, side, [k])
            for name in ("inner", "outer")
            for side, k in (("bottom", 1), ("top", 0))
        ]
        model = fem.assemble(bodies, [contact], supports)
        result: Any = model.problem().solve(model.pressure("inner", "left", p))
        t, weight = result.traction[0][:, 0], model.area
        errors.append(
            float(np.sqrt(np.sum(weight * (t - exact) ** 2) / weight.sum())) / exact
        )
        u = result.displacement[0].reshape(-1, 2)
        r = np.linalg.norm(model.nodes, axis=1)
        radial = np.sum(u * model.nodes, axis=1) / r
        lame = (1 + NU) * p * a**2 / (c**2 - a**2) * ((1 - 2 * NU) * r + c**2 / r)
        moved.append(abs(radial - lame).max() / lame.max())
    orders = [np.log2(e[0] / e[-1]) / 2 for e in (errors, moved)]
    assert orders[0] > (1.8 if slave == "inner" else 1.0), errors
    assert orders[1] > 1.8, moved
    assert errors[-1] < 0.03
    assert moved[-1] < 3e-3


def test_contacts_of_all_kinds_in_one_model() -> None:
    """Rows of B, areas and gaps are in the order of the contacts."""
    bodies = [block("up", "hexahedron", 3), block("low", "tetrahedron", 2)]
    pair = fem.Contact("up", "bottom", 0.3, against=("low", "top"), pairing="mortar")
    ground = fem.Contact("low", "bottom", 0.2, plane=([0, 0, -1.5], [0, 0, 1]))
    both, first = (
        fem.assemble(bodies, contacts) for contacts in ([ground, pair], [pair])
    )
    count = len(both.gap) - len(first.gap)
    np.testing.assert_array_equal(both.gap[:count], 0.5)
    np.testing.assert_array_equal(both.gap[count:], first.gap)
    assert (both.B[3 * count :] != first.B).nnz == 0
    np.testing.assert_array_equal(both.contact_dofs[count:, 1], -1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pairing": "mortars"}, "pairing of the contact on 'bottom' is 'mortars'"),
        (
            {"against": None, "plane": ((0, 0), (0, 1)), "pairing": "nodes"},
            "pairing is 'nodes', expected 'match' or 'mortar' for a rigid",
        ),
        ({"against": ("up", "top")}, "in contact with itself"),
        ({"against": ("low", "left")}, "^up.bottom .* 0 of up.bottom, .* of low.left"),
        ({"within": {0: (0.4, 0.5)}}, "within excludes all of them"),
        ({"pairing": "match"}, "do not match: .* use pairing='mortar', or meshes"),
    ],
)
def test_invalid_pairings(changes: dict[str, Any], message: str) -> None:
    bodies = [block("up", "quadrilateral", 4), block("low", "triangle", 3)]
    arguments = {"against": ("low", "top"), "pairing": "mortar", **changes}
    with refused(message):
        fem.assemble(bodies, [fem.Contact("up", "bottom", 0.3, **arguments)])
