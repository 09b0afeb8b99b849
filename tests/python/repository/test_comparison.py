"""The page that compares this program with others has the numbers of the benches."""

import re

import ratios
import tables
import whole_job

PAGE = ratios.PAGE.read_text(encoding="utf-8")
PROSE = " ".join(PAGE.split())


def test_the_table_is_that_of_the_stored_results() -> None:
    assert tables.replaced(PAGE, ratios.NAME, ratios.table()) == PAGE


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
