"""Bolts: preload of a shank that is cut, kept in later load steps."""

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.bolts import Bolt
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.mesh.elements import kind_of, make_mesh, second_order
from support.boxes import CELLS
from support.comparisons import close, refused

Floats = NDArray[np.float64]
YOUNG = 2e5
STEEL = fem.Material(YOUNG, 0.3, plane_stress=True)
# Residuals of 1e-13, times the condition of these small bodies, 1e2.
PATCH = 1e-11


def carve(
    name: str, axes: list[Any], cell: str, keep: Any, material: Any = STEEL
) -> Body:
    """Cells of a box whose middle satisfies ``keep``."""
    mesh = fem.box([np.asarray(a, float) for a in axes], cell)
    chosen = keep(*mesh.p[:, mesh.t].mean(axis=1))
    order = kind_of(mesh).order_of_vtk
    made, _ = make_mesh(kind_of(mesh).vtk, mesh.p.T, mesh.t.T[chosen][:, order])
    planes = {
        f"{'xyz'[k]}{level:g}": np.flatnonzero(
            np.isclose(made.p[k, made.facets], level).all(axis=0) & (made.f2t[1] == -1)
        )
        for k, axis in enumerate(axes)
        for level in axis
    }
    return Body(name, made.with_boundaries(planes), material)


def column(result: Any, name: str) -> Floats:
    return np.array([getattr(step, name) for step in result])


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_a_bar_has_its_own_stiffness(cell: str, degree: int, scale: float) -> None:
    """A held bar is shortened by F L / (E A), and pulled further by E A / L."""
    d, length, side = CELLS[cell], 10.0 * scale, 3.0 * scale
    force, young, up = 700.0, YOUNG / scale**2, np.eye(CELLS[cell])[-1]
    axes = [*[np.linspace(0, side, 3)] * (d - 1), np.linspace(0, length, 6)]
    mesh = fem.box(axes, cell)
    mesh = mesh if degree == 1 else second_order(mesh)
    body = Body("bar", mesh, fem.Material(young, 0.3, plane_stress=d == 2))
    pairing = "mortar" if degree == 2 else "match"
    far = Contact("bar", "top", 0.0, plane=(30 * length * up, -up), pairing=pairing)
    sides = [("bottom", d - 1), ("top", d - 1), ("left", 0), ("front", 1)][: d + 1]
    model = fem.assemble(
        [body],
        [far],
        [Support("bar", side, (k,)) for side, k in sides],
        bolts=[Bolt("bar", "bar", (0.45 * length * up, up))],
    )
    stretch = 1e-3 * length
    pull = model.reference_force("bar", force * np.eye(d)[0])
    path = [
        model.prescribed([[0.0], [top], *[[0.0]] * (d - 1)], {"bar": [bolt]})
        for top, bolt in ((0.0, np.nan), (0.0, 0.0), (stretch, 0.0))
    ]
    (remark,) = inspect(model, prescribed=path)
    assert "may never touch" in remark
    result = model.problem().solve([pull] * 3, path)
    area = side ** (d - 1)
    stiffness = young * area / length
    expected = [force, force, force + stiffness * stretch]
    shortening = column(result, "shortening")[:, 0]
    np.testing.assert_allclose(shortening, force / stiffness, rtol=PATCH)
    felt = column(result, "bolt_force")[:, 0]
    np.testing.assert_allclose(felt, expected, rtol=PATCH)
    u = model.displacement_of("bar", result[2].displacement)
    axial = fem.stress(model.bodies[0], u)[:, -1, -1]
    np.testing.assert_allclose(axial, expected[2] / area, rtol=PATCH)


def stand(
    cell: str = "quadrilateral",
    *,
    half: bool = False,
    mu: float = 0.0,
    bolts: tuple[str, ...] = ("left", "right"),
    scale: float = 1.0,
    share: float = 1.0,
) -> fem.Assembly:
    """A frame of columns under a beam, which clamp two blocks on the ground.

    Sections are at half the height of the columns; with ``half`` the middle column is cut
    along x = 0, a plane of symmetry.
    """
    middle, d = "middle" in bolts, CELLS[cell]
    x = np.array([-4, -2.5, -1, 0, 1, 2.5, 4])
    x = (x if middle else np.array([-6, -5, *x, 5, 6.5])) * scale
    deep, levels = [np.array([0, 3.0])] * (d - 2), np.array([0, 4, 8, 10, 12.0])
    axes = [x[x >= 0] if half else x, *(a * scale for a in (*deep, levels))]
    inner = (1.01 if middle else 4.01) * scale

    def is_frame(x: Floats, *yz: Floats) -> Any:
        column = np.abs(x) < inner if middle else np.abs(x) > inner
        return column | (yz[-1] > 10 * scale)

    def is_block(x: Floats, *yz: Floats) -> Any:
        return ~is_frame(x, *yz) & (yz[-1] < 10 * scale)

    kind: dict[str, Any] = {"plane_stress": True, "thickness": scale} if d == 2 else {}
    steel = fem.Material(YOUNG / scale**2, 0.3, **kind)
    soft = fem.Material(YOUNG / 5 / scale**2, 0.25, **kind)
    frame = carve("frame", axes, cell, is_frame, steel)
    block = carve("block", axes, cell, is_block, soft)
    name, up = f"{'xyz'[d - 1]}{10 * scale:g}", f"{'xyz'[d - 1]}0"
    mesh, at = frame.mesh, frame.mesh.p[:, frame.mesh.facets].mean(axis=1)
    cut = np.isclose(at[-1], 4 * scale) & (mesh.f2t[1] >= 0)
    where = {"left": at[0] < -inner, "right": at[0] > inner}
    where["middle"] = np.abs(at[0]) < inner
    sections = {bolt: np.flatnonzero(cut & where[bolt]) for bolt in bolts}
    frame = Body("frame", mesh.with_boundaries(sections), steel)
    supports = [Support(body, up, range(d)) for body in ("frame", "block")]
    return fem.assemble(
        [frame, block],
        [Contact("block", name, mu, against=("frame", name))],
        supports + [Support("frame", "x0", (0,))] * half,
        bolts=[Bolt(bolt, "frame", bolt, share) for bolt in bolts],
    )


def follow(
    model: fem.Assembly,
    forces: list[dict[str, float]],
    load: Floats | None = None,
    **settings: Any,
) -> bp.Result:
    """Tighten the bolts that each step names; the last step adds ``load``."""
    still = [[0.0] * len(s.components) for s in model.supports]
    moved, loads = [], []
    for step in forces:
        own = {b.name: [np.nan if b.name in step else 0.0] for b in model.bolts}
        moved.append(model.prescribed(still, own))
        loads.append(np.zeros(model.n))
        for name, force in step.items():
            share = next(b.share for b in model.bolts if b.name == name)
            unit = share * np.eye(model.dim)[0]
            loads[-1] += model.reference_force(name, force * unit)
    if load is not None:
        loads[-1] = loads[-1] + load
    return model.problem(**settings).solve(loads, moved, tol=1e-12)


def solve_densely(
    model: fem.Assembly, forces: list[dict[str, float]]
) -> tuple[Floats, Floats]:
    """Shortenings and forces with closed frictionless contacts, by multipliers.

    Copies of the section are unknowns of their own here, and the force of a bolt is the sum of
    the multipliers of its section.
    """
    bare = fem.assemble(model.bodies, [], model.supports)
    assert model.ties is not None
    K, n, bolts = bare.K.toarray(), bare.n, len(model.bolts)
    first = np.array([bolt.first for bolt in model.bolts])
    T = model.ties.within[model.ties.dependent].toarray()
    ties = np.hstack([-T[:, :n], -T[:, first]])
    ties[np.arange(len(T)), model.ties.dependent] = 1.0
    touch = model.B.toarray()[:: model.dim, :n]
    C = np.vstack([ties, np.hstack([touch, np.zeros((len(touch), bolts))])]) * K.max()
    size, m = n + bolts, len(C)
    saddle = np.zeros((size + m, size + m))
    saddle[:n, :n], saddle[size:, :size], saddle[:size, size:] = K, C, C.T
    kept, shortenings, felt = np.zeros(bolts), [], []
    for step in forces:
        right, u = np.zeros(size + m), np.zeros(size + m)
        locked = [k for k, bolt in enumerate(model.bolts) if bolt.name not in step]
        for k, bolt in enumerate(model.bolts):
            right[n + k] = step.get(bolt.name, 0.0)
        at = np.append(bare.fixed, n + np.array(locked, int))
        u[n + np.array(locked, int)] = kept[locked]
        free = np.setdiff1d(np.arange(size + m), at)
        rest = right[free] - saddle[np.ix_(free, at)] @ u[at]
        u[free] = np.linalg.solve(saddle[np.ix_(free, free)], rest)
        kept = u[n:size].copy()
        shortenings.append(kept)
        felt.append((saddle @ u)[n:size])
    return np.array(shortenings), np.array(felt)


SEQUENCE = [
    {"left": 900.0},
    {"right": 700.0},
    {"left": 1000.0, "right": 950.0},
    {"right": 1200.0},
    {},
]


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_bolts_tightened_in_sequence_change_each_other(cell: str) -> None:
    model = stand(cell)
    result = follow(model, SEQUENCE)
    shortenings, forces = solve_densely(model, SEQUENCE)
    kept, felt = column(result, "shortening"), column(result, "bolt_force")
    # Dense elimination loses the condition of the saddle, about 1e5.
    close(kept, shortenings, 1e-9)
    close(felt, forces, 1e-9)
    assert abs(felt[1, 0] / felt[0, 0] - 1) > 0.01, "the second bolt loads the first"
    assert np.array_equal(kept[3], kept[4])


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_units_and_the_order_of_bolts_change_nothing(scale: float) -> None:
    plain = follow(stand(mu=0.2), SEQUENCE)
    other = follow(stand(mu=0.2, bolts=("right", "left"), scale=scale), SEQUENCE)
    for name, unit in (("shortening", scale), ("bolt_force", 1.0)):
        # Young's modulus changes with the square of the length, and forces do not.
        theirs = column(other, name)[:, ::-1] / unit
        np.testing.assert_allclose(theirs, column(plain, name), rtol=1e-8)


@pytest.mark.parametrize("pull", [0.3, 0.9, 1.5, 4.0])
def test_a_joint_shares_loads_until_it_opens(pull: float) -> None:
    """The joint diagram: bolt and plate are two springs under a rigid head."""
    axes = [[0, 2, 5], [0, 5, 10, 11]]
    shank = carve("bolt", axes, "quadrilateral", lambda x, y: (x < 2) | (y > 10))
    plate = Body("plate", fem.box([[3, 4, 5], [0, 2, 6, 10]], "quadrilateral"), STEEL)
    within = {1: (10.0, 11.0)}
    held: dict[str, Any] = {"components": (0,), "rotations": (2,), "within": within}
    model = fem.assemble(
        [shank, plate],
        [Contact("plate", "top", 0.0, against=("bolt", "y10"), pairing="mortar")],
        [
            Support("bolt", "y0", (1,)),
            Support("plate", "bottom", (1,)),
            Support("plate", "left", (0,), {1: (0.0, 0.0)}),
        ],
        remotes=[fem.Remote("head", "bolt", point=[1.0, 11.0], **held)],
        bolts=[Bolt("bolt", "bolt", ([0.0, 6.0], [0.0, 1.0]))],
    )
    still = [[0.0], [0.0], [0.0]]
    free, kept = (model.prescribed(still, {"bolt": [b]}) for b in (np.nan, 0.0))
    problem, force = model.problem(), 500.0
    # Pulled away from the plate the head shows the stiffness of the shank alone.
    alone = problem.solve(model.reference_force("head", [0.0, 1.0]), kept, tol=1e-13)
    kb = 1.0 / model.reference_motion("head", alone[0].displacement)[0][1]
    kp = YOUNG * 2.0 / 10.0
    outer = pull * force * (kb + kp) / kp  # it opens at 1
    up = model.reference_force("head", [0.0, outer])
    tight = model.reference_force("bolt", [force, 0.0])
    result = problem.solve([tight, up], [free, kept], tol=1e-13)
    felt = force + outer * kb / (kb + kp) if pull < 1 else outer
    shortening = force / kb + force / kp
    np.testing.assert_allclose(result[0].shortening, shortening, rtol=PATCH)
    np.testing.assert_allclose(result[1].bolt_force, felt, rtol=PATCH)
    clamp = result.reaction[1, :, 0].sum()
    np.testing.assert_allclose(clamp, felt - outer, rtol=PATCH, atol=PATCH * force)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_derivatives_by_the_preload(engine: str) -> None:
    cell = "hexahedron" if engine == "iterative" else "quadrilateral"
    model = stand(cell, mu=0.3)
    push = model.traction("frame", "x6.5", -2.0 * np.eye(model.dim)[0])

    def solve(left: float = 900.0, right: float = 700.0) -> bp.Result:
        forces: list[dict[str, float]] = [{"left": left}, {"right": right}, {}]
        return follow(model, forces, push, engine=engine)

    def by_load(k: int, bolt: fem.Bolt) -> Floats:
        along = np.zeros((3, model.n))
        along[k] = model.reference_force(bolt.name, np.eye(model.dim)[0])
        return along

    result, size = solve(), 1e-2
    weights = np.random.default_rng(3).normal(size=result.reaction.shape)
    by_u = np.random.default_rng(4).normal(size=result.displacement.shape)
    gradient = result.vjp(reaction=weights, displacement=by_u)

    def total(tangent: Any) -> float:
        return float(
            np.sum(weights * tangent.reaction) + np.sum(by_u * tangent.displacement)
        )

    ends = (
        (solve(900 + size), solve(900 - size)),
        (solve(900, 700 + size), solve(900, 700 - size)),
    )
    for k, (more, less) in enumerate(ends):
        along = by_load(k, model.bolts[k])
        tangent = result.jvp(load=along)
        # Statuses do not change, and the path is then linear in the forces: differences are
        # exact up to the tolerance over the step, 1e-12 * 900 / 1e-2.
        for name in ("reaction", "displacement"):
            change = (getattr(more, name) - getattr(less, name)) / (2 * size)
            close(getattr(tangent, name), change, 1e-6)
        np.testing.assert_allclose(
            np.sum(gradient.load * along), total(tangent), rtol=1e-8
        )
    # A shortening that is prescribed after locking.
    shift = np.zeros((3, len(model.fixed)))
    at = np.searchsorted(model.fixed, model.bolts[0].first)
    shift[1:, at] = 1.0, -0.5
    tangent = result.jvp(prescribed=shift)
    kept = tangent.displacement[:, model.bolts[0].first]
    np.testing.assert_allclose(kept, [0.0, 1.0, -0.5], atol=1e-12)
    by_shift = gradient.prescribed[1:, at] @ [1.0, -0.5]
    np.testing.assert_allclose(by_shift, total(tangent), rtol=1e-8)


def test_a_prescribed_shortening_is_that_since_tightening() -> None:
    """In however many steps it grows."""
    model = stand()
    still = [[0.0] * 2] * 2
    first = follow(model, SEQUENCE[2:3])
    problem, start = model.problem(), first[0].shortening
    more = model.prescribed(still, {"left": [0.02], "right": [0.0]})
    paths = [
        problem.solve(None, moved, start=first)
        for moved in ([more], [more, more], [more / 4, more / 2, more])
    ]
    paths.append(problem.follow(prescribed=more, largest=0.3))
    start = [start, start, start, np.zeros(2)]
    assert len(paths[3]) > 3
    for path, at in zip(paths, start, strict=True):
        np.testing.assert_allclose(path[-1].shortening - at, [0.02, 0], atol=1e-15)


def bar(cell: str, level: float) -> tuple[fem.Assembly, Floats]:
    """A bar on a support under a plane, cut at a height, and its axis."""
    d, up = CELLS[cell], np.eye(CELLS[cell])[-1]
    mesh = fem.box([*[np.linspace(0, 2, 3)] * (d - 1), np.linspace(0, 10, 11)], cell)
    model = fem.assemble(
        [Body("bar", mesh, fem.Material(YOUNG, 0.3))],
        [Contact("bar", "top", 0.2, plane=(10 * up, up))],
        [Support("bar", "bottom", range(d))],
        bolts=[Bolt("bar", "bar", (level * up, up))],
    )
    return model, up


@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_the_force_is_that_of_the_section(cell: str) -> None:
    """Without the loads of the cells beside it: what is above the section is in balance."""
    force, level, d = 700.0, 6.5, CELLS[cell]
    model, up = bar(cell, level)
    loads = [
        fem.Load("bar", force=-50.0 * up),
        fem.Load("bar", "right", traction=20.0 * up),
        fem.Load("bar", strain=fem.thermal(1e-3, 30.0)),
    ]
    load = sum(model.nodal_forces(one) for one in loads)
    tight = load + model.reference_force("bar", force * np.eye(d)[0])
    moved = [model.prescribed([[0.0] * d], {"bar": [b]}) for b in (np.nan, 2.0)]
    result = model.problem().solve([tight, 3 * load], moved, tol=1e-13)
    body = model.bodies[0]
    above = body.points[body.cells][..., -1].mean(axis=1) > level
    nodes = np.unique(body.cells[above])
    weight = sum(one.forces(body).reshape(-1, d)[nodes, -1].sum() for one in loads)
    pushed = np.einsum("cij,sci->sj", model.frame, result.reaction)[:, -1]
    felt = column(result, "bolt_force")[:, 0]
    # Residuals of 1e-13 times the condition of the bar, 1e3.
    expected = pushed + np.array([1.0, 3.0]) * weight
    np.testing.assert_allclose(felt, expected, rtol=1e-9, atol=1e-9 * force)
    assert pushed.min() > force, "the bolt pulls the bar against the plane"
    np.testing.assert_allclose(felt[0], force, rtol=1e-14)


def test_friction_acts_where_only_the_shortening_slips() -> None:
    """An obstacle pressed by 300 against a copy whose node is held carries up to 150."""
    mesh = fem.box([np.linspace(0, 2, 3), np.linspace(0, 10, 6)], "quadrilateral")
    parts = {"lower": (0.0, 6.0), "upper": (6.0, 10.0)}
    sides = {n: fem.surface(mesh, {0: (0, 0), 1: ends}) for n, ends in parts.items()}
    pad: Any = {"within": {1: (5.9, 6.1)}, "floating": fem.Floating("pad", (0,))}
    model = fem.assemble(
        [Body("bar", fem.with_surfaces(mesh, sides), STEEL)],
        [Contact("bar", "upper", 0.5, plane=([0.0, 0.0], [1.0, 0.0]), **pad)],
        [Support("bar", "lower", (0, 1))],
        bolts=[Bolt("bar", "bar", ([0.0, 5.0], [0.0, 1.0]))],
    )
    load = model.reference_force("bar", [500.0, 0.0])
    load += model.reference_force("pad", [300.0, 0.0])
    load += model.traction("bar", "top", [0.0, 200.0])  # 400 of the 500
    free = model.prescribed([[0.0, 0.0]], {"bar": [np.nan]})
    result = model.problem().solve(load, free, tol=1e-12)
    np.testing.assert_allclose(np.abs(result.reaction[0, 0]), [300, 100], rtol=1e-9)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (([0.0, 8.5], [0.0, 1.0]), "cuts the body at several places, near"),
        (([0.0, 5.0, 0.0], [0.0, 1.0, 0.0]), "needs a point and a normal of 2 numbers"),
    ],
)
def test_sections_that_cut_no_shank(section: Any, message: str) -> None:
    bodies = stand().bodies
    with refused(message):
        fem.assemble(bodies, [], bolts=[Bolt("it", "frame", section)])
    with refused("there is no body 'farme'"):
        fem.assemble(bodies, [], bolts=[Bolt("it", "farme", section)])


def test_another_stiffness_in_the_same_problem_and_a_pickle() -> None:
    model = stand(mu=0.2)
    moved = [
        model.prescribed([[0.0] * 2] * 2, {b.name: [bolt] for b in model.bolts})
        for bolt in (np.nan, 0.0)
    ]
    load = model.body_force("frame", [0.0, -1.0])  # also beside the sections
    for name, force in (("left", 900.0), ("right", 500.0)):
        load += model.reference_force(name, [force, 0.0])
    problem = model.problem()
    before = problem.solve([load, load], moved, tol=1e-12)
    copy = pickle.loads(pickle.dumps(problem)).solve([load, load], moved, tol=1e-12)
    assert (
        column(copy, "shortening").tobytes() == column(before, "shortening").tobytes()
    )
    problem.update(2.0 * model.K)
    after = problem.solve([load, load], moved, tol=1e-12)
    for one, other in zip(after, before, strict=True):
        # Forces are the same, and displacements half as large.
        np.testing.assert_allclose(one.bolt_force, other.bolt_force, rtol=1e-9)
        np.testing.assert_allclose(2.0 * one.shortening, other.shortening, rtol=1e-9)
