"""`bp.State`: a start of one's own, the ``(t⁰, u⁰)`` of [dSF91, 52-54]."""

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.theory import law

STIFFNESS, PRESSURE, MU = 1e3, 10.0, 0.3


def point(d: int, **settings: object) -> bp.ContactProblem:
    """A point on springs, on a wall."""
    return bp.ContactProblem(
        STIFFNESS * np.eye(d), np.eye(d), gap=[0.0], mu=MU, **settings
    )


def state(tangential: list[float], normal: float = PRESSURE) -> bp.State:
    """The point pressed at a tangential position, without friction."""
    rest = [0.0] * len(tangential)
    return bp.State(
        reaction=[[normal, *rest]], relative_displacement=[[0.0, *tangential]]
    )


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("direction", [[-1.0], [0.6, 0.8]])
@pytest.mark.parametrize(
    ("at", "pull"),
    # The spring pulls by STIFFNESS * at; friction holds 3.
    [(2e-3, 3.0), (2e-3, 2.0), (5e-3, 0.0), (1e-3, 6.0), (-1e-3, 0.0)],
)
def test_one_point_sticks_where_it_is_or_slides_to_the_limit(
    direction: list[float], at: float, pull: float, engine: str
) -> None:
    t = np.array(direction)
    result = point(1 + len(t), engine=engine).solve(
        [-PRESSURE, *(pull * t)], start=state([*(at * t)]), tol=1e-14
    )
    held, limit = pull - STIFFNESS * at, MU * PRESSURE
    friction = -np.clip(held, -limit, limit)
    end = (pull + friction) / STIFFNESS
    # Four operations on numbers of size 10 and 1e-2.
    assert result.reaction[0, 0] == pytest.approx(
        [PRESSURE, *(friction * t)], abs=1e-13
    )
    assert result.relative_displacement[0, 0, 1:] == pytest.approx(end * t, abs=1e-16)
    assert result.slip[0, 0] == pytest.approx((end - at) * t, abs=1e-16)
    sticks = abs(held) < limit
    assert result.status[0, 0] == (bp.Status.STICK if sticks else bp.Status.SLIP)


def test_increments_from_the_state_satisfy_the_forms_of_the_paper() -> None:
    """(51) to (83) of [dSF91], with t⁰, u⁰ of the state and h₀ = gap."""
    problem = bp.ContactProblem(np.diag([2.0, 1.0]), np.eye(2), gap=[0.2], mu=0.4)
    at = bp.State(reaction=[[1.5, -0.3]], relative_displacement=[[0.0, 0.7]])
    for load in ([-2.0, 0.9], [-2.0, 3.0], [1.0, 0.0]):
        result = problem.solve(load, start=at, tol=1e-14)
        contact, du, dt = law.step_of(result, 0)
        np.testing.assert_array_equal(contact.start.reaction, at.reaction)
        assert result.reaction[0] == pytest.approx(at.reaction + dt, abs=1e-15)
        assert all(v.all() for v in law.verdicts(contact, du, dt, rho=1.0).values())


def test_the_closed_contacts_decide_among_several_answers() -> None:
    """With strong friction a contact that was closed sticks, and an open one stays open."""
    K = np.array([[1.0, -0.9], [-0.9, 1.0]])
    problem = bp.ContactProblem(K, np.eye(2), gap=[0.0], mu=2.0)
    # Free, the point lifts off: K⁻¹ f has a positive normal part; held, it is pressed.
    load = [-0.6, 1.0]
    assert len(problem.reduced(load).answers()) > 1
    closed = problem.solve(load, start=state([0.0], normal=1.0))
    opened = problem.solve(
        load,
        start=bp.State(reaction=[[0.0, 0.0]], relative_displacement=[[1.0, 0.0]]),
    )
    assert closed.status[0, 0] == bp.Status.STICK
    assert opened.status[0, 0] != bp.Status.STICK
    assert closed.success
    assert opened.success


def test_reduced_existence_follow_and_cases_take_a_state() -> None:
    problem = point(2)
    at = state([2e-3])
    load = np.array([-PRESSURE, 4.0])
    assert problem.reduced(load, start=at).q[0] == pytest.approx([-0.01, 0.004 - 0.002])
    assert problem.existence(load, start=at).verdict == "guaranteed"
    followed = problem.follow(load, start=at)
    assert followed.s[-1] == 1.0
    assert followed.relative_displacement[-1, 0, 1] == pytest.approx(2e-3)
    (case,) = problem.solve_many([{"load": load, "start": at}])
    assert case.relative_displacement[0, 0, 1] == pytest.approx(2e-3)


def test_a_little_tension_of_another_program_is_allowed() -> None:
    at = bp.State(
        reaction=[[1.0, 0.0], [-1e-6, 0.0]], relative_displacement=np.zeros((2, 2))
    )
    assert list(at.step().status) == [bp.Status.STICK, bp.Status.OPEN]


def test_a_state_does_not_number_the_steps_of_a_problem() -> None:
    """Loads of the problem are counted from a `Result`, which knows its steps."""
    problem = point(2, loads=[[-1.0, 0.0], [-2.0, 0.0]])
    with pytest.raises(TypeError, match="start is a State, expected a Result"):
        problem.solve(start=state([0.0]))


def test_derivatives_from_a_state_are_those_of_differences() -> None:
    """A sliding point, which a change of the load moves by change / STIFFNESS."""
    result = point(2).solve([-PRESSURE, 6.0], start=state([1e-3]), tol=1e-14)
    assert result.status[0, 0] == bp.Status.SLIP
    tangent = result.jvp(load=np.array([0.0, 1.0]))
    assert tangent.displacement[0] == pytest.approx([0.0, 1 / STIFFNESS], abs=1e-15)
    # Friction is at its limit, MU times the pressure.
    pressed = result.jvp(load=np.array([-1.0, 0.0]))
    assert pressed.reaction[0, 0] == pytest.approx([1.0, -MU], abs=1e-14)
