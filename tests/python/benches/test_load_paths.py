"""The bench of the collection counts whole paths, and only what is solved."""

from pathlib import Path

import load_paths
import numpy as np
import pytest
from collection import manifest

from support.places import ROOT

DATA = ROOT / "tests" / "data" / "collection"


@pytest.fixture(scope="module")
def lines() -> list[dict[str, object]]:
    lines_measured = []
    for row in manifest.read(DATA):
        methods = ["auto", "pivoting"]
        lines_measured += load_paths.measure(DATA / row.file, row, methods, None, 10.0)
    return lines_measured


def test_auto_solves_the_stored_files(lines: list[dict[str, object]]) -> None:
    lines_of_auto = [line for line in lines if line["program"] == "auto"]
    assert len(lines_of_auto) == 3 * 15
    assert all(line["solved"] for line in lines_of_auto)
    for line in lines_of_auto:
        # η times the condition of W, below 1e3; without an answer there is no error.
        assert line["error"] <= 1e3 * line["target"]


def test_a_path_costs_the_sum_of_its_files(lines: list[dict[str, object]]) -> None:
    work = load_paths.costs(lines, 1e-8, "work")["auto"]
    paths = list(dict.fromkeys(line["path"] for line in lines))
    for path, total in zip(paths, work, strict=True):
        seconds_of_files = [
            line["work"]
            for line in lines
            if (line["path"], line["program"], line["target"]) == (path, "auto", 1e-8)
        ]
        assert total == sum(seconds_of_files)


def test_what_is_not_accepted_is_not_solved(lines: list[dict[str, object]]) -> None:
    """Complementary pivoting needs supports."""
    held = {"none_2d_13_sliding", "none_2d_6_clamped"}
    assert load_paths.refused(lines) == load_paths.refused(lines, "pivoting") == held
    assert load_paths.refused(lines, "auto") == set()
    seconds = load_paths.costs(lines, 1e-4, "seconds")["pivoting"]
    assert np.isfinite(seconds).sum() == 2
    text = load_paths.table(lines)
    assert "| auto | 4 of 4 | 4 | 4 | 4 | 1 | 1 |" in text
    assert "| pivoting | 2 of 4 | 2 | 2 | 2 |" in text


def test_one_unsolved_file_costs_the_path(lines: list[dict[str, object]]) -> None:
    changed = [dict(line) for line in lines]
    for line in changed:
        if line["file"] == "block_2d_3-0001.hdf5":
            line["solved"] = False
    costs_of_auto = load_paths.costs(changed, 1e-8, "seconds")["auto"]
    assert np.isinf(costs_of_auto).sum() == 1


@pytest.mark.slow
def test_the_profiles_are_drawn(lines: list[dict[str, object]], tmp_path: Path) -> None:
    load_paths.draw(lines, tmp_path / "profiles.png")
    assert (tmp_path / "profiles.png").stat().st_size > 10_000
