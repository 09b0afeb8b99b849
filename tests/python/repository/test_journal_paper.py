"""The paper about this software: its form, its references, its numbers, CITATION.cff."""

import re
import tomllib
from typing import Any

import numpy as np
import pytest
import tables
import whole_job
import yaml

from support.places import ROOT

PAPER = ROOT / "paper" / "paper.md"


def parts(text: str) -> tuple[dict[str, Any], str]:
    """The head of a page as YAML, and its text."""
    empty, head, body = re.split(r"^---$", text, maxsplit=2, flags=re.MULTILINE)
    assert empty == ""
    return yaml.safe_load(head), body


@pytest.fixture(scope="module")
def head() -> dict[str, Any]:
    return parts(PAPER.read_text("utf-8"))[0]


@pytest.fixture(scope="module")
def body() -> str:
    return parts(PAPER.read_text("utf-8"))[1]


@pytest.fixture(scope="module")
def cited_as() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))


def test_citation_file_agrees(head: dict[str, Any], cited_as: dict[str, Any]) -> None:
    """Title, authors, version, licence and keywords stand in several files."""
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["package"]
    assert cited_as["title"] == head["title"]
    assert [author["name"] for author in cited_as["authors"]] == [
        author["name"] for author in head["authors"]
    ]
    assert cited_as["version"] == cargo["version"]
    assert " OR ".join(cited_as["license"]) == cargo["license"]
    assert cited_as["keywords"] == [
        tag for tag in head["tags"] if tag not in ("Python", "Rust")
    ]


def rows(name: str) -> list[dict[str, str]]:
    """Rows of a file of results."""
    return tables.read_rows(tables.RESULTS / name)


def sentence(body: str, pattern: str) -> re.Match[str]:
    """The only place of the text that a pattern matches; spaces stand for line breaks too."""
    (match,) = re.finditer(pattern, " ".join(body.split()))
    return match


def test_ratios_of_whole_jobs(body: str) -> None:
    """The fastest peer with a right result on each mesh, as in the README of the benches."""
    best: dict[tuple[str, int], float] = {}
    for row in rows(whole_job.SHEET):
        if row["program"] != "bipot_rs" and row["ratio"] and whole_job.trusted(row):
            place = whole_job.place(row)
            best[place] = min(best.get(place, np.inf), float(row["ratio"]))
    match = sentence(
        body, r"On (\d+) meshes of five scenes.* took (\S+) to (\S+) times"
    )
    assert int(match[1]) == len(best)
    assert len({scene for scene, _ in best}) == 5
    # Rounded to two digits, so half a unit of the second.
    assert float(match[2]) == pytest.approx(min(best.values()), abs=0.05)
    assert float(match[3]) == pytest.approx(max(best.values()), abs=0.5)


def test_problems_solved_to_a_true_error(body: str) -> None:
    auto = [
        row
        for row in rows("speed_against_error.csv")
        if (row["method"], row["measure"], row["target"]) == ("auto", "error", "1e-08")
    ]
    assert len(auto) == 7
    match = sentence(
        body,
        r"solves (\d+) of (\d+) problems to a true error of 1e-8, "
        r"with medians of (\d+) to (\d+) products",
    )
    assert int(match[1]) == sum(int(row["solved"]) for row in auto)
    assert int(match[2]) == sum(int(row["problems"]) for row in auto)
    products = [float(row["products_median"]) for row in auto]
    assert [int(match[3]), int(match[4])] == [
        round(min(products)),
        round(max(products)),
    ]


def test_the_large_block(body: str) -> None:
    match = sentence(body, r"([\d,]+) unknowns takes (\d+) s and (\d\.\d) GB")
    rows_of_engine = [
        row
        for row in rows("scale.csv")
        if row["unknowns"] == match[1].replace(",", "") and row["seconds"]
    ]
    assert round(min(float(row["seconds"]) for row in rows_of_engine)) == int(match[2])
    # MB of 10^6 bytes; one digit after the point is shown.
    peak = max(float(row["peak_mb"]) for row in rows_of_engine) / 1e3
    assert peak == pytest.approx(float(match[3]), abs=0.05)


def test_files_of_fclib(body: str) -> None:
    at = [row for row in rows("fclib.csv") if row["target"] == "1e-12"]
    ours = [row for row in at if row["program"] == "auto"]
    match = sentence(body, r"solves all (\d+) files to a residual of 1e-12")
    assert int(match[1]) == len(ours)
    assert all(row["solved"] == "True" for row in ours)
