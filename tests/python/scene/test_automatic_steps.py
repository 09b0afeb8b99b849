"""Scenes with automatic load steps."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.discretisation import discretisation_error
from bipot_rs.scene import assemble, bodies, read
from bipot_rs.scene.histories import evaluate_amplitude
from bipot_rs.scene.schema.load import Amplitude
from support.children import bipot, resumed
from support.comparisons import bits, refused

SLIDING = ("mesh.n=4", "path.automatic={slip = 0.004, first = 0.5}")


def made(name: str, *settings: str) -> Any:
    scene = read(name, settings)
    return assemble(scene, bodies(scene))


def test_automatic_steps_equal_given_steps() -> None:
    plain = made("two_blocks", "mesh.n=4")
    automatic = made("two_blocks", "mesh.n=4", "path.automatic=true").solve()
    np.testing.assert_array_equal(automatic.s, [1.0, 2.0])
    assert bits(automatic, plain.solve())


def test_sliding_divides_load_steps() -> None:
    case = made("two_blocks", *SLIDING)
    result = case.solve()
    assert {1.0, 2.0} <= set(result.s.tolist())
    assert len(result) > 3
    slips = np.linalg.norm(result.slip, axis=2)[result.status == bp.Status.SLIP]
    assert slips.max() <= 0.004
    # The same load points, given as load steps.
    at = case.sampled(result.s)
    assert bits(result, case.problem().solve(at.load, at.prescribed, tol=1e-12))
    for k, step in enumerate(result):
        assert case.step_parameter(k, step) == at.parameter[k]
    # Linear: pressed from 0 to 0.1 in the first load step, then sheared.
    np.testing.assert_allclose(at.parameter, np.maximum(result.s - 1, 0), rtol=1e-15)
    half = case.sampled([0.5]).prescribed[0]
    np.testing.assert_array_equal(half, case.prescribed[0] / 2)


@pytest.mark.parametrize(
    ("amplitude", "exact"),
    [
        (
            Amplitude(table=[0.25, -1.0, 3.0]),
            lambda t: np.interp(t, [1, 2, 3], [0.25, -1.0, 3.0]),
        ),
        (Amplitude(wave="ramp"), lambda t: t / 3),
        (
            Amplitude(wave="sine", period=7.0),
            lambda t: np.sin(2 * np.pi * (t - 1) / 7),
        ),
    ],
    ids=["table", "ramp", "sine"],
)
def test_amplitudes_between_load_steps(amplitude: Amplitude, exact: Any) -> None:
    t = np.linspace(1.0, 3.0, 9)
    found = evaluate_amplitude(amplitude, t, 3)
    np.testing.assert_allclose(found, exact(t), rtol=1e-15, atol=1e-15)
    # A straight line from the unloaded state.
    early = np.array([0.0, 0.25, 0.5])
    first = evaluate_amplitude(amplitude, early, 3)
    np.testing.assert_allclose(first, found[0] * early, rtol=1e-15)


def test_failed_path_reports_the_last_solved_load(tmp_path: Path) -> None:
    """A block pressed by 1 and pulled by 1.2 (t - 1), against friction of 0.5."""
    limit = 0.5 / 1.2
    m = bp.Model("towed")
    m.material("soft", young=10.0, poisson=0.0)
    kind: Any = {"material": "soft", "cell": "quadrilateral"}
    m.body("block", x=[0.0, 1.0, 2.0], y=[0.0, 1.0], **kind)
    m.pressure("block.top", 1.0)
    m.body_force("block", x=m.times(1.2, "tow"))
    m.contact("block.bottom", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.5)
    m.path(parameter="tow", tow=[0.0, 1.0], automatic={"smallest": 1e-4})
    m.to_toml(tmp_path / "towed.toml")
    run = bipot("run", "towed.toml", "--json", cwd=tmp_path)
    assert run.returncode == 1
    *steps, last = map(json.loads, run.stdout.splitlines())
    # To the smallest step, and the error that tol allows.
    assert limit - 1e-4 <= steps[-1]["load"] <= limit + 1e-9
    assert "the path ends at s = 1.416" in last["message"]
    kept = bp.load(tmp_path / "out" / "towed" / "result.h5")
    assert not kept.success
    assert kept.s is not None
    assert len(kept) == len(steps)
    text = bipot("run", "towed.toml", cwd=tmp_path).stderr
    assert "step 2: load 0.25, " in text


@pytest.mark.slow
def test_resumed_to_the_same_files(tmp_path: Path) -> None:
    settings = [word for setting in SLIDING for word in ("--set", setting)]
    resumed("two_blocks", "--out", "here", *settings, cwd=tmp_path)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("{smallest = 0.5, largest = 0.25}", "path.automatic: needs smallest <= first"),
        ("{first = 2.0}", "path.automatic.first: should be less than or equal to 1"),
        ("{slip = 0.0}", "path.automatic.slip: should be greater than 0"),
        ("{step = 1}", "path.automatic.step: unknown key"),
        ("3", "path.automatic: should be a table"),
    ],
)
def test_mistakes(setting: str, words: str) -> None:
    with refused(words):
        read("two_blocks", [f"path.automatic={setting}"])


@pytest.mark.slow
def test_the_error_of_the_mesh(tmp_path: Path) -> None:
    """For steps in between it equals that of the same load points; also by the command."""
    p1 = (*SLIDING, "mesh.element=P1", "mesh.n=2")
    case = made("two_blocks", *p1)
    result = case.solve()
    at = case.sampled(result.s)
    fixed = at.problem().solve(at.load, at.prescribed, tol=1e-12)
    errors = [discretisation_error(case, result, k) for k in range(len(result))]
    for k, error in enumerate(errors):
        other = discretisation_error(at, fixed, k)
        assert error.cells.tobytes() == other.cells.tobytes()
    command = ["run", "two_blocks", "--error", "--json"]
    for setting in p1:
        command += ["--set", setting]
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    *steps, _ = map(json.loads, run.stdout.splitlines())
    assert [step["error"] for step in steps] == [error.relative for error in errors]
