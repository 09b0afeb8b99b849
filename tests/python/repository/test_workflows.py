"""The workflows of .github name what exists, and publish only what was checked and asked for."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from support.places import ROOT

yaml = pytest.importorskip("yaml")

FILES = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(
    re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text("utf-8"), re.M)
)
WHEELS = ROOT / ".github" / "workflows" / "wheels.yml"


def jobs(path: Any) -> dict[str, Any]:
    table = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert isinstance(table, dict)
    return dict(table["jobs"])


def steps(path: Any) -> Iterator[dict[str, Any]]:
    for job in jobs(path).values():
        yield from job["steps"]


def missing(command: str) -> list[str]:
    """Targets of make, files, and commands of .ci/release.py that do not exist."""
    targets = [f"make {t}" for t in re.findall(r"\bmake ([\w-]+)", command)]
    targets = [named for named in targets if named.removeprefix("make ") not in TARGETS]
    for word in command.split():
        path = word.strip("\"'")
        if "/" in path and not path.startswith(("out/", "$")) and "://" not in path:
            targets += [] if (ROOT / path).exists() else [path]
    source = (ROOT / ".ci" / "release.py").read_text(encoding="utf-8")
    for name in re.findall(r"release\.py (\w+)", command):
        targets += [] if f'case ["{name}"' in source else [f"release.py {name}"]
    return targets


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_commands_name_what_exists(path: Any) -> None:
    commands = [step["run"] for step in steps(path) if "run" in step]
    assert commands
    assert [fault for command in commands for fault in missing(command)] == []


def test_three_systems_and_two_pythons() -> None:
    matrix = jobs(WHEELS)["check"]["strategy"]["matrix"]
    built = jobs(WHEELS)["build"]["strategy"]["matrix"]["include"]
    systems = {"linux-x86_64", "linux-aarch64", "macos-x86_64", "macos-arm64"}
    assert set(matrix["system"]) == systems | {"windows-x86_64"}
    assert matrix["include"] == built
    assert {build_row["system"] for build_row in built} == set(matrix["system"])
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'requires-python = ">={matrix["python"][0]}"' in text


def test_publishing_is_off_and_waits_for_all_checks() -> None:
    every = jobs(WHEELS)
    publish = every.pop("publish")
    asked = " ".join(publish["if"].split())
    assert asked == (
        "github.event_name == 'push' && startsWith(github.ref, 'refs/tags/v') "
        "&& vars.PUBLISH == 'true'"
    )
    needed, left = set[str](), list(publish["needs"])
    while left:
        name = left.pop()
        needed.add(name)
        more = every[name].get("needs", [])
        left += [more] if isinstance(more, str) else more
    assert needed == set(every)
    # It alone has an identity that the index of packages trusts; nobody has a password.
    assert publish["permissions"] == {"id-token": "write"}
    assert publish["environment"] == "release"
    for job in every.values():
        assert job["permissions"] == {"contents": "read"}
    text = WHEELS.read_text(encoding="utf-8")
    assert "secrets." not in text
    assert yaml.safe_load(text)["permissions"] == {}
