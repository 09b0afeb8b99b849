"""Rigid motions that supports leave free are found, named, and held by contact."""

import pickle
import re
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bodies import block


def words(problem: bp.ContactProblem) -> list[str]:
    return [motion.split(",")[0] for motion in problem.rigid_motions]


@pytest.mark.parametrize("dim", [2, 3])
def test_free_block(dim: int) -> None:
    body = block((2, 1, 1)[:dim], (3, 2, 2)[:dim], 7.0, 0.3)
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3)
    # n, t1[, t2] translate the block; it rotates about one axis in the plane, three in space.
    shifts = [f"translation along {axis}" for axis in ("n", "t1", "t2")[:dim]]
    assert words(problem) == shifts + ["rotation"] * (1 if dim == 2 else 3)
    assert problem.stats["rigid_motions"] == (3 if dim == 2 else 6)


@pytest.mark.parametrize("axis", [0, 1])
def test_supports_take_motions_away(axis: int) -> None:
    body = block((2, 1), (3, 2), 7.0, 0.3)
    fixed = body.dofs(axis, 0.0 if axis == 0 else 1.0, axis)
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed)
    # Rollers along a wall leave the translation along it; rollers on top leave the one across.
    assert words(problem) == [f"translation along {'n' if axis == 0 else 't1'}"]
    frame = np.broadcast_to([[0.0, 1.0], [1.0, 0.0]], (len(body.gap), 2, 2))
    problem = bp.ContactProblem(
        body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed, frame=frame
    )
    assert words(problem) == [f"translation along {'y' if axis == 0 else 'x'}"]
    # The same block in a plane that is turned: a direction between the axes is no rotation.
    frame = np.broadcast_to([[0.6, 0.8], [-0.8, 0.6]], frame.shape)
    problem = bp.ContactProblem(
        body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed, frame=frame
    )
    (motion,) = problem.rigid_motions
    along = re.match(r"translation along \((.*)\) in \(x, y\), degree of", motion)
    assert along is not None
    turned = np.array([float(x) for x in along[1].split(",")])
    np.testing.assert_allclose(abs(turned @ frame[0, axis]), 1.0, rtol=1e-3)


def test_a_mechanism_held_by_contact() -> None:
    # Each of four springs resists stretching in one direction: sixteen unknowns in one
    # component with rank four leave twelve motions, far more than a rigid body has.
    rng = np.random.default_rng(5)
    factor = rng.standard_normal((16, 4))
    K = factor @ factor.T
    problem = bp.ContactProblem(K, np.eye(16), gap=np.zeros(8), mu=0.3)
    assert problem.stats["rigid_motions"] == 12
    # Contacts are pressed everywhere, so they carry the whole load.
    load = np.tile([-1.0, 0.2], 8)
    result = problem.solve(load)
    np.testing.assert_allclose(result.reaction[0].ravel(), -load, rtol=1e-12)
    with pytest.raises(bp.FloatingBodyError):
        bp.ContactProblem(K, np.eye(16)[:10], gap=np.zeros(5), mu=0.3)


def two_blocks(dof_names: bool) -> bp.ContactProblem:
    """Two blocks held by contact alone; the numbers of the second follow those of the first."""
    body = block((2, 1), (3, 2), 7.0, 0.3)
    K, B = (
        sparse.block_diag([block_matrix, block_matrix])
        for block_matrix in (body.K, body.B)
    )
    n = body.K.shape[0]
    names = {"bodies": {"upper": 0, "lower": n}} if dof_names else {}
    return bp.ContactProblem(K, B, gap=np.tile(body.gap, 2), mu=0.3, **names)


def test_messages_name_bodies() -> None:
    assert {motion.split(", ")[1] for motion in two_blocks(True).rigid_motions} == {
        "body 'upper'",
        "body 'lower'",
    }
    load = np.zeros(two_blocks(True).loading.n)
    load[len(load) // 2 + 1 :: 2] = 1.0  # # the second block is lifted
    with pytest.raises(bp.NoEquilibriumError, match="motion: body 'lower', con"):
        two_blocks(True).solve(load)
    with pytest.raises(bp.NoEquilibriumError, match="the body of degree of freedom"):
        two_blocks(False).solve(load)


def test_a_floating_body_is_named() -> None:
    body = block((2, 1), (2, 1), 7.0, 0.3)
    n = body.K.shape[0]
    K = sparse.block_diag([body.K, body.K])
    B = sparse.hstack([sparse.csr_array(body.B), sparse.csr_array(body.B.shape)])
    options = {"gap": body.gap, "mu": 0.3}
    with pytest.raises(bp.FloatingBodyError, match=r"^neither the stiffness") as plain:
        bp.ContactProblem(K, B, **options)
    # The second block has no contact; the elimination order decides which unknown is named.
    assert n <= plain.value.dof < 2 * n
    assert f"degree of freedom {plain.value.dof}:" in str(plain.value)
    names = {"upper": 0, "lower": n}
    with pytest.raises(
        bp.FloatingBodyError, match=r"^body 'lower': neither the st"
    ) as named:
        bp.ContactProblem(K, B, bodies=names, **options)
    again = pickle.loads(pickle.dumps(named.value))
    assert again.dof == named.value.dof == plain.value.dof
    assert str(again) == str(named.value)


def test_an_indefinite_body_is_named() -> None:
    K = np.diag([1.0, 1.0, -1.0, 1.0])
    B = np.eye(4)
    with pytest.raises(ValueError, match=r"^body 'b': stiffness K is indefinite"):
        bp.ContactProblem(K, B, gap=np.zeros(2), mu=0.3, bodies={"a": 0, "b": 2})


@pytest.mark.parametrize(
    ("bodies", "kind", "message"),
    [
        (["a"], TypeError, "bodies is a list, expected a mapping"),
        ({"a": 4}, ValueError, r"bodies\['a'\] is 4, expected 0 to 3"),
        ({"a": 0.5}, TypeError, r"bodies\['a'\] is 0.5, expected an integer"),
        ({"a": 0, "b": 0}, ValueError, "expected a different first degree of freedom"),
    ],
)
def test_wrong_names(bodies: Any, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        bp.ContactProblem(np.eye(4), np.eye(4), gap=np.zeros(2), mu=0.3, bodies=bodies)
