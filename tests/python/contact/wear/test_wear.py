"""Archard wear over cycles: closed forms, conservation, jumps and their bounds."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.path.load_path import PathSolver
from bipot_rs.contact.wear import cycle as cycle_of_wear
from bipot_rs.contact.wear import jumps
from bipot_rs.contact.wear.cycle import Stability
from bipot_rs.scene.build import bodies
from bipot_rs.scene.case import assemble
from bipot_rs.scene.reading import read
from support.bodies import block
from support.comparisons import near, refused
from support.two_blocks import arrays
from support.worn import COEFFICIENT, PULL, TOL, pad, random_pad, spring, worn_pad

# Sums of some hundred reactions that are solved to η = 1e-13.
SAME = 1e-11


@cache
def hertz(n: int = 6) -> tuple[Any, Any, Any, Any]:
    """The scene of Cattaneo and Mindlin after pressing, with a cycle to and fro."""
    scene = read("cattaneo_mindlin", [f"mesh.n={n}"])
    case = assemble(scene, bodies(scene))
    problem = case.problem()
    press, shear = case.prescribed
    pressed = problem.solve(prescribed=press, tol=TOL)
    cycle = press + np.array([[1.0], [-1.0]]) * (shear - press)
    return case.model, problem, pressed, cycle


def test_the_pressure_under_a_held_displacement_decays_exponentially() -> None:
    # A step wears by k p s and lowers the pressure by K / area times that.
    k, slip, steps = 2.5e-8, 8e-3, 800
    lost = k * slip * 1e3 / 1e-4
    wear = spring().wear(PULL, coefficient=k, cycles=400, jump=False, tol=TOL)
    # The first step slips by half as much.
    after = (1 - lost / 2) * (1 - lost) ** np.arange(0, steps, 2)
    # The pressure at the end of a cycle does not feel the wear of its last step.
    np.testing.assert_allclose(wear.pressure[:, 0], 1e5 * after, rtol=SAME)
    at = np.arange(0.5, steps, 2)
    # Explicit steps: (1 - x)^n differs from exp(-n x) by n x² / 2 at the most.
    exact = 1e5 * np.exp(-lost * at)
    assert (abs(wear.pressure[:, 0] / exact - 1) < steps * lost**2).all()


def test_the_depth_under_a_held_force_grows_linearly() -> None:
    problem = bp.ContactProblem(
        np.diag([0.0, 1e3]), np.eye(2), gap=[0.0], mu=0.0, area=[1e-4]
    )
    path = PULL + np.array([-10.0, 0.0])
    k, slip = 1e-9, 8e-3
    for jump in (False, True):
        wear = problem.wear(path, coefficient=k, cycles=400, jump=jump, tol=TOL)
        depth = k * 10.0 / 1e-4 * slip * (2 * wear.cycle - 0.5)
        np.testing.assert_allclose(wear.depth[:, 0], depth, rtol=SAME)
    # Jumps that grow fourfold, over 400 cycles whose rates differ by rounding.
    assert wear.rejected <= 2
    assert wear.paths <= 30


@pytest.mark.parametrize("jump", [False, True])
def test_the_worn_volume_is_the_heat_times_k_over_mu(jump: bool) -> None:
    wear = worn_pad(jump=jump)
    assert jump == (len(wear.jumps) > wear.rejected)
    factor = COEFFICIENT / 0.3
    np.testing.assert_allclose(wear.volume, factor * wear.dissipation, rtol=SAME)
    np.testing.assert_allclose(
        wear.total_volume, factor * wear.total_dissipation, rtol=SAME
    )
    area = pad()[0].area
    np.testing.assert_allclose(wear.total_volume, wear.depth @ area, rtol=SAME)
    np.testing.assert_allclose(wear.volume, wear.worn @ area, rtol=SAME)
    # Of the last cycle, step by step.
    steps = wear.result
    slip = np.linalg.norm(steps.slip, axis=2)
    worn = COEFFICIENT * (steps.traction[:, :, 0] * slip).sum(axis=0)
    np.testing.assert_allclose(worn, wear.worn[-1], rtol=SAME)


def test_jumps_have_second_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def solved(over: int) -> np.ndarray:
        def length(run: Any) -> int:
            # The first cycles differ by the history of the loads.
            if run._state.cycle < 6:
                return 0
            return int(min(over, run._end - run._state.cycle - 1))

        monkeypatch.setattr(jumps.CycleSolver, "_choose_jump", length)
        wear = spring().wear(PULL, coefficient=2.5e-8, cycles=262, rtol=0.9)
        assert wear.rejected == 0
        return np.asarray(wear.depth[-1])

    exact = solved(0)
    # 256 cycles in jumps with the cycle after each. A linear rate makes the error of a jump
    # over N cycles N (N + 1) (N - 1) / 6 times its second derivative: N (N - 1) for each of
    # the N + 1 cycles.
    over = np.array([15, 31, 63])
    errors = np.array([abs(solved(int(n)) - exact).max() for n in over])
    order = np.diff(np.log(errors)) / np.diff(np.log(over * (over - 1.0))) * 2
    # The terms of higher order disturb the limit of 2.
    assert (abs(order - 2) < 0.2).all(), order


def test_results_do_not_depend_on_units() -> None:
    # Powers of two: nothing is rounded.
    length, force = 2.0**10, 2.0**-7
    body, problem, cycle = pad()
    scaled = bp.ContactProblem(
        body.K * (force / length),
        body.B,
        gap=problem.contacts.gap * length,
        mu=0.3,
        fixed=problem.stiffness.options.fixed,
        area=body.area * length,
    )
    wear = worn_pad(cycles=40)
    # Stress in the plane is force / length, of unit thickness.
    k = COEFFICIENT * length / force
    other = scaled.wear(prescribed=cycle * length, coefficient=k, cycles=40, tol=TOL)
    assert [(j.cycles, j.accepted) for j in other.jumps] == [
        (j.cycles, j.accepted) for j in wear.jumps
    ]
    np.testing.assert_allclose(other.depth, wear.depth * length, rtol=SAME)


def test_wear_continues_with_jumps() -> None:
    arguments = {"coefficient": COEFFICIENT / 2, "rtol": 1e-2}
    every = worn_pad(cycles=160, jump=False, **arguments)
    half = worn_pad(cycles=90, **arguments)
    rest = worn_pad(cycles=70, start=half, **arguments)
    assert rest.cycle[-1] == 160
    # It goes on with jumps as long as before.
    assert max(j.cycles for j in rest.jumps[:2]) > 4
    error = abs(rest.depth[-1] - every.depth[-1]).max()
    assert error <= 1e-2 * every.depth[-1].max()


def test_a_start_presses_without_wear() -> None:
    _, problem, cycle = pad()
    pressed = problem.solve(prescribed=cycle[1:2], tol=TOL)
    little = 1e-6 * COEFFICIENT
    wear = worn_pad(coefficient=little, cycles=1, start=pressed)
    # So little wear changes nothing: the plain path from the same state.
    path = problem.solve(prescribed=cycle, start=pressed, tol=TOL)
    worn = little * (path.traction[:, :, 0] * abs(path.slip[:, :, 0])).sum(axis=0)
    near(wear.worn[0], worn, 1e-6 * worn.max())


def test_a_cycle_costs_one_load_path(monkeypatch: pytest.MonkeyPatch) -> None:
    _, problem, cycle = pad()
    steps = 0
    attempt = PathSolver.attempt

    def counted(self: Any, *asked: Any) -> Any:
        nonlocal steps
        steps += 1
        return attempt(self, *asked)

    def condensed(*_: Any) -> None:
        raise AssertionError("wear must not condense again")

    monkeypatch.setattr(PathSolver, "attempt", counted)
    monkeypatch.setattr(_core, "Condensed", condensed)
    for jump in (False, True):
        steps = 0
        wear = problem.wear(
            prescribed=cycle, coefficient=COEFFICIENT / 2, cycles=50, jump=jump
        )
        # The two with halved steps have twice as many.
        assert steps == 4 * (wear.paths + 2)
        made = sum(j.accepted for j in wear.jumps)
        # Two cycles for each jump, one of which is the next row.
        assert wear.paths <= 2 + len(wear.cycle) + made + 2 * wear.rejected
        if not jump:
            assert wear.paths == 2 + 50


def sliding() -> tuple[Any, Any]:
    """A block whose top is held and moved so far that all contacts slide."""
    _, flat, cycle = pad(n=8, curve=0.0)
    return flat, cycle * np.repeat([[20.0, 1.0]], cycle.shape[1] // 2, axis=1)


def alternating(pressure: np.ndarray) -> float:
    """Largest part of a pressure that alternates from node to node, away from the ends."""
    third = pressure[:-2] - 2 * pressure[1:-1] + pressure[2:]
    return float(abs(third[4:-4]).max() / pressure.mean())


def test_longer_jumps_would_let_pressures_oscillate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flat, cycle = sliding()
    arguments = {"prescribed": cycle, "coefficient": 1e-5, "cycles": 600, "tol": TOL}
    # The estimate of the error is switched off.
    monkeypatch.setattr(jumps.CycleSolver, "_limits", lambda *_: (np.inf, 0.0))
    stable = flat.wear(**arguments)
    longest = max(j.cycles for j in stable.jumps)
    assert 0.5 * stable.longest < longest < 2 * stable.longest
    # Wear evens out the pressure: what alternates falls. Beyond the bound it grows instead.
    assert alternating(stable.pressure[-1]) < alternating(stable.pressure[0])
    monkeypatch.setattr(cycle_of_wear, "STABLE", 5.0)
    unstable = flat.wear(**arguments)
    assert alternating(unstable.pressure[-1]) > 10 * alternating(stable.pressure[-1])


@pytest.mark.parametrize("kind", ["plane", "space", "mortar", "many"])
def test_the_stability_estimate_bounds_that_of_the_compliance(kind: str) -> None:
    if kind == "mortar":
        arrays_given, _ = arrays(10.0, 4, 3)
        K, B = arrays_given.pop("K"), arrays_given.pop("B")
        problem, d = bp.ContactProblem(K, B, **arrays_given), 3
    else:
        problem = pad(
            3 if kind == "space" else 2, {"space": 3, "many": 40}.get(kind, 8)
        )[1]
        d = problem.contacts.d
    weights = np.random.default_rng(1).uniform(0.5, 1.0, problem.contacts.count)
    parts = problem.stiffness.core.stiffness()
    rate = Stability(
        parts, problem.contacts.operator, problem.stiffness.options.fixed, d
    ).rate(weights)
    S = np.linalg.inv(problem.compliance[::d, ::d])
    exact = np.linalg.eigvals(weights[:, None] * S).real.max()
    # An upper bound, which moves only the nodes of the contacts: what it adds is the energy
    # that the nodes behind them give up.
    assert exact <= rate <= 3 * exact


def test_contacts_of_one_degree_of_freedom_forbid_jumps() -> None:
    # Two contacts share the pressure of one point in any way.
    B = np.vstack([np.eye(2), np.eye(2)])
    problem = bp.ContactProblem(
        1e3 * np.eye(2), B, gap=[-0.01, -0.01], mu=0.0, area=[1e-4, 1e-4]
    )
    wear = problem.wear(PULL, coefficient=1e-9, cycles=9)
    assert wear.longest == 0
    assert wear.jumps == ()
    # With two cycles in halved steps.
    assert wear.paths == 11


@pytest.mark.parametrize(("coefficient", "parts"), [(1e-6, 1), (2e-5, 2), (4e-5, 4)])
def test_load_steps_that_wear_too_much_are_divided(
    coefficient: float, parts: int
) -> None:
    """A step of one contact has the rate k slip K / area. The steps slip by 4 and 8 mm."""
    wear = spring().wear(PULL, coefficient=coefficient, cycles=1, jump=False)
    # Three digits.
    rate = coefficient * 1e3 / 1e-4
    assert wear.longest == pytest.approx(1 / (rate * 12e-3), rel=5e-3)
    assert wear.parts == parts == 2 ** max(0, np.ceil(np.log2(rate * 8e-3)))
    assert ("were divided into up to" in wear.said) == (parts > 1)
    # Each part lowers the pressure by its rate, and the approach is 10 mm.
    first = 2 ** max(0, np.ceil(np.log2(rate * 4e-3)))
    left = (1 - rate * 4e-3 / first) ** first * (1 - rate * 8e-3 / parts) ** parts
    np.testing.assert_allclose(wear.depth[-1], 0.01 * (1 - left), rtol=SAME)


def test_load_steps_that_cannot_be_divided_are_refused() -> None:
    """With loads= only these can be solved, and too many parts take too long."""
    loads = bp.ContactProblem(
        1e3 * np.eye(2), np.eye(2), gap=[-0.01], mu=0.0, area=[1e-4], loads=PULL
    )
    with pytest.raises(NotConvergedError, match=r"^cycle 1: .*divide the load step in"):
        loads.wear(coefficient=1e-3, cycles=3)
    with pytest.raises(NotConvergedError, match=r"in 1024 parts .*; use a smaller co"):
        spring().wear(PULL, coefficient=1.0, cycles=3)
    # The loads of a state are not known.
    pressed = spring().solve([[0.0, 0.0]])
    state = bp.State(
        reaction=pressed.reaction[-1],
        relative_displacement=pressed.relative_displacement[-1],
    )
    with pytest.raises(NotConvergedError, match=r"divide the load step into 64,"):
        spring().wear(PULL, coefficient=1e-3, cycles=3, start=state)
    assert spring().wear(PULL, coefficient=1e-3, cycles=3, start=pressed).success


@pytest.mark.parametrize(
    ("coefficient", "jump"), [(2e-3, True), (1e-2, False), (1e-1, True)]
)
def test_a_pad_wears_by_its_approach_at_most(coefficient: float, jump: bool) -> None:
    """A flat pad that slides everywhere is pressed by 0.005."""
    _, flat, cycle = pad(n=5, curve=0.0)
    m = cycle.shape[1] // 2
    cycle = np.repeat([[0.1, -0.005], [-0.1, -0.005]], m, axis=1)
    wear = flat.wear(prescribed=cycle, coefficient=coefficient, cycles=12, jump=jump)
    # The edges are pressed by the shear of the pad too, by at most a hundredth.
    assert wear.depth.max() <= 1.01 * 0.005
    assert wear.depth[-1].min() >= 0.9 * 0.005
    # The least bound of all cycles, not that of the last one, in which nothing touches.
    assert wear.longest < 0.25
    assert "stable jumps have at most 0." in wear.said


@pytest.mark.parametrize(
    "seeds", [range(4), pytest.param(range(4, 60), marks=pytest.mark.slow)]
)
def test_load_steps_that_are_too_long_are_told(seeds: range) -> None:
    """Random pads, with one load step a half cycle, against eight times as many."""
    told = 0
    for seed in seeds:
        problem, path = random_pad(seed)
        path |= {"cycles": 2}
        cycle = path["prescribed"]
        from_rest = [divide(np.zeros_like(cycle[0]), cycle, parts) for parts in (2, 8)]
        wear, halved, fine = (
            problem.wear(**path | {"prescribed": c, "cycles": 1})
            for c in (cycle, *from_rest)
        )
        deepest = max(wear.depth.max(), halved.depth.max())
        change = abs(halved.depth[-1] - wear.depth[-1]).max() / deepest
        assert wear.step_error == pytest.approx(change, rel=1e-6, abs=1e-9), seed
        # Two cycles: the second begins at the end of the first.
        both = problem.wear(**path)
        rest = divide(cycle[-1], cycle, 8)
        fine = problem.wear(**path | {"prescribed": rest, "cycles": 1}, start=fine)
        deepest = max(fine.depth.max(), both.depth.max())
        error = abs(fine.depth[-1] - both.depth[-1]).max() / deepest
        # Halving removes half of a small error of the first order, and less of a large one.
        assert both.step_error >= error / 10, seed
        assert error <= 0.5 or both.step_error > 0.1, seed
        assert ("into more load steps" in both.said) == (both.step_error > 0.1), seed
        told += both.step_error > 0.1
    assert told > 0


def divide(begin: np.ndarray, cycle: np.ndarray, parts: int) -> np.ndarray:
    """The load steps of a cycle, divided."""
    shares = np.arange(1, parts + 1)[:, None] / parts
    before = [begin, *cycle[:-1]]
    return np.concatenate(
        [a + shares * (b - a) for a, b in zip(before, cycle, strict=True)]
    )


def test_cycles_with_one_load_step_and_frames_are_not_compared() -> None:
    one = spring().wear(PULL[:1], coefficient=1e-9, cycles=3, jump=False)
    # The pressure changes by k slip K / area = 4e-5 in a load step.
    assert one.step_error <= 4e-5
    moving = bp.MovingGaps([[-0.01]] * 2, [[np.eye(2)]] * 2, np.zeros((2, 1, 2)))
    framed = spring(frame=[np.eye(2)]).wear(
        PULL, coefficient=1e-9, cycles=3, gap=moving
    )
    assert framed.step_error is None
    assert "halved" not in framed.said


def test_a_hertz_contact_wears_to_its_stick_zone() -> None:
    edges = []
    for n in (4, 8):
        model, problem, pressed, cycle = hertz(n)
        first = problem.solve(prescribed=cycle, start=pressed)
        x, R, E = model.points[:, 0], 100.0, 210e3 / (1 - 0.3**2) / 2
        wear = problem.wear(
            prescribed=cycle, coefficient=3e-5, cycles=1500, start=pressed, rtol=0.1
        )
        p, before = wear.pressure[-1], first.traction[0, :, 0]
        stick = (wear.result.status == bp.Status.STICK).all(axis=0)
        # It is that of the unworn contact, up to one contact at each end.
        unworn = (first.status == bp.Status.STICK).all(axis=0)
        assert 0 <= unworn.sum() - stick.sum() <= 2
        # The pressure outside of the stick zone goes to zero.
        assert p[~stick].max() < 0.02 * p.max()
        assert before[~stick].max() > 0.4 * before.max()
        # The worn depth at the edge is sharp: nothing where contact sticks.
        assert wear.depth[-1][stick].max() < 1e-3 * wear.depth[-1].max()
        # A parabola on the stick zone carries its Hertz pressure, and the rest of the force
        # as a flat punch: the limit of Hills, Sackfield and Paynter (2009).
        force = float(p @ model.area)
        c = (x[stick].max() - x[stick].min()) / 2 + np.diff(x)[len(x) // 2] / 2
        inner = abs(x) < 0.6 * c
        root = np.sqrt(c**2 - x[inner] ** 2)
        hertzian = E * root / (2 * R)
        rest = force - np.pi * E * c**2 / (4 * R)
        exact = hertzian + rest / (np.pi * root)
        # The zone ends within a cell.
        assert abs(p[inner] / exact - 1).max() < 0.6 / n
        edges.append(p.max() / before.max())
    # The pressure at the edge has no bound: it grows as the mesh is refined.
    assert edges[0] > 1.0
    assert edges[1] > 1.2 * edges[0]


@pytest.mark.parametrize("two", [False, True])
def test_friction_by_direction_and_three_dimensions(two: bool) -> None:
    body, problem, cycle = pad(3, 3, two=two)
    k = np.linspace(1e-5, 2e-5, len(body.area))
    wear = problem.wear(prescribed=cycle, coefficient=k, cycles=8, tol=TOL)
    slip = np.linalg.norm(wear.result.slip, axis=2)
    worn = k * (wear.result.traction[:, :, 0] * slip).sum(axis=0)
    np.testing.assert_allclose(worn, wear.worn[-1], rtol=SAME)
    assert wear.volume[-1] > 0


def test_other_engines_and_arguments_of_the_problem() -> None:
    body, problem, cycle = pad(3, 3)
    gap, arguments = problem.contacts.gap, {"coefficient": 1e-4, "cycles": 6}
    expected = problem.wear(prescribed=cycle, **arguments, tol=TOL)
    given = {"K": body.K, "B": body.B, "gap": gap, "mu": 0.3, "area": body.area}
    given["fixed"] = problem.stiffness.options.fixed
    loads = np.zeros(body.K.shape[0]), cycle
    moved = {"prescribed": cycle}
    for more, path in (
        ({"engine": "iterative"}, moved),
        ({"working_set": True}, moved),
        ({"loads": loads}, {}),
        ({"gaps": np.tile(gap, (4, 1))}, moved),
        ({}, moved | {"gap": gap[None]}),
    ):
        other = bp.ContactProblem(**given | more)
        wear = other.wear(**path, **arguments, tol=1e-12)
        assert wear.cycle.tolist() == expected.cycle.tolist()
        # Reactions of both engines agree to 1e-9.
        near(wear.depth, expected.depth, 1e-8 * expected.depth.max())


def stalls(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> None:
    """Let load steps with these numbers end without convergence."""
    from dataclasses import replace

    attempt, steps = PathSolver.attempt, 0

    def failing(self: Any, *asked: Any) -> Any:
        nonlocal steps
        steps += 1
        step_result = attempt(self, *asked)
        return (
            replace(step_result, outcome=Outcome.STALLED)
            if steps in numbers
            else step_result
        )

    monkeypatch.setattr(PathSolver, "attempt", failing)


def test_a_step_that_fails_keeps_the_cycles_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # After two cycles, and the same with halved steps.
    stalls(monkeypatch, 4 * 2 + 8 * 2 + 3)
    with pytest.raises(NotConvergedError, match=r"^cycle 3: load step 3: ") as raised:
        worn_pad(cycles=9, jump=False)
    error = raised.value
    assert error.wear is not None
    assert error.result is not None
    assert len(error.result) == 2
    assert not error.wear.success
    assert error.wear.message == str(error)
    assert error.wear.cycle.tolist() == [1, 2]
    monkeypatch.undo()
    np.testing.assert_array_equal(
        error.wear.depth, worn_pad(cycles=2, jump=False).depth
    )
    # What was kept can be continued, also after it was sent to another process.
    again = pickle.loads(pickle.dumps(error)).wear
    rest = worn_pad(cycles=7, jump=False, start=again)
    np.testing.assert_array_equal(
        rest.depth[-1], worn_pad(cycles=9, jump=False).depth[-1]
    )


def test_a_trial_that_fails_is_a_rejected_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = spring().wear(PULL, coefficient=1e-9, cycles=60)
    # After two cycles, and the same with halved steps.
    stalls(monkeypatch, 2 * 2 + 2 * 4 + 2)
    wear = spring().wear(PULL, coefficient=1e-9, cycles=60)
    assert not wear.jumps[0].accepted
    assert np.isnan(wear.jumps[0].estimate)
    # The accuracy is that of rtol = 0.01.
    assert abs(wear.depth[-1] / plain.depth[-1] - 1).max() < 0.01


def test_wear_needs_contacts_areas_and_a_matching_start() -> None:
    none = bp.ContactProblem(np.eye(2), np.zeros((0, 2)), gap=[], mu=0.3, dim=2)
    given: Any = {"coefficient": 1e-9, "cycles": 3}
    with refused(r"^the problem has no contacts"):
        none.wear(PULL, **given)
    with refused(r"^area is missing: wear needs pressures"):
        spring(area=None).wear(PULL, **given)
    other = worn_pad(cycles=1)
    with refused(r"start is a step of worn contacts"):
        worn_pad(start=other.result)
    with refused(r"start has the wear of 17 contacts"):
        spring().wear(PULL, start=other, **given)


def test_the_record_is_told_cycle_by_cycle(tmp_path: Path) -> None:
    """Files keep the depth."""
    told: list[tuple[int, Any]] = []
    wear = worn_pad(on_cycle=lambda number, step: told.append((number, step.wear)))
    assert [number for number, _ in told] == wear.cycle.tolist()
    np.testing.assert_array_equal([depth for _, depth in told], wear.depth)
    ends = wear.ends
    assert ends[-1] is wear.result[-1]
    assert [step.cycle for step in ends] == wear.cycle.tolist()
    assert {step.cycle for step in wear.result} == {60}
    np.testing.assert_array_equal(ends.traction[:, :, 0], wear.pressure)
    assert repr(wear).startswith("Wear(60 cycles, ")
    ends.save(tmp_path / "worn.h5")
    loaded = bp.load_result(tmp_path / "worn.h5")
    assert [step.cycle for step in loaded] == wear.cycle.tolist()
    np.testing.assert_array_equal([step.wear for step in loaded], wear.depth)
    none = worn_pad(coefficient=0.0)
    assert none.depth.max() == 0 == none.error_estimate


@pytest.mark.parametrize(
    "seeds", [range(2), pytest.param(range(2, 120), marks=pytest.mark.slow)]
)
def test_random_pads(seeds: range) -> None:
    """The error of jumps is at most `rtol`, and not above its estimate by much."""
    jumped = 0
    for seed in seeds:
        problem, path = random_pad(seed)
        rtol = 10 ** np.random.default_rng(seed).uniform(-3, -1.3)
        every = problem.wear(**path, jump=False)
        wear = problem.wear(**path, rtol=rtol)
        error = abs(wear.depth[-1] - every.depth[-1]).max() / every.depth[-1].max()
        jumped += wear.paths < every.paths
        assert error <= rtol, seed
        # It holds the leading terms, and one change of status within a jump.
        assert error <= 1.5 * wear.error_estimate, seed
    assert jumped >= len(seeds) / 2


def test_history_that_settles_is_not_extrapolated() -> None:
    """A pad whose places still settle when the first jumps are made.

    Its stick zone remembers them. With the mean drift over each jump in place of that of a cycle,
    the error was 75 times the estimate.
    """
    body = block([1.8, 1.0], [7, 4], 1e3, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    x = body.points[:, 0] - 0.9
    gap = 1.6e-3 * (1 + np.sin(1.7 * x + 1.85))
    problem = bp.ContactProblem(
        body.K, body.B, gap=gap, mu=0.75, fixed=fixed, area=body.area
    )
    m = len(fixed) // 2
    cycle = np.repeat([[0.0238, -0.0099], [-0.0238, -0.0135]], m, axis=1)
    given = {"prescribed": cycle, "coefficient": 1.4e-5, "cycles": 154, "tol": 1e-12}
    every, wear = problem.wear(**given, jump=False), problem.wear(**given, rtol=0.0145)
    error = abs(wear.depth[-1] - every.depth[-1]).max() / every.depth[-1].max()
    assert wear.paths < 60
    assert error <= wear.error_estimate <= 0.0145 / 2
    # The places at the end: those of every cycle.
    ends = [w.ends[-1].relative_displacement[:, 1] for w in (wear, every)]
    moved = abs(
        np.diff([e.relative_displacement[:, 1] for e in every.ends[:6]], axis=0)
    )
    assert abs(ends[0] - ends[1]).max() <= 0.1 * moved[-1].max()
