"""The pairs (u_i, σ_i) of the minimising sequence and the bifunctional along it."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.theory.functionals import Functionals, of_problem
from support.random_problems import random_problem as held_problem

METHOD = "minimising_sequence"


def test_one_sliding_contact_follows_its_closed_form() -> None:
    # Slip to positive v_t at all fields: r = p (1, -mu), and Tresca's τ slides with limit mu p.
    a, c, b, mu = 2.0, 0.5, 1.5, 0.4
    W, q = np.array([[a, c], [c, b]]), np.array([-1.0, 2.0])
    start = np.array([1.0, -mu])
    problem = bp.ReducedProblem(W, [q], mu)
    sequence = problem.solve(METHOD, tol=1e-12, start=[start]).minimising_sequence
    assert len(sequence) >= 5
    p = start[0]
    ray = np.array([1.0, -mu])
    for i in range(len(sequence)):
        r = p * ray
        np.testing.assert_allclose(sequence.reaction[i, 0], r, rtol=1e-12)
        # [dSF91, 33]: v_n = 0 with the friction mu p.
        tau = np.array([(c * mu * p - q[0]) / a, -mu * p])
        v = W @ tau + q
        assert v[1] > 0
        np.testing.assert_allclose(sequence.balanced_reaction[i, 0], tau, rtol=1e-12)
        # v_n = 0 has the rounding of its terms.
        np.testing.assert_allclose(
            sequence.relative_displacement[i, 0], v, rtol=1e-12, atol=1e-14
        )
        values = [(p, sequence.bifunctional[2 * i])]
        # [dSF91, 31]: the minimum over the ray of ½ r·W r + (q + mu |v_t| n)·r.
        p = -(q[0] + mu * v[1] - mu * q[1]) / (ray @ W @ ray)
        if 2 * i + 1 < len(sequence.bifunctional):
            values.append((p, sequence.bifunctional[2 * i + 1]))
        for pressure, value in values:
            lack = tau - pressure * ray
            expected = 0.5 * lack @ W @ lack + pressure * v[0]
            # A difference of products of size one.
            assert value == pytest.approx(expected, rel=1e-10, abs=1e-15)


class Two:
    """Two contacts of a body on springs, pressed, then pulled."""

    K = np.diag([2.0, 1.5, 2.0, 1.5])
    K[[0, 1, 2, 3], [1, 0, 3, 2]] = 0.3, 0.3, 0.2, 0.2
    K[[0, 2, 1, 3], [2, 0, 3, 1]] = -0.8, -0.8, -0.4, -0.4
    loads = np.array([[-1.0, 0.1, -1.0, 0.2], [-1.0, 0.6, -0.8, 0.7]])

    @classmethod
    def problem(cls) -> bp.ContactProblem:
        return bp.ContactProblem(cls.K, np.eye(4), gap=[0.0, 0.05], mu=0.4)

    @classmethod
    def result(cls, **settings: object) -> bp.Result:
        return cls.problem().solve(cls.loads, method=METHOD, **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [0, 1])
def test_b_is_the_papers_functional_of_the_fields(k: int) -> None:
    result = Two.result(tol=1e-13)
    sequence = result[k].minimising_sequence
    # Both contacts stick in the first step, whose answer the second pass meets on its way.
    assert len(sequence) >= 1 + k
    u = result[k].minimising_displacements()
    assert u.shape == (len(sequence), 4)
    # In totals, with the slip history in the offset.
    f = Functionals.of_step(
        of_problem(Two.problem(), Two.K), result, k, increments=False
    )
    for i in range(len(sequence)):
        # u_i is in equilibrium with τ_i, and v_i is its relative displacement.
        force = Two.loads[k] + sequence.balanced_reaction[i].ravel()
        np.testing.assert_allclose(Two.K @ u[i], force, atol=1e-13)
        np.testing.assert_allclose(
            f.relative_displacement(u[i]), sequence.relative_displacement[i], atol=1e-13
        )
        for j in (i, i + 1):
            if i + j >= len(sequence.bifunctional):
                continue
            r = sequence.reaction[j]
            # [dSF91, 25] with contact: B = Φ(u) + Π(σ) + Σ b, and the sum without cancellation.
            whole = f.potential(u[i]) + f.complementary(r)
            whole += f.bipotential(u[i], r).sum()
            # Φ and Π are of size one, and cancel.
            assert sequence.bifunctional[i + j] == pytest.approx(whole, abs=1e-13)
            assert sequence.bifunctional[i + j] == pytest.approx(
                f.excess(u[i], r), rel=1e-9, abs=1e-14
            )


def test_elliptic_friction_has_the_fields_in_the_variables_of_the_caller() -> None:
    W = np.diag([1.0, 1.0, 2.0])
    problem = bp.ReducedProblem(W, [[-1.0, 1.0, 1.5]], [[0.6, 0.3]])
    solution = problem.solve(METHOD, tol=1e-12)
    sequence = solution.minimising_sequence
    assert len(sequence) >= 1
    for v, tau in zip(
        sequence.relative_displacement, sequence.balanced_reaction, strict=True
    ):
        np.testing.assert_allclose(
            v.ravel(), W @ tau.ravel() + problem.q[0], rtol=1e-12
        )
    ellipse = np.hypot(
        sequence.reaction[:, 0, 1] / 0.6, sequence.reaction[:, 0, 2] / 0.3
    )
    for i in range(len(sequence)):
        r, v = sequence.reaction[i, 0], sequence.relative_displacement[i, 0]
        lack = sequence.balanced_reaction[i, 0] - r
        expected = 0.5 * lack @ W @ lack + r @ v
        expected += r[0] * np.hypot(0.6 * v[1], 0.3 * v[2])
        # A difference of products of size one.
        assert sequence.bifunctional[2 * i] == pytest.approx(
            expected, rel=1e-9, abs=1e-14
        )
    # Reactions lie in their cones, to rounding.
    assert (ellipse <= sequence.reaction[:, 0, 0] * (1 + 1e-15)).all()
    assert ellipse[-1] == pytest.approx(sequence.reaction[-1, 0, 0], rel=1e-9)


@pytest.mark.needs_extra
def test_other_methods_and_files_have_none(tmp_path: Path) -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.6]], 0.3)
    assert problem.solve().minimising_sequence is None
    step = Two.problem().solve(Two.loads)[0]
    assert step.minimising_sequence is None
    with pytest.raises(ValueError, match='method="minimising_sequence"'):
        step.minimising_displacements()
    result = Two.result()
    result.save(tmp_path / "result.h5")
    assert bp.load_result(tmp_path / "result.h5")[0].minimising_sequence is None


def test_a_copy_from_another_process_keeps_the_fields_without_displacements() -> None:
    step = Two.result()[1]
    again = pickle.loads(pickle.dumps(step))
    ours, theirs = step.minimising_sequence, again.minimising_sequence
    assert np.array_equal(ours.bifunctional, theirs.bifunctional)
    assert np.array_equal(ours.reaction, theirs.reaction)
    with pytest.raises(ValueError, match="before the step is sent"):
        again.minimising_displacements()
    assert repr(ours).startswith(f"MinimisingSequence({len(ours)} pairs, B from ")


def test_the_bifunctional_bounds_the_error() -> None:
    """½ (1 - L) (‖u - u*‖² + ‖r - r*‖²) ≤ B, which is sharp after a step in u and one in r."""
    sharpness = []
    for seed in range(60):
        W, q, mu, _ = held_problem("held", 2 + seed % 2, seed)
        problem, K = bp.ReducedProblem(W, q, mu), np.linalg.inv(W)
        answer = problem.solve(tol=1e-15)
        L = answer.error.contraction
        if L is None or L >= 1 or not answer.reaction.any():
            continue
        start = answer.reaction + 0.1
        # Some starts lie outside of the cones.
        start = start - 0.5 if seed % 3 == 0 else bp.project(start, mu)[0]
        sequence = problem.solve(METHOD, start=start, tol=1e-12).minimising_sequence
        for i, value in enumerate(sequence.bifunctional[:4]):
            x = sequence.relative_displacement[i // 2] - answer.relative_displacement
            y = sequence.reaction[(i + 1) // 2] - answer.reaction
            away = (x.ravel() @ K @ x.ravel() + y.ravel() @ W @ y.ravel()) / 2
            # Differences of products of size one.
            assert (1 - L) * away <= value * (1 + 1e-9) + 1e-14
            if i == 1:
                sharpness.append(value / away)
        # It falls to zero, in the second order of a distance that contracts.
        work = np.abs(answer.reaction * q).sum()
        # What reactions do on the free displacement, of which B is a difference.
        assert np.diff(sequence.bifunctional).max(initial=0.0) <= 1e-12 * work
        assert len(sequence) < 4 or sequence.bifunctional[-1] <= 1e-8 * work
    # The constant in B/away may be anything between 1 - L and 1.
    assert len(sharpness) > 10
    assert np.quantile(sharpness, 0.1) > 0.5
    assert np.quantile(sharpness, 0.9) < 2
