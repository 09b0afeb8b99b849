"""Derivatives of models with tied displacements, against differences of results.

The relations of rigid sets, cuts and inclined planes change the variables of K, B and loads;
derivatives are those of the whole displacements.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.contact.law.status import Status
from bipot_rs.fem.constraints.repetition import Cyclic, Periodic
from support.boxes import box, placed
from support.random_paths import (
    FIELDS,
    Data,
    apart,
    cotangents,
    differences,
    jvp,
    products,
)

Floats = NDArray[np.float64]
SOFT = fem.Material(10.0, 0.3)
KINDS = (
    "rigid set",
    "cyclic symmetry",
    "periodicity",
    "planes",
    "plane in a rigid set",
)
CASES = [(2, "direct"), (3, "direct"), (3, "iterative")]
# Differences of the fourth order with h = 1e-4: rounding times a condition of 1e3 over h.
CLOSE = 1e-8
# Two orders of the same sums: rounding times the condition of the tangent systems.
SAME = 1e-12


def tied(kind: str, d: int, material: fem.Material = SOFT) -> fem.Assembly:
    """A block on a floor, whose top moves; some contact nodes are tied."""
    mesh = box("quadrilateral" if d == 2 else "hexahedron", 5 - d)
    turn, up, foot = np.eye(d), np.eye(d)[-1], np.zeros(d)
    if kind.startswith("plane"):
        turn[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
        if d == 3:
            turn = turn @ [[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]]
        mesh, up = placed(mesh, turn @ mesh.p), turn[:, -1]
    more: dict[str, Any] = {}
    side, sides = "bottom", ("left", "front")[: d - 1]
    if "rigid set" in kind:
        rotations, sides = ((2,) if d == 2 else (0, 1, 2)), ("left",)
        # The nodes of the left side touch the floor: a force presses them on it.
        grip, held = ("left", d - 1) if kind == "rigid set" else ("top", d)
        translations = tuple(range(held))
        grip_set = fem.Remote("grip", "it", grip, None, translations, rotations)
        more["remotes"] = [grip_set]
    elif kind == "cyclic symmetry" and d == 2:
        # The node at the end of the contacts is the image of one on the top.
        side, up, foot = "right", np.array([-1.0, 0.0]), np.array([1.0, 0.0])
        more["supports"] = [fem.Support("it", None, (0, 1), at=[1 / 3, 1.0])]
    else:
        # Nodes on an axis of symmetry move along it.
        components = (2,) if "cyclic" in kind else tuple(range(d))
        more["supports"] = [fem.Support("it", "top", components)]
    if "plane" in kind:
        more["symmetries"] = [fem.Symmetry("it", side) for side in sides]
    elif kind == "periodicity":
        more["repetitions"] = [Periodic(("it", "left"), ("it", "right"))]
    elif kind == "cyclic symmetry":
        cuts = ("it", "bottom" if d == 2 else "front"), ("it", "left")
        axis = None if d == 2 else [0, 0, 1.0]
        more["repetitions"] = [Cyclic(*cuts, 4, axis=axis)]
    mu = 0.9 if side == "right" else 0.3
    contact = fem.Contact("it", side, mu, plane=(foot, up))
    return fem.assemble([fem.Body("it", mesh, material)], [contact], **more)


def path(model: fem.Assembly) -> tuple[Floats, Floats]:
    """Loads and prescribed displacements of three steps: press, drag, and return."""
    d, up = model.dim, model.frame[0, 0]
    across = np.ones(d) - up.sum() * up
    if model.inclined is not None:
        normals = model.inclined.normals.toarray().T.reshape(-1, d)
        _, size, rows = np.linalg.svd(normals)
        rows = rows[size > 1e-6]
        across -= rows.T @ rows @ across
    # Friction alone stops a twist of a whole structure of equal sectors.
    shear = (0.6 if d == 2 else 0.1) if model.images else 1.5

    def force(x: Any) -> Any:
        along = np.multiply.outer(np.full(d, shear), x[0] - 0.5)
        return along + np.multiply.outer(up, 3 * x[-1] - 1)

    f, weight = model.body_force("it", force), np.zeros(model.n)
    if model.remotes:
        weight = model.body_force("it", -3.0 * up)
        weight += model.reference_force("grip", -0.5 * up)

    def prescribed(down: float, drag: float) -> Floats:
        v = drag * across - down * up
        if not model.remotes:
            return model.prescribed([v[list(model.supports[0].components)]])
        (grip,) = model.remotes
        turn = 0.0 if model.inclined else 0.01 * down
        turns = [turn] * len(grip.rotations)
        return model.prescribed([], {"grip": [*v[: len(grip.components)], *turns]})

    ends = [(0.03, 0.01), (0.05, 0.04), (0.05, 0.035)]
    loads = np.array([share * f + weight for share in (1, 2, -1)])
    return loads, np.array([prescribed(*end) for end in ends])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("d", "engine"), CASES)
def test_derivatives_of_tied_models(kind: str, d: int, engine: str) -> None:
    model = tied(kind, d)
    assert model.ties is not None
    rng = np.random.default_rng([KINDS.index(kind), d])
    load, prescribed = path(model)
    data = Data(load, prescribed, model.gap, model.mu, model.K)
    # Motions that the relations allow.
    motion = rng.normal(size=prescribed.shape)
    motion[:, np.isin(model.fixed, model.ties.dependent)] = 0.0
    rule = model.ties.given.toarray()[:, model.fixed]
    motion -= motion @ (np.linalg.pinv(rule) @ rule) if len(rule) else 0.0
    by = Data(
        # Forces on dependent nodes too.
        0.1 * rng.normal(size=load.shape),
        0.01 * motion,
        0.01 * rng.normal(size=model.gap.shape),
        0.1 * rng.normal(size=model.mu.shape) * (model.mu > 0),
        tied(kind, d, fem.Material(5.0, 0.1)).K,
    )

    def solve(data: Data) -> bp.Result:
        near = replace(model, gap=data.gap, mu=data.mu, K=data.K)
        problem = near.problem(engine=engine)
        return problem.solve(data.load, data.prescribed, tol=1e-13)

    result = solve(data)
    assert {Status.SLIP, Status.STICK} <= set(result.status.ravel().tolist())
    tangent = jvp(result, by)
    expected = differences(lambda t: solve(data.moved(by, t)), 1e-4)
    assert expected is not None
    bars = cotangents(result, 1)
    gradient = result.vjp(**bars)
    terms = [bars[name] * getattr(tangent, name) for name in FIELDS]
    off = abs(products(gradient, by) - sum(map(np.sum, terms)))
    assert apart(tangent, expected) <= CLOSE
    assert off <= SAME * sum(np.abs(t).sum() for t in terms)
