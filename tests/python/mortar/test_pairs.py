"""Non-matching surfaces: balance, reproduction, invariance, and partly covered edges."""

import pickle
from typing import Any

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.mortar import integrals, polygons
from support.comparisons import close, near, refused
from support.sheets import line, rotation, second_order, sheet

Array = NDArray[np.float64]
KINDS = (3, 4, 6, 8, 9)


def tilted(seed: int, *sheets: Any) -> tuple[Any, Any, Array]:
    """Two surfaces rotated together, and the rotation."""
    Q = rotation(seed, sheets[0][0].shape[1])
    one, other = ((x @ Q.T, f) for x, f in sheets)
    return one, other, Q


def in_balance(pairs: Any, one: Any, other: Any, limit: float) -> None:
    """As one rigid body they move without gaps: forces and moments of reactions balance."""
    x = np.concatenate([one[0], other[0]])
    for spin in np.eye(3 if x.shape[1] == 3 else 1):
        assert abs(pairs.B @ rigid(x, spin).ravel()).max() < limit
    for way in np.eye(x.shape[1]):
        assert abs(pairs.B @ np.tile(way, len(x))).max() < 1e-14


def rigid(x: Array, spin: Array) -> Array:
    return np.cross(spin, x) if x.shape[1] == 3 else spin[0] * x[:, ::-1] * [-1.0, 1.0]


@pytest.mark.parametrize("master", KINDS)
@pytest.mark.parametrize("slave", KINDS)
def test_swapping_the_roles_keeps_the_forces(slave: int, master: int) -> None:
    """∫ φ_j over the overlap, the force of a constant pressure, is the same for both roles.

    The squares overlap in part; the edge of each cuts facets of the other.
    """
    seed = 10 * slave + master
    below = sheet(slave, 5, up=False, seed=seed, low=-0.23, high=0.9)
    one, other, Q = tilted(seed, below, sheet(master, 4, up=True, seed=seed + 1))
    pairs, swapped = bp.pairs(*one, *other), bp.pairs(*other, *one)
    assert pairs.area.sum() == pytest.approx(0.9**2, rel=1e-13)
    for p, q in ((pairs, swapped), (swapped, pairs)):
        assert (p.area > 0).all()
        # Sums over some ten facets, each a sum over some ten intersections: rounding.
        near(p.slave.T @ p.area, q.master.T @ q.area, 1e-13 * pairs.area.max())
        np.testing.assert_allclose(p.slave.sum(axis=1), 1, rtol=1e-14)
        np.testing.assert_allclose(p.master.sum(axis=1), 1, rtol=1e-14)
        # No weight is so large that it amplifies rounding in displacements.
        assert max(abs(p.slave).max(), abs(p.master).max()) < 4
    # Normals from the master towards the slave, which is above.
    near(pairs.frame[:, 0] - Q[:, 2], 0, 1e-14)
    in_balance(pairs, one, other, 1e-13)
    # Both lie in one plane; coordinates are of size 1.
    assert abs(pairs.gap).max() < 1e-14


@pytest.mark.parametrize("middles", [False, True])
def test_swapping_the_roles_keeps_the_forces_in_the_plane(middles: bool) -> None:
    random = np.random.default_rng(5)
    below = line(np.sort(random.uniform(-0.3, 0.8, 9)), up=False, middles=middles)
    above = line(np.sort(np.append(random.uniform(0, 1, 6), [0, 1])), up=True)
    one, other, _ = tilted(6, below, above)
    pairs, swapped = bp.pairs(*one, *other), bp.pairs(*other, *one)
    for p, q in ((pairs, swapped), (swapped, pairs)):
        near(p.slave.T @ p.area, q.master.T @ q.area, 1e-14)  # as above
        assert (p.area > 0).all()
    in_balance(pairs, one, other, 1e-14)


def test_weights_are_the_integrals_of_dual_functions() -> None:
    """On triangles ψ_i = 4 N_i - 1; a quadratic function, which six nodes represent exactly."""
    x, cells = sheet(3, 5, up=False, seed=1)
    y, facets = sheet(6, 4, up=True, seed=2)
    pairs = bp.pairs(x, cells, y, facets)

    def f(p: Any) -> Any:
        return 1 + 2 * p[0] - p[1] + 3 * p[0] * p[1] - 5 * p[1] ** 2

    mesh = skfem.MeshTri(np.ascontiguousarray(x[:, :2].T), cells.T.copy())
    basis = skfem.Basis(mesh, skfem.ElementTriP1(), intorder=4)
    # The form receives one shape function N at a time.
    value = skfem.LinearForm(lambda v, w: (4 * v - 1) * f(w.x)).assemble(basis)
    area = skfem.LinearForm(lambda v, _: v).assemble(basis)
    np.testing.assert_array_equal(pairs.node, np.arange(len(x)))
    np.testing.assert_allclose(pairs.area, area, rtol=1e-13)
    close(pairs.master @ f(y.T), value / area, 1e-13)
    # Dual: one slave node for each row.
    np.testing.assert_allclose(pairs.slave.toarray(), np.eye(len(x)), atol=1e-14)


@pytest.mark.parametrize(
    ("nodes", "within"),
    # Sums in another order, and other triangles in skewed quadrilaterals, where the
    # quadrature is not exact.
    [(3, 1e-13), (4, 1e-7)],
)
def test_numbering_has_no_effect(nodes: int, within: float) -> None:
    below = sheet(nodes, 4, up=False, seed=7, high=0.8)
    above = sheet(3, 5, up=True, seed=8)
    pairs = bp.pairs(*below, *above)
    random = np.random.default_rng(9)
    p, q = (random.permutation(len(x)) for x, _ in (below, above))

    def renumbered(x: Array, cells: NDArray[np.int64], order: Any) -> tuple[Array, Any]:
        shuffled = random.permutation(np.argsort(order)[cells])
        return x[order], np.array([np.roll(c, random.integers(4)) for c in shuffled])

    again = bp.pairs(*renumbered(*below, p), *renumbered(*above, q))
    row = np.searchsorted(pairs.node, p[again.node])
    np.testing.assert_array_equal(pairs.node[row], p[again.node])
    for name, order in (("slave", p), ("master", q)):
        ours = getattr(pairs, name).toarray()[row][:, order]
        np.testing.assert_allclose(getattr(again, name).toarray(), ours, atol=within)
    np.testing.assert_allclose(again.area, pairs.area[row], rtol=1e-13)


@pytest.mark.parametrize("method", ["mortar", "nodes"])
@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_units_and_origin_have_no_effect(unit: float, method: str) -> None:
    (x, below), (y, above) = (
        sheet(4, 4, up=False, seed=7, high=0.8),
        sheet(4, 5, up=True, seed=8),
    )
    x[:, 2] += 0.125
    pairs = bp.pairs(x, below, y, above, method=method)
    x, y = (unit * (p + 1000 * np.array([1.0, -2.0, 3.0])) for p in (x, y))
    again = bp.pairs(x, below, y, above, method=method)
    np.testing.assert_array_equal(again.node, pairs.node)
    # Coordinates have lost four digits, and slivers at the edge are ill-conditioned.
    np.testing.assert_allclose(again.area, unit**2 * pairs.area, rtol=1e-9)
    np.testing.assert_allclose(again.gap, unit * pairs.gap, rtol=1e-9)
    assert abs(again.B - pairs.B).max() < 1e-9


def test_numbering_of_degrees_of_freedom_by_the_caller() -> None:
    below, above = sheet(3, 3, up=False), sheet(3, 2, up=True)
    pairs, count = bp.pairs(*below, *above), len(below[0])
    n = 3 * (count + len(above[0])) + 5
    order = np.random.default_rng(1).permutation(n)[: pairs.B.shape[1]]
    one, other = np.split(order.reshape(-1, 3), [count])
    again = bp.pairs(*below, *above, dofs_slave=one, dofs_master=other, n=n)
    assert again.B.shape == (pairs.B.shape[0], n)
    assert abs(again.B[:, order] - pairs.B).max() == 0
    assert again.B.nnz == pairs.B.nnz
    copy = pickle.loads(pickle.dumps(again))
    np.testing.assert_array_equal(copy.B.toarray(), again.B.toarray())


@pytest.mark.parametrize("shift", [0.3, 1e-1, 1e-2, 1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize("nodes", [3, 4])
def test_a_facet_that_is_hardly_covered(nodes: int, shift: float) -> None:
    """The master extends into the next row of facets by `shift` cells.

    The whole pressure is transferred, and no displacement is amplified. Without special
    treatment of the edge, weights grow as 1/shift.
    """
    below = sheet(nodes, 4, up=False, seed=2, bend=0.0)
    above = sheet(3, 5, up=True, seed=3, high=0.75 + shift / 4)
    pairs = bp.pairs(*below, *above)
    whole = bp.pairs(*above, *below).area  # fully covered
    assert max(abs(pairs.slave).max(), abs(pairs.master).max()) < 6
    # 1e-14 of a facet counts as nothing; the rest is rounding.
    close(pairs.master.T @ pairs.area, whole, 1e-12)
    in_balance(pairs, below, above, 1e-12)


@pytest.mark.parametrize("size", [0.5, 1e-2, 1e-5])
@pytest.mark.parametrize("nodes", KINDS)
def test_a_punch_smaller_than_a_facet(nodes: int, size: float) -> None:
    slave_side = sheet(nodes, 1, up=False)
    other = sheet(4, 3, up=True, low=0.3, high=0.3 + size)
    pairs = bp.pairs(*slave_side, *other)
    assert len(pairs.node) >= 1
    assert pairs.area.sum() == pytest.approx(size**2, rel=1e-9)
    assert max(abs(pairs.slave).max(), abs(pairs.master).max()) < 10
    np.testing.assert_allclose(
        pairs.master.T @ pairs.area, bp.pairs(*other, *slave_side).area, rtol=1e-8
    )


@pytest.mark.parametrize("nodes", KINDS)
def test_gap_is_that_of_the_positions(nodes: int) -> None:
    below, above = sheet(nodes, 3, up=False), sheet(4, 4, up=True)
    below[0][:, 2] += 0.25
    values = np.random.default_rng(0).normal(size=len(below[0]))
    for method in ("mortar", "nodes") if nodes < 5 else ("mortar",):

        def made(clearance: Any, method: str = method) -> Any:
            return bp.pairs(*below, *above, method=method, clearance=clearance)

        np.testing.assert_allclose(made(0.5).gap, 0.75, rtol=1e-14)
        # Dual functions also reproduce a linear clearance at the nodes.
        pairs = made(lambda x: 3 * x[:, 0] - 1)
        # The quadrature error on skewed quadrilaterals, see the module.
        exact = 1e-6 if nodes != 3 else 1e-13
        near(pairs.gap, 3 * pairs.points[:, 0] - 0.75, exact)
        # Values at nodes count by the mean of their interpolation: they are like a
        # displacement of the slave along the normals that opens the gap.
        plain, pairs = made(0.0), made(values)
        opened = np.concatenate([values[:, None] * [0, 0, 1], 0 * above[0]]).ravel()
        near(pairs.gap, plain.gap + (plain.B @ opened)[::3], 1e-13)
        if method == "nodes":
            near(pairs.gap - plain.gap, values[pairs.node], 1e-15)


def test_clearance_in_the_mean() -> None:
    """∫ ψ x² / a = x² - h²/6 for 2 N_1 - N_2 on each side, on segments of length h."""
    x = np.linspace(0, 1, 6)
    slave_side, other = line(x, up=False), line(np.linspace(0, 1, 4), up=True)
    pairs = bp.pairs(*slave_side, *other, clearance=lambda p: p[:, 0] ** 2)
    np.testing.assert_allclose(pairs.gap[1:-1], x[1:-1] ** 2 - 0.2**2 / 6, rtol=1e-13)


def test_nodes_fail_the_patch_test() -> None:
    """Three segments on two, by hand: a constant pressure is wrong by 1/9 at each node."""
    below, above = (
        line(np.linspace(0, 1, 4), up=False),
        line(np.linspace(0, 1, 3), up=True),
    )
    pairs, right = (bp.pairs(*below, *above, method=m) for m in ("nodes", "mortar"))
    np.testing.assert_allclose(pairs.area, [1 / 6, 1 / 3, 1 / 3, 1 / 6], rtol=1e-14)
    exact = np.array([1 / 4, 1 / 2, 1 / 4])
    wrong = pairs.master.T @ pairs.area / exact - 1
    np.testing.assert_allclose(wrong, [1 / 9, -1 / 9, 1 / 9], rtol=1e-12)
    np.testing.assert_allclose(right.master.T @ right.area, exact, rtol=1e-14)


@pytest.mark.parametrize("master", KINDS)
@pytest.mark.parametrize("slave", [3, 4])
def test_nodes_are_in_balance(slave: int, master: int) -> None:
    below = sheet(slave, 5, up=False, seed=1, low=-0.2, high=0.9)
    one, other, _ = tilted(3, below, sheet(master, 4, up=True, seed=2))
    pairs = bp.pairs(*one, *other, method="nodes")
    above = ((below[0][:, :2] >= 0) & (below[0][:, :2] <= 1)).all(axis=1)
    np.testing.assert_array_equal(pairs.node, np.flatnonzero(above))
    in_balance(pairs, one, other, 1e-14)  # one facet each: rounding


@pytest.mark.parametrize(
    ("nodes", "corner", "middle", "centre"),
    [(6, 0, 1 / 3, []), (8, -1 / 12, 1 / 3, []), (9, 1 / 36, 1 / 9, [4 / 9])],
)
def test_constant_pressure_on_second_order_facets(
    nodes: int, corner: float, middle: float, centre: list[float]
) -> None:
    """Nodal forces as in textbooks, from areas that are positive at all corners."""
    x, cells = sheet(nodes, 1, up=False)
    c = 3 if nodes == 6 else 4
    x, cells = second_order(x[cells[0, :c]], np.arange(c)[None], nodes)
    pairs = bp.rigid_pairs(x, cells, lambda p: p[:, 2])
    size = 1 / 2 if c == 3 else 1.0
    np.testing.assert_allclose(pairs.area, size / c, rtol=1e-14)
    force = pairs.B[::3].T @ pairs.area
    near(force[2::3], size * np.array([corner] * c + [middle] * c + centre), 1e-15)
    assert pairs.B.shape == (3 * c, 3 * len(x))


def test_constant_pressure_on_lines_of_three_nodes() -> None:
    x, cells = line(np.array([0.0, 1.0]), up=False, middles=True)
    pairs = bp.rigid_pairs(x, cells, lambda p: p[:, 1])
    force = pairs.B[::2].T @ pairs.area
    np.testing.assert_allclose(force[1::2], [1 / 6, 1 / 6, 2 / 3], rtol=1e-14)


def test_rigid_obstacles() -> None:
    """An inclined plane: its linear gap equals the gap of the nodes."""
    normal = np.array([1.0, 2.0, 2.0]) / 3
    facets = sheet(6, 3, up=False, seed=4)
    pairs, by_place = (
        bp.rigid_pairs(*facets, lambda p: p @ normal + 0.5, normal=n)
        for n in (normal, lambda p: 0 * p + normal)
    )
    np.testing.assert_allclose(pairs.gap, pairs.points @ normal + 0.5, rtol=1e-13)
    near(pairs.frame[:, 0] - normal, 0, 1e-15)
    assert pairs.area.sum() == pytest.approx(1, rel=1e-14)
    assert abs(by_place.B - pairs.B).max() == 0


def cap(
    nodes: int, n: int, radius: float, half: float, up: bool
) -> tuple[Array, NDArray[np.int64]]:
    """A sheet on a sphere with non-planar quadrilaterals and curved edges."""
    x, cells = sheet(nodes, n, up=up, seed=n, low=-half, high=half, bend=0.15)
    x[:, 2] = 1
    return radius * x / np.linalg.norm(x, axis=1)[:, None], cells


@pytest.mark.parametrize(
    ("slave", "master"), [(4, 4), (3, 4), (4, 3), (6, 9), (8, 6), (9, 8)]
)
@pytest.mark.quick_variants("3-*", "4-*")
def test_gaps_between_spheres(slave: int, master: int) -> None:
    errors = []
    for n in (4, 8, 16):
        pairs = bp.pairs(
            *cap(slave, n, 1.1, 0.5, up=False),
            *cap(master, round(1.3 * n), 1.0, 0.7, up=True),
        )
        assert (pairs.area > 0).all()
        assert abs(pairs.master).max() < 3
        np.testing.assert_allclose(pairs.master.sum(axis=1), 1, rtol=1e-13)
        errors.append(np.sqrt(np.mean((pairs.gap - 0.1) ** 2)))
    assert np.log2(errors[0] / errors[-1]) / 2 > 1.8, errors
    assert errors[-1] < 5e-4


@pytest.mark.parametrize("nodes", [0, 3, 4, 6, 9])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.slow_variants("*-9", "False-*")
def test_a_coarse_facet_on_a_fine_mesh(
    nodes: int, turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Facets of the master are compared with their neighbours, not with all."""
    clipped: list[int] = []
    clip = integrals.clip

    def counted_clip(subject: Array, by: Array) -> Array:
        clipped.append(len(subject))
        return clip(subject, by)

    monkeypatch.setattr(integrals, "clip", counted_clip)
    for n in (20, 40):
        if nodes == 0:
            x = np.linspace(0, 1, n * n + 1)
            surfaces: Any = line(x[[0, -1]], up=False), line(x, up=True)
        else:
            surfaces = sheet(nodes, 1, up=False), sheet(nodes, n, up=True)
        if turned:
            *surfaces, _ = tilted(n, *surfaces)
        clipped.clear()
        slave, master = surfaces
        pairs = bp.pairs(*slave, *master)
        np.testing.assert_allclose(pairs.slave.sum(axis=1), 1, rtol=1e-13)
        # One comparison with the slave, and eight with neighbours, four of which share an edge;
        # for triangles twelve, three of which share one.
        assert sum(clipped) <= 14 * len(master[1])


@pytest.mark.parametrize("d", [1, 2])
def test_boxes_side_by_side_are_those_of_comparing_all(d: int) -> None:
    """Boxes of many sizes, with duplicates, of one or many slave facets; each pair once."""
    rng, met = np.random.default_rng(5), 0
    for _ in range(40):
        count = int(rng.integers(0, 300))
        middle = rng.normal(size=(count, d)) * 10 ** rng.uniform(-3, 3)
        wide = np.abs(middle).max(initial=0.0) * 10 ** rng.uniform(-4, 0, (count, d))
        again = rng.integers(0, count, count) if rng.random() < 0.5 else slice(None)
        corners = np.stack([middle - wide, middle + wide], axis=1)[again]
        s = np.sort(rng.integers(0, rng.choice([1, 5, 100]), count))
        low, high = corners[:, 0], corners[:, 1]
        over = ((high[:, None] > low) & (high > low[:, None])).all(axis=2)
        expected = np.argwhere(np.tril(over & (s[:, None] == s), -1)).tolist()
        portions = [np.zeros((0, 2), int)]
        portions += map(np.column_stack, polygons.find_overlapping_boxes(s, corners))
        assert sorted(np.concatenate(portions).tolist()) == expected
        met += len(expected)
    assert met > 4_000


@pytest.mark.parametrize("corners", [3, 4])
def test_nodal_areas_integrate_linear_functions(corners: int) -> None:
    """Σ A and Σ A x of a tilted surface are its area and moments, by the shoelace formula."""
    rng = np.random.default_rng(corners)
    axis = np.arange(5.0)
    flat = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    flat += rng.uniform(-0.2, 0.2, flat.shape)
    k = (5 * np.arange(4)[:, None] + np.arange(4)).ravel()
    facets = np.stack([k, k + 5, k + 6, k + 1], axis=1)
    if corners == 3:
        facets = np.concatenate([facets[:, :3], facets[:, [0, 2, 3]]])
    basis = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    areas = bp.nodal_areas(np.vstack([flat @ basis, np.zeros(3)]), facets)
    assert areas[-1] == 0.0
    x, y = flat[facets], np.roll(flat[facets], -1, axis=1)
    cross = x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]
    moments = ((x + y) * cross[..., None]).sum(axis=(0, 1)) / 6
    # Sums of 25 numbers of size 1 to 4.
    found, wanted = [areas.sum(), *(areas[:-1] @ flat)], [cross.sum() / 2, *moments]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_nodal_areas_of_quadratic_facets_are_refused() -> None:
    x = [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]]
    with refused("give the facets of their corners"):
        bp.nodal_areas(x, [[0, 1, 2]])
    with refused("facets has node 3 in facet 0"):
        bp.nodal_areas(x, [[0, 3]])


@pytest.mark.parametrize("method", ["mortar", "nodes"])
@pytest.mark.parametrize("cells", [10, 200])
def test_a_pad_over_a_round_surface(method: str, cells: int) -> None:
    """Facets to the side are nearer than opposite ones, more so in a finer mesh."""
    x = np.linspace(-0.5, 0.5, cells + 1)
    round_ = 1.1 * x
    pad = np.c_[x, 0 * x]
    ground = np.c_[round_, -2 + np.sqrt(1 - round_**2)]
    lines = np.c_[np.arange(cells), np.arange(1, cells + 1)]
    pairs = bp.pairs(pad, lines, ground, lines[:, ::-1], method=method)
    assert len(pairs.gap) == cells + 1
    # The sagitta of a facet is h²/8 over the radius, measured along the vertical.
    exact = 2 - np.sqrt(1 - x**2)
    assert np.abs(pairs.gap - exact)[1:-1].max() < (1.1 / cells) ** 2


@pytest.mark.parametrize("parts", [1, 4])
def test_distance_is_along_the_normal(parts: int) -> None:
    """It is not the distance of facet centres, which depend on the mesh of the master."""
    x = np.linspace(0, 10, parts + 1)
    lines = [[i + 1, i] for i in range(parts)]
    pad = [[1, 0.61], [1.2, 0.61]]
    pairs = bp.pairs(pad, [[0, 1]], np.c_[x, 0.5 * x], lines, distance=0.2)
    np.testing.assert_allclose(pairs.gap, [0.11, 0.01], rtol=1e-12)
