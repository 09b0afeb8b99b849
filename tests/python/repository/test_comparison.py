"""The page that compares this program with others has the numbers of the benches."""

import re
from collections import Counter

import ratios
import tables
import whole_job

PAGE = ratios.PAGE.read_text(encoding="utf-8")
PROSE = " ".join(PAGE.split())


def test_the_table_is_that_of_the_stored_results() -> None:
    assert tables.replaced(PAGE, ratios.NAME, ratios.table()) == PAGE


def test_what_the_text_says_of_fclib() -> None:
    solved, files = Counter(), Counter()
    for row in tables.read_rows(tables.RESULTS / "fclib.csv"):
        if row["target"] == ratios.ETA:
            files[row["program"]] += 1
            solved[row["program"]] += row["solved"] == "True"
    (sentence,) = re.finditer(
        r"bipot_rs solves all (\d+) files; of (\d+), "
        r"Gauss–Seidel of Siconos leaves (\d+) unsolved, and its semismooth Newton (\d+)",
        PROSE,
    )
    own, theirs, *unsolved = map(int, sentence.groups())
    assert own == files["auto"] == solved["auto"]
    assert theirs == files["NSGS"] == files["NSN_AC"]
    assert unsolved == [files[k] - solved[k] for k in ("NSGS", "NSN_AC")]


def test_what_the_text_says_of_heaps() -> None:
    rows = tables.read_rows(tables.RESULTS / "granular.csv")
    heaps = [float(row["residual"]) for row in rows if row["set"] == "heaps"]
    unsolved = sum(residual > 1e-10 for residual in heaps)
    assert f"leaves {unsolved} of {len(heaps)} [heaps of disks]" in PROSE


def test_tractions_of_getfem_and_of_this_program_agree() -> None:
    between = [
        float(row["error"])
        for row in tables.read_rows(tables.RESULTS / whole_job.SHEET)
        if (row["program"], row["against"]) == ("bipot_rs", "GetFEM")
    ]
    assert len(between) > 3
    assert "agree to 1e-11 on the scenes" in PROSE
    assert max(between) <= 1e-11
