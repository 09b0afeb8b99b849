"""Every step of the scenes: all forms of the law, and the bifunctional."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import scene
from bipot_rs.theory import law as laws
from bipot_rs.theory.functionals import Functionals, of_problem

pytestmark = [pytest.mark.needs_extra, pytest.mark.xdist_group("theory_scenes")]
SCENES = [
    ("pressed_block", 8, {0, 1, 2}),
    ("sheared_cube", 3, {1, 2}),
    ("two_blocks", 4, {1, 2}),
    ("cattaneo_mindlin", 4, {0, 1, 2}),
    ("cyclic_cube", 3, {1, 2}),
    ("raous_plate", 8, {0, 1, 2}),
]
Solved = tuple[Any, bp.ContactProblem, bp.Result]


@pytest.fixture(scope="module", params=SCENES, ids=lambda row: row[0])
def solved(request: pytest.FixtureRequest) -> Solved:
    name, n, found = request.param
    whole = scene.read(name, [f"mesh.n={n}"])
    case = scene.assemble(whole, scene.bodies(whole))
    problem = case.model.problem()
    result = problem.solve(case.load, case.prescribed, tol=1e-14)
    assert set(result.status.ravel().tolist()) == found
    return case.model.K, problem, result


def some_steps(result: bp.Result) -> set[int]:
    return {0, 1, len(result) // 2, len(result) - 1} & set(range(len(result)))


def test_every_form_of_the_law_holds(solved: Solved) -> None:
    """Each step starts from the state at the end of the step before."""
    _, _, result = solved
    for k, step in enumerate(result):
        law, du, dt = laws.step_of(result, k)
        assert bool(np.any(law.start.reaction != 0)) == (k > 0)
        # One rho for all contacts: the largest force over the largest displacement.
        size = np.linalg.norm(step.reaction, axis=1).max()
        rho = float(size / np.linalg.norm(step.relative_displacement, axis=1).max())
        whole = float(laws.size(law, du, dt, rho).max())
        for form, residual in laws.FORMS.items():
            # The solver's residual is 1e-14 of all reactions, with a rho for each contact that
            # is within a factor of ten of this one. Another factor of ten allows for the directions
            # of short slips.
            assert residual(law, du, dt, rho).max() <= 1e-11 * whole, (k, form)
        for form, verdict in laws.verdicts(law, du, dt, rho).items():
            assert verdict.all(), (k, form)


def test_the_bifunctional_vanishes(solved: Solved) -> None:
    K, problem, result = solved
    for k in some_steps(result):
        u, r = result[k].displacement, result[k].reaction
        # Increments are differences of totals, and B is a difference of energies. Each is a sum
        # of some hundred products with as many roundings, most of which cancel.
        small = 2e-13 * (u @ (K @ u))
        for increments in (False, True):
            f = Functionals.of_step(
                of_problem(problem, K), result, k, increments=increments
            )
            if increments and k:
                u, r = u - result[k - 1].displacement, r - result[k - 1].reaction
            assert abs(f.excess(u, r)) <= small
            assert abs(f.bifunctional(u, r) + f.start_work) <= small
            assert abs(f.start_work) <= small
