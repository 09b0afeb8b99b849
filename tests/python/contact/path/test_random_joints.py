"""The iterative engine takes every scene: random joints with and without nodes of their own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import scene
from support.body_models import on_a_ball
from support.comparisons import bits, solve_in_parts
from support.lap_joint import lap_joint
from support.models_and_arrays import arguments
from support.pressed_in_space import pressed
from support.random_joints import CLASSES, random_joint

pytestmark = pytest.mark.needs_extra


def close(found: Any, expected: Any) -> None:
    """η of the direct engine is 1e-12; contrast 1e6 costs it four digits."""
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * size)


def solved(problem: dict[str, Any], load: Any, engine: str, **more: Any) -> bp.Result:
    return bp.ContactProblem(**problem, engine=engine, **more).solve(load, tol=1e-12)


@pytest.mark.slow_variants("all-3", "groove-3")
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", CLASSES)
def test_both_engines_agree(kind: str, dim: int) -> None:
    """Where statuses do not settle the direct engine solves; it does so in a part of them."""
    own = 0
    for seed in range(2):
        problem, load = random_joint(kind, dim, seed)
        try:
            expected = solved(problem, load, "direct")
        except bp.NotConvergedError:
            continue
        result = solved(problem, load, "iterative")
        own += all("krylov" in step.stats for step in result)
        free = np.ones(problem["B"].shape[1], bool)
        free[problem["fixed"]] = False
        for step, other in zip(result, expected, strict=True):
            # Reactions that supports bear on all sides are not determined; their forces are.
            forces = [
                (problem["B"].T @ s.reaction.ravel())[free] for s in (step, other)
            ]
            close(*forces)
            close(step.displacement, other.displacement)
    assert own >= (0 if (kind, dim) == ("all", 3) else 1)


@pytest.mark.parametrize(
    ("kind", "dim", "seed"),
    [("mortar", 2, 2), ("mortar", 2, 3), ("symmetry", 2, 3), ("symmetry", 3, 3)],
)
def test_statuses_settle_beside_stiff_bodies(kind: str, dim: int, seed: int) -> None:
    """Moduli that differ by up to 1e6: coarse linear systems make statuses alternate."""
    problem, load = random_joint(kind, dim, seed)
    result, expected = (solved(problem, load, e) for e in ("iterative", "direct"))
    for step, other in zip(result, expected, strict=True):
        assert "krylov" in step.stats
        close(step.displacement, other.displacement)


BLOCKS = ("block", "without coordinates", "open contacts")


def iterated(kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of a problem, and its loads or prescribed displacements."""
    if kind not in BLOCKS:
        problem, load = random_joint(kind, 3, 2)
        return problem, {"load": load}
    model = on_a_ball() if kind == "open contacts" else pressed(4)
    case = model.assemble()
    problem = arguments(case.model)
    if kind == "without coordinates":
        del problem["coordinates"]
    return problem, {"prescribed": case.prescribed}


KINDS = pytest.mark.parametrize("kind", [*BLOCKS, "symmetry", "oblique", "groove"])


def followed(problem: dict[str, Any], path: dict[str, Any], **more: Any) -> bp.Result:
    made = bp.ContactProblem(**problem, engine="iterative", **more)
    return made.solve(**path, tol=1e-12)


@pytest.mark.parametrize("kind", ["without coordinates", "oblique", "groove"])
def test_threads_do_not_change_a_bit(kind: str) -> None:
    problem, path = iterated(kind)
    assert bits(*(followed(problem, path, num_threads=k) for k in (1, 2)))


@KINDS
def test_a_path_continues_to_the_same_bits(kind: str, tmp_path: Path) -> None:
    problem, path = iterated(kind)
    made = bp.ContactProblem(**problem, engine="iterative")
    whole = solve_in_parts(made, tmp_path, **path)
    assert all("krylov" in step.stats for step in whole)


@pytest.mark.parametrize("kind", ["block", "without coordinates", "oblique"])
def test_components_first_and_other_units_do_not_matter(kind: str) -> None:
    """Degrees of freedom by components, K in other units: the same problem."""
    problem, path = iterated(kind)
    expected = followed(problem, path)
    n = problem["K"].shape[0]
    order = np.arange(n).reshape(-1, 3).T.ravel()
    turned = problem | {
        "K": problem["K"].tocsr()[order][:, order] * 1e7,
        "B": problem["B"].tocsr()[:, order],
        "fixed": np.argsort(order)[problem["fixed"]],
    }
    for name in ("coordinates", "cohesion"):
        if name in problem:
            turned[name] = (
                problem[name][order] if name == "coordinates" else problem[name] * 1e7
            )
    if "load" in path:
        path = {"load": path["load"][:, order] * 1e7}
    result = followed(turned, path)
    for step, other in zip(result, expected, strict=True):
        assert "krylov" in step.stats
        close(step.displacement, other.displacement[order])


# Krylov iterations: 621 and 1942, and a third more for other machines.
@pytest.mark.slow_variants("False-*")
@pytest.mark.parametrize(("symmetric", "most"), [(True, 830), (False, 2600)])
def test_a_lap_joint_takes_few_iterations(symmetric: bool, most: int) -> None:
    """A plane of symmetry needs no multipliers; with them the work is a few times as much."""
    model, load, prescribed = lap_joint(2, symmetric=symmetric)
    result, expected = (
        model.problem(engine=engine).solve(load, prescribed, tol=1e-12)
        for engine in ("iterative", "direct")
    )
    assert {0, 1, 2} == set(result.status.ravel().tolist())
    assert sum(step.stats["krylov"] for step in result) <= most
    for step, other in zip(result, expected, strict=True):
        close(step.reaction, other.reaction)
        close(step.displacement, other.displacement)


@pytest.mark.slow
def test_contacts_without_nodes_of_their_own_are_condensed() -> None:
    """Mortar of second order: on the displacements statuses may not settle."""
    keys = ["mesh.n=10", "mesh.element=P2", "contact.0.pairing=mortar"]
    read = scene.read("two_blocks", keys)
    case = scene.assemble(read, scene.bodies(read))
    problem = case.model.problem()
    problem.solve(case.load, case.prescribed)
    assert problem.stats["engine"] == "direct"
