"""Gaps and frames that change along the load path: obstacles that move, turn or curve."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.contact.law.frames import frames, turn_frames
from bipot_rs.contact.results.contact_fields import measure_displacement
from bipot_rs.theory import functionals, law
from support.bodies import Body, block
from support.comparisons import bits, near, refused

pytestmark = pytest.mark.needs_extra

TOL = 1e-13
# Two solutions with η = 1e-13 whose matrices differ by the rounding of rotations.
SAME = 1e-9
ENGINES = ["direct", "iterative"]


@cache
def setup(dim: int) -> tuple[Body, Any, np.ndarray, np.ndarray]:
    """A block held at its top over a plane that slopes away, its gap and its frames."""
    body = block([1.0] * dim, [5 if dim == 2 else 3] * dim, 1.0, 0.3)
    fixed = np.concatenate([body.dofs(dim - 1, 1.0, k) for k in range(dim)])
    gap = 0.03 * np.abs(body.points[:, 0] - 0.4)
    normal = np.eye(dim)[-1]
    return body, fixed, gap, frames(np.tile(normal, (len(gap), 1)))


def make(dim: int, mu: Any = 0.3, **more: Any) -> bp.ContactProblem:
    body, fixed, gap, base = setup(dim)
    given = {"B": body.B, "gap": gap, "mu": mu, "fixed": fixed, "area": body.area}
    given |= {"points": body.points, "frame": base}
    return bp.ContactProblem(
        body.K, **given | {"coordinates": body.basis.doflocs.T} | more
    )


def wall(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Displacements of the obstacle, normal first ``(4, d)``, and the gaps that they give.

    The obstacle rises, moves aside, returns past its start, and sinks a little.
    """
    ways = np.zeros((4, dim))
    ways[:, 0] = [0.01, 0.01, 0.012, 0.006]
    ways[:, 1] = [0.0, 0.004, -0.003, -0.002]
    if dim == 3:
        ways[:, 2] = [0.0, 0.001, 0.003, 0.0]
    gap = setup(dim)[2]
    gaps = np.repeat(-ways[:, None], len(gap), axis=1)
    gaps[:, :, 0] += gap
    return ways, gaps


def turning(dim: int, steps: int = 4, seed: int = 3) -> bp.MovingGaps:
    """Normals that turn, a surface that comes nearer and is dragged about."""
    rng = np.random.default_rng(seed)
    frame = setup(dim)[3]
    count = len(frame)
    frames_of_path = []
    for _ in range(steps):
        tilt = frame[:, 0] + 0.08 * rng.normal(size=(count, dim))
        frame = turn_frames(frame, tilt / np.linalg.norm(tilt, axis=1, keepdims=True))
        frames_of_path.append(frame)
    gap = np.cumsum(rng.normal(-0.004, 0.006, size=(steps, count)), axis=0)
    drag = np.cumsum(0.01 * rng.normal(size=(steps, count, dim)), axis=0)
    return bp.MovingGaps(gap, np.array(frames_of_path), drag)


# Gaps of four steps in space.
MOVING = {"gaps": lambda: wall(3)[1], "frames": lambda: turning(3)}


def close(found: Any, expected: Any, share: float = SAME) -> None:
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * size)


def as_supports(dim: int, ways: np.ndarray) -> np.ndarray:
    """Prescribed displacements of the top with the same effect on the body as the wall."""
    fixed = len(setup(dim)[1]) // dim
    in_axes = np.column_stack([ways[:, 1:], ways[:, 0]])
    return np.repeat(-in_axes, fixed, axis=1)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_moving_wall_equals_a_moving_body(dim: int) -> None:
    problem = make(dim)
    ways, gaps = wall(dim)
    moving = problem.solve(gap=gaps, tol=TOL)
    body = problem.solve(prescribed=as_supports(dim, ways), tol=TOL)
    assert {0, 1, 2} <= set(body.status.ravel().tolist())
    assert np.array_equal(moving.status, body.status)
    close(moving.reaction, body.reaction)
    close(moving.relative_displacement, body.relative_displacement)
    close(moving.slip, body.slip)
    # The two differ by the motion of the wall.
    shift = np.zeros((dim, len(ways)))
    shift[:-1], shift[-1] = ways[:, 1:].T, ways[:, 0]
    n = moving.displacement.shape[1] // dim
    close(moving.displacement - np.tile(shift.T, n), body.displacement)


def of_angle(angle: float) -> np.ndarray:
    """Frame (n, t) with n along y, turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[-s, c], [c, s]])


def node(K: Any, moving: bp.MovingGaps, **more: Any) -> bp.ContactProblem:
    """A node on springs under an obstacle, in its first frame."""
    first = {"gap": [0.0], "frame": moving.frame[0], "coordinates": np.zeros((2, 2))}
    return bp.ContactProblem(K, moving.frame[0, 0], **first, gaps=moving, **more)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("mu", [0.0, 0.1, 5.0])
def test_a_node_on_springs_under_a_turning_plane(mu: float, engine: str) -> None:
    """The plane turns about the node by 8° in each step and stays δ inside it.

    Springs of equal stiffness k: r = k u with n·u = δ. Without slip t·u is that of the
    displacement before, and friction limits it to μ δ.
    """
    k, delta, angles = 1e6, 1e-3, np.deg2rad([0.0, 8.0, 16.0, 24.0, 16.0, 8.0])
    bases = np.array([[of_angle(a)] for a in angles])
    moving = bp.MovingGaps(np.full((6, 1), -delta), bases, np.zeros((6, 1, 2)))
    result = node(k * np.eye(2), moving, mu=mu, engine=engine).solve(tol=TOL)
    u, slipped = np.zeros(2), 0
    for angle, step in zip(angles, result, strict=True):
        n, t = of_angle(angle)
        before = t @ u
        held = np.clip(before, -mu * delta, mu * delta)
        slipped += held != before
        u = delta * n + held * t
        # 1e-12: some digits less than the tolerance of the solver.
        np.testing.assert_allclose(step.displacement, u, rtol=0, atol=1e-12 * delta)
        local = k * delta * np.array([1.0, held / delta])
        np.testing.assert_allclose(step.reaction[0], local, atol=1e-12 * k * delta)
        assert step.slip[0, 0] == pytest.approx(held - before, abs=1e-12 * delta)
    assert slipped == {0.0: 5, 0.1: 4, 5.0: 0}[mu]
    force = result.resultant
    np.testing.assert_allclose(force, k * result.displacement, atol=1e-9 * k * delta)


def alone(dim: int, moving: bp.MovingGaps, mu: Any, **more: Any) -> list[bp.Step]:
    """The same path, with a problem of its own for each step: B and history by hand."""
    body, *_, base = setup(dim)
    plain = body.B.toarray().reshape(len(base), dim, -1)
    # In global components: B is in the frames of the start.
    node = np.einsum("ckd,ckn->cdn", base, plain)
    w, steps_alone = np.zeros((len(base), dim)), []
    for k in range(len(moving)):
        gap_of_step = moving[k]
        B = np.einsum("ckd,cdn->ckn", gap_of_step.frame, node).reshape(
            -1, body.K.shape[0]
        )
        gap = -np.einsum("ckd,cd->ck", gap_of_step.frame, gap_of_step.drag + w)
        gap[:, 0] = gap_of_step.gap
        problem = make(dim, mu, B=sparse.csr_array(B), engine="direct", **more)
        (step,) = problem.solve(gap=gap[None], tol=TOL)
        w = np.einsum("cdn,n->cd", node, step.displacement) - gap_of_step.drag
        steps_alone.append(step)
    return steps_alone


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("dim", "mu"), [(2, 0.3), (3, 0.0), (3, 0.3), (3, [0.4, 0.2])], ids=str
)
def test_each_step_is_that_of_a_problem_in_its_frames(
    dim: int, mu: Any, engine: str
) -> None:
    mu = np.tile(mu, (len(setup(dim)[2]), 1)) if np.ndim(mu) else mu
    moving = turning(dim)
    result = make(dim, mu, gaps=moving, engine=engine).solve(tol=TOL)
    statuses = set()
    for step, expected, frame in zip(
        result, alone(dim, moving, mu), moving.frame, strict=True
    ):
        assert step.converged
        assert np.array_equal(step.status, expected.status)
        statuses |= set(step.status.tolist())
        close(step.reaction, expected.reaction)
        close(step.slip, expected.slip)
        close(step.displacement, expected.displacement)
        force = np.einsum("ck,ckd->d", expected.reaction, frame)
        close(step.reaction[:, 0].sum(), expected.reaction[:, 0].sum())
        close(result.resultant[result.steps.index(step)], force)
        if engine == "direct":
            # Bounds and estimates are about the problem of the step.
            assert step.unique == expected.unique
            bound, other = step.error, expected.error
            assert (bound.kind, bound.unique) == (other.kind, other.unique)
            assert (bound.energy is None) == (other.energy is None)
            assert step.error_estimate is not None
            assert max(step.error_estimate) < 1e-9
    assert {0, 1} <= statuses


def test_a_working_set_changes_nothing() -> None:
    results = [
        make(3, gaps=turning(3), engine="direct", working_set=some).solve(tol=TOL)
        for some in (True, None)
    ]
    close(results[0].reaction, results[1].reaction)
    close(results[0].displacement, results[1].displacement)


@pytest.mark.parametrize("motion", MOVING)
def test_the_reduced_problem_is_that_of_the_step(motion: str) -> None:
    moving = MOVING[motion]()
    problem = make(3, gaps=moving, engine="direct")
    result = problem.solve(tol=TOL)
    for k, step in enumerate(result):
        reduced = problem.reduced(start=result[k - 1] if k else None, gap=moving[k])
        assert reduced.residual(step.reaction) < 1e-12
        close(reduced.solve(tol=TOL).relative_displacement[:, 1:], step.slip)


@pytest.mark.parametrize("engine", ENGINES)
def test_frames_of_the_problem_change_no_bit(engine: str) -> None:
    still, base = turning(3), setup(3)[3]
    moving = bp.MovingGaps(still.gap, np.array([base] * 4), still.drag)
    solved = make(3, gaps=moving, engine=engine).solve()
    plain = make(3, gaps=moving.by_component, engine=engine).solve()
    assert bits(solved, plain)
    assert solved[0].frame is not None
    assert plain[0].frame is None


@pytest.mark.parametrize("motion", MOVING)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_path_continues_from_a_part_a_file_and_another_process(
    engine: str, motion: str, tmp_path: Path
) -> None:
    """The first steps do not depend on later ones."""
    moving = MOVING[motion]()
    problem = make(3, gaps=moving, engine=engine)
    whole = problem.solve()
    part = problem.solve(start=None, gap=moving[:2])
    assert bits(part, whole[:2])
    assert bits(pickle.loads(pickle.dumps(problem)).solve(), whole)
    part.save(tmp_path / "part.h5")
    for start in (part, bp.load_result(tmp_path / "part.h5")):
        assert np.array_equal(start[1].gap, whole[1].gap)
        assert bits(problem.solve(start=start), whole[2:])
        (many,) = problem.solve_many([{"start": start}])
        assert bits(many, whole[2:])
    if motion == "frames":
        for name in ("frame", "drag"):
            assert np.array_equal(getattr(start[1], name), getattr(whole[1], name))
        moving = moving.opened(np.full(len(setup(3)[2]), 1e-3))
    else:
        moving = moving + 1e-3
    with pytest.raises(ValueError, match="another gap than load step 2"):
        make(3, gaps=moving, engine=engine).solve(start=part)


@pytest.mark.parametrize("motion", MOVING)
def test_paths_side_by_side_and_automatic_steps(motion: str) -> None:
    moving = MOVING[motion]()
    problem = make(3, engine="direct")
    expected = problem.solve(gap=moving)
    plain = turning(3).by_component
    first, second = problem.solve_many([{"gap": moving}, {"gap": plain, "mu": 0.1}])
    assert bits(first, expected)
    assert bits(second, make(3, 0.1, engine="direct").solve(gap=plain))
    stops = [1.0, 2.0, 3.0, 4.0]
    followed = problem.follow(
        gap=lambda s: moving[round(s) - 1], stops=stops, largest=1.0, smallest=1.0
    )
    assert bits(followed, expected)


def test_back_to_gaps_without_frames() -> None:
    """After steps in other frames the path goes on in the frames of B."""
    moving, base = turning(3), setup(3)[3]
    problem = make(3, engine="direct")
    turned = problem.solve(gap=moving[:1])
    rest = np.zeros((2, len(base), 3))
    rest[:, :, 0] = -0.01
    back = problem.solve(gap=rest, start=turned)
    drag = np.zeros((3, len(base), 3))
    drag[0] = moving.drag[0]
    gap = np.array([moving.gap[0], *rest[:, :, 0]])
    whole = bp.MovingGaps(gap, np.array([moving.frame[0], base, base]), drag)
    expected = problem.solve(gap=whole)
    close(back.reaction, expected.reaction[1:])
    close(back.slip, expected.slip[1:])


def test_wear_opens_the_gap_along_the_normal_of_the_step() -> None:
    """One cycle wears ``k p |slip|`` of the path without wear, where that is small."""
    problem = make(3, gaps=turning(3), engine="direct")
    result = problem.solve(tol=TOL)
    k = 1e-9
    worn = problem.wear(coefficient=k, cycles=1, jump=False, tol=TOL)
    slip = np.linalg.norm(result.slip, axis=2)
    expected = k * (result.reaction[:, :, 0] / setup(3)[0].area * slip).sum(axis=0)
    # The wear of earlier steps changes later ones by about its share of the approach.
    np.testing.assert_allclose(worn.depth[-1], expected, atol=1e-6 * expected.max())


def test_what_is_asked_of_a_path_with_frames() -> None:
    """Obstacles that move are no distance from the geometry; theory and derivatives refuse."""
    problem = make(3, gaps=turning(3), engine="direct")
    result = problem.solve(tol=TOL)
    body, base = setup(3)[0], setup(3)[3]
    for step in result:
        u = np.einsum("cdk,cd->ck", base, (body.B @ step.displacement).reshape(-1, 3))
        expected = np.einsum("ckd,cd->ck", step.frame[:, 1:], u)
        close(measure_displacement(step, np.arange(len(u))), expected, 1e-12)
    structure = functionals.of_problem(problem, body.K)
    for ask in (
        lambda: functionals.Functionals.of_step(structure, result),
        lambda: law.step_of(result, 1),
        lambda: result.jvp(mu=1.0),
        lambda: result.vjp(reaction=np.ones_like(result.reaction)),
    ):
        with refused("has frames of its own"):
            ask()


def test_a_support_oblique_to_a_frame_leaves_the_step_to_the_direct_engine() -> None:
    """Node 1 moves along x only: in a turned frame its support is oblique."""
    bases = np.array([[of_angle(a)] for a in (0.0, 0.3)])
    moving = bp.MovingGaps([[-1e-3], [-1e-3]], bases, np.zeros((2, 1, 2)))

    K = np.array([[2e6, 1e5], [1e5, 1e6]])
    by_iteration, expected = (
        node(K, moving, mu=0.0, fixed=[0], engine=engine).solve(tol=TOL)
        for engine in ("iterative", "direct")
    )
    close(by_iteration.reaction, expected.reaction)
    # n·u = δ with u along y.
    assert expected.displacement[1, 1] == pytest.approx(1e-3 / np.cos(0.3), rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_smallest_rotation_of_a_frame(dim: int) -> None:
    rng = np.random.default_rng(8)
    first, second = rng.normal(size=(2, 50, dim))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    frame = frames(first)
    turned = turn_frames(frame, second)
    eye = np.tile(np.eye(dim), (50, 1, 1))
    np.testing.assert_allclose(turned @ turned.swapaxes(1, 2), eye, atol=1e-14)
    np.testing.assert_array_equal(turned[:, 0], second)
    near(np.linalg.det(turned), np.linalg.det(frame), 1e-14)
    if dim == 3:
        # The axis of the rotation is n × n', so that nothing turns about the normal.
        R = np.einsum("cki,ckj->cij", turned, frame)
        axis = np.array(
            [Rotation.from_matrix(rotation_matrix).as_rotvec() for rotation_matrix in R]
        )
        expected = np.cross(frame[:, 0], second)
        lined = np.linalg.norm(np.cross(axis, expected), axis=1)
        np.testing.assert_allclose(lined, 0, atol=1e-12)
    assert np.array_equal(turn_frames(frame, frame[:, 0]), frame)
    opposite = turn_frames(frame, -frame[:, 0])
    np.testing.assert_allclose(opposite @ opposite.swapaxes(1, 2), eye, atol=1e-14)
    near(np.linalg.det(opposite), np.linalg.det(frame), 1e-14)


def test_wrong_uses_of_moving_gaps() -> None:
    eye, zero = np.eye(2)[None], np.zeros((1, 2))
    moving = bp.MovingGaps([0.0], eye, zero)
    given: Any = {"K": np.eye(2), "B": np.eye(2), "gap": [0.0], "mu": 0.3}
    bare, problem = bp.ContactProblem(**given), bp.ContactProblem(**given, frame=eye)
    with refused("pass frame= to ContactProblem"):
        bp.ContactProblem(**given, gaps=moving)
    with refused("moving gaps of 2 contacts"):
        problem.solve(gap=bp.MovingGaps([0.0] * 2, [*eye, *eye], np.zeros((2, 2))))
    with refused("expected those of one, moving"):
        problem.reduced(gap=bp.MovingGaps([[0.0]], [eye], [zero]))
    with pytest.raises(TypeError, match="one step, which has no length"):
        len(moving)
    turned = bp.MovingGaps([[0.0]], [[of_angle(0.1)]], [zero])
    result = problem.solve(gap=turned)
    for ask in (bare.solve, bare.reduced):
        with refused("start has frames of its own"):
            ask(start=result)


@pytest.mark.parametrize(("dim", "mu"), [(2, 0.3), (3, [0.3, 0.1])])
def test_rows_of_loads_and_gaps(dim: int, mu: Any) -> None:
    """The gaps of the problem given again change no bit; a single row is repeated."""
    body, fixed, gap, _ = setup(dim)
    mu = mu if dim == 2 else np.tile(mu, (len(gap), 1))
    problem = make(dim, mu)
    ways, gaps = wall(dim)
    prescribed = as_supports(dim, ways)
    without = problem.solve(prescribed=prescribed)
    with_gap = problem.solve(prescribed=prescribed, gap=gap)
    assert bits(with_gap, without)
    assert without[0].gap is None
    np.testing.assert_array_equal(with_gap[0].gap[:, 0], gap)
    moved = problem.solve(prescribed=prescribed[0], gap=gaps)
    spelled = problem.solve(prescribed=np.tile(prescribed[0], (4, 1)), gap=gaps)
    assert bits(moved, spelled)
    kept = problem.solve(prescribed=prescribed, gap=gaps[1:2])
    assert bits(kept, problem.solve(prescribed=prescribed, gap=gaps[[1] * 4]))
    with_loads = make(dim, mu, loads=(None, prescribed)).solve(gap=gaps)
    both = problem.solve(prescribed=prescribed, gap=gaps)
    # Loads pass the factor as a block and not one by one.
    close(with_loads.reaction, both.reaction)
    arguments: Any = {"gap": gap, "mu": mu, "fixed": fixed}
    once = bp.solve(body.K, body.B, gaps=gaps, **arguments)
    close(once.reaction, problem.solve(gap=gaps).reaction)
    with pytest.raises(ValueError, match="case 0: gap"):
        problem.solve_many([{"gap": np.zeros(len(gap) - 1)}])


@pytest.mark.parametrize("rows", [0, 1, 4])
def test_loads_and_gaps_of_the_problem_continue_after_the_start(
    rows: int, tmp_path: Path
) -> None:
    """Arguments apply to the following steps only."""
    ways, gaps = wall(2)
    prescribed = as_supports(2, 0.1 * ways[::-1])
    loads = {"loads": (None, prescribed[:rows])} if rows else {}
    told = {4: prescribed, 1: np.tile(prescribed[0], (4, 1)), 0: 0 * prescribed}[rows]
    problem, alone = make(2, gaps=gaps, **loads), make(2)
    whole = problem.solve()
    assert len(whole) == 4
    first = alone.solve(prescribed=told[:2], gap=gaps[:2])
    # A path in three parts numbers its steps from the first part on.
    third = alone.solve(prescribed=told[2:3], gap=gaps[2:3], start=first)
    for k, part in ((2, first), (3, third)):
        part.save(tmp_path / "part.h5")
        for start in (part, bp.load(tmp_path / "part.h5")):
            rest = problem.solve(start=start)
            (many,) = problem.solve_many([{"start": start}])
            for ours in (rest, many):
                assert np.array_equal(ours.reaction, whole.reaction[k:])
                assert np.array_equal(ours.slip, whole.slip[k:])
    assert len(problem.solve(start=whole)) == 0
    if not rows:
        given = problem.solve(prescribed=prescribed[2:], start=first)
        followed = alone.solve(prescribed=prescribed[2:], gap=gaps[2:], start=first)
        assert bits(given, followed)


def test_a_start_that_does_not_determine_the_next_step() -> None:
    ways, gaps = wall(2)
    prescribed = as_supports(2, ways)
    problem, alone = make(2, gaps=gaps), make(2)
    whole = problem.solve()
    with pytest.raises(TypeError, match="start is a Step, expected a Result: its numb"):
        problem.solve(start=whole[1])
    with pytest.raises(TypeError, match="case 0: start is a Step"):
        problem.solve_many([{"start": whole[1]}])
    again = problem.solve(gap=gaps[2:], start=whole[1])
    assert np.array_equal(again.reaction, whole.reaction[2:])
    with refused(r"4 steps, and the loads or gaps .* have 4: give"):
        problem.solve(prescribed=prescribed, start=whole)
    with refused("load has 4 steps, expected 2"):
        problem.solve(prescribed=prescribed, start=alone.solve(gap=gaps[:2]))
    with refused("gaps has 4 steps but loads has 3"):
        make(2, gaps=gaps, loads=(None, prescribed[:3]))
    with refused("start ends with another prescribed than load step 1"):
        start = alone.solve(prescribed=2 * prescribed[0])
        make(2, loads=(None, prescribed)).solve(start=start)


def test_existence_uses_the_gaps_of_the_step() -> None:
    """A contact that cannot move has a solution if it is closed, none if it penetrates."""
    problem = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.1], mu=0.3, fixed=[0])
    assert problem.existence().verdict == "guaranteed"
    assert problem.existence(gap=[-0.1]).verdict == "none"
    with pytest.raises(
        bp.NoEquilibriumError, match="step 2: contact 0 penetrates by 1"
    ):
        problem.solve(gap=[[0.1], [-0.1]])


@pytest.mark.parametrize("dim", [2, 3])
def test_adaptive_steps(dim: int) -> None:
    """Gaps as a function of s; steps that are not halved equal given load steps."""
    gaps = wall(dim)[1]
    start = np.zeros_like(gaps[0])
    start[:, 0] = setup(dim)[2]
    known = np.stack([start, *gaps])
    problem = make(dim)
    fixed = problem.solve(gap=gaps, tol=TOL)

    def at(s: float) -> Any:
        before = min(int(s), 3)
        share = s - before
        if share == 1.0:
            return known[before + 1]
        return (1 - share) * known[before] + share * known[before + 1]

    options = {"stops": np.arange(1.0, 5.0), "gap": at, "tol": TOL}
    assert bits(problem.follow(largest=1.0, **options), fixed)
    # Halved steps use the gaps of their own s, and the path continues from there.
    options["slip"] = 0.3 * float(np.abs(fixed.slip).max())
    divided = problem.follow(**options)
    assert len(divided) > 4
    assert bits(
        divided, problem.solve(gap=np.stack([at(s) for s in divided.s]), tol=TOL)
    )
    assert bits(problem.follow(**options, start=divided[2]), divided[3:])


def test_loads_of_the_problem_need_an_explicit_load_for_one_step() -> None:
    """`reduced` and `follow` raise if the problem has loads and none is given."""
    K = 1e3 * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
    given = {"K": K, "B": np.eye(2, 4), "gap": [0.0], "mu": 0.3}
    load = np.array([10.0, 1.0, 0.0, 0.0])
    with_row = bp.ContactProblem(**given, loads=load[None])
    assert with_row.existence().verdict == "none"
    plain = bp.ContactProblem(**given)
    np.testing.assert_array_equal(with_row.reduced().q, plain.reduced(load).q)
    several = bp.ContactProblem(**given, loads=[0 * load, load])
    for ask in (several.existence, several.reduced):
        with refused(r"load is missing: .* have 2 steps"):
            ask()
    for problem in (with_row, several):
        with refused(r"load is missing: .* as a function of s"):
            problem.follow()
    # Otherwise the obstacles would stop moving without a message.
    with refused("gap is missing: the gaps of this problem have 4"):
        make(2, gaps=wall(2)[1]).follow()


@pytest.mark.parametrize("engine", ENGINES)
def test_held_nodes_that_follow_an_oblique_obstacle_touch(engine: Any) -> None:
    """A side that is moved by ``depth`` along the normal, as the plane is: a sum of rounding."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        angle, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0.01, 0.1)
        n = np.array([np.cos(angle), np.sin(angle)])
        axes = np.array([[-n[1], n[0]], n]).T
        mesh = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
        mesh = mesh.morphed(*(lambda p, axis=axis: axis @ p for axis in axes))
        body = fem.Body("block", mesh, fem.Material(1e3, 0.3))
        contact = fem.Contact("block", "bottom", mu=0.3, plane=((0.0, 0.0), tuple(n)))
        model = fem.assemble([body], [contact], [fem.Support("block", "left", (0, 1))])
        gap = np.column_stack([model.gap - depth, np.zeros(len(model.gap))])
        problem = model.problem(engine=engine)
        (step,) = problem.solve(
            None, model.prescribed([tuple(depth * n)]), gap=gap[None]
        )
        # The body moves as a whole, along with the plane.
        moved = np.tile(depth * n, len(mesh.p.T))
        np.testing.assert_allclose(step.displacement, moved, atol=1e-12)
