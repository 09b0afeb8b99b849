"""The benches keep prose they did not write, and peers answer in one form."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import beside
import judge
import numpy as np
import programs
import pytest
import rust
import slopes
import tables

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


@pytest.mark.parametrize(
    ("page", "name"),
    [("no markers", "one"), (PAGE + PAGE, "one"), (PAGE, "three")],
    ids=["none", "twice", "another"],
)
def test_markers_must_be_there_once(page: str, name: str) -> None:
    with pytest.raises(ValueError, match="markers"):
        tables.replaced(page, name, "text")


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="1 cells below a head of 2"):
        tables.table(("a", "b"), [("1",)])


@pytest.mark.parametrize("page", ["README.md", "benches/README.md"])
def test_the_pages_have_the_markers(repository: Path, page: str) -> None:
    """Each table of a page is between a pair, and its program writes that name."""
    text = (repository / page).read_text(encoding="utf-8")
    beyond = re.sub(r"(?s)<!-- (.*?), written by .*?<!-- end of \1 -->", "", text)
    if page.startswith("benches"):
        assert "|---" not in beyond
    found = re.findall(r"<!-- (.*), written by (\S+) -->", text)
    assert found
    for name, program in found:
        assert "\nnew\n" in tables.replaced(text, name, "new")
        assert f'"{name}"' in (repository / program).read_text("utf-8")


def test_make_bench_runs_all_that_write(repository: Path) -> None:
    page = (repository / "benches" / "README.md").read_text(encoding="utf-8")
    recipe = (repository / "Makefile").read_text("utf-8").split("bench-full:")[-1]
    recipe = recipe.split("\n\n")[0]
    for program in set(re.findall(r", written by (\S+) -->", page)):
        assert f"$(PY) {program}" in recipe


def test_what_criterion_kept_becomes_rates(tmp_path: Path) -> None:
    """A million elements in 10 ms are 100 M/s; groups of other sizes, tables apart."""
    for group, function, value, counted, ns in (
        ("project", "threads", "1", {"Elements": 1_000_000}, 1e7),
        ("project", "threads", "2", {"Elements": 1_000_000}, 5e6),
        ("product", None, "900", {"Bytes": 2**30}, 5e8),
    ):
        folder = tmp_path / group / str(function) / value / "new"
        folder.mkdir(parents=True)
        told = {"group_id": group, "function_id": function, "value_str": value}
        told["throughput"] = counted
        (folder / "benchmark.json").write_text(json.dumps(told))
        median = {"median": {"point_estimate": ns}}
        (folder / "estimates.json").write_text(json.dumps(median))
    assert rust.pivoted(rust.samples(tmp_path)).split("\n\n") == [
        tables.table(("bench, unit", "of", "900"), [("product, GiB/s", "", "2")]),
        tables.table(
            ("bench, unit", "of", "1", "2"), [("project, M/s", "threads", "100", "200")]
        ),
    ]
    with pytest.raises(SystemExit, match="no rates"):
        rust.samples(tmp_path / "empty")


def test_the_sheet_gives_the_table(repository: Path) -> None:
    """Rows of the page are those of its sheet, none retyped."""
    page = (repository / "benches" / "README.md").read_text(encoding="utf-8")
    with (repository / "benches" / "beside.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows
    for row in rows:
        assert "| " + " | ".join(beside.cells(row)) + " |" in page
    first = (repository / "README.md").read_text(encoding="utf-8")
    assert beside.short(rows) in first
    assert len(first.splitlines()) <= 150


@pytest.fixture(scope="module")
def answers() -> dict[str, programs.Run]:
    peer = programs.Peer("SciPy", "with_scipy.py", "scipy, skfem", 1e-9, "").find()
    assert peer.python
    return {
        "ours": programs.Ours().run("sheared_cube", 4, 1),
        "peer": peer.run("sheared_cube", 4, 1),
    }


def test_programs_answer_in_one_form(answers: dict[str, programs.Run]) -> None:
    for run in answers.values():
        assert run.dofs == 3 * 5**3
        assert run.R.shape == run.v.shape == (2, 25, 3)
        assert 0 < run.job <= run.process
        assert run.later is not None
        assert 0 < run.later < run.job
        assert run.peak_mb > 20  # a Python with NumPy


def test_programs_agree(answers: dict[str, programs.Run]) -> None:
    ours = answers["ours"]
    reference = {key: getattr(ours, key) for key in ("x", "area", "mu", "R", "v")}
    error, wrong = judge.compare(answers["peer"], reference)
    # The peer stops at 1e-9 of the largest force; W's condition adds a digit at most.
    assert error <= 1e-8
    assert wrong == 0


def test_a_wrong_answer_is_marked(answers: dict[str, programs.Run]) -> None:
    ours, peer = answers["ours"], answers["peer"]
    reference = {key: getattr(ours, key) for key in ("x", "area", "mu", "R", "v")}
    # The node in the middle of the face, which sticks, is taken off the plane.
    R, v = peer.R.copy(), peer.v.copy()
    R[-1, 12], v[-1, 12] = 0.0, (1e-3, 0.0, 0.0)
    spoilt = programs.Run(**(vars(peer) | {"R": R, "v": v}))
    error, wrong = judge.compare(spoilt, reference)
    assert error > 1e-3
    assert wrong == 1
    row = dict.fromkeys(beside.COLUMNS, "") | {"error": error, "wrong_statuses": wrong}
    assert not beside.trusted(row)


def test_tied_statuses_are_not_counted() -> None:
    """A node at its friction limit that does not move may be called either."""
    R = np.array([[[1.0, 0.3], [1.0, 0.3], [1.0, 0.1], [0.0, 0.0], [1.0, 0.0]]])
    v = np.array([[[0.0, 0.0], [0.0, -1.0], [0.0, 0.0], [1.0, 0.5], [0.0, 0.0]]])
    mu = np.array([0.3, 0.3, 0.3, 0.3, 0.0])
    status, clear = judge.statuses(R, v, mu)
    assert status[0, 1:].tolist() == [1, 2, 0, 1]
    assert clear[0].tolist() == [False, True, True, True, True]


def test_peers_say_why_they_do_not_run(repository: Path) -> None:
    peers = repository / "benches" / "peers"
    # An isolated Python sees neither package.
    for script, package in (("getfem", "getfem"), ("siconos", "siconos")):
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


def test_unavailable_peer_is_reported() -> None:
    peer = programs.Peer("none", "none.py", "no_such_package, numpy", 1.0, "").find()
    assert peer.python is None
    assert peer.missing == "no Python here has no_such_package and numpy"


def test_rows_measured_anew_take_the_place_of_the_old() -> None:
    def row(scene: str, n: int | str, program: str) -> dict[str, object]:
        return {"scene": scene, "n": n, "program": program}

    old = [
        row("sheared_cube", "9", "bipot_rs"),
        row("sheared_cube", "9", "SciPy"),
        row("two_blocks", "8", "bipot_rs"),
    ]
    new = [row("pressed_block", 32, "bipot_rs"), row("sheared_cube", 9, "bipot_rs")]
    assert beside.merged(old, new) == [new[0], new[1], old[2]]


def test_a_peer_is_predicted_by_its_own_slope() -> None:
    history = [(100, 1.0, 1), (200, 4.0, 2)]
    # Twice the unknowns took four times as long: sixteen seconds next.
    for known, scene, seconds in (
        (history, "sheared_cube", 16.0),
        (history[:1], "sheared_cube", 16.0),
        (history[:1], "pressed_block", 8.0),
    ):
        found = beside.predicted(known, 400, scene)
        assert found == pytest.approx(seconds, rel=1e-12)


def test_sheets_give_their_tables(repository: Path) -> None:
    """`--again`, of the sheets that are there and of older ones without a machine."""
    rows = beside.read(repository / "benches" / beside.SHEET)
    assert beside.written(rows).count("\n| ") == len(rows) + 1
    with (repository / "benches" / slopes.SHEET).open(encoding="utf-8") as file:
        assert "Expected: " in slopes.written(list(csv.DictReader(file)))
    for row in rows:
        row.pop("machine", None)
    rows[0]["machine"] = "one, 2 cores"
    assert beside.written(rows).startswith("one, 2 cores; machine not noted, load ")


def test_exponents_are_slopes() -> None:
    n = np.array([1e3, 1e4, 1e5])
    # Logarithms of a power law lie on a line, to rounding.
    assert slopes.exponent(n, 3 * n**1.5) == pytest.approx(1.5, rel=1e-12)


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
