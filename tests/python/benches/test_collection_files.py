"""The files of the collection: written twice, checked, and damaged; answers of load paths."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from collection import manifest, rules
from collection.catalogue import PATHS
from collection.checks import check
from collection.reference import refine
from collection.rules import FILES, RULES
from collection.steps import steps
from collection.system import system
from collection.write import generate

import bipot_rs as bp
from support.places import ROOT

DATA = ROOT / "tests" / "data" / "collection"
R, U = "/solution/r", "/solution/u"
NAMES = ["block_2d_3", "block_3d_4_turning", "several_2d_3", "none_2d_6_clamped"]
# The last has entries that are zero by symmetry: their digits would show the order of sums.
NAMES += ["floating_3d_16_cyclic", "none_2d_13_sliding"]
LARGER = ["pair_3d_49_mortar", "block_3d_9_release"]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("collection")
    generate(folder, NAMES)
    return folder


@pytest.mark.slow
def test_two_runs_write_the_same_bytes(tmp_path: Path) -> None:
    """Another process, with another number of threads."""
    first, again = tmp_path / "first", tmp_path / "again"
    generate(first, [*NAMES, *LARGER])
    names = ("BIPOT_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
    command = [sys.executable, "-m", "collection", str(again), "--only"]
    told = subprocess.check_output(
        [*command, ",".join([*NAMES, *LARGER])],
        env=os.environ | dict.fromkeys(names, "2"),
        cwd=ROOT / "benches",
        text=True,
    )
    files = sorted(path.name for path in first.iterdir())
    assert files == sorted(path.name for path in again.iterdir())
    for name in files:
        assert (again / name).read_bytes() == (first / name).read_bytes()
    assert told.count("contacts") == len(files) - 2
    # Numbers are rounded to 1.1e-16; conditions are below 100.
    assert max(it.error for it in check(first)) <= 1e-14


@pytest.mark.slow
def test_stored_files_are_those_of_the_generator(written: Path) -> None:
    """Other machines may round W and q in the last digits; references follow them."""
    stored = sorted(DATA.glob("*.hdf5"))
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 300_000
    assert len(stored) == 15
    for path in stored:
        old, new = (bp.fclib.read(p) for p in (path, written / path.name))
        # Conditions are below 1e3, entries are rounded to 1e-16.
        close = {"rtol": 0, "atol": 1e-13 * np.abs(old.q).max()}
        np.testing.assert_allclose(old.q, new.q, **close)
        first, two = (bp.fclib.read_solution(p) for p in (path, written / path.name))
        if first is None:
            assert two is None
        elif not path.name.startswith("none"):
            close = {"rtol": 0, "atol": 1e-12 * np.abs(first.r).max()}
            np.testing.assert_allclose(first.r, two.r, **close)


@pytest.mark.parametrize("folder", ["stored", "written"])
def test_the_check_passes(folder: str, written: Path) -> None:
    checked_files = check(DATA if folder == "stored" else written)
    assert checked_files
    assert [it for it in checked_files if it.faults] == []
    # Numbers are rounded to 1.1e-16; conditions are below 100.
    assert max(it.error for it in checked_files) <= 1e-14


def test_every_solver_answer_is_near_a_reference(written: Path) -> None:
    for row in manifest.read(written):
        problem = bp.fclib.read(written / row.file)
        solution = problem.solve(tol=1e-12)
        stored_answer = bp.fclib.read_solution(written / row.file)
        if stored_answer is None:
            assert solution.outcome is bp.Outcome.NO_EQUILIBRIUM
        elif row.determined != "u":
            answers = [stored_answer, *bp.fclib.read_guesses(written / row.file)]
            size = max(np.abs(stored_answer.r).max(), 1e-300)
            # The tolerance times the condition of W, below 1e3.
            nearest = min(np.abs(solution.reaction - a.r).max() for a in answers)
            assert nearest <= 1e-9 * size


Change = Callable[[h5py.File], None]


def _scaled(name: str, by: float) -> Change:
    def change(file: h5py.File) -> None:
        file[name][...] *= by

    return change


def _without(name: str) -> Change:
    return lambda file: file.__delitem__(name)


def _entry(name: str, at: int, value: float) -> Change:
    def change(file: h5py.File) -> None:
        file[f"/solution/{name}"][at] = value

    return change


def _consistent(file: h5py.File) -> None:
    """Reactions that are wrong by 1e-11, with the u that belongs to them."""
    size = int(file["/fclib_local/W/m"][0])
    W = file["/fclib_local/W/x"][:].reshape(size, size)
    r = file["/solution/r"][:] * (1 + 1e-11)
    file["/solution/r"][...] = r
    u = W @ r + file["/fclib_local/vectors/q"][:]
    keep = file["/solution/u"][:] == 0
    file["/solution/u"][...] = np.where(keep, 0, u)


def _second_answer_as_first(file: h5py.File) -> None:
    for name in ("u", "r"):
        file[f"/guesses/1/{name}"][...] = file[f"/solution/{name}"][:]


TURNING, NONE = "block_3d_4_turning-0001", "none_2d_6_clamped-0002"
WRONG = {
    "reaction": ("block_2d_3-0001", _scaled(R, 1 + 1e-11), "its error is about"),
    "displacement": ("block_2d_3-0001", _scaled(U, 1 + 1e-11), "u is not W r"),
    "consistent": ("block_2d_3-0002", _consistent, "its error is about"),
    "tension": ("block_2d_3-0002", _entry("r", 0, -1e-3), "pulls"),
    "penetration": ("block_2d_3-0003", _entry("u", 0, -1e-6), "penetrates"),
    "friction": ("block_2d_3-0002", _entry("r", 1, 1.0), "too large"),
    "open": ("block_2d_3-0002", _entry("u", 0, 1e-9), "pressed contact is open"),
    "direction": (TURNING, _entry("u", 7, 1e-3), "oppose"),
    "status": (TURNING, _entry("u", 1, 1e-30), "too little"),
    "balance": ("floating_3d_16_cyclic-0000", _scaled(R, 1 + 1e-11), "do not balance"),
    "missing": ("block_2d_3-0002", _without("/solution"), "0 answers, expected 1"),
    "twice": ("several_2d_3-0000", _second_answer_as_first, "answers are the same"),
    "motion": ("none_2d_13_sliding-0002", _scaled("/guesses/1/l", -1), "dual cone"),
    "forces": (NONE, _scaled("/guesses/1/r", -1), "normal reactions"),
    "no proof": (NONE, _without("/guesses"), "proof is missing"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_reference_is_found(case: str, written: Path, tmp_path: Path) -> None:
    name, change, words = WRONG[case]
    rows = manifest.read(written)
    rows_of_path = [row for row in rows if row.path == name.partition("-")[0]]
    manifest.write(tmp_path, rows_of_path)
    for row in rows_of_path:
        shutil.copy(written / row.file, tmp_path)
    with h5py.File(tmp_path / f"{name}.hdf5", "r+") as file:
        change(file)
    (wrong,) = (it for it in check(tmp_path) if it.faults)
    assert wrong.file == f"{name}.hdf5"
    assert words in "; ".join(wrong.faults)


@pytest.mark.slow
def test_a_damaged_file_is_a_fault(written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(written, folder)
    damaged, gone = (folder / f"block_2d_3-000{k}.hdf5" for k in (4, 5))
    damaged.write_bytes(b"not HDF5")
    gone.unlink()
    wrong = {it.file: it.faults for it in check(folder) if it.faults}
    assert set(wrong) == {damaged.name, gone.name}
    assert "cannot be read as HDF5" in wrong[damaged.name][0]


def test_the_rules_are_on_the_site_and_in_the_folder(written: Path) -> None:
    page = (ROOT / "docs" / "collection.md").read_text(encoding="utf-8")
    assert page.endswith(FILES + "\n" + RULES)
    for name, entry in PATHS.items():
        assert f"\n| {name} | {entry.family} | {entry.about} |\n" in page
    stored = (DATA / "README.md").read_text(encoding="utf-8")
    assert stored == rules.page(manifest.read(DATA))
    text_of_page = (written / "README.md").read_text(encoding="utf-8")
    assert text_of_page.endswith(FILES + "\n" + RULES)
    assert (
        "| several_2d_3 | several answers | 2 | 3 | 3 | 1 to 3 | local |"
        in text_of_page
    )


def test_a_path_without_its_answer_is_an_error() -> None:
    """A load that the contacts cannot carry, without a proof."""
    path = replace(PATHS["none_2d_13_sliding"].make(), proof=None)
    with pytest.raises(bp.NotConvergedError):
        list(steps(path))


def test_without_statuses_near_there_is_no_reference() -> None:
    # A pull on a body that contact alone holds.
    free = bp.ReducedProblem(
        np.zeros((2, 2)), [[0.0, 0.0]], 0.3, rigid=(np.eye(2), [1.0, 0.0])
    )
    with pytest.raises((ArithmeticError, RuntimeError)):
        refine(system(free), np.ones((1, 2)), np.zeros(2), np.array([2], np.int8))


def whole(path: Any, tol: float) -> bp.Result:
    """The answer of `ContactProblem` for all load steps of a path."""
    names = ("gap", "mu", "fixed", "frame", "gaps")
    known = {name: getattr(path, name) for name in names}
    problem = bp.ContactProblem(path.K, path.B, **known, engine="direct")
    return problem.solve(path.load, path.prescribed, tol=tol)


def test_a_path_is_that_of_the_whole_problem() -> None:
    """Slip history enters each file: `ContactProblem.solve` finds the same reactions."""
    path = PATHS["block_2d_9_cyclic"].make()
    for step, step_of_path in zip(steps(path), whole(path, 1e-12), strict=True):
        (answer,) = step.answers
        # The tolerance of the solver times the condition of W, below 100.
        size = 1e-10 * np.abs(answer.r).max()
        np.testing.assert_allclose(answer.r, step_of_path.reaction, rtol=0, atol=size)
        np.testing.assert_array_equal(answer.status, step_of_path.status)


def test_frames_of_each_step_are_those_of_the_load_path() -> None:
    """A roller that rolls: histories carried as `ContactProblem.solve` carries them."""
    path = PATHS["roller_2d_41"].make()
    expected = whole(path, 1e-13)
    assert expected[1].status.min() < bp.Status.STICK
    # η is 1e-13; the errors are larger by the condition of the contacts.
    size, shift = np.abs(expected.reaction).max(), np.abs(expected.slip).max()
    for of_path, step in zip(steps(path), expected, strict=True):
        (answer, *_) = of_path.answers
        assert np.abs(answer.r - step.reaction).max() <= 1e-11 * size
        assert np.abs(answer.u[:, 1:] - step.slip).max() <= 1e-11 * shift
