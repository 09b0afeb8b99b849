"""Verdicts on existence agree with closed forms and with solves."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.contacts import rigid_rows
from support.random_problems import KINDS, random_problem

Array = NDArray[np.float64]


def slider(F: float, mu: float = 0.5) -> bp.Existence:
    """Pressed by a spring with force 1, pulled by F, free to slide: solvable iff F <= mu."""
    problem = bp.ContactProblem(np.diag([1.0, 0.0]), np.eye(2), gap=[0.0], mu=mu)
    return problem.existence([-1.0, F])


def test_balance_is_necessary_and_not_sufficient() -> None:
    # r = (F/μ, -F) balances the free direction for every F; a solution exists up to F = μ.
    for F in (0.2, 0.499, 0.501, 5.0):
        problem = bp.ContactProblem(np.diag([1.0, 0.0]), np.eye(2), gap=[0.0], mu=0.5)
        existence = problem.existence([-1.0, F])
        assert existence.verdict == "unknown"
        assert existence.displacement is not None
        # The proof is the motion along the pull, which pressure alone does not stop.
        assert existence.motion.tolist() == [[0.0, 1.0]]
        assert existence.displacement == pytest.approx([0.0, 1.0], abs=1e-15)
        exhausted = problem.existence([-1.0, F], exhaust=True)
        assert exhausted.verdict == ("guaranteed" if F < 0.5 else "none")
        if F < 0.5:
            assert problem.solve([-1.0, F]).success
        else:
            with pytest.raises(bp.BipotError):
                problem.solve([-1.0, F])
    assert slider(0.0).verdict == "guaranteed"
    without = slider(0.1, mu=0.0)
    assert without.verdict == "none"
    assert without.motion.tolist() == [[0.0, 1.0]]


def check(given: Any, found: bp.Existence) -> None:
    """The verdict is proved by its witnesses, checked by their definitions."""
    W, q, mu, rigid = given
    columns = W if rigid is None else np.hstack([W, rigid[0]])
    if found.inside is not None:
        v = found.inside
        assert (v[:, 0] > mu * np.linalg.norm(v[:, 1:], axis=1)).all()
        rows = np.ones(q.shape, bool)
        rows[:, 1:] = (mu > 0)[:, None]
        lack = (v - q).ravel()[rows.ravel()]
        reach = columns[rows.ravel()]
        rest = lack - reach @ np.linalg.lstsq(reach, lack, rcond=None)[0]
        # The loads are in the range, to the accuracy of least squares with a singular matrix.
        assert np.abs(rest).max() <= 1e-9 * np.abs(v - q).max()
    if found.pressure is not None:
        R, e = rigid
        assert (found.pressure >= 0).all()
        balance = R.reshape(*q.shape, -1)[:, 0].T @ found.pressure + e
        terms = np.abs(R).max() * np.abs(found.pressure).sum() + np.abs(q).max()
        assert np.abs(balance).max() <= 1e-9 * terms
    if found.overlap is not None:
        n = q.shape[1]
        assert (found.overlap >= 0).all()
        assert found.overlap @ q[:, 0] < 0
        # To 1e-9 of the sum of the gaps, in the scale of the compliance.
        assert (
            np.abs(found.overlap @ columns[::n]).max() <= 1e-8 * np.abs(columns).max()
        )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_guaranteed_solutions_are_found(kind: str, d: int) -> None:
    guaranteed = 0
    for seed in range(15):
        random_data = random_problem(kind, d, seed)
        problem = random_data.problem()
        existence = problem.existence()
        check(random_data, existence)
        assert existence.verdict != "none"  # # all of these have solutions
        if existence.verdict == "guaranteed":
            guaranteed += 1
            assert problem.solve(max_iterations=5000).converged
    # Redundant contacts may only open slightly.
    assert guaranteed >= (11 if kind == "redundant" else 15)


def solvable(problem: bp.ReducedProblem) -> bool:
    """Whether the default method or, if it stalls, momentum finds a solution.

    One method may miss an existing solution: a body without loads, or with one foot that
    is hardly pressed.
    """
    methods = ("auto", "nesterov")
    return any(problem.solve(m, max_iterations=5000).converged for m in methods)


def random_rigid(d: int, seed: int) -> Any:
    """A body surrounded by contacts, held by them alone, with random loads."""
    rng = np.random.default_rng([11, d, seed])
    # Fewer contacts cannot hold a body under any load.
    n = int(rng.integers(d, 7 if d == 2 else 10))
    root = rng.normal(size=(n * d, n * d)) / np.sqrt(n * d)
    W = root @ root.T + 0.1 * np.eye(n * d)
    points, frames = rng.normal(size=(n, d)), []
    for _ in points:
        frame = np.linalg.qr(rng.normal(size=(d, d)))[0]
        # Normals mostly upwards, so that all three verdicts occur.
        frame[0] = np.eye(d)[-1] + 0.5 * rng.normal(size=d)
        frame = np.linalg.qr(frame.T)[0].T
        frame[0] *= np.sign(frame[0, -1])
        frames.append(frame)
    R = rigid_rows(points, frames)
    e = np.append(0.4 * rng.normal(size=d), 0.3 * rng.normal(size=R.shape[1] - d))
    e[d - 1] = -rng.exponential()
    if seed % 3 == 0:
        # Loads that the pressures of a few contacts balance: mostly on the boundary of the cone.
        pressure = rng.exponential(size=n) * (rng.random(n) < 0.6)
        e = -R[::d].T @ pressure
    q = rng.normal(size=(n, d)) * 0.3
    return W, q, rng.uniform(0.0, 0.8, n), (R, e)


@pytest.mark.parametrize("d", [2, 3])
def test_verdicts_on_bodies_that_contact_alone_holds(d: int) -> None:
    seen = {"guaranteed": 0, "none": 0, "unknown": 0}
    for seed in range(40 if d == 2 else 16):
        random_data = random_rigid(d, seed)
        W, q, mu, rigid = random_data
        problem = bp.ReducedProblem(W, q, mu, rigid=rigid)
        existence = problem.existence()
        check(random_data, existence)
        seen[existence.verdict] += 1
        assert existence.verdict == "guaranteed" or seed % 3
        # In the plane all statuses are tried, which gives the truth independently.
        answers = problem.answers() if d == 2 else None
        complete = answers is not None and answers.complete
        if existence.verdict == "guaranteed":
            assert solvable(problem)
            assert not complete or len(answers or ()) > 0
        elif existence.verdict == "none":
            assert not problem.solve(max_iterations=300).converged
            assert not answers
        if complete:
            exhausted = problem.existence(exhaust=True)
            assert (exhausted.verdict == "none") == (len(answers or ()) == 0)
            assert exhausted.verdict != "unknown"
    assert min(seen.values()) >= 2, seen


@pytest.mark.parametrize("d", [2, 3])
def test_verdicts_do_not_depend_on_units(d: int) -> None:
    for seed in range(6):
        W, q, mu, (R, e) = random_rigid(d, seed)
        told = bp.ReducedProblem(W, q, mu, rigid=(R, e)).existence().verdict
        # Metres to micrometres, newtons to meganewtons; rotations stay in radians.
        length, force = 1e6, 1e-6
        changed = R.copy()
        changed[:, d:] *= length
        work = np.append(np.full(d, force), np.full(len(e) - d, force * length))
        other = bp.ReducedProblem(
            W * length / force, q * length, mu, rigid=(changed, e * work)
        )
        assert other.existence().verdict == told


def test_a_tripod_is_always_decided() -> None:
    """Three feet share the weight in one way only, for any pull and moment."""
    seen = {"guaranteed": 0, "none": 0}
    for seed in range(30):
        rng = np.random.default_rng([13, seed])
        R = rigid_rows(np.column_stack([rng.normal(size=(3, 2)), np.zeros(3)]))
        share = rng.dirichlet(np.ones(3))
        mu = rng.uniform(0.2, 0.8, (3, 2) if seed % 2 else 3)
        pull = 0.15 * rng.normal(size=2) * rng.choice([0.3, 1.0, 2.0])
        r = np.zeros((3, 3))
        r[:, 0] = share
        turn = 0.1 * rng.normal()
        e = -R.T @ r.ravel() + [*pull, 0.0, 0.0, 0.0, turn]
        root = rng.normal(size=(9, 9)) / 3
        W = root @ root.T + 0.1 * np.eye(9)
        problem = bp.ReducedProblem(W, rng.normal(size=(3, 3)), mu, rigid=(R, e))
        verdict = problem.existence().verdict
        seen[verdict] += 1
        assert solvable(problem) == (verdict == "guaranteed")
    assert min(seen.values()) >= 5


def test_walls_that_overlap() -> None:
    # A node between two walls, held by a spring: the gaps add up to the room between them.
    B = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    for room, verdict in ((0.1, "guaranteed"), (-0.1, "none")):
        problem = bp.ContactProblem(np.eye(2), B, gap=[-0.3, 0.3 + room], mu=[0.2, 0.5])
        load = [0.0, 3.0]
        existence = problem.existence(load)
        assert existence.verdict == verdict
        reduced = problem.reduced(load)
        check((problem.compliance, reduced.q, reduced.mu, None), existence)
        if verdict == "none":
            assert existence.overlap == pytest.approx([1.0, 1.0], rel=1e-12)
            with pytest.raises(bp.BipotError):
                problem.solve(load)
        else:
            assert problem.solve(load).success
    # Walls that just touch the node on both sides: no room, but no contradiction.
    problem = bp.ContactProblem(np.eye(2), B, gap=[-0.3, 0.3], mu=[0.2, 0.5])
    assert problem.existence(load).verdict == "unknown"
    # A contact with all components prescribed, which penetrates.
    held = bp.ContactProblem(np.eye(4), np.eye(4), gap=[0.0, 0.0], mu=0.3, fixed=[0, 1])
    assert held.existence(None, [-0.1, 0.0]).verdict == "none"
    assert held.existence(None, [0.1, 0.0]).verdict == "guaranteed"


def test_compliance_that_no_theorem_covers() -> None:
    W = np.array([[1.0, 2.0], [-2.0, 0.0]])
    existence = bp.ReducedProblem(W, [[-1.0, 0.2]], 0.3).existence()
    assert existence.verdict == "unknown"
    assert "not symmetric" in existence.reason
    # A definite W is enough; it need not be symmetric.
    W[1, 1] = 1.0
    assert bp.ReducedProblem(W, [[-1.0, 0.2]], 0.3).existence().verdict == "guaranteed"
    existence = bp.ReducedProblem(np.diag([1.0, -1.0]), [[-1.0, 0.2]], 0.3).existence()
    assert "not positive semidefinite" in existence.reason
    with pytest.raises(TypeError, match="exhaust is 1, expected a bool"):
        bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.3).existence(
            exhaust=1  # type: ignore[arg-type]
        )


@pytest.mark.parametrize("turns", [-7, -3, 1, 5, 9])
def test_a_rounding_error_of_a_normal_balances_no_load(turns: int) -> None:
    """cos(π/2) is 6e-17: a pressure of 1e16 would balance the loads by it."""
    angle = turns * np.pi / 2
    n = np.array([np.cos(angle), np.sin(angle)])
    side = np.array([-n[1], n[0]])
    for sign in (-1.0, 1.0):
        load = sign * n - 0.3 * np.array([1.0, 0.0])
        problem = bp.ContactProblem(
            np.diag([0.0, 1.0]), np.array([n, side]), gap=[0.0], mu=0.2
        )
        existence = problem.existence(load)
        assert existence.verdict != "guaranteed"
        with pytest.raises((bp.NoEquilibriumError, bp.NotConvergedError)):
            problem.solve(load)


@pytest.mark.parametrize("stiff", [1e-10, 1e-12, 1e-14])
def test_soft_springs_along_the_surface_contradict_nothing(stiff: float) -> None:
    """r = (1, 0) solves it exactly, whatever holds the point along the surface."""
    problem = bp.ReducedProblem(np.diag([1.0, 2.0 / stiff]), [[-1.0, 0.0]], 0.3)
    solution = problem.solve()
    assert solution.outcome != bp.Outcome.NO_EQUILIBRIUM
    if solution.converged:
        assert abs(solution.reaction - [[1.0, 0.0]]).max() <= 1e-9
    assert problem.existence().verdict == "guaranteed"
