"""Rows that fail: their steps are kept, and they lose nothing but themselves."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.study.plan import plan
from bipot_rs.cli.study.row import Row, solve_as
from support.comparisons import bits
from support.pushed_study import PUSHED, table

Bipot = Callable[..., tuple[int, str, str]]
STUDY = ("sweep", "push.toml", "--out", "here", "--jobs", "1")


@pytest.fixture(autouse=True)
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "push.toml"
    path.write_text(PUSHED)
    return path


def test_a_row_that_fails_at_step_4_keeps_its_three_steps(bipot: Bipot) -> None:
    status, output, _ = bipot(*STUDY, "--set", "contact.0.mu=0.1,0.3,0.5,0.01,-1")
    assert status == 2
    assert "the load steps of rows that failed are in here/rows" in output
    *rows, without_step, wrong = table("here")
    assert [row["outcome"] for row in rows] == ["no answer", "no answer", "solved"]
    assert [row["steps"] for row in rows] == ["1", "3", "5"]
    assert rows[1]["message"].startswith("load step 4: no solution exists")
    # Step k carries a tangential force of 0.08 k times the normal force of 1000.
    for row, steps in zip(rows, (1, 3, 5), strict=True):
        force = float(row["tangential_force of block.bottom"])
        assert force == pytest.approx(80 * steps, rel=1e-9)  # 1e-12 is asked for
    kept = bp.load("here/rows/0001/result.h5")
    assert (len(kept), kept.success) == (3, False)
    assert rows[1]["message"] == kept.message
    counts = [int(rows[1][name]) for name in ("open", "slip", "stick")]
    assert counts == np.bincount(kept[-1].status, minlength=3).tolist()
    assert float(rows[1]["residual"]) == kept.residual.max()
    assert int(rows[1]["iterations"]) == kept.iterations.sum()
    pressure = float(rows[1]["max_pressure of block.bottom"])
    assert pressure == pytest.approx(kept.traction[-1, :, 0].max(), rel=1e-15)
    # A row that is solved has a file only if that is asked for; one without steps has none.
    assert (without_step["outcome"], without_step["steps"]) == ("no answer", "0")
    assert (wrong["outcome"], wrong["steps"]) == ("bad input", "")
    assert sorted(p.name for p in Path("here/rows").iterdir()) == ["0000", "0001"]


@pytest.mark.slow
def test_kept_steps_are_those_of_a_single_run_which_can_go_on(bipot: Bipot) -> None:
    chosen = ("--set", "contact.0.mu=0.3")
    bipot(*STUDY, *chosen)
    bipot("run", "push.toml", *chosen, "--out", "single")
    assert bits(bp.load("here/rows/0000/result.h5"), bp.load("single/result.h5"))
    more = ("--out", "here/rows/0000", "--resume")
    errors = bipot("run", "push.toml", *chosen, *more)[2]
    assert "here/rows/0000/result.h5: continuing after 3 load steps" in errors
    assert "load step 4 of 5: no solution exists" in errors


@pytest.mark.slow
def test_results_of_all_rows(bipot: Bipot, scene: Path) -> None:
    settings = ("--set", "contact.0.mu=0.3,0.5")
    bipot(*STUDY, *settings)
    resume = (*STUDY, *settings, "--results", "--resume")
    # A solved row without its file is solved again.
    assert "1 of 2 rows are already finished" in bipot(*resume)[2]
    results = [bp.load(f"here/rows/{k:04d}/result.h5") for k in (0, 1)]
    assert [(len(it), it.success) for it in results] == [(3, False), (5, True)]
    assert "2 of 2 rows are already finished" in bipot(*resume)[2]
    # A study of another scene resumes nothing.
    scene.write_text(PUSHED.replace("value = 10", "value = 20"))
    errors = bipot(*resume)[2]
    assert "already finished" not in errors
    for name in ("sweep-before.csv", "rows-before"):
        assert f"are kept in here/{name}" in errors


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


def solved(scene: Path, mu: str, folder: Path, digest: str) -> Any:
    return solve_as(Row(0, str(scene), {KEY: mu}, None, None, folder), digest)


def digest_of(scene: Path, mu: str) -> str:
    return plan(str(scene), [f"{KEY}={mu}"], [], None, None).digests[0]


KEY = "contact.0.mu"


def test_a_folder_that_cannot_be_written_costs_no_row(
    scene: Path, tmp_path: Path
) -> None:
    # A file stands where the folder of the rows should be.
    (tmp_path / "rows").write_text("")
    absent = tmp_path / "absent"
    for folder, told in (
        (absent, f"; no result.h5: its worker has no folder {absent}"),
        (tmp_path, "; no result.h5: "),
    ):
        row = solved(scene, "0.3", folder, digest_of(scene, "0.3"))
        assert (row["outcome"], row["steps"]) == ("no answer", 3)
        assert told in row["message"]
    assert not absent.exists()


def test_a_worker_with_another_scene_does_not_solve_it(
    scene: Path, tmp_path: Path
) -> None:
    known = scene, "0.5", tmp_path, digest_of(scene, "0.5")
    assert solved(*known)["outcome"] == "solved"
    scene.write_text(PUSHED.replace("value = 10", "value = 11"))
    assert "its worker reads another scene" in str(solved(*known))
    scene.unlink()
    assert "its worker cannot read the scene" in str(solved(*known))
