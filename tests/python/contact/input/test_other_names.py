"""Names that users know from SciPy, or from the argument that they gave."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fclib, scene

pytestmark = pytest.mark.needs_extra

K, B = 1000.0 * np.eye(4), np.eye(4)
CONTACTS: dict[str, Any] = {"gap": [0.0, 0.0], "mu": 0.3}
LOAD = [-10.0, 2.0, -10.0, 5.0]
POINTS = [[0.0, 0.0], [1.0, 0.0]]


def solves() -> dict[str, Callable[..., Any]]:
    """Everything that takes ``max_iterations``."""
    problem = bp.ContactProblem(K, B, **CONTACTS)
    reduced = problem.reduced(LOAD)
    whole = fclib.GlobalProblem(K, B.T, np.array(LOAD), np.zeros((2, 2)), [0.3, 0.3])
    model = bp.Model.from_toml("pressed_block").with_(**{"mesh.n": 2})
    case = model.assemble()

    def wear(**given: Any) -> Any:
        worn = model.to_dict() | {"wear": {"coefficient": 0.0, "cycles": 1}}
        made = scene.check("it", worn)
        return scene.assemble(made, scene.bodies(made)).wear(**given)

    def cycles(**given: Any) -> Any:
        return problem.wear(LOAD, coefficient=0.0, cycles=1, **given)

    def follow(**given: Any) -> Any:
        return problem.follow(lambda t: t * np.array(LOAD), **given)

    return {
        "solve": lambda **given: problem.solve(LOAD, **given),
        "solve_many": lambda **given: problem.solve_many([LOAD], **given),
        "follow": follow,
        "wear": cycles,
        "bp.solve": lambda **given: bp.solve(K, B, LOAD, **CONTACTS, **given),
        "reduced": reduced.solve,
        "global": whole.solve,
        "model": model.solve,
        "case": case.solve,
        "case.wear": wear,
    }


@pytest.mark.parametrize("name", solves())
def test_maxiter_is_max_iterations(name: str) -> None:
    solve = solves()[name]
    with pytest.raises(ValueError, match="max_iterations is 0, expected"):
        solve(maxiter=0)
    with pytest.raises(
        TypeError, match="max_iterations is 3 and maxiter is 4: they are"
    ):
        solve(max_iterations=3, maxiter=4)


def test_maxiter_limits_the_iterations() -> None:
    reduced = bp.ReducedProblem(np.array([[2.0, 1.0], [1.0, 2.0]]), [[-1.0, 0.5]], 0.3)
    first_step = reduced.solve("uzawa", maxiter=1)
    assert (first_step.iterations, first_step.outcome) == (
        1,
        bp.Outcome.ITERATION_LIMIT,
    )


def test_points_are_found_by_the_name_of_the_argument(tmp_path: Path) -> None:
    result = bp.solve(K, B, LOAD, points=POINTS, **CONTACTS)
    result.save(tmp_path / "a.h5")
    again = pickle.loads(pickle.dumps(result))
    for any_result in (result, again, bp.load_result(tmp_path / "a.h5")):
        np.testing.assert_array_equal(any_result.contacts["points"], POINTS)
        np.testing.assert_array_equal(any_result.contacts.get("points"), POINTS)
        # Not a second array: files and loops over the data have it once.
        assert "points" not in list(any_result.contacts)
    with pytest.raises(KeyError, match="'place': the contacts have x, normal"):
        result.contacts["place"]
    assert result.contacts.get("place") is None
    bare = bp.solve(K, B, LOAD, **CONTACTS)
    assert bare.contacts["points"] is None
