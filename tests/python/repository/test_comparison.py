"""The page that compares this program with others has the numbers of the benches."""

import re

import pytest
import ratios
import tables
import whole_job

PAGE = ratios.PAGE.read_text(encoding="utf-8")
PROSE = " ".join(PAGE.split())


def test_the_table_is_that_of_the_stored_results() -> None:
    assert tables.replaced(PAGE, ratios.NAME, ratios.table()) == PAGE


@pytest.mark.parametrize(
    ("numbers", "cells"),
    [
        ([2.0, 0.5, 8.0], ["3", "0.50", "2.0", "8.0", "1"]),
        # Exactly as fast is no case that the other program wins.
        ([1.0, 30.0], ["2", "1.0", "16", "30", "none"]),
        ([0.004, 1234.0, 100.0, 99.0], ["4", "0.0040", "100", "1,234", "1"]),
    ],
)
def test_losses_are_counted(numbers: list[float], cells: list[str]) -> None:
    assert list(ratios.line("what", "program", numbers)) == ["what", "program", *cells]


def test_ratios_of_processes_are_theirs_over_ours() -> None:
    """The first case by hand: pressed_block 32, where the other processes end first."""
    rows = tables.read_rows(tables.RESULTS / whole_job.SHEET)
    process = {
        row["program"]: float(row["process"])
        for row in rows
        if whole_job.place(row) == ("pressed_block", 32)
    }
    (ratio_row,) = (
        numbers
        for what, program, numbers in ratios.whole_jobs()
        if (what, program) == ("whole process, with start and imports", "Siconos")
    )
    expected = process["Siconos"] / process["bipot_rs"]
    assert expected < 1
    assert ratio_row[0] == pytest.approx(expected, rel=1e-14)  # one division


def test_what_the_text_says_of_fclib() -> None:
    solved, files = {}, {}
    for row in tables.read_rows(tables.RESULTS / "fclib.csv"):
        if row["target"] == ratios.ETA:
            name = row["program"]
            files[name] = files.get(name, 0) + 1
            solved[name] = solved.get(name, 0) + (row["solved"] == "True")
    (sentence_match,) = re.finditer(
        r"bipot_rs solves all (\d+) files; of (\d+), "
        r"Gauss–Seidel of Siconos leaves (\d+) unsolved, and its semismooth Newton (\d+)",
        PROSE,
    )
    assert int(sentence_match[1]) == files["auto"] == solved["auto"]
    assert int(sentence_match[2]) == files["NSGS"] == files["NSN_AC"]
    assert int(sentence_match[3]) == files["NSGS"] - solved["NSGS"]
    assert int(sentence_match[4]) == files["NSN_AC"] - solved["NSN_AC"]


def test_what_the_text_says_of_heaps() -> None:
    heaps = [
        row
        for row in tables.read_rows(tables.RESULTS / "granular.csv")
        if row["set"] == "heaps"
    ]
    unsolved = sum(float(row["residual"]) > 1e-10 for row in heaps)
    assert f"leaves {unsolved} of {len(heaps)} [heaps of disks]" in PROSE


def test_tractions_of_getfem_and_of_this_program_agree() -> None:
    rows = tables.read_rows(tables.RESULTS / whole_job.SHEET)
    between = [
        float(row["error"])
        for row in rows
        if row["program"] == "bipot_rs" and row["against"] == "GetFEM"
    ]
    assert len(between) > 3
    assert "agree to 1e-11 on the scenes" in PROSE
    assert max(between) <= 1e-11
