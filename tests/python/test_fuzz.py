"""Readers under altered scenes and damaged files: a sentence, or what was meant."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bipot_rs as bp
from bars import bar_problem, pulled
from bipot_rs.scene import SceneError, assemble, bodies, read, shipped, text
from children import bipot
from fuzzing import altered, document, survives_damage

# Small enough to be solved some hundred times.
SMALL = {"pressed_block": 4, "cattaneo_mindlin": 10, "two_blocks": 4}


def small(name: str) -> dict[str, Any]:
    table = tomllib.loads(text(name))
    table["mesh"]["n"] = SMALL.get(name, 2)
    return table


def check_scene(path: Path, table: dict[str, Any]) -> str:
    """What becomes of a scene: ``refused``, ``no answer`` or ``solved``."""
    path.write_text(document(table), encoding="utf-8")
    try:
        scene = read(str(path))
        case = assemble(scene, bodies(scene))
    except SceneError as error:
        for problem in error.problems:
            assert "\n" not in problem
            assert re.match(
                r"[\w.]+: |[a-z -]*(node|bod|contact|is not TOML)", problem
            ), problem
        return "refused"
    if len(case.parameter) > 50 or case.model.n > 3000:
        return "large"
    try:
        problem = case.model.problem()
        result = problem.solve(
            case.load,
            case.prescribed,
            method=scene.solver.method,
            tol=scene.solver.tol,
            max_iterations=2000,
        )
    except (ValueError, bp.BipotError) as error:
        assert str(error)
        assert "\n" not in str(error)
        return "no answer"
    assert np.isfinite(result.reaction).all()
    assert np.isfinite(result.displacement).all()
    assert (result.residual <= [step.tolerance for step in result]).all()
    return "solved"


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", shipped())
def test_altered_scenes(name: str, tmp_path: Path) -> None:
    @settings(
        max_examples=60,
        suppress_health_check=[HealthCheck.too_slow],
        derandomize=True,
    )
    @given(st.data())
    def one(data: Any) -> None:
        table = small(name)
        for _ in range(data.draw(st.integers(1, 2))):
            altered(data.draw, table)
        check_scene(tmp_path / "scene.toml", table)

    assert check_scene(tmp_path / "scene.toml", small(name)) == "solved"
    one()
