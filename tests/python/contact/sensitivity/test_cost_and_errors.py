"""What derivatives cost, counted, and what they refuse."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact import tuning
from bipot_rs.contact.sensitivity.response import CondensedResponse
from support.comparisons import refused
from support.random_paths import random_path


@pytest.fixture
def path() -> bp.Result:
    path_problem, data = random_path("held", 3, 25)
    return path_problem.solve(data)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of contacts of each tangent system that is factored."""
    counts: list[int] = []
    factor_laws = CondensedResponse.factor_laws

    def counted(self: CondensedResponse, laws: Any) -> Any:
        counts.append(len(laws.contacts))
        return factor_laws(self, laws)

    monkeypatch.setattr(CondensedResponse, "factor_laws", counted)
    return counts


def test_nothing_is_factored_again(
    path: bp.Result, made: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gradient factors K zero times, and one tangent system a step."""

    def fail(*_: Any) -> None:
        pytest.fail("K was factored again")

    monkeypatch.setattr(_core, "Condensed", fail)
    gradient = path.vjp(np.ones_like(path.reaction), np.ones_like(path.displacement))
    assert gradient.K.nnz
    assert gradient.load.size
    closed = (path.status != bp.Status.OPEN).sum(axis=1)
    # Only over the contacts that are closed.
    assert made == closed[::-1].tolist()


def test_systems_are_kept_for_further_derivatives(
    path: bp.Result, made: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Columns and rows of a Jacobian share them; what does not fit is factored again."""
    first = path.jvp(mu=1.0)
    path.jvp(gap=np.ones(path.reaction.shape[1]))
    path.vjp(reaction=np.ones_like(path.reaction)).mu  # noqa: B018
    assert len(made) == len(path)
    again = path.jvp(mu=1.0)
    assert np.array_equal(again.reaction, first.reaction)

    path_problem, data = random_path("held", 3, 25)
    fresh = path_problem.solve(data)
    monkeypatch.setattr(tuning, "KEPT_BYTES", 0)
    made.clear()
    for _ in range(2):
        other = fresh.jvp(mu=1.0)
    assert len(made) == 2 * len(path)
    assert np.array_equal(other.reaction, first.reaction)


def test_displacements_without_a_factor() -> None:
    """With loads= gaps and friction may change, and what needs the factor says so."""
    path_problem, data = random_path("held", 2, 3)
    arguments = {"gap": data.gap, "mu": data.mu}
    kept = bp.ContactProblem(data.K, path_problem.B, **arguments).solve(
        data.load, tol=1e-13
    )
    problem = bp.ContactProblem(data.K, path_problem.B, **arguments, loads=data.load)
    result = problem.solve(tol=1e-13)
    bar = np.random.default_rng(0).normal(size=result.reaction.shape)
    ours, theirs = (
        result.vjp(bar, slip=bar[:, :, 1:]),
        kept.vjp(bar, slip=bar[:, :, 1:]),
    )
    np.testing.assert_allclose(ours.mu, theirs.mu, rtol=1e-9)
    np.testing.assert_allclose(ours.gap, theirs.gap, rtol=1e-9, atol=1e-9)
    derivative, other = result.jvp(mu=1.0), kept.jvp(mu=1.0)
    np.testing.assert_allclose(derivative.slip, other.slip, rtol=1e-9, atol=1e-12)
    for work in (
        lambda: ours.load,
        lambda: derivative.displacement,
        lambda: result.jvp(load=np.ones_like(data.load)),
        lambda: result.vjp(displacement=np.zeros_like(kept.displacement)),
    ):
        with refused("factor"):
            work()


@pytest.mark.needs_extra
def test_results_without_their_problem(path: bp.Result, tmp_path: Path) -> None:
    path.save(tmp_path / "x.h5")
    for lost in (bp.load(tmp_path / "x.h5"), pickle.loads(pickle.dumps(path))):
        with refused("read from a file"):
            lost.jvp(mu=1.0)
        with refused("read from a file"):
            lost.vjp()
    with refused("use jvp and vjp of its Result"):
        path[0].jvp(mu=1.0)
    loose = bp.ContactProblem(np.zeros((2, 2)), np.eye(2), gap=[0.0], mu=0.3)
    with pytest.raises(bp.NoEquilibriumError) as error:
        loose.solve([[1.0, 0.0]])
    assert error.value.result is not None
    with refused("no steps"):
        error.value.result.jvp(mu=1.0)


def test_shapes_of_gaps() -> None:
    """As the gap of the problem, or as the gaps of each step."""
    given = {"K": np.eye(4), "B": np.eye(4), "mu": 0.3}
    problem = bp.ContactProblem(**given, gap=[0.0, 0.1])
    load = np.array([[-1.0, 0.2, -1.0, 0.1], [-1.0, -0.2, -1.0, 0.4]])
    bar, shapes = np.ones((2, 2, 2)), [(2, 2), (2, 2, 2)]
    moved, whole = (problem.solve(load, gap=np.zeros(s)).vjp(bar).gap for s in shapes)
    assert [moved.shape, whole.shape] == shapes
    np.testing.assert_array_equal(moved, whole[:, :, 0])
    assert problem.solve(load).vjp(bar).gap.shape == (2,)
    by_component = bp.ContactProblem(**given, gap=np.zeros((2, 2))).solve(load)
    assert by_component.vjp(bar).gap.shape == (2, 2)
