"""The forecast of sizes, memory and time, before a scene is solved."""

import io
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.cli import progress as telling
from bipot_rs.cli.run import cost_forecast
from bipot_rs.scene import assemble, bodies, read
from support.lap_joint import lap_joint
from support.models_and_arrays import arguments

COUNTS = (
    *("bodies", "n_contact_dofs", "nnz_factor", "flops", "bytes_factor"),
    *("bytes_peak", "ordering"),
)


def model_of(scene: str, *settings: str) -> fem.Assembly:
    asked = read(scene, settings)
    return assemble(asked, bodies(asked)).model


@pytest.mark.parametrize(
    ("scene", "n"),
    # Two and three dimensions, two bodies; the last takes longer than the interval of signals.
    [
        ("pressed_block", 8),
        ("sheared_cube", 4),
        ("two_blocks", 4),
        ("sheared_cube", 13),
    ],
)
@pytest.mark.slow_variants("sheared_cube-13")
def test_forecast_comes_once_and_is_correct(scene: str, n: int) -> None:
    model = model_of(scene, f"mesh.n={n}")
    told: list[Any] = []
    problem = model.problem(on_forecast=told.append)
    (counts,) = told
    assert set(counts) == {*COUNTS, "engine", "engine_reason"}
    assert {name: problem.stats[name] for name in counts} == dict(counts)
    # The problem is the same without a forecast.
    assert model.problem().stats["flops"] == counts["flops"]
    with pytest.raises(TypeError, match="on_forecast is 3, expected a function"):
        model.problem(on_forecast=3)


def test_with_few_of_many_candidates() -> None:
    """Above 600 components only the candidates that touch are condensed."""
    model = model_of("sheared_cube", "mesh.n=14")
    told: list[Any] = []
    known = arguments(model)
    known["gap"] = np.where(np.arange(len(model.gap)) < 3, model.gap, 1.0)
    del known["coordinates"]
    problem = bp.ContactProblem(**known, working_set=True, on_forecast=told.append)
    assert problem.stats["working_set"] is not None
    assert told[-1]["n_contact_dofs"] == problem.stats["n_contact_dofs"]
    assert told[-1]["flops"] == problem.stats["flops"]


@pytest.mark.slow
def test_the_iterative_forecast_follows_the_iterations() -> None:
    """Bodies on each other take some ten times as many as one on a rigid plane: a factor of 2."""
    asked = read("sheared_cube", ["mesh.n=8"])
    case = assemble(asked, bodies(asked))
    works = []
    for model, *path in (
        (case.model, case.load, case.prescribed),
        lap_joint(2, symmetric=True),
    ):
        told: list[Any] = []
        problem = model.problem(
            engine="iterative", on_forecast=told.append, steps=len(path[-1])
        )
        krylov = sum(step.stats["krylov"] for step in problem.solve(*path))
        works.append(told[0]["flops"] / model.n / krylov)
    assert 0.5 < works[0] / works[1] < 2.0


def test_an_exception_ends_the_work_in_the_calling_thread() -> None:
    where = []

    def stop(_: Any) -> None:
        where.append(threading.current_thread())
        raise InterruptedError

    with pytest.raises(InterruptedError):
        model_of("sheared_cube", "mesh.n=8").problem(on_forecast=stop)
    assert where == [threading.current_thread()]


def test_more_work_takes_longer_and_more_cores_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("BIPOT_NUM_THREADS", "1")
    small = {"flops": 1e9, "n_contact_dofs": 100, "bodies": 1}
    alone = cost_forecast.seconds(small | {"flops": 1e12})
    assert alone > 100 * cost_forecast.seconds(small)
    # With the same unknowns on two bodies, the inverses are a quarter of the work.
    dense = {"flops": 0.0, "n_contact_dofs": 1000}
    halves = cost_forecast.seconds(dense | {"bodies": 2})
    assert halves == pytest.approx(cost_forecast.seconds(dense | {"bodies": 1}) / 4)
    monkeypatch.setenv("BIPOT_NUM_THREADS", "4")
    four = cost_forecast.seconds(small | {"flops": 1e12})
    assert four == pytest.approx(alone / 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "engine", "settings"),
    [
        ("sheared_cube", "direct", ["mesh.n=17"]),
        ("two_blocks", "direct", ["mesh.n=16"]),
        ("two_blocks", "direct", ["mesh.n=14", 'contact.0.pairing="mortar"']),
        ("pressed_block", "direct", ["mesh.n=128"]),
        ("sheared_cube", "iterative", ["mesh.n=28"]),
        ("two_blocks", "iterative", ["mesh.n=20"]),
        ("two_blocks", "iterative", ["mesh.n=20", 'contact.0.pairing="mortar"']),
    ],
)
def test_the_memory_of_a_run_is_what_check_says(
    scene: str, engine: str, settings: list[str], tmp_path: Path
) -> None:
    """Peak of the process, within a sixth: the heap keeps pieces, and libraries differ."""
    options = [word for setting in settings for word in ("--set", setting)]

    def answer(command: str, *more: str) -> Any:
        words = ["-m", "bipot_rs", command, scene, "--json", *options, *more]
        out = subprocess.check_output([sys.executable, *words], cwd=tmp_path)
        return json.loads(out.splitlines()[-1])

    told = answer("check", "--set", f"solver.engine={engine}")["forecast"]
    assert told["engine"] == engine
    peak = 2**20 * answer("run", "--engine", engine)["peak_mb"]
    assert 5 / 6 < told["bytes_run"] / peak < 6 / 5


def test_a_run_prints_the_forecast_before_the_first_step(bipot: Any) -> None:
    run = ("run", "sheared_cube", "--set", "mesh.n=3")
    lines = bipot(*run)[2].splitlines()
    assert lines[0] == "Cube pressed onto a rigid plane, then sheared"
    heads = "bodies contacts sizes engine memory time"
    assert [line.split()[0] for line in lines[1:7]] == heads.split()
    assert lines[7].startswith("load step 1 of 2")
    # With --json nothing else is printed.
    assert bipot(*run, "--json")[2] == ""


def test_meshes_of_files_are_counted_after_reading(
    monkeypatch: pytest.MonkeyPatch, repository: Path
) -> None:
    """Their size is unknown before; then their own cells count, as those of boxes do."""
    file = repository / "examples" / "scenes" / "gmsh_two_bodies.toml"
    asked = read(str(file))
    meshed = bodies(asked)
    cells = sum(body.mesh.nelements for body in meshed)
    entries = 6 * cells * (3 * 2) ** 2
    monkeypatch.setattr(cost_forecast, "available", lambda: entries - 1)
    cost_forecast.fits(asked)
    with pytest.raises(MemoryError, match="use fewer cells"):
        cost_forecast.fits(asked, meshed)
    monkeypatch.setattr(cost_forecast, "available", lambda: entries)
    cost_forecast.fits(asked, meshed)
    for settings in ([], ["mesh.element=P1"], ["mesh.element=P2"], ["mesh.element=Q2"]):
        for name in ("pressed_block", "sheared_cube"):
            box = read(name, ["mesh.n=3", *settings])
            assert cost_forecast.assembly(box) == cost_forecast._measure_entries(
                bodies(box)
            )


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


def wait_for(condition: Callable[[], bool]) -> None:
    limit = time.monotonic() + 10
    while not condition() and time.monotonic() < limit:
        time.sleep(0.01)
    assert condition()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of a phase, which stands."""
    seconds = [100.0]
    monkeypatch.setattr(telling, "monotonic", lambda: seconds[0])
    return seconds


def test_a_terminal_shows_that_a_long_phase_is_running(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its name, its clock, its share and the rest are drawn again without a new step."""
    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    with telling.Progress(6, 2, quiet=False) as progress:
        progress.phase("condense")
        progress.forecast(40.0)
        clock[0] += 10.0
        progress.bar.refresh()
        began = screen.getvalue()
        assert "condense" in began
        assert "25 %, about 30 s left" in began
        # The clock without a remaining time: the phases differ too much.
        assert len(re.findall(r"-:--|\d:\d\d:\d\d", began.splitlines()[-1])) == 1
        # Ten times a second, while the core works without holding the interpreter.
        wait_for(lambda: screen.getvalue() != began)
        clock[0] += 30.0
        # A forecast that was too short is not a share of 100 %.
        wait_for(lambda: "longer than expected" in screen.getvalue())
        progress.phase("solve")
        progress.bar.refresh()
        assert "expected" not in screen.getvalue().rpartition("solve")[2]


def test_lines_break_the_silence_without_a_terminal(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line after each interval with nothing else, with the share of the forecast."""
    screen = io.StringIO()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr(telling, "SILENCE", 0.05)
    with telling.Progress(6, 2, quiet=False) as progress:
        progress.phase("condense")
        progress.forecast(40.0)
        clock[0] += 10.0
        told = "condense: about 10 s so far, 25 %, about 30 s left\n"
        wait_for(lambda: screen.getvalue().endswith(told))
        # A step is a line: the clock has not moved since.
        progress.advance("", "load step 1 of 2")
        time.sleep(0.1)
        assert screen.getvalue().endswith(told + "load step 1 of 2\n")


def test_lines_about_a_phase_begin_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that runs as soon as it starts knows the phase and when it began."""
    seen = []

    class AtOnce:
        def __init__(self, **_: object) -> None:
            pass

        def start(self) -> None:
            seen.append(progress.current)

    monkeypatch.setattr(telling, "Thread", AtOnce)
    monkeypatch.setattr(telling, "monotonic", lambda: 7.0)
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with telling.Progress(6, 2, quiet=False) as progress:
        progress.phase("mesh")
        progress.phase("condense")
    assert seen == [("mesh", 7.0)]


@pytest.mark.parametrize(
    ("poisson", "engine", "named"),
    [
        (0.4995, "iterative", True),
        (0.4995, "direct", False),
        (0.49, "iterative", False),
    ],
)
def test_a_nearly_incompressible_body_is_named_before_it_stalls(
    poisson: float, engine: str, named: bool
) -> None:
    """Only if the iterative engine would solve, and only above the ratio."""
    ratio = f"material.steel.poisson={poisson}"
    model = model_of("sheared_cube", "mesh.n=3", ratio)
    said = cost_forecast.describe_stalling({"engine": engine}, model)
    assert bool(said) == named
    assert all("Use engine = " in line for line in said)
