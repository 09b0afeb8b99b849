"""Every step of the scenes: all forms of the law."""

import numpy as np
import pytest

from bipot_rs import scene
from bipot_rs.theory import law as laws

pytestmark = pytest.mark.needs_extra
SCENES = [
    ("pressed_block", 8, {0, 1, 2}),
    ("sheared_cube", 3, {1, 2}),
    ("two_blocks", 4, {1, 2}),
    ("cattaneo_mindlin", 4, {0, 1, 2}),
    ("cyclic_cube", 3, {1, 2}),
    ("raous_plate", 8, {0, 1, 2}),
]


@pytest.mark.parametrize(("name", "n", "found"), SCENES)
def test_every_form_of_the_law_holds(name: str, n: int, found: set[int]) -> None:
    """Each step starts from the state at the end of the step before."""
    whole = scene.read(name, [f"mesh.n={n}"])
    case = scene.assemble(whole, scene.bodies(whole))
    result = case.model.problem().solve(case.load, case.prescribed, tol=1e-14)
    assert set(result.status.ravel().tolist()) == found
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
