"""Motions that supports leave free: found, counted, named, and pinned by contact."""

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bodies import block


def words(problem: bp.ContactProblem) -> list[str]:
    return [motion.split(",")[0] for motion in problem.rigid_motions]


@pytest.mark.parametrize("dim", [2, 3])
def test_free_block(dim: int) -> None:
    body = block((2, 1, 1)[:dim], (3, 2, 2)[:dim], 7.0, 0.3)
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3)
    # n, t1[, t2] shift it; about one axis in the plane, about three in space it turns.
    shifts = [f"translation along {axis}" for axis in ("n", "t1", "t2")[:dim]]
    assert words(problem) == shifts + ["rotation"] * (1 if dim == 2 else 3)
    assert problem.stats["rigid_motions"] == (3 if dim == 2 else 6)


@pytest.mark.parametrize("axis", [0, 1])
def test_supports_take_motions_away(axis: int) -> None:
    body = block((2, 1), (3, 2), 7.0, 0.3)
    fixed = body.dofs(axis, 0.0 if axis == 0 else 1.0, axis)
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed)
    # Rollers along a wall leave the shift along it; on top, the shift across.
    assert words(problem) == [f"translation along {'n' if axis == 0 else 't1'}"]
    frame = np.broadcast_to([[0.0, 1.0], [1.0, 0.0]], (len(body.gap), 2, 2))
    problem = bp.ContactProblem(
        body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed, frame=frame
    )
    assert words(problem) == [f"translation along {'y' if axis == 0 else 'x'}"]


def test_a_held_body_has_none() -> None:
    body = block((2, 1), (3, 2), 7.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, 0), body.dofs(1, 1.0, 1)])
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed)
    assert problem.rigid_motions == ()


def test_contacts_that_do_not_pin_a_body_are_refused() -> None:
    body = block((2, 1, 1), (2, 1, 1), 7.0, 0.3)
    one = sparse.csr_array(body.B)[:3]
    with pytest.raises(bp.FloatingBodyError, match="degree of freedom"):
        bp.ContactProblem(body.K, one, gap=np.zeros(1), mu=0.3)


def test_a_mechanism_is_refused() -> None:
    # Four springs in a ring resist stretching of one direction each: sixteen
    # unknowns in one component with rank four leave far more than a rigid body has.
    rng = np.random.default_rng(5)
    factor = rng.standard_normal((16, 4))
    with pytest.raises(bp.FloatingBodyError, match=r"motions free|rigid body"):
        bp.ContactProblem(factor @ factor.T, np.eye(16), gap=np.zeros(8), mu=0.3)
