"""Derivatives of the iterative engine, by Krylov solves in the response."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.path.iterative import Iterative
from bipot_rs.contact.sensitivity import response
from support.body_models import floating, on_a_ball, on_springs
from support.models_and_arrays import arguments
from support.pressed_in_space import pressed
from support.random_paths import FIELDS
from support.two_blocks import two_blocks


def forth_and_back(m: bp.Model, far: float = 1.0) -> bp.Model:
    """Hexahedra that are pressed and sheared, one way and back."""
    m.path(press=[0.3, 1.0, 0.7], shear=[0.2 * far, far, 0.2 * far])
    return m


MODELS: dict[str, Callable[[], bp.Model]] = {
    "hexahedra": lambda: forth_and_back(pressed(4)),
    "friction by direction": lambda: forth_and_back(
        pressed(3, mu=[0.5, 0.1], axis=[1.0, 0.0, 0.0])
    ),
    "no friction": lambda: forth_and_back(pressed(3, mu=0.0)),
    "two bodies": lambda: forth_and_back(two_blocks(2.0, 3, 3), 5.0),
    "mortar": lambda: forth_and_back(two_blocks(2.0, 2, 3), 5.0),
    "held by contact alone": floating,
    "springs": on_springs,
    "a ball": on_a_ball,
}


@pytest.fixture
def no_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where a factor is made."""

    def refused(_engine: Iterative) -> None:
        pytest.fail("a factor was made")

    monkeypatch.setattr(Iterative, "replacement", refused)


def solved(name: str) -> tuple[Any, bp.Result, bp.Result]:
    """The case, and its results by both engines."""
    case = MODELS[name]().assemble()
    results_of_engines = []
    for engine in ("iterative", "direct"):
        problem = bp.ContactProblem(**arguments(case.model), engine=engine)
        results_of_engines.append(
            problem.solve(case.load, case.prescribed, gap=case.gaps, tol=1e-13)
        )
    assert "krylov" in results_of_engines[0][-1].stats
    assert results_of_engines[0].converged.all()
    assert results_of_engines[1].converged.all()
    return case, results_of_engines[0], results_of_engines[1]


def near(one: Any, other: Any) -> None:
    """Equal to 1e-8: the points of linearisation of both engines agree to 1e-9."""
    a, b = np.asarray(one), np.asarray(other)
    assert np.abs(a - b).max(initial=0.0) <= 1e-8 * np.abs(b).max(initial=0.0)


@pytest.mark.usefixtures("no_factor")
@pytest.mark.parametrize("name", MODELS)
def test_as_the_direct_engine(name: str) -> None:
    case, ours, theirs = solved(name)
    rng = np.random.default_rng(0)
    shape = ours.reaction.shape
    load = rng.normal(size=(shape[0], case.model.n))
    load *= np.abs(ours.reaction).mean() * (name != "held by contact alone")
    moved = np.abs(ours.displacement).mean()
    gap = moved * rng.normal(size=shape)
    motion = moved * rng.normal(size=(shape[0], len(case.model.fixed)))
    mu = np.asarray(ours.contacts["mu"])
    change = 0.1 * mu * rng.uniform(size=mu.shape)
    changes = {"load": load, "prescribed": motion, "gap": gap, "mu": change}
    stiffened = 0.1 * case.model.K
    iterative, other = (r.jvp(**changes, K=stiffened) for r in (ours, theirs))
    assert not iterative.one_sided.any()
    bars = {f: rng.normal(size=getattr(ours, f).shape) for f in FIELDS}
    gradient, expected = ours.vjp(**bars), theirs.vjp(**bars)
    for field in (*FIELDS, "displacement"):
        near(getattr(iterative, field), getattr(other, field))
    for field in ("load", "prescribed", "gap_by_component", "mu"):
        near(getattr(gradient, field), getattr(expected, field))
    near((gradient.K * stiffened).sum(), (expected.K * stiffened).sum())
    pulled = [
        np.sum(gradient.load * load),
        np.sum(gradient.prescribed * motion),
        np.sum(gradient.gap_by_component * gap),
        np.sum(gradient.mu * change),
        (gradient.K * stiffened).sum(),
    ]
    terms = [np.sum(bars[f] * getattr(iterative, f)) for f in FIELDS]
    sizes = [np.abs(bars[f] * getattr(iterative, f)).sum() for f in FIELDS]
    # Residuals of 1e-13 of the linear systems, times their condition.
    assert abs(sum(pulled) - sum(terms)) <= 1e-9 * sum(sizes)


@pytest.mark.parametrize(
    ("name", "statuses"),
    [
        ("a ball", {bp.Status.OPEN, bp.Status.STICK, bp.Status.SLIP}),
        ("hexahedra", {bp.Status.STICK, bp.Status.SLIP}),
        ("two bodies", {bp.Status.STICK, bp.Status.SLIP}),
        ("mortar", {bp.Status.STICK, bp.Status.SLIP}),
    ],
)
def test_the_paths_have_several_statuses(name: str, statuses: set[bp.Status]) -> None:
    """So that the comparison says something."""
    _, ours, _ = solved(name)
    assert {int(s) for s in np.unique(ours.status)} >= {int(s) for s in statuses}


@pytest.mark.usefixtures("no_factor")
@pytest.mark.parametrize("direction", range(6))
def test_borders(direction: int) -> None:
    """A contact at the friction limit and one at rest: several right sides."""
    K = 1000.0 * (2.0 * np.eye(4) - 0.5 * np.eye(4, k=2) - 0.5 * np.eye(4, k=-2))
    K[:2, 2:] += 100.0 * np.array([[0.0, 1.0], [1.0, 0.0]])
    K[2:, :2] += 100.0 * np.array([[0.0, 1.0], [1.0, 0.0]])
    change = np.random.default_rng(direction).normal(size=4)
    tangents = []
    for engine in ("iterative", "direct"):
        problem = bp.ContactProblem(
            K, np.eye(4), gap=np.zeros(2), mu=0.5, engine=engine
        )
        result = problem.solve([-10.0, 5.0, 0.0, 0.0], tol=1e-13)
        tangent = result.jvp(load=change)
        np.testing.assert_array_equal(tangent.one_sided, [[True, True]])
        tangents.append(tangent)
    for field in (*FIELDS, "displacement"):
        near(getattr(tangents[0], field), getattr(tangents[1], field))


@pytest.mark.usefixtures("no_factor")
@pytest.mark.parametrize("fixed", [[1], [2], [1, 5], [0], [0, 1, 2]])
def test_prescribed_components_of_contacts(fixed: list[int]) -> None:
    """Reactions along them are no unknowns: the laws alone give them."""
    K = 1000.0 * (3.0 * np.eye(6) + 0.3 * np.ones((6, 6)))
    moved = np.where(np.array(fixed) == 0, 0.0, -1e-3)
    rng = np.random.default_rng(0)
    bars = {
        f: rng.normal(size=(1, 2, 3)) for f in ("reaction", "relative_displacement")
    }
    of_engines = []
    for engine in ("iterative", "direct"):
        problem = bp.ContactProblem(
            K, np.eye(6), gap=np.zeros(2), mu=0.3, fixed=fixed, engine=engine
        )
        load = np.array([-10.0, 4.0, 5.0, -10.0, 2.0, 1.0])
        result = problem.solve(load, moved, tol=1e-13)
        tangent = result.jvp(load=np.arange(1.0, 7.0), prescribed=1e-3 * moved)
        gradient = result.vjp(**bars)
        of_engines.append((tangent, gradient))
    (iterative, first), (other, second) = of_engines
    for field in (*FIELDS, "displacement"):
        near(getattr(iterative, field), getattr(other, field))
    for field in ("load", "prescribed", "gap", "mu"):
        near(getattr(first, field), getattr(second, field))


def test_a_solver_that_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    """The direct engine replaces it; without memory the error says what happened."""
    _, ours, theirs = solved("two bodies")
    bar = np.ones_like(ours.reaction)

    def stalled(*_: Any, **__: Any) -> None:
        raise response.Stalled

    monkeypatch.setattr(response.KrylovSystem, "solve_transposed", stalled)

    def full(_engine: Iterative) -> None:
        raise MemoryError("the factor does not fit")

    with monkeypatch.context() as without_memory:
        without_memory.setattr(Iterative, "replacement", full)
        with pytest.raises(
            MemoryError, match="does not converge for the derivatives, and"
        ):
            ours.vjp(reaction=bar)
    near(ours.vjp(reaction=bar).gap, theirs.vjp(reaction=bar).gap)


def test_threads_do_not_change_bits() -> None:
    case = MODELS["hexahedra"]().assemble()
    gradients = []
    for threads in (1, 2):
        problem = bp.ContactProblem(
            **arguments(case.model), engine="iterative", num_threads=threads
        )
        result = problem.solve(case.load, case.prescribed)
        gradient = result.vjp(reaction=np.ones_like(result.reaction))
        gradients.append((gradient.load, gradient.gap))
    for plain_row, other in zip(*gradients, strict=True):
        np.testing.assert_array_equal(plain_row, other)
