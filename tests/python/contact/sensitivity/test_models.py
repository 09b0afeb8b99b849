"""Derivatives of meshed models: supports, several bodies, mortar."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from support.bodies import block
from support.body_models import floating, on_a_ball, on_springs
from support.random_paths import FIELDS

Solve = Callable[[Any, Any], bp.Result]


def two_blocks(pairing: str) -> bp.Model:
    """A block on a wider base, sheared by its top."""
    m = bp.Model("Two blocks")
    m.material("soft", young=1000.0, poisson=0.3)
    upper = {"from": 0.0, "to": 1.0, "cells": 3}
    lower = {"from": 0.0, "to": 1.0, "cells": 3 if pairing == "match" else 4}
    side = {"from": 0.0, "to": 0.6, "cells": 2}
    below = {"from": -0.7, "to": 0.0, "cells": 2}
    m.body("block", material="soft", cell="quadrilateral", x=upper, y=side)
    m.body("base", material="soft", cell="quadrilateral", x=lower, y=below)
    m.contact("block.bottom", against="base.top", mu=0.3, pairing=pairing)
    m.support("base.bottom", x=0.0, y=0.0)
    m.support("block.top", x=m.times(0.013, "shear"), y=m.times(-0.02, "press"))
    m.path(press=[1.0, 1.0, 0.8], shear=[0.3, 1.0, -0.2])
    return m


MODELS: dict[str, Callable[[], bp.Model]] = {
    "node to node": lambda: two_blocks("match"),
    "mortar": lambda: two_blocks("mortar"),
    "floating": floating,
    "springs": on_springs,
    "obstacle": on_a_ball,
}


def directions(case: Any, result: bp.Result) -> tuple[Any, Any]:
    """Changes of loads and gaps of the size of the results."""
    rng = np.random.default_rng(0)
    force = np.abs(result.reaction).mean()
    moved = np.abs(result.displacement).mean()
    shape = (len(result), case.model.n)
    # Smooth over the nodes, so that few contacts change their status.
    load = np.zeros(shape)
    contact = np.abs(case.model.B).sum(axis=0) > 0
    load[:, contact] = force * rng.uniform(0.5, 1.0, (len(result), contact.sum()))
    return load, 0.3 * moved * rng.uniform(0.5, 1.0, result.reaction.shape[1])


@pytest.mark.parametrize("name", MODELS)
def test_models(name: str) -> None:
    """Against differences of the fourth order, and jvp against vjp."""
    case = MODELS[name]().assemble()
    problem = case.problem()
    gaps = case.gaps if case.gaps is not None else case.model.gap[None]
    base = np.zeros((len(case.prescribed), case.model.n))
    base = base if case.load is None else case.load

    def solve(load: Any, gap: Any) -> bp.Result:
        return problem.solve(load, case.prescribed, gap=gap, tol=1e-13)

    result = solve(base, gaps)
    load, gap = directions(case, result)
    if name == "floating":
        load[:] = 0.0  # contact balances no others
    steps = len(result)
    moving = np.zeros((steps, *np.shape(gaps)[1:]))
    if moving.ndim == 3:
        moving[:, :, 0] = gap
    else:
        moving[:] = gap
    tangent = result.jvp(load, gap=moving)
    rng = np.random.default_rng(1)
    bars = {f: rng.normal(size=getattr(result, f).shape) for f in FIELDS}
    gradient = result.vjp(**bars)
    left = np.sum(gradient.load * load) + np.sum(gradient.gap * moving)
    terms = [bars[f] * getattr(tangent, f) for f in FIELDS]
    # Rounding times the condition of K and of the tangent systems.
    allowed = 1e-10 * sum(np.abs(t).sum() for t in terms)
    if not tangent.one_sided.any():
        assert abs(left - sum(map(np.sum, terms))) <= allowed
    for h in (1e-3, 1e-4, 1e-5):
        near = [
            solve(base + t * h * load, gaps + t * h * moving) for t in (-2, -1, 1, 2)
        ]
        if not any((r.status != result.status).any() for r in near):
            break
    else:
        pytest.fail("a contact changes its status")
    weights = np.array([1, -8, 8, -1]) / (12 * h)
    for field in FIELDS:
        slope = sum(w * getattr(r, field) for w, r in zip(weights, near, strict=True))
        off = np.abs(getattr(tangent, field) - slope).max()
        # h⁴ times a fifth derivative, and rounding of 1e-14 over h.
        assert off <= 1e-7 * np.abs(slope).max() + 1e-14 / h, field


def test_inclined_supports() -> None:
    """A rotated body with symmetry planes has the derivatives of the body that is not."""
    results_of_frames = []
    angle = 0.4
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    straight = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
    rng = np.random.default_rng(3)
    push = rng.normal(size=(straight.p.shape[1], 2))
    push[:, 1] -= 3.0
    bar = rng.normal(size=push.shape)
    steel = fem.Material(young=1000.0, poisson=0.3)
    for R in (np.eye(2), turn):
        mesh = type(straight)(R @ straight.p, straight.t, straight.boundaries)
        model = fem.assemble(
            [fem.Body("it", mesh, steel)],
            [fem.Contact("it", "bottom", 0.3, plane=(np.zeros(2), R[:, 1]))],
            symmetries=[fem.Symmetry("it", "left")],
        )
        assert (model.inclined is None) == (R is not turn)
        result = model.problem().solve((push @ R.T).ravel(), tol=1e-13)
        gradient = result.vjp(displacement=(bar @ R.T).ravel())
        tangent = result.jvp(load=(bar @ R.T).ravel())
        rows = (gradient.load, tangent.displacement)
        results_of_frames.append(
            [np.reshape(row, (-1, 2)) @ R for row in rows] + [gradient.gap]
        )
    held = np.abs(straight.p[0]) < 1e-12
    assert (results_of_frames[1][0][held, 0] == 0).all() or np.abs(
        results_of_frames[1][0][held, 0]
    ).max() < 1e-14
    for plain_row, other in zip(*results_of_frames, strict=True):
        # Rounding times the condition of K.
        np.testing.assert_allclose(
            plain_row, other, atol=1e-11 * np.abs(plain_row).max()
        )


def test_prescribed_displacements() -> None:
    """The gradient by supports is the force that they need: that of an adjoint model."""
    case = two_blocks("mortar").assemble()
    problem = case.problem()
    result = problem.solve(None, case.prescribed, tol=1e-13)
    rng = np.random.default_rng(2)
    by = rng.normal(size=case.prescribed.shape) * np.abs(case.prescribed).max()
    by[:, case.prescribed[0] == 0] = 0.0
    tangent = result.jvp(prescribed=by)
    bars = {f: rng.normal(size=getattr(result, f).shape) for f in FIELDS}
    left = np.sum(result.vjp(**bars).prescribed * by)
    terms = [bars[f] * getattr(tangent, f) for f in FIELDS]
    assert abs(left - sum(map(np.sum, terms))) <= 1e-10 * sum(
        np.abs(t).sum() for t in terms
    )
    h = 1e-5
    near = [
        problem.solve(None, case.prescribed + t * h * by, tol=1e-13) for t in (-1, 1)
    ]
    slope = (near[1].reaction - near[0].reaction) / (2 * h)
    off = np.abs(slope - tangent.reaction).max()
    # h² of a second order, and rounding of 1e-14 over h.
    assert off <= 1e-7 * np.abs(slope).max()


def test_a_working_set() -> None:
    """Derivatives of a path whose W was never formed for all candidates."""
    body = block([1.0, 0.0125], [320, 4], 1.0, 0.3)
    gap = ((body.points[:, :-1] - 0.5) ** 2).sum(axis=1) / 2
    fixed = np.concatenate([body.dofs(1, 0.0125, k) for k in range(2)])
    path = np.zeros((3, len(fixed)))
    component = np.asarray(fixed) % 2
    path[:, component == 1] = -0.0005 * np.array([[1.0], [1.0], [0.4]])
    path[1:, component == 0] = 0.0002
    results = []
    for grow in (True, False):
        problem = bp.ContactProblem(
            body.K, body.B, gap=gap, mu=0.4, fixed=fixed, working_set=grow
        )
        results.append(problem.solve(None, path, tol=1e-13))
    members = results[0][-1].working_set
    assert members is not None
    assert len(members) < len(gap)
    rng = np.random.default_rng(0)
    bars = rng.normal(size=results[0].reaction.shape)
    gradients = [r.vjp(reaction=bars, relative_displacement=bars) for r in results]
    tangents = [r.jvp(gap=1 + gap, prescribed=path) for r in results]
    for derivative, other, names in (
        (*gradients, ("gap", "mu", "load", "prescribed")),
        (*tangents, FIELDS),
    ):
        for name in names:
            exact = getattr(other, name)
            # As the solutions: two W's with the rounding of one K.
            np.testing.assert_allclose(
                getattr(derivative, name),
                exact,
                atol=1e-9 * np.abs(exact).max(),
                err_msg=name,
            )
