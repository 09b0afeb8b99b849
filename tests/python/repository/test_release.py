"""A release: one version everywhere, and the program that builds and tests its wheel."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

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


@pytest.mark.parametrize(
    ("listed", "pin", "said"),
    [
        # Neither by the order of the list nor by that of the letters.
        ("1.23.5, 1.24.0rc1, 1.24.10, 1.24.2, 2.0.0", "numpy==1.24.2", ""),
        ("2.1.0, 2.1.1, 10.0.0", "numpy==2.1.0", "numpy 1.24 has no wheel"),
        ("1.24.0", "numpy==1.24.0", ""),
    ],
)
def test_lowest_version_with_a_wheel(
    listed: str,
    pin: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer(f"requirement numpy<0 (from versions: {listed})\n", monkeypatch)
    assert release.lowest(Path(sys.executable), "numpy>=1.24") == pin
    printed = capsys.readouterr().out
    assert printed.startswith(said)
    assert bool(printed) == bool(said)


@pytest.mark.parametrize("listed", ["1.23.5", "none", ""])
def test_no_version_with_a_wheel(listed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answer(f"(from versions: {listed})", monkeypatch)
    with pytest.raises(SystemExit, match=r"no wheel of numpy>=1\.24"):
        release.lowest(Path(sys.executable), "numpy>=1.24")


def answer(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What pip says of a version that does not exist."""

    def run(command: Any, **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 1, "", text)

    monkeypatch.setattr(subprocess, "run", run)


def test_flags_of_this_machine_stay_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A core for one processor ends with an illegal instruction on an older one."""
    for name in ("CFLAGS", "CARGO_ENCODED_RUSTFLAGS", "PYTHONPATH", "PYO3_PYTHON"):
        monkeypatch.setenv(name, "anything")
    monkeypatch.setenv("PATH", os.environ["PATH"])
    seen: list[dict[str, str]] = []

    def run(command: Any, **keywords: Any) -> subprocess.CompletedProcess[str]:
        seen.append(keywords["env"])
        return subprocess.CompletedProcess(command, 1, "", "")

    monkeypatch.setattr(release, "_made", lambda _: Path(sys.executable))
    monkeypatch.setattr(release, "_pip", lambda *_: None)
    monkeypatch.setattr(release, "WHEELS", Path("nowhere"))
    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setenv("RUSTFLAGS", "-C target-cpu=native")
    with pytest.raises(SystemExit, match="failed: -m maturin build"):
        release.build()
    (environment,) = seen
    assert environment["RUSTFLAGS"] == ""
    assert not {"CFLAGS", "CARGO_ENCODED_RUSTFLAGS", "PYTHONPATH"} & set(environment)


@pytest.mark.parametrize(
    "names",
    [(), ("cp311-cp311-linux_x86_64",), ("cp311-abi3-a", "cp311-abi3-b")],
    ids=["none", "another_abi", "two"],
)
def test_one_wheel_is_expected(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(release, "WHEELS", tmp_path)
    for name in names:
        (tmp_path / f"bipot_rs-{release.version()}-{name}.whl").touch()
    with pytest.raises(SystemExit, match="expected one abi3 wheel"):
        release.check()


def test_unknown_arguments_print_the_usage() -> None:
    with pytest.raises(SystemExit, match=r"^usage: release\.py build"):
        release.main(["publish"])


def test_quick_tests_exist() -> None:
    assert [path for path in release.QUICK if not (ROOT / path).exists()] == []
