"""Bodies and soils in frictional contact: limits, closed forms, other solvers, three methods."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.bodies.elasticity import stiffness
from bipot_rs.mesh.boxes import box
from bipot_rs.mesh.elements import second_order
from bipot_rs.theory.functionals import (
    Functionals,
    of_problem,
)
from bipot_rs.theory.limit_load import bound_load
from bipot_rs.theory.points import (
    PlasticPoints,
    Rate,
    critical_hardening,
    find_ellipticity,
)
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import StepNotConvergedError, StructureStep

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
METHODS = ("newton", "displacements", "uzawa")


def body_of(
    x: Any, y: Any, cell: str = "quadrilateral", young: float = 100.0, nu: float = 0.3
) -> fem.Body:
    mesh = box([np.asarray(x, float), np.asarray(y, float)], cell)
    mesh = second_order(mesh, serendipity=cell == "quadrilateral")
    return fem.Body("ground", mesh, fem.Material(young, nu))


def nodes_along(body: fem.Body, inside: Array) -> NDArray[np.int64]:
    """Nodes in the order of x."""
    nodes = np.flatnonzero(inside)
    return nodes[np.argsort(body.points[nodes, 0])]


def pressed_from_above(nodes: NDArray[np.int64], n: int) -> Array:
    """B of contacts with a rigid obstacle above: normal down, tangent along x."""
    B = np.zeros((2 * len(nodes), n))
    rows = np.arange(len(nodes))
    B[2 * rows, 2 * nodes + 1] = -1.0
    B[2 * rows + 1, 2 * nodes] = 1.0
    return B


def press_and_drag(count: int, depths: Any, ways: Any) -> Array:
    """Gaps of an obstacle that goes down and along x, ``(steps, count, 2)``."""
    gap = np.zeros((len(depths), count, 2))
    gap[:, :, 0] = -np.reshape(depths, (-1, 1))
    gap[:, :, 1] = -np.reshape(ways, (-1, 1))
    return gap


def footing(
    phi: float,
    psi: float,
    mu: float,
    *,
    law: str = "mohr-coulomb",
    cohesion: float = 1.0,
    weight: float = 0.0,
    unit: float = 1.0,
    length: float = 1.0,
) -> tuple[Structure, Array]:
    """A strip of width 2 on ground of 5 by 2, and B of its contacts."""
    x = length * np.array([-2.5, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2.5])
    y = length * np.array([-2.0, -1.0, -0.5, 0.0])
    body = body_of(x, y, young=200.0 * unit)
    at = body.points / length
    foot = nodes_along(body, (at[:, 1] > -1e-9) & (np.abs(at[:, 0]) < 1 + 1e-9))
    base = np.flatnonzero(at[:, 1] < -2 + 1e-9)
    sides = np.flatnonzero(np.abs(at[:, 0]) > 2.5 - 1e-9)
    fixed = np.unique(np.concatenate([2 * base, 2 * base + 1, 2 * sides]))
    B = pressed_from_above(foot, body.points.size)
    heavy = weight * unit / length
    soil = Soil.of_body(body, phi, psi, cohesion * unit, heavy, law)
    contacts = Contacts(B, np.zeros(len(foot)), mu)
    return Structure([], [soil], contacts, fixed), B


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_elastic_limit_is_the_contact_problem(cell: str) -> None:
    """A soil that never yields, pressed and dragged: partial slip, as of Cattaneo."""
    # The base moves against an obstacle at rest; a = c cot φ is far above all stresses.
    ticks = np.linspace(0, 2, 5)
    body = body_of(ticks, [0.0, 0.5, 1.0], cell)
    at, n = body.points, body.points.size
    base = np.flatnonzero(at[:, 1] < 1e-9)
    top = nodes_along(body, at[:, 1] > 1 - 1e-9)
    fixed = np.concatenate([2 * base, 2 * base + 1])
    B, mu = pressed_from_above(top, n), 0.4
    soil = Soil.of_body(body, 30.0, 5.0, 1000.0)
    structure = Structure([], [soil], Contacts(B, np.zeros(len(top)), mu), fixed)
    moved = np.zeros((4, len(fixed)))
    along = np.isin(structure.fixed, 2 * base)
    moved[:, ~along] = np.array([0.01, 0.02, 0.02, 0.02])[:, None]
    moved[:, along] = np.array([0.0, 0.0, 0.002, 0.01])[:, None]
    steps = structure.solve(prescribed=moved, tol=1e-13)
    # Triangles of second order: stiffness of the full rule, which is exact too.
    K = stiffness(body) if cell == "triangle" else structure.elastic
    problem = bp.ContactProblem(
        K, B, gap=np.zeros(len(top)), mu=mu, fixed=structure.fixed
    )
    result = problem.solve(None, moved, tol=1e-14)
    statuses = set()
    for step, other in zip(steps, result, strict=True):
        scale = np.abs(other.reaction).max()
        assert soil.apex > 100 * np.abs(step.stress[0]).max()
        # Rounding of the stiffness, times its condition.
        assert np.abs(step.reaction - other.reaction).max() < 1e-12 * scale
        size = np.abs(other.displacement).max()
        assert np.abs(step.displacement - other.displacement).max() < 1e-12 * size
        assert np.abs(step.plastic_strain[0]).max() == 0.0
        statuses.update(other.status.tolist())
    assert statuses >= {int(bp.Status.STICK), int(bp.Status.SLIP)}
    # The obstacle moves against a base at rest: the same, but for a translation.
    ways = np.array([0.0, 0.0, 0.002, 0.01])
    gap = press_and_drag(len(top), [0.01, 0.02, 0.02, 0.02], -ways)
    for step, other in zip(structure.solve(gap=gap, tol=1e-13), steps, strict=True):
        scale = np.abs(other.reaction).max()
        assert np.abs(step.reaction - other.reaction).max() < 1e-12 * scale


def test_reduced_problem_with_a_cone_at_each_point() -> None:
    """Without dilatancy each point is a contact in space with W = M⁻¹, R the strains."""
    structure, _ = footing(20.0, 0.0, 0.3)
    (points,), free = structure.points, structure.free
    count, m = structure.shape[0], len(points.weights)
    assert m < 150
    gap = press_and_drag(count, [0.03], [0.0])
    (step,) = structure.solve(gap=gap, tol=1e-12)
    # Reactions of the points are forces w r; contacts in the plane have an idle tangent.
    compliance = 1 / (points.springs * points.weights[:, None])
    idle = np.tile([0.0, 0.0, compliance.mean()], count)
    W = sparse.diags_array(np.concatenate([compliance.ravel(), idle]))
    q = np.zeros((m + count, 3))
    q[:m] = -points.rest / points.springs
    q[m:, :2] = gap[0]
    B = np.zeros((count, 3, structure.n))
    B[:, :2] = structure.matrix.toarray().reshape(count, 2, -1)
    R = np.vstack([points.strain.toarray(), B.reshape(3 * count, -1)])[:, free]
    pull = points.strain.T @ (points.weights[:, None] * points.rest).ravel()
    reduced = bp.ReducedProblem(
        sparse.csr_array(W),
        q,
        np.concatenate([points.law.mu, np.full(count, 0.3)]),
        rigid=(R, -pull[free]),
    )
    solution = reduced.solve(tol=1e-12)
    assert solution.converged
    scale = np.abs(step.reaction).max()
    assert np.abs(solution.reaction[m:, :2] - step.reaction).max() < 1e-9 * scale
    r = points.from_tensors(step.stress[0])
    stress = solution.reaction[:m] / points.weights[:, None]
    assert np.abs(stress - r).max() < 1e-9 * np.abs(r).max()
    assert np.abs(step.plastic_strain[0]).max() > 1e-4


def draw_structure(seed: int) -> tuple[Structure, dict[str, Any]]:
    """Two to six cells of soil under an obstacle, some with an elastic block on top."""
    rng = np.random.default_rng([37, seed])
    columns, rows = rng.integers(1, 4), rng.integers(1, 3)
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.4, 1.0, columns))])
    y = np.concatenate([[0.0], np.cumsum(rng.uniform(0.4, 1.0, rows))])
    cell = ("triangle", "quadrilateral")[rng.integers(2)]
    law = ("mohr-coulomb", "drucker-prager")[rng.integers(2)]
    phi = rng.uniform(10.0, 35.0)
    psi = phi * rng.choice([0.0, 1.0, rng.random()])
    # A Poisson's ratio for which σ_z stays between the others.
    ground = body_of(x, y, cell, young=rng.uniform(50, 200), nu=rng.uniform(0.3, 0.4))
    weight = rng.choice([0.0, 0.2])
    soil = Soil.of_body(ground, phi, psi, rng.uniform(0.5, 2.0), weight, law)
    at, height = ground.points, y[-1]
    base = np.flatnonzero(at[:, 1] < 1e-9)
    left = np.flatnonzero(at[:, 0] < 1e-9)
    fixed = [2 * base + 1, 2 * left]
    top = nodes_along(ground, at[:, 1] > height - 1e-9)
    mu, n = rng.choice([0.0, rng.uniform(0.1, 0.6)]), ground.points.size
    steps = np.sort(rng.uniform(0.002, 0.02, 2)) * height
    # Cohesion and dilatancy in half of the structures each, some associated.
    own = np.random.default_rng([38, seed])
    numbers = {
        "cohesion": own.choice([0.0, own.uniform(0.02, 0.5)]),
        "dilatancy": mu * own.choice([0.0, 0.0, own.random(), 1.0]),
    }
    if rng.random() < 0.5:
        gap = press_and_drag(len(top), steps, rng.uniform(-0.01, 0.01, 2))
        B = pressed_from_above(top, n)
        contacts = Contacts(B, np.zeros(len(top)), mu, **numbers)
        structure = Structure([], [soil], contacts, np.unique(np.concatenate(fixed)))
        return structure, {"gap": gap}
    # A block with nodes opposite those of the soil, moved from its top.
    block = body_of(x, [height, height + 0.6], cell, young=1000.0, nu=0.2)
    under = nodes_along(block, block.points[:, 1] < height + 1e-9)
    above = np.flatnonzero(block.points[:, 1] > height + 0.6 - 1e-9)
    size = block.points.size
    B = np.zeros((2 * len(top), size + n))
    B[:, size:] = pressed_from_above(top, n)
    B[:, :size] = -pressed_from_above(under, size)
    held = [2 * above, 2 * above + 1, *(size + dofs for dofs in fixed)]
    dofs = np.unique(np.concatenate(held))
    moved = np.zeros((2, len(dofs)))
    vertical = np.isin(dofs, 2 * above + 1)
    moved[:, vertical] = -steps[:, None]
    moved[:, np.isin(dofs, 2 * above)] = rng.uniform(-0.01, 0.01, (2, 1))
    contacts = Contacts(B, np.zeros(len(top)), mu, **numbers)
    return Structure([block], [soil], contacts, dofs), {"prescribed": moved}


@pytest.mark.slow_variants(*map(str, range(3, 50)))
@pytest.mark.parametrize("seed", range(50))
def test_three_methods_have_one_answer(seed: int) -> None:
    structure, path = draw_structure(seed)
    answers = {
        method: structure.solve(
            **path,
            method=method,
            tol=1e-12 if method == "newton" else 1e-10,
            max_iterations=20_000,
        )
        for method in METHODS
    }
    for at, step in enumerate(answers["newton"]):
        scale = np.abs(step.reaction).max(), np.abs(step.stress[0]).max()
        for method in METHODS[1:]:
            other = answers[method][at]
            # Gaps of 1e-10 are of the second order in the fields, but for contact.
            assert np.abs(other.reaction - step.reaction).max() < 1e-7 * scale[0]
            assert np.abs(other.stress[0] - step.stress[0]).max() < 1e-7 * scale[1]
        assert step.bifunctional <= 1e-14 * step.work
        assert max(step.gap_soil, step.gap_contact) <= 1e-14


def draw_path(seed: int) -> tuple[Array, Array, dict[str, Array], Array]:
    """K, B, the law and the loads of a path on which contacts break, slip and lift."""
    rng = np.random.default_rng([53, seed])
    d, count = rng.integers(2, 4), rng.integers(1, 6)
    n = d * count + rng.integers(1, 6)
    root = rng.normal(size=(n, n))
    mu = rng.uniform(0.0, 0.6, count) * (rng.random(count) < 0.8)
    law = {
        "mu": mu,
        "dilatancy": mu * rng.choice([0.0, 1.0, rng.random()], count),
        "cohesion": rng.uniform(0.0, 2.0, count) * (rng.random(count) < 0.7),
        "gap": rng.choice([0.0, 0.0, 0.2], count) * rng.random(count),
    }
    load = 2 * np.cumsum(rng.normal(size=(rng.integers(2, 6), n)), axis=0)
    B = rng.normal(size=(d * count, n))
    return root @ root.T + 0.3 * np.eye(n), B, law, load


def test_contacts_break_and_lift_as_of_a_contact_problem() -> None:
    seen = np.zeros(3, np.int64)
    for seed in range(12):
        K, B, law, load = draw_path(seed)
        result = bp.ContactProblem(K, B, **law).solve(load, tol=1e-14)
        steps = Structure([K], (), Contacts(B, **law)).solve(load, tol=1e-13)
        # The rounding of both in u; that of the reactions is less.
        near = 1e-12 * np.sqrt(np.linalg.cond(K))
        for force, step, other in zip(load, steps, result, strict=True):
            reach = np.abs(np.linalg.solve(K, force)).max()
            scale = np.abs(force).max()
            u, r = other.displacement, other.reaction
            assert np.abs(step.displacement - u).max() < near * reach
            assert np.abs(step.reaction - r).max() < near * scale
            assert np.array_equal(step.broken, other.broken)
            v, w = other.relative_displacement, step.relative_displacement
            size = np.abs(B).sum(axis=1).max() * reach + law["gap"].max()
            assert np.abs(w - v).max() < near * size
            assert np.abs(step.slip - other.slip).max() < near * size
            if other.dilation is not None:
                assert np.abs(step.dilation - other.dilation).max() < near * size
                seen[0] += (other.dilation > 0.01).sum()
            assert step.gap_contact <= 1e-14
        if other.broken is not None:
            seen[1:] += other.broken.sum(), (~other.broken).sum()
    assert (seen > 3).all()


@pytest.mark.parametrize("increments", [True, False])
def test_excess_of_steps_that_break_and_lift(increments: bool) -> None:
    """(28) of solved steps of a contact problem, with the cohesion and gaps of each."""
    for seed in range(12):
        K, B, law, load = draw_path(seed)
        problem = bp.ContactProblem(K, B, **law)
        result, structure = problem.solve(load, tol=1e-14), of_problem(problem, K)
        for k, force in enumerate(load):
            f = Functionals.of_step(structure, result, k, increments=increments)
            du, dr = result[k].displacement, result[k].reaction
            if k and increments:
                du, dr = du - result[k - 1].displacement, dr - result[k - 1].reaction
            v = result[k].relative_displacement
            size = force @ np.linalg.solve(K, force) + np.abs(dr * v).sum()
            # Rounding of some tens of terms.
            assert abs(f.excess(du, dr)) < 1e-13 * size
            whole = f.bifunctional(du, dr) + f.start_work
            assert whole == pytest.approx(f.excess(du, dr), abs=1e-13 * size)


@pytest.mark.parametrize(("phi", "psi"), [(20.0, 20.0), (20.0, 0.0), (35.0, 5.0)])
def test_plane_compression_between_smooth_platens(phi: float, psi: float) -> None:
    # One cell: with several, strains may gather in some of them.
    body = body_of([0, 1], [0, 1])
    at = body.points
    sides = [
        2 * np.flatnonzero(at[:, 0] < 1e-9),
        2 * np.flatnonzero(at[:, 1] < 1e-9) + 1,
    ]
    top = nodes_along(body, at[:, 1] > 1 - 1e-9)
    contacts = Contacts(pressed_from_above(top, at.size), np.zeros(len(top)), 0.0)
    soil = Soil.of_body(body, phi, psi, 1.0)
    structure = Structure([], [soil], contacts, np.concatenate(sides))
    gap = press_and_drag(len(top), [0.02, 0.06, 0.1], np.zeros(3))
    steps = structure.solve(gap=gap, tol=1e-13)
    sine = math.sin(math.radians(phi))
    strength = 2 * math.cos(math.radians(phi)) / (1 - sine)
    assert steps[-1].reaction[:, 0].sum() == pytest.approx(strength, rel=1e-12)
    # Once every point yields, the rest of the strain is plastic.
    change = steps[-1].displacement - steps[-2].displacement
    lateral = change[2 * np.flatnonzero(at[:, 0] > 1 - 1e-9)] / 0.04
    dilates = math.sin(math.radians(psi))
    assert lateral == pytest.approx((1 + dilates) / (1 - dilates), rel=1e-12)


@cache
def yielding(phi: float, psi: float, nu: float) -> tuple[PlasticPoints, Array]:
    """One point of Mohr and Coulomb, and a shear beyond its limit."""
    sine, dilates = (math.sin(math.radians(angle)) for angle in (phi, psi))
    shear = 1.0
    lame = 2 * shear * nu / (1 - 2 * nu)
    X = np.array(
        [[1.0, 1, 0, 0, 0, 0], [-1, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, -(2**0.5)]]
    )
    point = PlasticPoints(
        np.eye(3),
        [1.0],
        [[lame + shear, shear]],
        mu=sine,
        dilatancy=dilates,
        apex=1.0,
        components=X,
    )
    return point, np.array([[-0.1, 0.7, 0.9]])


@pytest.mark.parametrize(
    ("phi", "psi", "nu"), [(20, 20, 0.3), (20, 0, 0.3), (30, 20, 0.3), (35, 5, 0.2)]
)
def test_hardening_below_which_bands_form(phi: float, psi: float, nu: float) -> None:
    point, strain = yielding(phi, psi, nu)
    least = find_ellipticity(point, point.respond(strain, point.rest))
    sines = [math.sin(math.radians(angle)) for angle in (phi, psi)]
    critical = (sines[0] - sines[1]) ** 2 / (8 * (1 - nu))
    # det Q is proportional to (H - H_n)/(H + h), h the hardness of the flow.
    hardness = 1 + sines[0] * sines[1] / (1 - 2 * nu)
    # The grid of angles, and the further step.
    assert least == pytest.approx(-critical / hardness, abs=1e-6)
    if psi == phi:
        return
    assert critical > 0.01 or critical_hardening(point) == pytest.approx(0.01)
    rate = Rate(np.array([critical]), np.zeros(1))
    harder = find_ellipticity(point, point.respond(strain, point.rest, rate=rate), rate)
    assert harder == pytest.approx(0.0, abs=1e-6)


def test_uniqueness_is_not_claimed_without_ellipticity() -> None:
    def last(phi: float, psi: float, mu: float) -> StructureStep:
        structure, B = footing(phi, psi, mu)
        return structure.solve(gap=press_and_drag(len(B) // 2, [0.06], [0.0]))[-1]

    lost = last(20.0, 0.0, 0.0)
    assert not lost.elliptic
    assert not lost.unique
    assert lost.stability.startswith("ellipticity is lost at")
    assert last(20.0, 20.0, 0.0).unique
    # Friction is not associated.
    rough = last(20.0, 20.0, 0.3)
    assert rough.elliptic
    assert not rough.unique


@pytest.mark.parametrize("cohesion", [0.0, 0.01])
def test_limits_with_a_contact_in_the_mechanism(cohesion: float) -> None:
    """A block of soil pushed along a base of friction μ under its weight."""
    body = body_of([0, 1, 2], [0, 0.5, 1.0])
    at, n = body.points, body.points.size
    base = nodes_along(body, at[:, 1] < 1e-9)
    B = np.zeros((2 * len(base), n))
    rows = np.arange(len(base))
    B[2 * rows, 2 * base + 1] = B[2 * rows + 1, 2 * base] = 1.0
    soil = Soil.of_body(body, 30.0, 0.0, 100.0, weight=1.0)
    contacts = Contacts(B, np.zeros(len(base)), 0.4, cohesion, 0.1)
    structure = Structure([], [soil], contacts)
    push = np.zeros(n)
    push[2 * np.flatnonzero(at[:, 0] < 1e-9)] = [
        1 / 6 if 1e-9 < y < 1 - 1e-9 and abs(y - 0.5) > 1e-9 else 0.0
        for y in at[at[:, 0] < 1e-9, 1]
    ]
    push /= push.sum()
    limits = bound_load(structure, push)
    # The soil is strong: the block slides at μ times its weight, 0.4 · 2, unless it tilts.
    held = len(base) * cohesion
    assert limits.upper == pytest.approx(0.8 + held, rel=1e-6)
    assert limits.mechanism is not None
    # Without dilatancy the cone of β of the soil does not even carry the weight.
    assert limits.lower == -math.inf
    # An associated soil does, and the base carries β times it: it may break.
    strong = Soil.of_body(body, 30.0, 30.0, 100.0, weight=1.0)
    limits = bound_load(Structure([], [strong], contacts), push)
    assert limits.lower == pytest.approx(0.2, rel=1e-6)
    assert limits.upper == pytest.approx(0.8 + held, rel=1e-6)


@cache
def bear_footing(mu: float, unit: float, length: float) -> float:
    """The bound of the force on a footing, proved here by its definition in other sums."""
    structure, B = footing(
        30.0, 0.0, mu, cohesion=0.05, weight=1.0, unit=unit, length=length
    )
    # The footing moves down only: one degree of freedom more.
    n, count = structure.n, structure.shape[0]
    (points,) = structure.points
    law, idle = points.law, sparse.csr_array((points.strain.shape[0], 1))
    ground = PlasticPoints(
        sparse.hstack([points.strain, idle]),
        points.weights,
        points.stiffness,
        mu=law.mu,
        dilatancy=law.dilatancy,
        apex=points.apex,
    )
    down = np.tile([1.0, 0.0], count)[:, None]
    contacts = Contacts(np.hstack([B, down]), np.zeros(count), mu)
    whole = Structure([], [ground], contacts, structure.fixed)
    load, dead = -np.eye(n + 1)[n], np.r_[structure.weight, 0.0]
    limits = bound_load(whole, load, dead)
    d = limits.mechanism
    x, v = points.strains(d[:n]), (contacts.B @ d).reshape(-1, 2)
    # Rounding of the sums, which the proof itself does without.
    tiny = 1e-14 * np.abs(d).max()
    assert (law.mu * np.linalg.norm(x[:, 1:], axis=1) <= x[:, 0] + tiny / length).all()
    assert (mu * np.abs(v[:, 1]) <= v[:, 0] + tiny).all()
    bound = (points.weights @ (points.apex * x[:, 0]) - dead @ d) / (load @ d)
    assert limits.upper == pytest.approx(bound, rel=1e-11)
    return limits.upper / (unit * length)


@pytest.mark.quick_variants("0.3")
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.3, 10.0])
def test_limits_beside_a_dead_load_on_its_limit(mu: float) -> None:
    """The ground bears its weight, and contacts nothing: no reaction is inside its cone."""
    reference = bear_footing(mu, 1.0, 1.0)
    assert reference > bear_footing(0.0, 1.0, 1.0) * (1 - 1e-9)
    for unit, length in ((1e-6, 1.0), (1e6, 1e-3), (1.0, 1e3)):
        # The proof is repaired by shares of about 1e-9.
        scaled = bear_footing(mu, unit, length)
        assert scaled == pytest.approx(reference, rel=1e-7)


GRID = np.linspace(0, 1, 3)
QUADRATIC, ROCK = body_of(GRID, GRID), fem.Material(1.0, 0.3)


def soil_on(mesh: Any, *angles: Any) -> Soil:
    return Soil.of_body(fem.Body("b", mesh, ROCK), *angles)


MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: soil_on(box([GRID] * 2, "quadrilateral"), 30.0, 0.0, 1.0), "4 nodes in 2D, .* lock"),
    (lambda: soil_on(second_order(box([GRID] * 2, "quadrilateral")), 30.0, 0.0, 1.0),
     "9 nodes in 2D, .* does not strain"),
    (lambda: soil_on(second_order(box([GRID] * 3, "tetrahedron")), 30.0, 0.0, 1.0),
     "'mohr-coulomb' in space, expected 'drucker"),
    (lambda: Soil.of_body(QUADRATIC, 90.0, 0.0, 1.0), "phi is 90, expected 0 to below 90"),
    (lambda: Soil.of_body(QUADRATIC, 20.0, 30.0, 1.0), "psi is 30.0, expected 0 to 20.0"),
    (lambda: Soil.of_body(QUADRATIC, 0.0, 0.0, 0.0), "positive where phi is 0"),
    (lambda: Soil.of_body(QUADRATIC, 20.0, None, 1.0), "phi or psi is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_what_a_soil_refuses(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call()


def test_a_soil_of_arrays_has_its_weight() -> None:
    cells = QUADRATIC.cells[:, QUADRATIC.kind.order_of_vtk]
    soil = Soil(QUADRATIC.points, cells, 100.0, 0.3, 30.0, 0.0, 1.0, 0.5)
    assert soil.load.sum() == pytest.approx(-0.5, rel=1e-14)


def test_stress_across_the_plane_is_checked() -> None:
    # Without friction and with ν = 0.2 the stress across the plane stays behind.
    structure, B = footing(0.0, 0.0, 0.0)
    gap = press_and_drag(len(B) // 2, np.linspace(0.01, 0.06, 6), np.zeros(6))
    with pytest.raises(
        StepNotConvergedError, match="not the intermediate one"
    ) as caught:
        structure.solve(gap=gap)
    last = caught.value.last
    assert last.lack_across > 1e-6
    assert last.imbalance < 1e-10
    # The cone of Drucker and Prager has no such condition.
    other, _ = footing(0.0, 0.0, 0.0, law="drucker-prager")
    assert other.solve(gap=gap)[-1].converged
