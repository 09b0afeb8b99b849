"""Interrupted and resumed load paths: bitwise the results of an uninterrupted run."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import bipot_rs as bp
from support import children
from support.bars import bar_problem, pulled
from support.children import bipot, bipot_with
from support.comparisons import FIELDS, bits, content

SCENE = ("run", "cyclic_cube", "--set", "mesh.n=3", "--set", "path.steps=9")
HERE = ("--out", "here")


def resumed(cwd: Path, *more: str) -> Any:
    return bipot(*SCENE, *HERE, "--resume", *more, cwd=cwd)


def test_from_the_result_of_an_error(tmp_path: Path) -> None:
    def same(one: Any, other: Any) -> bool:
        return bits(one, other, (*FIELDS, "work"))

    problem, load = bar_problem(12)
    path = pulled(load, 30 * np.sin(0.3 * np.arange(9)))
    whole = problem.solve(path)
    # Enough iterations for the first three steps, but not for one of the others.
    limit = int(whole.iterations[:3].max())
    assert whole.iterations[3:].max() > limit
    with pytest.raises(bp.NotConvergedError) as stopped:
        problem.solve(path, max_iterations=limit)
    reached = stopped.value.result
    k = len(reached)
    assert 3 <= k < 9
    reached.save(tmp_path / "reached.h5")
    assert same(reached, whole[:k])
    assert same(problem.solve(path[k:], start=reached), whole[k:])
    again = bp.load(tmp_path / "reached.h5")
    assert same(bar_problem(12)[0].solve(path[k:], start=again), whole[k:])
    with pytest.raises(TypeError, match="start is a tuple, expected a Result, one of"):
        problem.solve(path, start=whole[:1])  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without interruption."""
    cwd = tmp_path_factory.mktemp("whole")
    assert bipot(*SCENE, *HERE, cwd=cwd).returncode == 0
    return cwd / "here"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """The same run, interrupted after four load steps."""
    assert interrupted(4, cwd=tmp_path).returncode == 130
    return tmp_path / "here"


ROW = "bipot_rs.contact.results.tables:make_row"


def stop_at(at: int) -> Callable[..., None]:
    """A fault that interrupts a run in one of its load steps."""

    def fault(step: int, *_: object) -> None:
        if step == at:
            raise KeyboardInterrupt

    return fault


def interrupted(after: int, *more: str, cwd: Path) -> Any:
    return bipot_with(stop_at(after), ROW, *SCENE, *HERE, *more, cwd=cwd)


@pytest.mark.slow
def test_resumed_twice_to_the_same_files(whole: Path, broken: Path) -> None:
    cwd = broken.parent
    assert interrupted(7, "--resume", cwd=cwd).returncode == 130
    run = resumed(cwd, "--json")
    assert run.returncode == 0, run.stderr
    *told, last = map(json.loads, run.stdout.splitlines())
    assert [line["step"] for line in told] == [7, 8]
    assert (last["steps"], last["message"]) == (9, "solved")
    assert content(broken / "result.h5") == content(whole / "result.h5")
    names = sorted(path.name for path in whole.iterdir())
    assert sorted(path.name for path in broken.iterdir()) == names
    for name in names:
        if name.endswith((".vtu", ".pvd")):
            assert (broken / name).read_bytes() == (whole / name).read_bytes()
    tables = [
        [line.split(",")[:-1] for line in (folder / "steps.csv").read_text().split()]
        for folder in (broken, whole)  # the last column is seconds
    ]
    assert tables[0] == tables[1]


def test_a_path_on_a_working_set_is_resumed_to_the_same_files(tmp_path: Path) -> None:
    """The working set is stored: contacts that have opened again are still in it."""
    m = bp.Model("A block pressed onto a ball")
    m.material("soft", young=1.0, poisson=0.3)
    sides = {"x": np.linspace(-1.0, 1.0, 321), "y": np.linspace(0.0, 0.2, 3)}
    m.body("block", material="soft", cell="quadrilateral", **sides)
    ball = {"point": [-0.2, -4.0], "radius": 4.0}
    m.obstacle("ball", cylinder=ball, move={"x": m.times(0.4, "way")})
    m.support("block.top", x=0, y=-2e-3)
    m.contact("block.bottom", against="ball", mu=0.3)
    m.path(way=[0.0, 0.4, 0.8, 1.0])
    m.to_toml(tmp_path / "ball.toml")
    step = bp.load(children.resumed("ball.toml", "--out", "here", cwd=tmp_path))[1]
    assert step.working_set is not None
    # Larger than the initial set of a path that starts from this state alone.
    assert len(step.working_set) > (step.status > 0).sum() + 12


@pytest.mark.slow
def test_problems_of_a_resumed_path(broken: Path) -> None:
    run = resumed(broken.parent, "--fclib")
    assert run.returncode == 0, run.stderr
    files = sorted(broken.glob("problem-*.hdf5"))
    assert len(files) == 9
    for path, step in zip(files, bp.load(broken / "result.h5"), strict=True):
        problem = bp.fclib.read(path)
        assert isinstance(problem, bp.ReducedProblem)
        # The scene's tolerance, and the rounding of W made anew.
        assert problem.residual(step.reaction) <= 1.01 * step.tolerance + 1e-14
    assert "without --resume" in resumed(broken.parent, "--fclib").stderr


@pytest.mark.slow
def test_a_new_run_reports_an_unfinished_one(broken: Path) -> None:
    looked = bipot("info", "here", cwd=broken.parent)
    assert "4 load steps of 9" in looked.stdout
    told = "4 load steps of this run; it starts again from the beginning, --resume"
    assert told in bipot(*SCENE, *HERE, cwd=broken.parent).stderr
    # The result is complete now; and a run with other settings cannot be resumed.
    for more in ([], ["--tol", "1e-9"]):
        quiet = bipot(*SCENE, *more, *HERE, cwd=broken.parent)
        assert quiet.returncode == 0
        assert "left off" not in quiet.stderr


def test_a_resumed_run_reports_its_start_and_its_end(broken: Path) -> None:
    run = resumed(broken.parent)
    assert run.returncode == 0
    assert "continuing after 4 load steps" in run.stderr
    looked = bipot("info", "here", cwd=broken.parent)
    assert "9 load steps\n" in looked.stdout
    before = (broken / "result.h5").read_bytes()
    run = resumed(broken.parent)
    assert run.returncode == 0
    assert "already complete" in run.stderr
    assert (broken / "result.h5").read_bytes() == before


def test_another_run_is_refused(broken: Path) -> None:
    before = (broken / "result.h5").read_bytes()
    for arguments, words in (
        (("--set", "contact.0.mu=0.31"), "belongs to another scene"),
        (("--tol", "1e-9"), "solved with tol 1e-12, this run uses 1e-09"),
        (("--method", "uzawa"), "method 'auto', this run uses 'uzawa'"),
    ):
        run = resumed(broken.parent, "--json", *arguments)
        assert run.returncode == 2
        (last,) = map(json.loads, run.stdout.splitlines())
        assert words in last["message"]
        assert "\n" not in last["message"]
        assert (broken / "result.h5").read_bytes() == before


def test_files_that_cannot_be_resumed(broken: Path) -> None:
    def refusal() -> str:
        run = resumed(broken.parent)
        assert (run.returncode, run.stdout) == (2, "")
        told = str(run.stderr.splitlines()[-1])
        assert told.startswith("bipot: ")
        return told

    file = broken / "result.h5"
    kept = broken / "kept.h5"
    shutil.copy(file, kept)
    for change, words in (
        (lambda f: f.attrs.update(package="0.0.1"), "version 0.0.1 of bipot_rs"),
        (
            lambda f: f["contacts/gap"].write_direct(np.full(16, 1.0)),
            "gap of its contacts differs",
        ),
    ):
        with h5py.File(file, "r+") as altered:
            # A file without a checksum, as other programs may write.
            del altered.attrs["sealed"]
            change(altered)
        assert words in refusal()
        shutil.copy(kept, file)
    with h5py.File(file, "r+") as damaged:
        damaged.attrs["package"] = "0.0.1"
    # Writing after the checksum of the file makes it invalid.
    assert re.search("checksum|its end is missing", refusal())
    bp.load(kept).save(file)
    assert "does not name its scene" in refusal()
    file.write_bytes(b"nothing of the kind")
    assert "cannot be read" in refusal()
    file.unlink()
    assert "cannot resume: there is no" in refusal()


@pytest.mark.parametrize("place", ["scene.build:bodies", "scene.case:assemble"])
@pytest.mark.quick_variants("scene.build:bodies")
def test_a_file_without_contacts_is_resumed(place: str, tmp_path: Path) -> None:
    """An interrupt before assembly leaves a result without steps and contacts."""
    scene = ("run", "cyclic_cube", "--set", "mesh.n=2", "--set", "path.steps=3")
    begun = bipot_with(stop_now, f"bipot_rs.{place}", *scene, *HERE, cwd=tmp_path)
    assert begun.returncode == 130
    file = tmp_path / "here" / "result.h5"
    assert len(bp.load(file)) == 0
    run = bipot(*scene, *HERE, "--resume", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert bipot(*scene, "--out", "whole", cwd=tmp_path).returncode == 0
    assert content(file) == content(tmp_path / "whole" / "result.h5")


def stop_now(*_: object) -> None:
    raise KeyboardInterrupt
