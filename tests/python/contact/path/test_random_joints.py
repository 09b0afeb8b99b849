"""The iterative engine takes every scene: random joints with and without nodes of their own."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import scene
from support.lap_joint import lap_joint
from support.random_joints import CLASSES, random_joint

pytestmark = pytest.mark.needs_extra


def solved(problem: dict[str, Any], load: Any, engine: str, **more: Any) -> bp.Result:
    return bp.ContactProblem(**problem, engine=engine, **more).solve(load, tol=1e-12)


@pytest.mark.slow_variants("all-3", "groove-3")
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", CLASSES)
def test_both_engines_agree(kind: str, dim: int) -> None:
    """Where statuses do not settle the direct engine solves; it does so in a part of them."""
    own = 0
    for seed in range(3):
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
            # η of the direct engine is 1e-12; contrast 1e6 costs it four digits.
            np.testing.assert_allclose(
                *forces, rtol=0, atol=1e-8 * np.abs(forces[1]).max()
            )
            moved = step.displacement, other.displacement
            np.testing.assert_allclose(
                *moved, rtol=0, atol=1e-8 * np.abs(moved[1]).max()
            )
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
        # As in `test_both_engines_agree`.
        np.testing.assert_allclose(
            step.displacement,
            other.displacement,
            rtol=0,
            atol=1e-8 * np.abs(other.displacement).max(),
        )


@pytest.mark.parametrize("kind", ["symmetry", "oblique", "groove"])
def test_threads_do_not_change_a_bit(kind: str) -> None:
    problem, load = random_joint(kind, 3, 2)
    one, two = (solved(problem, load, "iterative", num_threads=k) for k in (1, 2))
    np.testing.assert_array_equal(one.reaction, two.reaction)
    np.testing.assert_array_equal(one[-1].displacement, two[-1].displacement)


@pytest.mark.parametrize("kind", ["symmetry", "oblique", "groove"])
def test_a_path_continues_to_the_same_bits(kind: str) -> None:
    problem, load = random_joint(kind, 3, 2)
    whole = solved(problem, load, "iterative")
    path = bp.ContactProblem(**problem, engine="iterative")
    first = path.solve(load[:1], tol=1e-12)
    rest = path.solve(load[1:], tol=1e-12, start=first)
    np.testing.assert_array_equal(whole[-1].reaction, rest[-1].reaction)


def test_components_first_and_other_units_do_not_matter() -> None:
    """Degrees of freedom by components, K in other units: the same problem with copies."""
    problem, load = random_joint("oblique", 3, 2)
    expected = solved(problem, load, "iterative")
    n = problem["K"].shape[0]
    order = np.arange(n).reshape(-1, 3).T.ravel()
    turned = problem | {
        "K": problem["K"][order][:, order] * 1e7,
        "B": problem["B"][:, order],
        "fixed": np.flatnonzero(np.isin(order, problem["fixed"])),
        "coordinates": problem["coordinates"][order],
    }
    if "cohesion" in turned:
        turned["cohesion"] = turned["cohesion"] * 1e7
    result = solved(turned, load[:, order] * 1e7, "iterative")
    for step, other in zip(result, expected, strict=True):
        assert "krylov" in step.stats
        np.testing.assert_allclose(
            step.displacement,
            other.displacement[order],
            rtol=0,
            atol=1e-8 * np.abs(other.displacement).max(),
        )


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
        for one, two in (
            (step.reaction, other.reaction),
            (step.displacement, other.displacement),
        ):
            np.testing.assert_allclose(one, two, rtol=0, atol=1e-8 * np.abs(two).max())


@pytest.mark.slow
def test_contacts_without_nodes_of_their_own_are_condensed() -> None:
    """Mortar of second order: on the displacements statuses may not settle."""
    keys = ["mesh.n=10", "mesh.element=P2", "contact.0.pairing=mortar"]
    read = scene.read("two_blocks", keys)
    case = scene.assemble(read, scene.bodies(read))
    problem = case.model.problem()
    problem.solve(case.load, case.prescribed)
    assert problem.stats["engine"] == "direct"
