"""Global problems, condensed or factored by LU, satisfy their equations in NumPy."""

from functools import cache
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.fclib import GlobalProblem
from support.bodies import block
from support.collection import FILES, GLOBAL, dense, path
from support.conditions import violation

Array = NDArray[np.float64]


@cache
def arrays(name: str) -> tuple[Array, ...]:
    """M, H, f, w, mu of a file, as dense arrays."""
    with h5py.File(path(name)) as file:
        group = file["fclib_global"]
        f, w, mu = (group["vectors"][k][:] for k in ("f", "w", "mu"))
        return dense(group, "M"), dense(group, "H"), f, w.reshape(len(mu), -1), mu


@cache
def solved(name: str) -> tuple[GlobalProblem, bp.Solution]:
    problem = bp.fclib.read(path(name))
    solution = problem.solve(tol=1e-12)
    assert solution.converged
    return problem, solution


def balance(problem: Any, solution: bp.Solution, parts: tuple[Array, ...]) -> float:
    """Largest error of both equations, relative to the sum of the sizes of their terms."""
    M, H, f, w, _ = parts
    v, r = problem.velocity(solution), solution.reaction.ravel()
    force = M @ v - H @ r - f
    force_size = np.abs(M) @ np.abs(v) + np.abs(H) @ np.abs(r) + np.abs(f)
    u = H.T @ v + w.ravel() - solution.relative_displacement.ravel()
    size = np.abs(H.T) @ np.abs(v) + np.abs(w.ravel())
    return max(
        np.abs(force).max() / force_size.max(),
        np.abs(u).max() / max(size.max(), 1e-300),
    )


@pytest.mark.parametrize("name", GLOBAL)
def test_equations_and_law_hold(name: str) -> None:
    problem, solution = solved(name)
    parts = arrays(name)
    # Backward stable solves: a few ε per degree of freedom of a body. u from W also has the
    # error of W, whose condition is below 1e6 here.
    assert balance(problem, solution, parts) <= 1e-13
    r, u = solution.reaction, solution.relative_displacement
    # η = 1e-12 bounds F at each contact, in node-scaled variables and relative to the
    # whole problem; the scales of contacts differ by at most 1e2. u is a difference from
    # the free motion.
    free = parts[1].T @ np.linalg.solve(parts[0], parts[2]) + parts[3].ravel()
    assert violation(r, u, parts[4], free) <= 1e-9


@pytest.mark.parametrize("name", ["fe_cube_h8_9c", "rods_2_3c"])
def test_agrees_with_its_local_form(name: str) -> None:
    """The local form comes from another program; W has full rank, so r is determined."""
    _, solution = solved(name)
    reduced = bp.fclib.read(path(f"{name}__local"))
    local = reduced.solve(tol=1e-12)
    assert local.converged
    # Both have the error η = 1e-12 times cond W, 1.2e5 for the rods. Where all contacts
    # stick, u is a rounding error relative to q.
    for field, size in (
        ("reaction", local.reaction),
        ("relative_displacement", reduced.q),
    ):
        difference = getattr(solution, field) - getattr(local, field)
        assert np.abs(difference).max() <= 1e-6 * np.abs(size).max()
    np.testing.assert_array_equal(solution.status, local.status)


@pytest.mark.parametrize("name", GLOBAL)
@pytest.mark.slow_variants("box_stacks_i0122_82")
@pytest.mark.slow_variants("d2_granular_g69")
def test_compliance_is_that_of_dense_algebra(name: str) -> None:
    M, H, f, w, _ = arrays(name)
    reduced = solved(name)[0].reduced()
    W = reduced.W
    if name in ("box_stacks_i0122_82", "d2_granular_g69"):
        # Many bodies of three or six unknowns.
        assert sparse.issparse(W)
        W = W.toarray()
    expected = H.T @ np.linalg.solve(M, H)
    # After a change of units cond(M) is below 1e4 in all of them; the error is ε times that.
    assert np.abs(W - expected).max() <= 1e-11 * np.abs(expected).max()
    q = H.T @ np.linalg.solve(M, f) + w.ravel()
    assert np.abs(reduced.q.ravel() - q).max() <= 1e-11 * np.abs(q).max()
    # W has the listed rank: singular values below 1e-10 of the largest count as zero.
    assert np.linalg.matrix_rank(W, rtol=1e-10) == FILES[name].rank


def test_asymmetric_matrix_is_used_as_given_and_reported() -> None:
    problem, solution = solved("fe_cube_h8_9c")
    M = arrays("fe_cube_h8_9c")[0]
    root = np.sqrt(M.diagonal())
    expected = (np.abs(M - M.T) / np.outer(root, root)).max()
    # The same few operations in another order.
    assert problem.asymmetry == pytest.approx(expected, rel=1e-14)
    assert problem.stats["asymmetry"] == problem.asymmetry > 0.2
    # An asymmetry of 16 % in W, as published with the file.
    assert problem.reduced().asymmetry == pytest.approx(0.16, abs=5e-3)
    assert solution.converged


def test_units_of_the_unknowns_change_nothing() -> None:
    """Length in one unknown, time in the next: symmetry and solution do not change."""
    rng = np.random.default_rng(3)
    for name in ("fe_cube_h8_9c", "rods_2_3c"):
        M, H, f, w, mu = arrays(name)
        S = 2.0 ** rng.integers(-30, 30, len(f))
        scaled = GlobalProblem(S[:, None] * M * S, S[:, None] * H, S * f, w, mu)
        problem, solution = solved(name)
        # Powers of two change no bit of the quotient of two entries.
        assert scaled.asymmetry == problem.asymmetry
        other = scaled.solve(tol=1e-12)
        assert other.converged
        # Pivots may differ; both have the error η = 1e-12 times cond W = 1.2e5.
        size = np.abs(solution.reaction).max()
        assert np.abs(other.reaction - solution.reaction).max() <= 1e-6 * size
        v = problem.velocity(solution)
        assert np.abs(S * scaled.velocity(other) - v).max() <= 1e-6 * np.abs(v).max()


@pytest.mark.parametrize(("noise", "condensed"), [(1e-14, True), (1e-8, False)])
def test_rounding_errors_do_not_count_as_asymmetry(
    noise: float, condensed: bool
) -> None:
    M, H, f, w, mu = arrays("rods_2_3c")
    shaken = M * (1 + noise * np.triu(np.ones_like(M), 1))
    problem = GlobalProblem(shaken, H, f, w, mu)
    assert ("cond_S" in problem.stats) == condensed
    expected = solved("rods_2_3c")[1].reaction
    # The noise times cond W = 1.2e5, with a margin for cond M.
    reaction = problem.solve(tol=1e-12).reaction
    assert np.abs(reaction - expected).max() <= 1e7 * noise * np.abs(expected).max()


def test_body_held_by_contact_alone() -> None:
    body = block((2, 1), (4, 2), 100.0, 0.3)
    load = body.traction(1, 1.0, [0.05, -1.0])
    n_c = len(body.gap)
    problem = GlobalProblem(body.K, body.B.T, load, np.zeros((n_c, 2)), 0.3)
    solution = problem.solve(tol=1e-12)
    assert solution.converged
    assert len(solution.rigid_motion) == 3
    parts = (body.K.toarray(), body.B.toarray().T, load, np.zeros((n_c, 2)), None)
    # A body of 30 unknowns with ν = 0.3; its balance has the tolerance 1e-12.
    assert balance(problem, solution, parts) <= 1e-11
    with pytest.raises(ValueError, match="rigid motions, expected 3"):
        problem.velocity(solution.reaction)


def test_no_solution_is_an_outcome() -> None:
    """A contact penetrates, and no reaction can move it."""
    problem = GlobalProblem(np.eye(2), np.zeros((2, 2)), [0, 0], [[-1.0, 0.0]], 0.3)
    solution = problem.solve()
    assert solution.outcome is bp.Outcome.NO_EQUILIBRIUM
    assert np.isfinite(problem.velocity(solution)).all()


@pytest.mark.parametrize(
    ("M", "error", "said"),
    [
        (np.diag([1.0, 0.0]), bp.FloatingBodyError, "degree of freedom 1"),
        (np.diag([1.0, -1.0]), ValueError, "^M is indefinite.*; M must be"),
        ([[1.0, 2.0], [0.5, 1.0]], ValueError, "asymmetric and singular"),
        ([[0.0, 2.0], [0.0, 0.0]], ValueError, "asymmetric and singular"),
    ],
)
def test_singular_in_a_way_contact_cannot_hold(
    M: Any, error: type[Exception], said: str
) -> None:
    H = [[1.0, 0.0], [0.0, 0.0]]
    problem = GlobalProblem(M, H, [0.0, 1.0], [[1.0, 0.0]], 0.3)
    with pytest.raises(error, match=said):
        problem.solve()


def test_without_contacts() -> None:
    problem = GlobalProblem(
        np.diag([2.0, 4.0]), np.zeros((2, 0)), [1.0, 1.0], np.zeros((0, 3)), 0.0
    )
    solution = problem.solve()
    assert solution.converged
    np.testing.assert_array_equal(problem.velocity(solution), [0.5, 0.25])
