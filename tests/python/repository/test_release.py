"""A release: one version everywhere, and the program that builds and tests its wheel."""

import re
import tomllib

import pytest

import release
from support.places import ROOT


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_one_version_and_one_date() -> None:
    version = tomllib.loads(read("Cargo.toml"))["package"]["version"]
    assert release.version() == version
    locked = tomllib.loads(read("Cargo.lock"))["package"]
    assert [p["version"] for p in locked if p["name"] == "bipot_rs"] == [version]
    cited = dict(
        re.findall(r"^(version|date-released): (.*)$", read("CITATION.cff"), re.M)
    )
    headings = re.findall(r"^## (.*)$", read("CHANGELOG.md"), re.M)
    assert headings[0] == "[Unreleased]"
    assert headings[1] == f"[{version}] - {cited['date-released']}"
    assert cited["version"] == version


def test_a_tag_must_name_the_version() -> None:
    release.tag(f"v{release.version()}")
    for other in (release.version(), "v99.0.0"):
        with pytest.raises(SystemExit, match=f"{other} does not belong to version"):
            release.tag(other)


def test_quick_tests_exist() -> None:
    assert [path for path in release.QUICK if not (ROOT / path).exists()] == []
