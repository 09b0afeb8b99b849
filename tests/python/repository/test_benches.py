"""Tables that the benches write, results of the peers, and their comparison."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import compare_tractions
import fclib
import iterations
import iterative_file
import numpy as np
import pytest
import scaling
import speed_against_error
import tables
import tuning
import whole_job
from peers import commands
from scipy import sparse

PAGE = """before | kept |
<!-- one, written by benches/one.py -->
| old |
<!-- end of one -->
between, \\1 and \\g<0> kept
<!-- two, written by benches/two.py -->
<!-- end of two -->
after
"""


def test_a_table_replaces_only_what_is_between_its_markers(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text(PAGE, encoding="utf-8")
    tables.rewrite(page, "one", tables.table(("a", "b"), [("1 \\1", "2")]))
    tables.rewrite(page, "two", "text")
    tables.rewrite(page, "two", "text")
    new = page.read_text(encoding="utf-8")
    assert new == PAGE.replace(
        "| old |", "| a | b |\n|---|---|\n| 1 \\1 | 2 |"
    ).replace("two.py -->\n", "two.py -->\ntext\n")
    assert [file.name for file in tmp_path.iterdir()] == ["README.md"]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="1 cells below a head of 2"):
        tables.table(("a", "b"), [("1",)])


def test_fitted_constants_are_found_and_changed() -> None:
    constants = {constant.name: constant for constant in tuning.rust_constants()}
    assert len(constants) > 60
    assert constants["bipot_rs::solver::tuning::gain"].scaled(0.5) == "0.15"
    assert constants["bipot_rs::path::tuning::all_candidates_above"].scaled(2.0) == "6"
    constants |= {constant.name: constant for constant in tuning.python_constants()}
    assert constants["bipot_rs.contact.tuning.SIDES_TRIED"].scaled(0.5) == "2048"
    assert constants["bipot_rs.petsc.tuning.SMOOTHED_TO"].set == "petsc"
    for constant in constants.values():
        half, twice = float(constant.scaled(0.5)), float(constant.scaled(2.0))
        assert abs(half) < abs(twice)
        assert constant.set in tuning.RUNS


@pytest.mark.parametrize("page", ["README.md", "benches/README.md"])
def test_the_pages_have_the_markers(repository: Path, page: str) -> None:
    """Each table of a page is between two markers that its program names."""
    text = (repository / page).read_text(encoding="utf-8")
    marks = re.findall(r"<!-- (.*), written by (\S+) -->", text)
    assert marks
    for name, program in marks:
        assert "\nnew\n" in tables.replaced(text, name, "new")
        assert f'"{name}"' in (repository / program).read_text("utf-8")


def test_make_bench_runs_all_that_write(repository: Path) -> None:
    page = (repository / "benches" / "README.md").read_text(encoding="utf-8")
    recipe = (repository / "Makefile").read_text("utf-8").split("bench-full:")[-1]
    recipe = recipe.split("\n\n")[0]
    for program in set(re.findall(r", written by (\S+) -->", page)):
        assert f"$(PY) {program}" in recipe


def test_the_csv_file_gives_the_table(repository: Path) -> None:
    """The rows of the page are those of its CSV file."""
    page = (repository / "benches" / "README.md").read_text(encoding="utf-8")
    rows = tables.read_rows(tables.RESULTS / whole_job.SHEET)
    assert rows
    for row in rows:
        assert "| " + " | ".join(whole_job.cells(row)) + " |" in page
    first = (repository / "README.md").read_text(encoding="utf-8")
    assert whole_job.short(rows) in first
    assert len(first.splitlines()) <= 150


@pytest.fixture(scope="module")
def answers() -> dict[str, commands.Run]:
    peer = commands.Peer("SciPy", "with_scipy.py", "scipy, skfem", 1e-9, "").find()
    assert peer.python
    return {
        "ours": commands.Bipot().run("sheared_cube", 4, 1),
        "peer": peer.run("sheared_cube", 4, 1),
    }


@pytest.mark.slow
def test_results_of_programs_have_one_form(answers: dict[str, commands.Run]) -> None:
    for run in answers.values():
        assert run.dofs == 3 * 5**3
        assert run.R.shape == run.v.shape == (2, 25, 3)
        assert 0 < run.job <= run.process
        assert run.later is not None
        assert 0 < run.later < run.job
        assert run.peak_mb > 20  # a Python with NumPy


def test_programs_agree(answers: dict[str, commands.Run]) -> None:
    ours = answers["ours"]
    reference = {key: getattr(ours, key) for key in ("x", "area", "mu", "R", "v")}
    error, wrong = compare_tractions.compare(answers["peer"], reference)
    # The peer stops at 1e-9 of the largest force; W's condition adds a digit at most.
    assert error <= 1e-8
    assert wrong == 0


@pytest.mark.slow
def test_a_wrong_answer_is_marked(answers: dict[str, commands.Run]) -> None:
    ours, peer = answers["ours"], answers["peer"]
    reference = {key: getattr(ours, key) for key in ("x", "area", "mu", "R", "v")}
    # The node in the middle of the face, which sticks, is taken off the plane.
    R, v = peer.R.copy(), peer.v.copy()
    R[-1, 12], v[-1, 12] = 0.0, (1e-3, 0.0, 0.0)
    spoilt = commands.Run(**(vars(peer) | {"R": R, "v": v}))
    error, wrong = compare_tractions.compare(spoilt, reference)
    assert error > 1e-3
    assert wrong == 1
    row = dict.fromkeys(whole_job.COLUMNS, "") | {
        "error": error,
        "wrong_statuses": wrong,
    }
    assert not whole_job.trusted(row)


def test_statuses_on_a_border_are_not_compared() -> None:
    """A node at its friction limit that does not move may have status slip or stick."""
    R = np.array([[[1.0, 0.3], [1.0, 0.3], [1.0, 0.1], [0.0, 0.0], [1.0, 0.0]]])
    v = np.array([[[0.0, 0.0], [0.0, -1.0], [0.0, 0.0], [1.0, 0.5], [0.0, 0.0]]])
    mu = np.array([0.3, 0.3, 0.3, 0.3, 0.0])
    status, clear = compare_tractions.statuses(R, v, mu)
    assert status[0, 1:].tolist() == [1, 2, 0, 1]
    assert clear[0].tolist() == [False, True, True, True, True]


@pytest.mark.slow
def test_a_peer_without_its_package_names_it(repository: Path) -> None:
    peers = repository / "benches" / "peers"
    # An isolated Python sees neither package.
    needs = {"getfem": "getfem", "siconos": "siconos", "petsc": "petsc4py"}
    for script, package in needs.items():
        code = "import sys, runpy; sys.path.insert(0, %r); sys.modules[%r] = None; "
        code += "sys.argv = ['x', 'sheared_cube', '3']; "
        code += "runpy.run_path(%r, run_name='__main__')"
        name = str(peers / f"with_{script}.py")
        run = subprocess.run(
            [sys.executable, "-c", code % (str(peers), package, name)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 1
        assert run.stderr.strip() == f"{package} is not installed"


def test_a_row_of_iterations_counts_those_of_the_iterative_engine() -> None:
    row = iterations.row("two blocks", "small", iterations.blocks(6, 6, 10.0))
    assert row["solved by"] == "iterative"
    assert row["residual"] <= iterations.TOL
    assert 0 < row["steps"] < row["Krylov"]
    assert row["contacts"] == 49


def test_the_slabs_of_petsc_are_the_system_of_bipot_rs(tmp_path: Path) -> None:
    """The rows of two ranks together, for displacements of the last load step."""
    case, load = iterative_file.assembled((2, 3, 2))
    path, model = tmp_path / "slabs.npz", case.model
    dofs = iterative_file.write_slabs(path, case, load, 2)
    u = np.random.default_rng(1).standard_normal(model.n)
    u[model.fixed] = case.prescribed[-1]
    imbalance, v = [], []
    with np.load(path) as slabs:
        for rank in range(2):
            names = ("data", "indices", "indptr", "forces", "contacts")
            *csr, forces, contacts = (slabs[f"{name}.{rank}"] for name in names)
            K = sparse.csr_array(tuple(csr), shape=(forces.shape[1], len(dofs)))
            first = sum(map(len, imbalance))
            imbalance.append(K @ u[dofs] - forces[-1])
            v.append(u[dofs][first + contacts[:, None] + np.arange(3)])
    expected = (model.K @ u)[dofs]
    # Sums of some 80 terms in another order.
    tolerance = 1e-13 * abs(model.K).sum(axis=1).max()
    np.testing.assert_allclose(np.concatenate(imbalance), expected, atol=tolerance)
    np.testing.assert_array_equal(np.concatenate(v).ravel(), model.B @ u)


def test_rows_measured_again_replace_the_old_ones() -> None:
    def row(scene: str, n: int | str, program: str) -> dict[str, object]:
        return {"scene": scene, "n": n, "program": program}

    old = [
        row("sheared_cube", "9", "bipot_rs"),
        row("sheared_cube", "9", "SciPy"),
        row("two_blocks", "8", "bipot_rs"),
    ]
    new = [row("pressed_block", 32, "bipot_rs"), row("sheared_cube", 9, "bipot_rs")]
    assert whole_job.merged(old, new) == [new[0], new[1], old[2]]


def test_seconds_of_a_peer_are_predicted_from_its_slope() -> None:
    history = [(100, 1.0, 1), (200, 4.0, 2)]
    # Twice the unknowns took four times as long: sixteen seconds next.
    for recorded_times, scene, seconds in (
        (history, "sheared_cube", 16.0),
        (history[:1], "sheared_cube", 16.0),
        (history[:1], "pressed_block", 8.0),
    ):
        seconds_predicted = whole_job.predicted(recorded_times, 400, scene)
        assert seconds_predicted == pytest.approx(seconds, rel=1e-12)


def test_csv_files_with_and_without_machine_give_tables() -> None:
    """`--again` with the stored CSV files, and with older ones without a machine."""
    rows = tables.read_rows(tables.RESULTS / whole_job.SHEET)
    assert whole_job.written(rows).count("\n| ") == len(rows) + 1
    assert "Expected: " in scaling.written(
        tables.read_rows(tables.RESULTS / scaling.SHEET)
    )
    for row in rows:
        row.pop("machine", None)
    rows[0]["machine"] = "one, 2 cores"
    assert whole_job.written(rows).startswith(
        "one, 2 cores; machine not recorded, load "
    )


@pytest.mark.parametrize(
    "bench", [fclib, speed_against_error], ids=lambda b: b.__name__
)
def test_print_writes_no_files(
    bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rungs = [{"tol": 0.0, "work": 1.0, "seconds": 1.0, "eta": 0.0, "error": 0.0}]
    line = dict.fromkeys(fclib.COLUMNS, 1.0) | {"program": "auto", "file": "a.h5"}
    lines = [line | {"target": target} for target in fclib.TARGETS]
    results, data = tmp_path / "results", tmp_path / "data"
    results.mkdir()
    data.mkdir()
    (data / "a.h5").touch()
    monkeypatch.setattr(tables, "RESULTS", results)
    monkeypatch.setattr(fclib, "find", lambda *_: None)
    monkeypatch.setattr(fclib, "measure", lambda *_: lines)
    monkeypatch.setattr(
        speed_against_error, "collect", lambda *_: {("held", "auto", 0): rungs}
    )
    asked = ["--data", str(data)] if bench is fclib else []
    monkeypatch.setattr(sys, "argv", ["bench", "--methods", "auto", "--print", *asked])
    bench.main()
    assert list(results.iterdir()) == []


def test_the_matrices_of_a_peer_are_those_of_the_scene(
    repository: Path, tmp_path: Path
) -> None:
    """What `system.py` writes for a Python without scikit-fem."""
    path = tmp_path / "system.npz"
    script = repository / "benches" / "peers" / "system.py"
    run = subprocess.run(
        [sys.executable, str(script), "two_blocks", "4", "--save", str(path)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    line = json.loads(run.stdout)
    assert line["dofs"] == 2 * 3 * 5 * 5 * 3
    with np.load(path) as file:
        assert tuple(file["B_shape"]) == (75, 450)
        assert file["prescribed"].shape == (2, 150)
        # Faces of 100 x 100 mm², to rounding of a sum.
        assert file["area"].sum() == pytest.approx(1e4, rel=1e-12)
