"""Rows that fail: their steps are kept, and they lose nothing but themselves."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.study.plan import plan
from bipot_rs.cli.study.row import Row, solve_as
from support.comparisons import bits
from support.pushed_study import PUSHED, table

Bipot = Callable[..., tuple[int, str, str]]
STUDY = ("sweep", "push.toml", "--out", "here", "--jobs", "1")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "push.toml"
    path.write_text(PUSHED)
    return path


@pytest.mark.usefixtures("scene")
def test_a_row_that_fails_at_step_4_keeps_its_three_steps(bipot: Bipot) -> None:
    status, output, _ = bipot(*STUDY, "--set", "contact.0.mu=0.1,0.3,0.5")
    assert status == 1
    assert "the load steps of rows that failed are in here/rows" in output
    rows = table("here")
    assert [row["outcome"] for row in rows] == ["no answer", "no answer", "solved"]
    assert [row["steps"] for row in rows] == ["1", "3", "5"]
    assert rows[1]["message"].startswith("load step 4: no solution exists")
    # Step k carries a tangential force of 0.08 k times the normal force of 1000.
    for row, steps in zip(rows, (1, 3, 5), strict=True):
        force = float(row["tangential_force of block.bottom"])
        assert force == pytest.approx(80 * steps, rel=1e-9)  # 1e-12 is asked for
        counts = [int(row[name]) for name in ("open", "slip", "stick")]
        assert sum(counts) == 7
    kept = bp.load("here/rows/0001/result.h5")
    assert (len(kept), kept.success) == (3, False)
    assert rows[1]["message"] == kept.message
    assert [int(k) for k in np.bincount(kept[-1].status, minlength=3)] == [
        int(rows[1][name]) for name in ("open", "slip", "stick")
    ]
    assert float(rows[1]["residual"]) == kept.residual.max()
    assert int(rows[1]["iterations"]) == kept.iterations.sum()
    pressure = kept.traction[-1, :, 0].max()
    assert float(rows[1]["max_pressure of block.bottom"]) == pytest.approx(
        pressure, rel=1e-15
    )
    # A row that is solved has a file only if that is asked for.
    assert not Path("here/rows/0002").exists()


@pytest.mark.usefixtures("scene")
@pytest.mark.slow
def test_kept_steps_are_those_of_a_single_run_which_can_go_on(bipot: Bipot) -> None:
    chosen = ("--set", "contact.0.mu=0.3")
    bipot(*STUDY, *chosen)
    bipot("run", "push.toml", *chosen, "--out", "single")
    resumed, other = bp.load("here/rows/0000/result.h5"), bp.load("single/result.h5")
    assert bits(resumed, other)
    errors = bipot("run", "push.toml", *chosen, "--out", "here/rows/0000", "--resume")[
        2
    ]
    assert "here/rows/0000/result.h5: continuing after 3 load steps" in errors
    assert "load step 4 of 5: no solution exists" in errors


@pytest.mark.usefixtures("scene")
@pytest.mark.slow
def test_a_row_without_a_solved_step_has_no_file(bipot: Bipot) -> None:
    bipot(*STUDY, "--set", "contact.0.mu=0.01,-1")
    rows = table("here")
    assert [(row["outcome"], row["steps"]) for row in rows] == [
        ("no answer", "0"),
        ("bad input", ""),
    ]
    assert not Path("here/rows").exists()


@pytest.mark.usefixtures("scene")
@pytest.mark.slow
def test_results_of_all_rows(bipot: Bipot) -> None:
    settings = ("--set", "contact.0.mu=0.3,0.5")
    bipot(*STUDY, *settings)
    # A solved row without its file is solved again.
    errors = bipot(*STUDY, *settings, "--results", "--resume")[2]
    assert "1 of 2 rows are already finished" in errors
    results = [bp.load(f"here/rows/{k:04d}/result.h5") for k in (0, 1)]
    assert [(len(result), result.success) for result in results] == [
        (3, False),
        (5, True),
    ]
    errors = bipot(*STUDY, *settings, "--results", "--resume")[2]
    assert "2 of 2 rows are already finished" in errors


@pytest.mark.usefixtures("scene")
@pytest.mark.slow
def test_results_follow_their_rows_to_new_numbers(bipot: Bipot) -> None:
    bipot(*STUDY, "--set", "contact.0.mu=0.1,0.3", "--results")
    before = Path("here/rows/0001/result.h5").read_bytes()
    errors = bipot(*STUDY, "--set", "contact.0.mu=0.3,0.5", "--results", "--resume")[2]
    assert "1 of 2 rows are already finished" in errors
    assert Path("here/rows/0000/result.h5").read_bytes() == before
    # Those of other rows are kept, as their table is.
    assert "are kept in here/rows-before" in errors
    assert len(bp.load("here/rows-before/0000/result.h5")) == 1
    assert [row["contact.0.mu"] for row in table("here")] == ["0.3", "0.5"]
    assert len(bp.load("here/rows/0001/result.h5")) == 5


def test_a_folder_that_cannot_be_written_costs_no_row(
    scene: Path, tmp_path: Path
) -> None:
    row = Row(0, str(scene), {"contact.0.mu": "0.3"}, None, None, tmp_path / "absent")
    digest = plan(str(scene), ["contact.0.mu=0.3"], [], None, None).digests[0]
    refused_row = solve_as(row, digest)
    assert isinstance(refused_row, dict)
    assert (refused_row["outcome"], refused_row["steps"]) == ("no answer", 3)
    told = f"; no result.h5: its worker has no folder {tmp_path / 'absent'}"
    assert refused_row["message"].endswith(told)
    assert not (tmp_path / "absent").exists()
    # A file stands where the folder of the rows should be.
    (tmp_path / "rows").write_text("")
    blocked = Row(0, str(scene), {"contact.0.mu": "0.3"}, None, None, tmp_path)
    refused_row = solve_as(blocked, digest)
    assert isinstance(refused_row, dict)
    assert refused_row["steps"] == 3
    assert "; no result.h5: " in refused_row["message"]


def test_a_worker_with_another_scene_does_not_solve_it(
    scene: Path, tmp_path: Path
) -> None:
    digest = plan(str(scene), ["contact.0.mu=0.5"], [], None, None).digests[0]
    row = Row(0, str(scene), {"contact.0.mu": "0.5"}, None, None, tmp_path)
    solved = solve_as(row, digest)
    assert isinstance(solved, dict)
    assert solved["outcome"] == "solved"
    scene.write_text(PUSHED.replace("value = 10", "value = 11"))
    assert "its worker reads another scene" in str(solve_as(row, digest))
    scene.unlink()
    assert "its worker cannot read the scene" in str(solve_as(row, digest))


@pytest.mark.slow
def test_a_study_of_another_scene_resumes_nothing(scene: Path, bipot: Bipot) -> None:
    settings = ("--set", "contact.0.mu=0.3", "--results")
    bipot(*STUDY, *settings)
    scene.write_text(PUSHED.replace("value = 10", "value = 20"))
    errors = bipot(*STUDY, *settings, "--resume")[2]
    assert "already finished" not in errors
    for name in ("sweep-before.csv", "rows-before"):
        assert f"are kept in here/{name}" in errors
