"""Fixtures of all tests: the root of the repository, reproducible examples, the command."""

import os
import signal
from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# In CI a failing run must fail again when repeated; elsewhere each run draws new examples.
# No deadline, because other programs share both machines.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("home", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "home")

# A shell starts jobs in the background with SIGINT ignored, and so would be the programs that
# tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Module(pytest.Module):
    """A file of tests. If tests with extras are left out, so is a file that imports one."""

    def collect(self) -> Any:
        """Find the tests."""
        try:
            return super().collect()
        except self.CollectError as error:
            missing = error.__cause__
            if (
                "not needs_extra" in self.config.option.markexpr
                and isinstance(missing, ModuleNotFoundError)
                and not str(missing.name).startswith("bipot_rs")
            ):
                return []
            raise


def pytest_pycollect_makemodule(module_path: Path, parent: Any) -> Module:
    """Make files of tests of the class above."""
    return Module.from_parent(parent, path=module_path)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark variants of parametrised tests as slow, by patterns of their ids."""
    for item in items:
        for name, matching in (("slow_variants", True), ("quick_variants", False)):
            for marker in item.iter_markers(name):
                variant = item.callspec.id  # type: ignore[attr-defined]
                if matching == any(fnmatchcase(variant, a) for a in marker.args):
                    item.add_marker(pytest.mark.slow)


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
        from bipot_rs.cli.entry import call

        status = call(list(arguments)) or 0
        return status, *capsys.readouterr()

    return run
