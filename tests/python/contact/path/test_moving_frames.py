"""Load steps with frames of their own: obstacles that turn or curve."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

import bipot_rs as bp
from bipot_rs.contact.law.frames import frames, turn_frames
from bipot_rs.contact.law.slip_check import measure_displacement
from bipot_rs.theory import functionals, law
from support.bodies import Body, block

TOL = 1e-13
# Two solutions with η = 1e-13 whose matrices differ by the rounding of rotations.
SAME = 1e-9
ENGINES = ["direct", "iterative"]


def of_angle(angle: float) -> np.ndarray:
    """Frame (n, t) with n along y, turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[-s, c], [c, s]])


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
    problem = bp.ContactProblem(
        k * np.eye(2),
        bases[0, 0],
        gap=[0.0],
        mu=mu,
        frame=bases[0],
        coordinates=np.zeros((2, 2)),
        gaps=moving,
        engine=engine,
    )
    result = problem.solve(tol=TOL)
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


@cache
def setup(dim: int) -> tuple[Body, np.ndarray, np.ndarray]:
    """A block that is held at its top, with contacts at its bottom."""
    body = block([1.0] * dim, [5 if dim == 2 else 3] * dim, 1.0, 0.3)
    fixed = np.concatenate([body.dofs(dim - 1, 1.0, k) for k in range(dim)])
    normal = np.zeros(dim)
    normal[-1] = 1.0
    return body, fixed, frames(np.tile(normal, (len(body.gap), 1)))


def path(dim: int, steps: int = 4, seed: int = 3) -> bp.MovingGaps:
    """Normals that turn, a surface that comes nearer and is dragged about."""
    rng = np.random.default_rng(seed)
    base = setup(dim)[2]
    count = len(base)
    frames_of_path, frame = [], base
    for _ in range(steps):
        tilt = frame[:, 0] + 0.08 * rng.normal(size=(count, dim))
        frame = turn_frames(frame, tilt / np.linalg.norm(tilt, axis=1, keepdims=True))
        frames_of_path.append(frame)
    gap = np.cumsum(rng.normal(-0.004, 0.006, size=(steps, count)), axis=0)
    drag = np.cumsum(0.01 * rng.normal(size=(steps, count, dim)), axis=0)
    return bp.MovingGaps(gap, np.array(frames_of_path), drag)


def make(dim: int, mu: Any = 0.3, **more: Any) -> bp.ContactProblem:
    body, fixed, base = setup(dim)
    return bp.ContactProblem(
        body.K,
        more.pop("B", body.B),
        gap=np.zeros(len(base)),
        mu=mu,
        fixed=fixed,
        area=body.area,
        points=body.points,
        frame=base,
        coordinates=body.basis.doflocs.T,
        **more,
    )


def alone(dim: int, moving: bp.MovingGaps, mu: Any, **more: Any) -> list[bp.Step]:
    """The same path, with a problem of its own for each step: B and history by hand."""
    body, _, base = setup(dim)
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


def close(found: Any, expected: Any, share: float = SAME) -> None:
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * size)


def pairs_of(dim: int) -> np.ndarray:
    """Two friction coefficients of each contact."""
    return np.tile([0.4, 0.2], (len(setup(dim)[2]), 1))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("dim", "mu"), [(2, 0.3), (3, 0.0), (3, 0.3), (3, "pair")], ids=str
)
def test_each_step_is_that_of_a_problem_in_its_frames(
    dim: int, mu: Any, engine: str
) -> None:
    mu = pairs_of(dim) if mu == "pair" else mu
    moving = path(dim)
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


@pytest.mark.parametrize("working_set", [True, False])
def test_a_working_set_changes_nothing(working_set: bool) -> None:
    moving = path(3)
    solved_problem = make(3, gaps=moving, engine="direct", working_set=working_set)
    result = solved_problem.solve(tol=TOL)
    expected = make(3, gaps=moving, engine="direct").solve(tol=TOL)
    close(result.reaction, expected.reaction)
    close(result.displacement, expected.displacement)


def test_the_reduced_problem_is_that_of_the_step() -> None:
    moving = path(3)
    problem = make(3, gaps=moving, engine="direct")
    result = problem.solve(tol=TOL)
    for k, step in enumerate(result):
        before = result[k - 1] if k else None
        reduced = problem.reduced(start=before, gap=moving[k])
        assert reduced.residual(step.reaction) < 1e-12
        solved = reduced.solve(tol=TOL)
        close(solved.relative_displacement[:, 1:], step.slip)


@pytest.mark.parametrize("engine", ENGINES)
def test_frames_of_the_problem_change_no_bit(engine: str) -> None:
    body, _, base = setup(3)
    still = path(3)
    moving = bp.MovingGaps(still.gap, np.array([base] * 4), still.drag)
    gaps = moving.by_component
    solved = make(3, gaps=moving, engine=engine).solve()
    plain = make(3, gaps=gaps, engine=engine).solve()
    for name in ("reaction", "relative_displacement", "slip", "displacement"):
        assert np.array_equal(getattr(solved, name), getattr(plain, name))
    assert solved[0].frame is not None
    assert plain[0].frame is None
    assert len(body.gap) == len(base)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_first_steps_do_not_depend_on_later_ones(engine: str) -> None:
    moving = path(3)
    whole = make(3, gaps=moving, engine=engine).solve()
    first = make(3, gaps=moving[:2], engine=engine).solve()
    assert np.array_equal(first.reaction, whole.reaction[:2])
    assert np.array_equal(first.displacement, whole.displacement[:2])


def same_bits(found: bp.Result, expected: bp.Result) -> None:
    for name in ("reaction", "relative_displacement", "slip", "status"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    for step_of_path, other in zip(found, expected, strict=True):
        assert step_of_path.frame is not None
        assert np.array_equal(step_of_path.frame, other.frame)
        assert np.array_equal(step_of_path.drag, other.drag)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_path_continues_from_a_part_a_file_and_another_process(
    engine: str, tmp_path: Path
) -> None:
    moving = path(3)
    problem = make(3, gaps=moving, engine=engine)
    whole = problem.solve()
    part = problem.solve(start=None, gap=moving[:2])
    again = pickle.loads(pickle.dumps(problem))
    same_bits(again.solve(), whole)
    part.save(tmp_path / "part.h5")
    for start in (part, bp.load_result(tmp_path / "part.h5")):
        rest = problem.solve(start=start)
        assert np.array_equal(rest.reaction, whole.reaction[2:])
        assert np.array_equal(rest.slip, whole.slip[2:])
    other = moving.opened(np.full(len(setup(3)[2]), 1e-3))
    with pytest.raises(ValueError, match="another gap than load step 2"):
        make(3, gaps=other, engine=engine).solve(start=part)


def test_paths_side_by_side_and_automatic_steps() -> None:
    moving = path(3)
    problem = make(3, engine="direct")
    expected = problem.solve(gap=moving)
    first, second = problem.solve_many(
        [{"gap": moving}, {"gap": moving.by_component, "mu": 0.1}]
    )
    same_bits(first, expected)
    assert second.success
    followed = problem.follow(
        gap=lambda s: moving[round(s) - 1],
        stops=[1.0, 2.0, 3.0, 4.0],
        largest=1.0,
        smallest=1.0,
    )
    same_bits(followed, expected)


def test_back_to_gaps_without_frames() -> None:
    """After steps in other frames the path goes on in the frames of B."""
    moving, base = path(3), setup(3)[2]
    problem = make(3, engine="direct")
    turned = problem.solve(gap=moving[:1])
    rest = np.zeros((2, len(base), 3))
    rest[:, :, 0] = -0.01
    back = problem.solve(gap=rest, start=turned)
    frame = np.array([moving.frame[0], base, base])
    gap = np.array([moving.gap[0], *rest[:, :, 0]])
    drag = np.array([moving.drag[0], 0 * moving.drag[0], 0 * moving.drag[0]])
    whole = bp.MovingGaps(gap, frame, drag)
    expected = problem.solve(gap=whole)
    close(back.reaction, expected.reaction[1:])
    close(back.slip, expected.slip[1:])


def test_wear_opens_the_gap_along_the_normal_of_the_step() -> None:
    """One cycle wears ``k p |slip|`` of the path without wear, where that is small."""
    moving = path(3)
    problem = make(3, gaps=moving, engine="direct")
    result = problem.solve(tol=TOL)
    k = 1e-9
    worn = problem.wear(coefficient=k, cycles=1, jump=False, tol=TOL)
    slip = np.linalg.norm(result.slip, axis=2)
    expected = k * (result.reaction[:, :, 0] / setup(3)[0].area * slip).sum(axis=0)
    # The wear of earlier steps changes later ones by about its share of the approach.
    np.testing.assert_allclose(worn.depth[-1], expected, atol=1e-6 * expected.max())


def test_the_motion_of_the_obstacle_is_no_distance_from_the_geometry() -> None:
    moving = path(3)
    result = make(3, gaps=moving, engine="direct").solve(tol=TOL)
    B, d = setup(3)[0].B, 3
    for step in result:
        u = np.einsum("cdk,cd->ck", setup(3)[2], (B @ step.displacement).reshape(-1, d))
        expected = np.einsum("ckd,cd->ck", step.frame[:, 1:], u)
        close(measure_displacement(step, np.arange(len(u))), expected, 1e-12)


def test_theory_refuses_increments_between_frames() -> None:
    problem = make(3, gaps=path(3), engine="direct")
    result = problem.solve()
    structure = functionals.of_problem(problem, setup(3)[0].K)
    with pytest.raises(ValueError, match="the step before it, has frames of its own"):
        functionals.Functionals.of_step(structure, result)
    with pytest.raises(ValueError, match="the step before it, has frames of its own"):
        law.step_of(result, 1)


def test_derivatives_of_such_paths_are_refused() -> None:
    result = make(3, gaps=path(3), engine="direct").solve()
    with pytest.raises(ValueError, match="load step 1 has frames of its own"):
        result.jvp(mu=1.0)
    with pytest.raises(ValueError, match="load step 1 has frames of its own"):
        result.vjp(reaction=np.ones_like(result.reaction))


def test_a_support_oblique_to_a_frame_leaves_the_step_to_the_direct_engine() -> None:
    """Node 1 moves along x only: in a turned frame its support is oblique."""
    bases = np.array([[of_angle(a)] for a in (0.0, 0.3)])
    moving = bp.MovingGaps([[-1e-3], [-1e-3]], bases, np.zeros((2, 1, 2)))

    def solved(engine: str) -> bp.Result:
        problem = bp.ContactProblem(
            np.array([[2e6, 1e5], [1e5, 1e6]]),
            bases[0, 0],
            gap=[0.0],
            mu=0.0,
            fixed=[0],
            frame=bases[0],
            coordinates=np.zeros((2, 2)),
            gaps=moving,
            engine=engine,
        )
        return problem.solve(tol=TOL)

    by_iteration, expected = solved("iterative"), solved("direct")
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
    np.testing.assert_allclose(
        np.linalg.det(turned), np.linalg.det(frame), rtol=0, atol=1e-14
    )
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
    np.testing.assert_allclose(
        np.linalg.det(opposite), np.linalg.det(frame), rtol=0, atol=1e-14
    )


EYE = np.eye(2)[None]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0.0, EYE, [[0.0, 0.0]]), r"gap of the moving gaps has shape \(\)"),
        (([0.0], EYE, [0.0, 0.0]), r"drag of the moving gaps has shape \(2,\)"),
        (([0.0], EYE, [[0.0]]), r"drag of the moving gaps has shape \(1, 1\)"),
        (([0.0], 2 * EYE, [[0.0, 0.0]]), "frame of contact 0 has the rows"),
        (([0.0], np.eye(2), [[0.0, 0.0]]), "frame of the moving gaps has shape"),
        (([np.nan], EYE, [[0.0, 0.0]]), "gap of the moving gaps"),
    ],
)
def test_wrong_moving_gaps(arguments: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        bp.MovingGaps(*arguments)


def test_wrong_uses() -> None:
    moving = bp.MovingGaps([0.0], EYE, [[0.0, 0.0]])
    K, base = np.eye(2), np.eye(2)[None]
    arguments: Any = {"gap": [0.0], "mu": 0.3}
    with pytest.raises(ValueError, match="pass frame= to ContactProblem"):
        bp.ContactProblem(K, np.eye(2), gaps=moving, **arguments)
    problem = bp.ContactProblem(K, np.eye(2), frame=base, **arguments)
    with pytest.raises(ValueError, match="moving gaps of 2 contacts"):
        problem.solve(gap=bp.MovingGaps([0.0] * 2, [np.eye(2)] * 2, np.zeros((2, 2))))
    with pytest.raises(ValueError, match="expected those of one, moving"):
        problem.reduced(gap=bp.MovingGaps([[0.0]], [base], [[[0.0, 0.0]]]))
    with pytest.raises(TypeError, match="one step, which has no length"):
        len(moving)
    turned = bp.MovingGaps([[0.0]], [[of_angle(0.1)]], [[[0.0, 0.0]]])
    result = problem.solve(gap=turned)
    bare = bp.ContactProblem(K, np.eye(2), **arguments)
    with pytest.raises(ValueError, match="start has frames of its own"):
        bare.solve(start=result)
    with pytest.raises(ValueError, match="start has frames of its own"):
        bare.reduced(start=result)
