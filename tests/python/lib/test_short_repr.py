"""An object with many arrays is shown on a screen: not their numbers, but their shapes."""

import numpy as np
import pytest

import bipot_rs as bp

pytestmark = pytest.mark.needs_extra


def shown() -> list[object]:
    """Objects of a model with many contacts."""
    model = bp.Model.from_toml("two_blocks").with_(**{"mesh.n": 8})
    case, pressed = model.assemble(), bp.Model.from_toml("pressed_block").assemble()
    problem = case.problem()
    result = model.solve()
    body = case.model.bodies[0]
    assert len(case.model.gap) == 81
    assert pressed.loads
    return [
        *(model, model.scene, case, case.model, body, body.mesh, body.material),
        *(body.surface("bottom"), body.volume(), pressed.loads[0], pressed),
        *(problem, problem.reduced(None, case.prescribed[0]), result, result[0]),
        *(result[0].error, case.model.contacts[0], case.model.supports[0]),
    ]


def test_within_twenty_lines() -> None:
    for shown_object in shown():
        for text in (repr(shown_object), str(shown_object)):
            assert len(text.splitlines()) <= 20
            # No numbers of a long array: they fill lines even when NumPy cuts them short.
            assert "..." not in text
            assert "array([[" not in text
        first, *more = repr(shown_object).splitlines()
        assert not more or max(map(len, (first, *more))) <= 88


def test_shapes_and_counts() -> None:
    case = bp.Model.from_toml("two_blocks").with_(**{"mesh.n": 8}).assemble()
    text = repr(case.model)
    entries = case.model.K.nnz
    for part in (
        "gap=array (81,)",
        "frame=array (81, 3, 3)",
        f"K=sparse (2430, 2430), {entries} entries",
        "dim=3",
        "numbered={'upper': 0, 'lower': 1215}",
    ):
        assert part in text
    assert repr(case).startswith("Case(model=Assembly(…), ")
    # A short array is given with its numbers.
    np.testing.assert_array_equal(case.parameter, [0, 1])
    assert "parameter=array([0., 1.])" in repr(case)


def test_a_long_text_keeps_its_beginning() -> None:
    blocks = [
        bp.blocks.Block("low", [[0, 0], [1, 0], [1, 1], [0, 1]], support=True),
        bp.blocks.Block("high", [[0.8, 1], [2, 1], [2, 2], [0.8, 2]]),
    ]
    problem = bp.blocks.assemble(blocks, mu=0.5)
    found = problem.equilibrium()
    assert found.verdict == "none"
    assert len(found.reason) > 78
    assert found.reason[:70] in repr(found)
    assert str(problem).startswith("BlockProblem: 2 contacts in the plane")
