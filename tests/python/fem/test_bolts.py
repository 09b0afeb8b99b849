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
from bipot_rs.fem.constraints.bolts import Bolt
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.mesh.elements import kind_of, make_mesh, second_order
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
YOUNG = 2e5
STEEL = fem.Material(YOUNG, 0.3, plane_stress=True)
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
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


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_a_bar_has_its_own_stiffness(cell: str, degree: int, scale: float) -> None:
    """A held bar is shortened by F L / (E A), and pulled further by E A / L."""
    d, length, side = CELLS[cell], 10.0 * scale, 3.0 * scale
    force, young = 700.0, YOUNG / scale**2
    across = [np.linspace(0, side, 3)] * (d - 1)
    mesh = fem.box([*across, np.linspace(0, length, 6)], cell)
    mesh = mesh if degree == 1 else second_order(mesh)
    area = side ** (d - 1)
    body = Body("bar", mesh, fem.Material(young, 0.3, plane_stress=d == 2))
    up = np.eye(d)[-1]
    model = fem.assemble(
        [body],
        [
            Contact(
                "bar",
                "top",
                0.0,
                plane=(30 * length * up, -up),
                pairing="mortar" if degree == 2 else "match",
            )
        ],
        [
            Support("bar", "bottom", (d - 1,)),
            Support("bar", "top", (d - 1,)),
            *(
                Support("bar", s, (k,))
                for k, s in enumerate(("left", "front")[: d - 1])
            ),
        ],
        bolts=[Bolt("bar", "bar", (0.45 * length * up, up))],
    )
    stretch = 1e-3 * length

    def prescribed(top: float, bolt: float) -> Floats:
        moved: list[list[float]] = [[0.0], [top], *[[0.0]] * (d - 1)]
        return model.prescribed(moved, {"bar": [bolt]})

    pull = model.reference_force("bar", force * np.eye(d)[0])
    result = model.problem().solve(
        [pull, pull, pull],
        [prescribed(0.0, np.nan), prescribed(0.0, 0.0), prescribed(stretch, 0.0)],
    )
    stiffness = young * area / length
    kept = np.array([step.shortening for step in result])[:, 0]
    felt = np.array([step.bolt_force for step in result])[:, 0]
    np.testing.assert_allclose(kept, force / stiffness, rtol=PATCH)
    expected = [force, force, force + stiffness * stretch]
    np.testing.assert_allclose(felt, expected, rtol=PATCH)
    stress = fem.stress(
        model.bodies[0], model.displacement_of("bar", result[2].displacement)
    )
    axial = stress.reshape(len(stress), -1)[:, (d - 1) * d + d - 1]
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
    x = np.array([-6, -5, -4, -2.5, -1, 0, 1, 2.5, 4, 5, 6.5]) * scale
    if "middle" in bolts:
        x = np.array([-4, -2.5, -1, 0, 1, 2.5, 4]) * scale
    x = x[x >= 0] if half else x
    levels = np.array([0, 4, 8, 10, 12.0]) * scale
    d, deep = CELLS[cell], [np.array([0, 3.0]) * scale]
    axes = [x, *(deep if d == 3 else []), levels]
    inner = 1.01 * scale if "middle" in bolts else 4.01 * scale

    def is_frame(x: Floats, *yz: Floats) -> Any:
        column = np.abs(x) < inner if "middle" in bolts else np.abs(x) > inner
        return column | (yz[-1] > 10 * scale)

    def is_block(x: Floats, *yz: Floats) -> Any:
        return ~is_frame(x, *yz) & (yz[-1] < 10 * scale)

    kind: dict[str, Any] = {"plane_stress": True, "thickness": scale} if d == 2 else {}
    steel = fem.Material(YOUNG / scale**2, 0.3, **kind)
    soft = fem.Material(YOUNG / 5 / scale**2, 0.25, **kind)
    frame = carve("frame", axes, cell, is_frame, steel)
    block = carve("block", axes, cell, is_block, soft)
    name, up = f"{'xyz'[d - 1]}{10 * scale:g}", f"{'xyz'[d - 1]}0"
    mesh, middle = frame.mesh, frame.mesh.p[:, frame.mesh.facets].mean(axis=1)
    at_section = np.isclose(middle[-1], 4 * scale) & (mesh.f2t[1] >= 0)
    where = {"left": middle[0] < -inner, "right": middle[0] > inner}
    where["middle"] = np.abs(middle[0]) < inner
    frame = Body(
        "frame",
        mesh.with_boundaries(
            {one: np.flatnonzero(at_section & where[one]) for one in bolts}
        ),
        steel,
    )
    supports = [
        Support("frame", up, range(d)),
        Support("block", up, range(d)),
    ]
    if half:
        supports.append(Support("frame", "x0", (0,)))
    return fem.assemble(
        [frame, block],
        [Contact("block", name, mu, against=("frame", name))],
        supports,
        bolts=[Bolt(one, "frame", one, share) for one in bolts],
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
    C = np.vstack([ties, np.hstack([touch, np.zeros((len(touch), bolts))])])
    C *= K.max()
    size, m = n + bolts, len(C)
    saddle = np.zeros((size + m, size + m))
    saddle[:n, :n], saddle[size:, :size], saddle[:size, size:] = K, C, C.T
    kept, shortenings, felt = np.zeros(len(model.bolts)), [], []
    for step in forces:
        right, fixed = np.zeros(size + m), dict.fromkeys(bare.fixed.tolist(), 0.0)
        for k, bolt in enumerate(model.bolts):
            if bolt.name in step:
                right[n + k] = step[bolt.name]
            else:
                fixed[n + k] = kept[k]
        at = np.array(list(fixed))
        free = np.setdiff1d(np.arange(size + m), at)
        u = np.zeros(size + m)
        u[at] = list(fixed.values())
        u[free] = np.linalg.solve(
            saddle[np.ix_(free, free)],
            right[free] - saddle[np.ix_(free, at)] @ u[at],
        )
        kept = u[n:size]
        shortenings.append(kept.copy())
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
    kept = np.array([step.shortening for step in result])
    felt = np.array([step.bolt_force for step in result])
    # Dense elimination loses the condition of the saddle, about 1e5.
    np.testing.assert_allclose(kept, shortenings, rtol=1e-9, atol=1e-9 * kept.max())
    np.testing.assert_allclose(felt, forces, rtol=1e-9, atol=1e-9 * felt.max())
    assert abs(felt[1, 0] / felt[0, 0] - 1) > 0.01, "the second bolt loads the first"
    assert np.array_equal(kept[3], kept[4])


def test_half_a_model_is_the_whole_one() -> None:
    forces = [{"middle": 800.0}, {}]
    whole = stand(bolts=("middle",))
    half = stand(bolts=("middle",), half=True, share=0.5)
    results = [
        follow(m, forces, m.traction("frame", "y12", [0.0, 3.0])) for m in (whole, half)
    ]
    for name in ("shortening", "bolt_force"):
        two, one = ([getattr(step, name) for step in r] for r in results)
        # Residuals of 1e-12, times the condition of the stand.
        np.testing.assert_allclose(one, two, rtol=1e-9)
    total = [r.reaction[:, :, 0].sum(axis=1) for r in results]
    np.testing.assert_allclose(2 * total[1], total[0], rtol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_units_and_the_order_of_bolts_change_nothing(scale: float) -> None:
    plain = follow(stand(mu=0.2), SEQUENCE)
    other = follow(stand(mu=0.2, bolts=("right", "left"), scale=scale), SEQUENCE)
    for name, unit in (("shortening", scale), ("bolt_force", 1.0)):
        ours, theirs = (
            np.array([getattr(step, name) for step in r]) for r in (plain, other)
        )
        # Young's modulus changes with the square of the length, and forces do not.
        np.testing.assert_allclose(theirs[:, ::-1] / unit, ours, rtol=1e-8)


@pytest.mark.parametrize("pull", [0.3, 0.9, 1.5, 4.0])
def test_a_joint_shares_loads_until_it_opens(pull: float) -> None:
    """The joint diagram: bolt and plate are two springs under a rigid head."""
    steel = fem.Material(YOUNG, 0.3, plane_stress=True)
    axes = [[0, 2, 5], [0, 5, 10, 11]]
    shank = carve("bolt", axes, "quadrilateral", lambda x, y: (x < 2) | (y > 10), steel)
    plate = Body("plate", fem.box([[3, 4, 5], [0, 2, 6, 10]], "quadrilateral"), steel)
    model = fem.assemble(
        [shank, plate],
        [Contact("plate", "top", 0.0, against=("bolt", "y10"), pairing="mortar")],
        [
            Support("bolt", "y0", (1,)),
            Support("plate", "bottom", (1,)),
            Support("plate", "left", (0,), {1: (0.0, 0.0)}),
        ],
        remotes=[
            fem.Remote(
                "head",
                "bolt",
                point=[1.0, 11.0],
                components=(0,),
                rotations=(2,),
                within={1: (10.0, 11.0)},
            )
        ],
        bolts=[Bolt("bolt", "bolt", ([0.0, 6.0], [0.0, 1.0]))],
    )
    still = [[0.0], [0.0], [0.0]]
    free, kept = (model.prescribed(still, {"bolt": [b]}) for b in (np.nan, 0.0))
    problem, force = model.problem(), 500.0
    # Pulled away from the plate the head shows the stiffness of the shank alone.
    alone = problem.solve(model.reference_force("head", [0.0, 1.0]), kept, tol=1e-13)
    kb = 1.0 / model.reference_motion("head", alone[0].displacement)[0][1]
    kp = YOUNG * 2.0 / 10.0
    opening = force * (kb + kp) / kp
    outer = pull * opening
    up = model.reference_force("head", [0.0, outer])
    tight = model.reference_force("bolt", [force, 0.0])
    result = problem.solve([tight, up], [free, kept], tol=1e-13)
    felt = force + outer * kb / (kb + kp) if pull < 1 else outer
    np.testing.assert_allclose(
        result[0].shortening, force / kb + force / kp, rtol=PATCH
    )
    np.testing.assert_allclose(result[1].bolt_force, felt, rtol=PATCH)
    clamp = result.reaction[1, :, 0].sum()
    np.testing.assert_allclose(clamp, felt - outer, rtol=PATCH, atol=PATCH * force)


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_derivatives_by_the_preload(engine: str) -> None:
    cell = "hexahedron" if engine == "iterative" else "quadrilateral"
    model = stand(cell, mu=0.3)
    push = model.traction("frame", "x6.5", -2.0 * np.eye(model.dim)[0])

    def solve(left: float, right: float) -> bp.Result:
        forces: list[dict[str, float]] = [{"left": left}, {"right": right}, {}]
        return follow(model, forces, push, engine=engine)

    result, size = solve(900.0, 700.0), 1e-2
    units = [model.reference_force(b.name, np.eye(model.dim)[0]) for b in model.bolts]
    weights = np.random.default_rng(3).normal(size=result.reaction.shape)
    by_u = np.random.default_rng(4).normal(size=result.displacement.shape)
    gradient = result.vjp(reaction=weights, displacement=by_u)
    for k, bolt in enumerate(({"left": size}, {"right": size})):
        more = {"left": 900.0, "right": 700.0}
        less = dict(more)
        for name, change in bolt.items():
            more[name] += change
            less[name] -= change
        ends = solve(**more), solve(**less)
        change = (ends[0].reaction - ends[1].reaction) / (2 * size)
        moved = (ends[0].displacement - ends[1].displacement) / (2 * size)
        along = np.zeros((3, model.n))
        along[k] = units[k]
        tangent = result.jvp(load=along)
        # Statuses do not change, and the path is then linear in the forces: differences are
        # exact up to the tolerance over the step, 1e-12 * 900 / 1e-2.
        scale = np.abs(change).max()
        near(tangent.reaction, change, 1e-6 * scale)
        scale = np.abs(moved).max()
        near(tangent.displacement, moved, 1e-6 * scale)
        total = np.sum(weights * tangent.reaction) + np.sum(by_u * tangent.displacement)
        np.testing.assert_allclose(np.sum(gradient.load * along), total, rtol=1e-8)
    # A shortening that is prescribed after locking.
    shift = np.zeros((3, len(model.fixed)))
    at = np.searchsorted(model.fixed, model.bolts[0].first)
    shift[1:, at] = 1.0, -0.5
    tangent = result.jvp(prescribed=shift)
    np.testing.assert_allclose(
        tangent.displacement[:, model.bolts[0].first], [0.0, 1.0, -0.5], atol=1e-12
    )
    total = np.sum(weights * tangent.reaction) + np.sum(by_u * tangent.displacement)
    by_shift = gradient.prescribed[1:, at] @ [1.0, -0.5]
    np.testing.assert_allclose(by_shift, total, rtol=1e-8)


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


@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_the_place_of_the_section_does_not_matter(cell: str) -> None:
    """Loads on the cells beside a section act on its shortening as on any displacement.

    A bar is shortened by the same amount at two sections, under weight, heat, and a traction
    along its side. Above both of them, and below, displacements are the same.
    """
    d, side = CELLS[cell], [np.linspace(0, 2, 3)]
    mesh = fem.box([*side * (d - 1), np.linspace(0, 10, 11)], cell)
    body = Body("bar", mesh, fem.Material(YOUNG, 0.3))
    up, ends = np.eye(d)[-1], []
    for level in (2.5, 6.5):
        model = fem.assemble(
            [body],
            [Contact("bar", "top", 0.2, plane=(10 * up, up))],
            [Support("bar", "bottom", range(d))],
            bolts=[Bolt("bar", "bar", (level * up, up))],
        )
        load = model.body_force("bar", -50.0 * up)
        load += model.initial_strain("bar", fem.thermal(1e-5, 30.0))
        load += model.traction("bar", "right", 20.0 * up)
        moved = model.prescribed([[0.0] * d], {"bar": [0.01]})
        result = model.problem().solve(load, moved, tol=1e-13)
        cut = model.bodies[0].points
        outside = (cut[:, -1] < 1.5) | (cut[:, -1] > 7.5)
        order = np.lexsort(cut[outside].T.round(6))
        u = model.displacement_of("bar", result.displacement[0])
        ends.append((u[outside][order], result.reaction[0]))
    for one, other in zip(*ends, strict=True):
        # Residuals of 1e-13 times the condition of the bar, 1e3.
        close(one, other, 1e-9)


@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_the_force_is_that_of_the_section(cell: str) -> None:
    """Without the loads of the cells beside it: what is above the section is in balance."""
    d, level, force = CELLS[cell], 6.5, 700.0
    mesh = fem.box([*[np.linspace(0, 2, 3)] * (d - 1), np.linspace(0, 10, 11)], cell)
    up = np.eye(d)[-1]
    model = fem.assemble(
        [Body("bar", mesh, fem.Material(YOUNG, 0.3))],
        [Contact("bar", "top", 0.2, plane=(10 * up, up))],
        [Support("bar", "bottom", range(d))],
        bolts=[Bolt("bar", "bar", (level * up, up))],
    )
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
    felt = [step.bolt_force[0] for step in result]
    # Residuals of 1e-13 times the condition of the bar, 1e3.
    expected = pushed + np.array([1.0, 3.0]) * weight
    np.testing.assert_allclose(felt, expected, rtol=1e-9, atol=1e-9 * force)
    assert pushed.min() > force, "the bolt pulls the bar against the plane"
    np.testing.assert_allclose(felt[0], force, rtol=1e-14)


def test_friction_acts_where_only_the_shortening_slips() -> None:
    """An obstacle pressed by 300 against a copy whose node is held carries up to 150."""
    mesh = fem.box([np.linspace(0, 2, 3), np.linspace(0, 10, 6)], "quadrilateral")
    middle = mesh.p[:, mesh.facets].mean(axis=1)
    left = np.flatnonzero(middle[0] == 0)
    mesh = mesh.with_boundaries(
        {"lower": left[middle[1, left] < 6], "upper": left[middle[1, left] > 6]}
    )
    model = fem.assemble(
        [Body("bar", mesh, STEEL)],
        [
            Contact(
                "bar",
                "upper",
                0.5,
                plane=([0.0, 0.0], [1.0, 0.0]),
                within={1: (5.9, 6.1)},
                floating=fem.Floating("pad", (0,)),
            )
        ],
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
        (([0.0, 50.0], [0.0, 1.0]), "does not meet body 'frame'"),
        (([0.0, 5.0, 0.0], [0.0, 1.0, 0.0]), "needs a point and a normal of 2 numbers"),
        ("no", "has no surface 'no'"),
        ("y12", "is on the boundary of the body at"),
    ],
)
def test_sections_that_cut_no_shank(section: Any, message: str) -> None:
    bodies = stand().bodies
    with refused(message):
        fem.assemble(bodies, [], bolts=[Bolt("it", "frame", section)])
    with refused("there is no body 'farme'"):
        fem.assemble(bodies, [], bolts=[Bolt("it", "farme", section)])


def test_another_stiffness_in_the_same_problem() -> None:
    model, stiff = stand(mu=0.2), 2.0
    forces: list[dict[str, float]] = [{"left": 900.0, "right": 500.0}, {}]
    still = [[0.0] * 2] * 2
    moved = [
        model.prescribed(still, {b.name: [bolt] for b in model.bolts})
        for bolt in (np.nan, 0.0)
    ]
    load = sum(model.reference_force(n, [f, 0.0]) for n, f in forces[0].items())
    load = load + model.body_force("frame", [0.0, -1.0])  # also beside the sections
    problem = model.problem()
    before = problem.solve([load, load], moved, tol=1e-12)
    assert model.ties is not None
    problem.update(stiff * model.K)
    after = problem.solve([load, load], moved, tol=1e-12)
    for one, other in zip(after, before, strict=True):
        # Forces are the same, and displacements half as large.
        np.testing.assert_allclose(one.bolt_force, other.bolt_force, rtol=1e-9)
        np.testing.assert_allclose(stiff * one.shortening, other.shortening, rtol=1e-9)


def test_a_pickled_problem_solves_to_the_same_bits() -> None:
    model = stand(mu=0.2)
    moved = model.prescribed([[0.0] * 2] * 2, {"left": [np.nan], "right": [0.0]})
    load = model.reference_force("left", [900.0, 0.0])
    problem = model.problem()
    ours, theirs = (
        p.solve(load, moved) for p in (problem, pickle.loads(pickle.dumps(problem)))
    )
    assert ours[0].shortening.tobytes() == theirs[0].shortening.tobytes()


def test_names_of_bodies_repeat_beside_a_bolt() -> None:
    frame = stand().bodies[0]
    up = ([0.0, 9.0], [0.0, 1.0])
    with refused("names of bodies repeat"):
        fem.assemble(
            [
                frame,
                frame,
                Body("bar", fem.box([[0, 1], [0, 8, 16]], "triangle"), STEEL),
            ],
            [],
            bolts=[Bolt("it", "bar", up)],
        )
