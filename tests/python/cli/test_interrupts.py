"""Ctrl-C and SIGTERM at chosen places of a run: messages, exit status and files."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from bipot_rs.files import export
from support.children import bipot, bipot_hit_at_import, bipot_with, child, strays

STEPS = 8
RUN = (
    f"run cyclic_cube --set mesh.n=2 --set path.steps={STEPS} --out here --json".split()
)
INT, TERM = signal.SIGINT, signal.SIGTERM


def left(cwd: Path) -> tuple[bool, int]:
    """Whether `result.h5` is complete, and its number of steps."""
    assert strays(cwd / "here") == []
    _, steps, attributes, _ = export.read_saved(cwd / "here" / "result.h5")
    return attributes["complete"], len(steps)


def hit(
    number: signal.Signals, times: int = 1, pause: float = 0.0
) -> Callable[..., None]:
    """A fault that sends signals to this process, the first time that it is called."""
    pending = list(range(times))

    def fault(*_: object) -> None:
        while pending:
            k = pending.pop(0)
            time.sleep(pause if k else 0.0)
            os.kill(os.getpid(), number)

    return fault


BODIES = "bipot_rs.fem.paraview:write_bodies"


@pytest.mark.parametrize(
    ("before", "number", "steps"),
    [
        ("bipot_rs.files.export:require", INT, 0),
        ("bipot_rs.scene.reading:read", TERM, 0),
        ("bipot_rs.scene.build:bodies", INT, 0),
        ("bipot_rs.scene.case:assemble", TERM, 0),
        ("bipot_rs._core:Condensed", INT, 0),
        ("bipot_rs._core:Path", TERM, 0),
        # All steps are solved by then, and all files are written whole.
        (BODIES, INT, STEPS),
        ("bipot_rs.files.series:_three", INT, STEPS),
    ],
)
@pytest.mark.quick_variants("*require*", "*Condensed*", "*write_bodies*")
def test_before_the_first_step_and_while_files_are_written(
    before: str, number: signal.Signals, steps: int, tmp_path: Path
) -> None:
    run = bipot_with(hit(number), before, *RUN, cwd=tmp_path)
    assert run.returncode == 128 + number
    assert run.stderr == ""
    *told, last = map(json.loads, run.stdout.splitlines())
    assert len(told) == steps
    assert last["message"].startswith("interrupted")
    assert left(tmp_path) == (False, steps)
    # After the last file the run has ended.
    if before == BODIES:
        ended = bipot_with(hit(INT), "bipot_rs.cli.run.job:replace", *RUN, cwd=tmp_path)
        assert ended.returncode == 0
        assert left(tmp_path) == (True, STEPS)


@pytest.mark.parametrize("number", [INT, TERM])
def test_between_steps(number: signal.Signals, tmp_path: Path) -> None:
    def fault(step: int, *_: object) -> None:
        if step == 3:
            os.kill(os.getpid(), number)

    row = "bipot_rs.contact.results.tables:make_row"
    run = bipot_with(fault, row, *RUN, cwd=tmp_path)
    assert run.returncode == 128 + number
    *steps, last = map(json.loads, run.stdout.splitlines())
    assert [step["step"] for step in steps] == list(range(3))
    assert last["steps"] == 3
    assert left(tmp_path) == (False, 3)
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert {"result.pvd", "steps.csv", "result_0002.vtu"} <= names
    with h5py.File(tmp_path / "here" / "result.vtkhdf") as file:
        assert file["VTKHDF/Steps"].attrs["NSteps"] == 3
        assert len(file["VTKHDF/Steps/Values"]) == 3


def test_an_earlier_result_is_replaced_by_load_steps_only(tmp_path: Path) -> None:
    assert bipot(*RUN, cwd=tmp_path).returncode == 0
    before = (tmp_path / "here" / "result.h5").read_bytes()
    run = bipot_with(hit(INT), "bipot_rs.scene.build:bodies", *RUN, cwd=tmp_path)
    assert run.returncode == 130
    assert "result.h5 is unchanged" in json.loads(run.stdout)["message"]
    assert (tmp_path / "here" / "result.h5").read_bytes() == before


def test_a_second_signal_does_not_wait_for_files(tmp_path: Path) -> None:
    # Two signals within a second count as one: some launchers send it twice.
    run = bipot_with(hit(INT, 2), BODIES, *RUN, cwd=tmp_path)
    assert (run.returncode, left(tmp_path)) == (130, (False, STEPS))
    before = (tmp_path / "here" / "result.h5").read_bytes()
    run = bipot_with(hit(INT, 2, 1.1), BODIES, *RUN, cwd=tmp_path)
    assert run.returncode == 130
    assert json.loads(run.stdout.splitlines()[-1])["message"] == "interrupted"
    assert strays(tmp_path / "here") == []
    assert (tmp_path / "here" / "result.h5").read_bytes() == before


def test_an_interrupt_that_python_cannot_raise(tmp_path: Path) -> None:
    """Python prints an exception in a finaliser and continues."""

    class Hit:
        def __del__(self) -> None:
            os.kill(os.getpid(), INT)

    at = "bipot_rs.scene.build:bodies"
    run = bipot_with(lambda *_: Hit(), at, *RUN, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (130, "")
    assert left(tmp_path) == (False, 0)


@pytest.mark.parametrize(
    ("module", "number"),
    [
        ("bipot_rs.cli.app", INT),
        ("bipot_rs.cli.run.job", INT),
        ("bipot_rs._core", INT),
        ("numpy", INT),
        ("h5py", TERM),
        ("meshio", INT),
        ("pydantic", INT),
    ],
)
@pytest.mark.quick_variants("bipot_rs._core-*")
def test_while_package_and_libraries_load(
    module: str, number: signal.Signals, tmp_path: Path
) -> None:
    run = bipot_hit_at_import(number, module, *RUN, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (128 + number, "")
    # The core is loaded when the run has begun, with its files and the last line of --json.
    if run.stdout:
        assert json.loads(run.stdout)["success"] is False
    if (tmp_path / "here").exists():
        assert left(tmp_path) == (False, 0)
    else:
        assert list(tmp_path.iterdir()) == []


def test_the_package_as_a_library_leaves_signals_alone(tmp_path: Path) -> None:
    code = """
import signal
before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
import bipot_rs.cli.entry
try:
    bipot_rs.cli.entry.call(["scenes"])
finally:
    after = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    print(before == after)
"""
    run = child(code, cwd=tmp_path)
    assert run.stdout.splitlines()[-1] == "True"


@pytest.mark.slow
def test_sigterm_while_metis_orders(tmp_path: Path) -> None:
    """METIS uses SIGTERM internally, and jumps from the thread that receives it."""
    code = """
import os, signal, threading, time
import numpy as np
from scipy import sparse
import bipot_rs as bp
came = []
signal.signal(signal.SIGTERM, lambda *_: came.append(1))
n = 26
line = sparse.diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)],
    offsets=[-1, 0, 1])
K = sparse.kronsum(sparse.kronsum(line, line), line).tocsr() + sparse.eye_array(n**3) * 0.1
B = sparse.eye_array(2, n**3, format="csr")
done = False
def send():
    while not done:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.0005)
sender = threading.Thread(target=send)
sender.start()
problem = bp.ContactProblem(K, B, gap=[0.0], mu=0.3)
done = True
sender.join()
assert came and problem.stats["seconds_order"] > 0.02, problem.stats
"""
    run = child(code, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
