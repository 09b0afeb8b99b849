"""Tables that the benches write, results of the peers, and their comparison."""

import re
from pathlib import Path

import compare_tractions
import numpy as np
import pytest
import tables
import tuning
import whole_job
from peers import commands


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
def test_programs_agree_and_a_wrong_answer_is_marked(
    answers: dict[str, commands.Run],
) -> None:
    ours, peer = answers["ours"], answers["peer"]
    reference = {key: getattr(ours, key) for key in ("x", "area", "mu", "R", "v")}
    error, wrong = compare_tractions.compare(peer, reference)
    # The peer stops at 1e-9 of the largest force; W's condition adds a digit at most.
    assert error <= 1e-8
    assert wrong == 0
    # The node in the middle of the face, which sticks, is taken off the plane.
    R, v = peer.R.copy(), peer.v.copy()
    R[-1, 12], v[-1, 12] = 0.0, (1e-3, 0.0, 0.0)
    spoilt = commands.Run(**(vars(peer) | {"R": R, "v": v}))
    error, wrong = compare_tractions.compare(spoilt, reference)
    assert error > 1e-3
    assert wrong == 1
    row = dict.fromkeys(whole_job.COLUMNS, "")
    assert not whole_job.trusted(row | {"error": error, "wrong_statuses": wrong})


def test_statuses_on_a_border_are_not_compared() -> None:
    """A node at its friction limit that does not move may have status slip or stick."""
    R = np.array([[[1.0, 0.3], [1.0, 0.3], [1.0, 0.1], [0.0, 0.0], [1.0, 0.0]]])
    v = np.array([[[0.0, 0.0], [0.0, -1.0], [0.0, 0.0], [1.0, 0.5], [0.0, 0.0]]])
    mu = np.array([0.3, 0.3, 0.3, 0.3, 0.0])
    status, clear = compare_tractions.statuses(R, v, mu)
    assert status[0, 1:].tolist() == [1, 2, 0, 1]
    assert clear[0].tolist() == [False, True, True, True, True]
