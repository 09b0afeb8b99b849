"""Fixtures of all tests: the root of the repository, reproducible examples, the command."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from support import slow

# In CI a failing run must fail again when repeated; elsewhere each run draws new examples.
# No deadline, because other programs share both machines.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("home", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "home")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave slow variants of parametrised tests to `make verify`."""
    names = slow.listed()
    for item in items:
        if item.nodeid in names:
            item.add_marker(pytest.mark.verify)


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the source tree."""
    return Path(__file__).resolve().parents[2]


@pytest.fixture
def bipot(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., tuple[int, str, str]]:
    """Run the command in this process, in an empty folder: status, output, errors."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        # Imported here, because most tests do not need the command.
        from bipot_rs.cli.app import app

        status = app(list(arguments)) or 0
        return status, *capsys.readouterr()

    return run
