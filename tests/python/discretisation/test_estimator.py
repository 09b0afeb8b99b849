"""The discretisation error of scenes: a true bound where stated, zero for exact solutions."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import discretisation_error as bench
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem, scene
from bipot_rs.contact.law.contact_law import BESIDE_MU
from bipot_rs.discretisation import BOUND, INDICATOR, Estimator, discretisation_error
from bipot_rs.discretisation.stopping import LOOSEST, TIGHTEST, tolerance
from support.boxes import box
from support.comparisons import refused

Floats = NDArray[np.float64]
SMOOTH = "contact.0.mu=0.0"


@pytest.mark.parametrize(
    ("name", "n", "factor", "least"),
    # `least` allows for the error of the reference itself. It has half the cell size: half the
    # error or, at the corners of the cube, h^0.6. Hence 1 - 0.5² and 1 - 0.25^1.2.
    [("cattaneo_mindlin", 5, 2, 0.7), ("sheared_cube", 2, 4, 0.8)],
)
def test_bound_without_friction(name: str, n: int, factor: int, least: float) -> None:
    row = bench.compare(name, [SMOOTH], n, factor)
    assert row.error.kind == BOUND
    assert row.error.reasons == ()
    assert row.effectivity >= 1
    # The dual part of the bound is at most about as large as the error.
    assert row.effectivity <= 1.45 / least


@pytest.mark.parametrize(
    ("name", "n", "factor"), [("pressed_block", 8, 4), ("sheared_cube", 2, 2)]
)
def test_indicator_with_friction(name: str, n: int, factor: int) -> None:
    row = bench.compare(name, [], n, factor)
    assert row.error.kind == INDICATOR
    assert "Coulomb" in row.error.reasons[0]
    # By the identity, B without the term of unknown sign is at least the error.
    energy = row.error.elastic_energy
    assert row.error.total - row.term >= energy * row.true**2
    assert 0.9 < row.effectivity < 2.2


def tresca(case: scene.Case, limit: float) -> tuple[Any, Floats]:
    """Step of Tresca's problem with this limit [Pa], by sweeps over the dual."""
    model = case.model
    load = np.zeros(model.n) if case.load is None else case.load[0]
    reduced = model.problem().reduced(load, case.prescribed[0])
    W, q = np.asarray(reduced.W), np.asarray(reduced.q).ravel()
    assert reduced.rigid is None
    most = np.column_stack([np.full(len(model.area), np.inf), limit * model.area])
    least = np.column_stack([0 * model.area, -limit * model.area])
    r = np.zeros(len(q))
    for _ in range(20_000):
        before = r.copy()
        for i, (low, high) in enumerate(zip(least.flat, most.flat, strict=True)):
            r[i] = min(max(r[i] - (W[i] @ r + q[i]) / W[i, i], low), high)
        if np.abs(r - before).max() <= 1e-13 * np.abs(r).max():
            break
    v = (W @ r + q).reshape(-1, 2)
    u = np.zeros(model.n)
    u[model.fixed] = case.prescribed[0]
    free = np.setdiff1d(np.arange(model.n), model.fixed)
    f = model.B.T @ r - model.K @ u + load
    u[free] = spsolve(model.K[free][:, free].tocsc(), f[free])
    gap = np.column_stack([model.gap, 0 * model.gap])
    opened = (model.B @ u).reshape(-1, 2) + gap
    np.testing.assert_allclose(opened, v, atol=1e-9 * np.abs(u).max())
    fields = {"reaction": r.reshape(-1, 2), "relative_displacement": v}
    return SimpleNamespace(**fields, slip=v[:, 1:], displacement=u), v


def true_error(case: scene.Case, u: Floats, fine: scene.Case, of_fine: Floats) -> float:
    """Energy of the difference from a solution on a mesh of half the size."""
    _, climb = bench.finer(case.model.bodies[0], 2)
    off = of_fine - bench.prolonged(u.reshape(-1, 2), climb).ravel()
    return float(0.5 * off @ (fine.model.K @ off))


BLOCK = """
[mesh]
n = 4
element = "P1"
[material.it]
young = 100.0
poisson = 0.3
[body.block]
material = "it"
cell = "quadrilateral"
x = { from = 0.0, to = 2.0, cells = "2*n" }
y = { from = 0.0, to = 1.0, cells = "n" }
[[support]]
on = "block.top"
x = 0.03
y = -0.02
[[body_force]]
on = "block"
x = 1.0
[[pressure]]
on = "block.right"
value = 0.4
[[contact]]
on = "block.bottom"
plane = { point = [0.0, 0.0], normal = [0.0, 1.0] }
mu = 0.3
"""


def block(tmp_path: Path, *settings: str, finer: bool = False) -> scene.Case:
    path = tmp_path / "block.toml"
    path.write_text(BLOCK)
    read = scene.read(str(path), settings)
    (body,) = scene.bodies(read)
    return scene.assemble(read, [bench.finer(body, 2)[0] if finer else body])


def solved(case: scene.Case, **options: Any) -> Any:
    return case.model.problem().solve(case.load, case.prescribed, **options)


def test_bound_with_tresca_friction(tmp_path: Path) -> None:
    coarse, fine = block(tmp_path), block(tmp_path, finer=True)
    (step, v), (reference, _) = (tresca(case, 1.5) for case in (coarse, fine))
    # Both slip and stick occur; otherwise the test would not check friction.
    sticks = np.abs(v[:, 1]) <= 1e-9 * np.abs(v).max()
    assert sticks.any()
    assert not sticks.all()
    limits = np.full(len(coarse.model.gap), 1.5)
    error = discretisation_error(coarse, step, 0, threshold=limits)
    assert error.kind == BOUND
    assert error.contacts.min() >= -1e-14 * error.total
    true = true_error(coarse, step.displacement, fine, reference.displacement)
    assert true <= error.total <= 2.2 * true
    # As Coulomb's problem it is an indicator.
    assert discretisation_error(coarse, step, 0).kind == INDICATOR


def test_error_is_zero_for_exact_solutions() -> None:
    """Uniform pressure without friction gives a linear displacement."""
    case, result = bench.solved("pressed_block", [SMOOTH, "mesh.n=4"])
    error = discretisation_error(case, result)
    # The square of the rounding of stresses, and of v_n in contacts.
    assert error.cells.sum() <= 1e-26 * error.elastic_energy
    assert error.contacts.sum() <= 1e-13 * error.elastic_energy
    assert error.kind == BOUND


def test_units_do_not_matter(tmp_path: Path) -> None:
    """For example millimetres and megapascals, or inches and pounds; also the thickness."""
    length, stress = 1 / 25.4, 145.0377
    scaled = {
        "body.block.x.to": 2.0 * length,
        "body.block.y.to": 1.0 * length,
        "material.it.young": 100.0 * stress,
        "support.0.x": 0.03 * length,
        "support.0.y": -0.02 * length,
        "body_force.0.x": 1.0 * stress / length,
        "pressure.0.value": 0.4 * stress,
    }
    plain, other, thick = (
        discretisation_error(case, solved(case, tol=1e-13))
        for case in (
            block(tmp_path),
            block(tmp_path, *(f"{key}={value}" for key, value in scaled.items())),
            block(tmp_path, "body.block.thickness=3.0"),
        )
    )
    # The solver's tolerance, in products.
    wanted = plain.cells * stress * length**2
    np.testing.assert_allclose(other.cells, wanted, rtol=1e-7, atol=1e-9 * other.total)
    assert other.relative == pytest.approx(plain.relative, rel=1e-8)
    assert thick.total == pytest.approx(3 * plain.total, rel=1e-9)
    assert thick.relative == pytest.approx(plain.relative, rel=1e-9)


def test_no_penetration_between_nodes_of_a_curved_gap() -> None:
    """After the lift, the remaining curvature cannot close a facet, for any opening."""
    read = scene.read("cattaneo_mindlin", ["mesh.n=2", "mesh.element=P1"])
    case = scene.assemble(read, scene.bodies(read))
    estimator = Estimator(case)
    facets = estimator.facets
    # r²/(2 R) bulges by h²/(8 R), k/4, between points at distance h.
    np.testing.assert_allclose(facets.curvature, 0.25**2 / 200, rtol=1e-9)
    random = np.random.default_rng(2)
    for _ in range(20):
        opening = random.uniform(0, 1, len(case.model.gap)) ** 6 * facets.curvature[0]
        opening[random.random(len(opening)) < 0.3] = 0
        lift = estimator._lift(opening)
        s = np.linspace(0, 1, 11)[:, None]
        a, b = opening[facets.edges].T
        gap = (1 - s) * a + s * b - s * (1 - s) * lift.kept
        assert gap.min() >= -1e-15
        # The facet opens: the upper body moves up, the lower one down.
        for bubbles in lift.bubbles:
            up = case.model.bodies[bubbles.body].name == "upper"
            assert np.all(bubbles.vector[:, 1] > 0 if up else bubbles.vector[:, 1] < 0)
        # Each side contributes half of the opening.
        lifted = sum(np.abs(bubbles.vector).sum() for bubbles in lift.bubbles)
        assert lifted == pytest.approx((facets.curvature - lift.kept).sum())


def test_bad_calls(tmp_path: Path) -> None:
    read = scene.read("sheared_cube", ["mesh.n=2"])
    with refused(r"'cube' has cells of 8 nodes.*P1"):
        Estimator(scene.assemble(read, scene.bodies(read)))
    case, result = bench.solved("sheared_cube", ["mesh.n=2"])
    estimator = Estimator(case)
    with refused("step is 2, but the path has 2 steps"):
        estimator.error(result, 2)
    with refused(r"threshold has shape \(3,\)"):
        estimator.error(result, 0, threshold=np.ones(3))
    with refused("threshold is -1 at a contact"):
        estimator.error(result, 0, threshold=-np.ones(9))
    with refused(r"node at \(0, 0\) belongs to no facet"):
        Estimator(block(tmp_path, "contact.0.within={x = [0.0, 0.1]}"))
    mesh = box("triangle", 2)
    mesh.p[1] += 0.1 * mesh.p[0] * (1 - mesh.p[0]) * (1 - mesh.p[1])
    body = fem.Body("it", mesh, fem.Material(1.0, 0.3))
    below = fem.box([np.linspace(0, 1, 3), [-1, 0]], "triangle")
    pair = fem.Contact("it", "bottom", 0.3, against=("flat", "top"))
    model = fem.assemble([body, fem.Body("flat", below, body.material)], [pair])
    with refused("contact surface is curved"):
        Estimator(scene.Case(model, None, np.zeros((1, 0)), np.ones(1)))
    case = block(tmp_path)
    with refused("supports no other nodal forces"):
        discretisation_error(replace(case, loads=()), solved(case))


@pytest.mark.parametrize("key", BESIDE_MU)
def test_other_laws_are_refused(tmp_path: Path, key: str) -> None:
    """Without friction, but with cohesion, it would be called a guaranteed bound."""
    with refused(rf"{key} of contacts\[0\] is 0\.1"):
        Estimator(block(tmp_path, f"contact.0.{key}=0.1"))


def test_loads_that_contact_alone_cannot_spread(tmp_path: Path) -> None:
    """A body free to rotate: nodal forces and tractions have different torques."""
    settings = ["body_force=[]", "pressure=[]", "contact.0.mu=0.0"]
    settings += ["traction=[{on='block.top', y=-1.0}]"]
    settings += ["support=[{on='block.left', x=0.0}]"]
    case = block(tmp_path, *settings)
    result = solved(case)
    # The side holds x and the rotation: only y is free, and it balances.
    assert discretisation_error(case, result).kind == BOUND
    loads = tuple(replace(load, history=2 * load.history) for load in case.loads)
    wrong = replace(case, load=2 * np.asarray(case.load), loads=loads)
    with refused("contact alone keeps a body from moving"):
        discretisation_error(wrong, result)


def test_unconverged_solution_gives_an_indicator() -> None:
    """A penetration, or a reaction outside its limit, is not admissible."""
    case, _ = bench.solved("sheared_cube", [SMOOTH, "mesh.n=3"])
    for tol, kind, reasons in (
        (1e-2, INDICATOR, ("contacts that penetrate: solve with a smaller tol",)),
        (1e-12, BOUND, ()),
    ):
        result = solved(case, method="nesterov", tol=tol)
        error = discretisation_error(case, result, 0)
        depth = -result.relative_displacement[0, :, 0].min()
        assert (depth > 1e-9) == (kind == INDICATOR)
        assert (error.kind, error.reasons) == (kind, reasons)
    case, result = bench.solved("sheared_cube", ["mesh.n=2"])
    error = discretisation_error(case, result, 0, threshold=np.zeros(9))
    assert error.reasons == ("tractions above the threshold of friction",)


@pytest.mark.parametrize("poisson", [-0.4, 0.0, 0.49, 0.4999])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_bound_for_any_material(tmp_path: Path, poisson: float, plane: str) -> None:
    settings = [SMOOTH, f"material.it.poisson={poisson}", f"body.block.plane={plane}"]
    cases = [block(tmp_path, *settings, finer=finer) for finer in (False, True)]
    results = [solved(case, tol=1e-12) for case in cases]
    error = discretisation_error(cases[0], results[0])
    assert error.kind == BOUND
    u, of_fine = (result.displacement[0] for result in results)
    true = true_error(cases[0], u, cases[1], of_fine)
    assert error.total >= true
    # Near ν = 1/2 in plane strain, linear triangles lock. Their contact forces, which σ̂ must
    # carry, are far off: the bound holds but is not sharp.
    if plane == "stress" or poisson < 0.49:
        assert error.total <= 2.2 * true
    elif poisson == 0.49:
        assert error.total <= 4 * true


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "nesterov", "uzawa"])
@pytest.mark.parametrize(
    ("name", "n"), [("sheared_cube", 3), ("two_blocks", 4), ("cattaneo_mindlin", 5)]
)
@pytest.mark.quick_variants("*-3-auto", "*-3-gauss_seidel", "*-3-nesterov")
def test_solver_error_is_below_the_mesh_error(name: str, n: int, method: str) -> None:
    case, exact = bench.solved(name, [f"mesh.n={n}"])
    problem, estimator = case.model.problem(), Estimator(case)
    enough = tolerance(estimator, problem, method=method)
    assert TIGHTEST <= enough.tol <= LOOSEST
    assert enough.algebraic <= 0.1 * enough.discretisation
    assert enough.work > 0
    done = problem.solve(case.load, case.prescribed, method=method, tol=enough.tol)
    K = case.model.K
    for k in range(len(done)):
        left = done.displacement[k] - exact.displacement[k]
        u = exact.displacement[k]
        error = np.sqrt((left @ (K @ left)) / (u @ (K @ u)))
        # The rule allows a tenth for the step that it used; errors of a path add up over its
        # two steps.
        assert error <= 0.2 * estimator.error(exact, k).relative
    long = problem.solve(case.load, case.prescribed, method=method, tol=TIGHTEST)
    assert done.work.sum() <= long.work.sum()
    if method != "auto":
        # One or two of ten digits are needed.
        assert done.work.sum() <= 0.5 * long.work.sum()


def test_a_smaller_share_is_tighter() -> None:
    case, _ = bench.solved("two_blocks", ["mesh.n=4"])
    problem, estimator = case.model.problem(), Estimator(case)
    tols = [
        tolerance(estimator, problem, method="gauss_seidel", share=share).tol
        for share in (1.0, 0.1, 0.001)
    ]
    assert tols[0] > tols[1] > tols[2]


def test_tolerance_without_contact_force() -> None:
    case, _ = bench.solved("sheared_cube", ["mesh.n=2", "support.0.z=0.05"])
    assert tolerance(Estimator(case), case.model.problem()).tol == TIGHTEST


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, np.nan])
def test_share_out_of_range_is_refused(share: float) -> None:
    case, _ = bench.solved("sheared_cube", ["mesh.n=2"])
    with refused("share is"):
        tolerance(Estimator(case), case.model.problem(), share=share)
