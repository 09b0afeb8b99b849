"""Derivatives of meshed models by both engines: supports, several bodies, mortar.

Those of the iterative engine come from Krylov solves in the response; no factor is made.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.path.iterative import Iterative
from bipot_rs.contact.sensitivity import response
from support.body_models import floating, on_a_ball, on_springs
from support.models_and_arrays import arguments
from support.pressed_in_space import pressed
from support.random_paths import FIELDS, apart, differences
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


def near(one: Any, other: Any) -> None:
    """Equal to 1e-8: the points of linearisation of both engines agree to 1e-9."""
    a, b = np.asarray(one), np.asarray(other)
    assert np.abs(a - b).max(initial=0.0) <= 1e-8 * np.abs(b).max(initial=0.0)


@cache
def solved(name: str) -> tuple[dict[str, Any], dict[str, Any], bp.Result, bp.Result]:
    """Arguments of the problem and of its path, and the results by both engines."""
    case = MODELS[name]().assemble()
    model, steps = case.model, len(case.prescribed)
    gaps = np.zeros((steps, len(model.gap), model.dim))
    given = model.gap if case.gaps is None else case.gaps
    if np.ndim(given) == 3:
        gaps[:] = given
    else:
        gaps[:, :, 0] = given
    load = np.zeros((steps, model.n)) if case.load is None else case.load
    path = {"load": load, "prescribed": case.prescribed, "gap": gaps}
    problem = arguments(model)
    results = [
        bp.ContactProblem(**problem, engine=engine).solve(**path, tol=1e-13)
        for engine in ("iterative", "direct")
    ]
    assert "krylov" in results[0][-1].stats
    assert all(result.converged.all() for result in results)
    return problem, path, results[0], results[1]


@pytest.mark.usefixtures("no_factor")
@pytest.mark.parametrize("name", MODELS)
def test_models(name: str) -> None:
    """Both engines, jvp against vjp, and against differences of the fourth order."""
    problem, path, ours, theirs = solved(name)
    # So that the comparison says something.
    if name in ("a ball", "hexahedra", "two bodies", "mortar"):
        assert {bp.Status.STICK, bp.Status.SLIP} <= set(ours.status.ravel().tolist())
    rng = np.random.default_rng(0)
    force, moved = (0.1 * np.abs(x).mean() for x in (ours.reaction, ours.displacement))
    mu = np.asarray(problem["mu"])
    by = {
        # Contact balances no others.
        "load": force
        * rng.normal(size=path["load"].shape)
        * (name != "held by contact alone"),
        "prescribed": moved * rng.normal(size=path["prescribed"].shape),
        "gap": moved * rng.normal(size=path["gap"].shape),
        "mu": 0.1 * mu * rng.uniform(size=mu.shape),
    }
    stiffened = 0.1 * problem["K"]
    iterative, direct = (r.jvp(**by, K=stiffened) for r in (ours, theirs))
    assert not iterative.one_sided.any()
    bars = {f: rng.normal(size=getattr(ours, f).shape) for f in FIELDS}
    gradient, expected = ours.vjp(**bars), theirs.vjp(**bars)
    for field in FIELDS:
        near(getattr(iterative, field), getattr(direct, field))
    pulled = []
    for field, change in by.items():
        name_of_field = "gap_by_component" if field == "gap" else field
        near(getattr(gradient, name_of_field), getattr(expected, name_of_field))
        pulled.append(np.sum(getattr(gradient, name_of_field) * change))
    near((gradient.K * stiffened).sum(), (expected.K * stiffened).sum())
    pulled.append((gradient.K * stiffened).sum())
    terms = [bars[f] * getattr(iterative, f) for f in FIELDS]
    # Residuals of 1e-13 of the linear systems, times their condition.
    size = sum(np.abs(t).sum() for t in terms)
    assert abs(sum(pulled) - sum(map(np.sum, terms))) <= 1e-9 * size

    def solve(t: float) -> bp.Result:
        other = problem | {"K": problem["K"] + t * stiffened, "mu": mu + t * by["mu"]}
        made = bp.ContactProblem(**other, engine="direct")
        return made.solve(**{k: x + t * by[k] for k, x in path.items()}, tol=1e-13)

    for h in (1e-3, 1e-4, 1e-5):
        slope = differences(solve, h)
        if slope is not None:
            # h⁴ times a fifth derivative, and rounding of 1e-14 over h.
            assert apart(direct, slope) <= 1e-6
            break
    else:
        pytest.fail("a contact changes its status")


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
    *_, ours, theirs = solved("two bodies")
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
