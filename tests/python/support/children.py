"""Child processes that run `bipot` or other code, with a fault at a chosen place."""

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bipot_rs.cli.entry
import bipot_rs.cli.run.resume
import bipot_rs.scene.reading
from bipot_rs.files import export
from support.comparisons import content
from support.programs import child

# Children start with the modules loaded here, because imports take most of a run.
export.require()

# Runs the command in a new interpreter and sends a signal at the import of a module.
_AT_IMPORT = """
import os, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), {number})
sys.meta_path.insert(0, Finder())
sys.argv = ["bipot", *sys.argv[1:]]
from bipot_rs.__main__ import main
sys.exit(main())
"""


def forked(
    work: Callable[[], int | None], *, cwd: Path | None = None, seconds: float = 20
) -> subprocess.CompletedProcess[str]:
    """Run ``work`` in a forked child; return its exit status, and allow no traceback.

    A child that takes longer than ``seconds`` is a failure.
    """
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        with warnings.catch_warnings():
            # Some tests fork on purpose while other threads run.
            warnings.simplefilter("ignore", DeprecationWarning)
            child = os.fork()
        if child == 0:
            _become(work, out, err, cwd)
        deadline = time.monotonic() + seconds
        while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
            if time.monotonic() > deadline:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                raise AssertionError(f"the child hangs, for {seconds} s by now")
            time.sleep(0.002)
        out.seek(0)
        err.seek(0)
        status = os.waitstatus_to_exitcode(ended[1])
        run = subprocess.CompletedProcess("forked", status, out.read(), err.read())
    assert "Traceback" not in run.stderr, run.stderr
    return run


def _become(work: Callable[[], int | None], out: Any, err: Any, cwd: Any) -> None:
    """Run ``work`` and end this process without the exit code of pytest."""
    status = 1
    try:
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        if cwd is not None:
            os.chdir(cwd)
        status = work() or 0
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:  # noqa: BLE001 — the exception has nowhere else to go
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(status)


def bipot_with(
    fault: Callable[..., object], before: str, *arguments: str, cwd: Path
) -> subprocess.CompletedProcess[str]:
    """`bipot` with ``fault`` called before every call of ``module:name``."""

    def work() -> int:
        module = importlib.import_module(before.partition(":")[0])
        name = before.partition(":")[2]
        original = getattr(module, name)

        def faulty(*args: Any, **keywords: Any) -> Any:
            fault(*args)
            return original(*args, **keywords)

        setattr(module, name, faulty)
        sys.argv = ["bipot", *arguments]
        return int(bipot_rs.cli.entry.call(sys.argv[1:], last=True) or 0)

    return forked(work, cwd=cwd, seconds=60)


def bipot(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """`bipot` without any fault."""
    return bipot_with(
        lambda *_: None, "bipot_rs.scene.reading:read", *arguments, cwd=cwd
    )


def resumed(*command: str, cwd: Path) -> Path:
    """Interrupt `bipot run ... --out here` at step 2 and resume it: the file of a whole run."""

    def fault(step: int, *_: object) -> None:
        if step == 2:
            raise KeyboardInterrupt

    file = cwd / "here" / "result.h5"
    assert bipot("run", *command, cwd=cwd).returncode == 0
    whole = content(file)
    at = "bipot_rs.contact.results.tables:make_row"
    assert bipot_with(fault, at, "run", *command, cwd=cwd).returncode == 130
    run = bipot("run", *command, "--resume", "--json", cwd=cwd)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[0])["step"] == 2
    assert content(file) == whole
    return file


def bipot_hit_at_import(
    number: signal.Signals, module: str, *arguments: str, cwd: Path
) -> subprocess.CompletedProcess[str]:
    """`bipot` that receives a signal at its first import of ``module``."""
    code = _AT_IMPORT.format(module=module, number=int(number))
    return child(code, *arguments, cwd=cwd)


# Writing 5 resets the largest memory of the process.
RESET = Path("/proc/self/clear_refs")


def memory(name: str) -> int:
    """An entry of the status of this process, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def strays(folder: Path) -> list[str]:
    """What a run prepares its files in, and should have removed."""
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]
