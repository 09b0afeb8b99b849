"""The wheel of a release: built for old systems, tested with old and new libraries.

usage: release.py build       the wheel for this system, into out/wheels
       release.py sdist       the source distribution, into out/wheels
       release.py check       install the wheel with NumPy and SciPy alone, run the quick tests
       release.py tag NAME    fail unless NAME is "v" and the version of the package

It needs the standard library and pip only, on Linux, macOS and Windows alike.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
WHEELS = ROOT / "out" / "wheels"
# Virtual environments: of the tools, and of each set of libraries.
PLACES = ROOT / "out" / "release"
# Any Linux with glibc 2.17 from 2012. Zig links against the symbols that it had.
POLICY, TAG = "manylinux2014", "manylinux_2_17"
LINUX_TOOLS = ("ziglang>=0.17,<0.18", "auditwheel>=6.4")
TEST_TOOLS = ("pytest", "pytest-timeout", "hypothesis")
# Folders whose tests mostly need NumPy and SciPy only, and the marker of those that do.
QUICK = [
    f"tests/python/{name}"
    for name in (
        *("contact", "lib", "mortar", "obstacle", "theory", "test_analytic.py"),
        "repository/test_library_names.py",
    )
]
MARKED = "not slow and not needs_extra"
NAME = r"bipot_rs-[\d.]+-cp311-abi3-\w+(\.\w+)*\.whl"
# What surrounds this process must not enter the wheel: flags for its own processor would
# end the program on an older one. Nor must tests find another copy of the package.
FLAGS = ("CARGO_ENCODED_RUSTFLAGS", "CFLAGS", "CXXFLAGS", "LDFLAGS")
PATHS = ("PYTHONPATH", "PYTHONHOME")


def main(arguments: Sequence[str]) -> None:
    """Do what the arguments ask for; a failure ends with a message and status 1."""
    match list(arguments):
        case ["build"]:
            build()
        case ["sdist"]:
            sdist()
        case ["check"]:
            check()
        case ["tag", name]:
            tag(name)
        case _:
            sys.exit((__doc__ or "").partition("\n\n")[2].strip())


def build() -> None:
    """Build the wheel, and on Linux audit which libraries and symbols it needs."""
    linux = sys.platform == "linux"
    project = _table("pyproject.toml")
    python = _made("tools")
    _pip(python, *project["build-system"]["requires"], *(LINUX_TOOLS if linux else ()))
    for old in WHEELS.glob("*.whl"):
        old.unlink()
    flags = ("--zig", "--compatibility", POLICY) if linux else ()
    os.environ.update(
        # An empty variable also overrides flags in the configuration of cargo.
        RUSTFLAGS="",
        PYO3_PYTHON=str(python),
        # maturin finds Zig as a module of the Python that is first in PATH.
        PATH=f"{python.parent}{os.pathsep}{os.environ['PATH']}",
    )
    command = ("-m", "maturin", "build", "--release", "--locked", *flags)
    _run(python, *command, "--out", WHEELS)
    wheel = _wheel()
    if linux:
        told = _run(python, "-m", "auditwheel", "show", wheel, printed=False)
        sys.stdout.write(told)
        if not re.search(rf'platform tag:\s*"{TAG}_\w+"', told):
            sys.exit(f"{wheel.name}: the audit does not give the tag {TAG}, see above")
    say(f"the wheel:            {wheel}")


def sdist() -> None:
    """Write the source distribution."""
    python = _made("tools")
    _pip(python, *_table("pyproject.toml")["build-system"]["requires"])
    for old in WHEELS.glob("*.tar.gz"):
        old.unlink()
    _run(python, "-m", "maturin", "sdist", "--out", WHEELS)


def check() -> None:
    """Run the quick tests with the lowest and the newest NumPy and SciPy."""
    wheel, project = _wheel(), _table("pyproject.toml")["project"]
    tools = [
        requirement
        for requirement in project["optional-dependencies"]["dev"]
        if re.split(r"[<>=\[]", requirement)[0] in TEST_TOOLS
    ]
    ended = {}
    for name in ("lowest", "newest"):
        python = _made(name)
        needed = project["dependencies"]
        libraries = [lowest(python, n) for n in needed] if name == "lowest" else needed
        _pip(python, *libraries, wheel)
        versions = _alone(python)
        say(f"{name}: {versions}")
        _pip(python, *tools)
        done = subprocess.run(
            [
                *(python, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider"),
                *("-m", MARKED, *QUICK),
            ],
            cwd=ROOT,
            env=_environment(),
            check=False,
        )
        ended[name] = done.returncode
        say(f"{name}: {versions}: {'failed' if done.returncode else 'passed'}")
    if any(ended.values()):
        sys.exit("the quick tests failed, see above")


def lowest(python: Path, requirement: str) -> str:
    """The lowest version of ``name>=version`` that has a wheel for this Python, as a pin."""
    name, _, bound = requirement.partition(">=")
    # Nothing satisfies it, so that pip lists the versions that have wheels.
    impossible = ("install", "--dry-run", "--only-binary", ":all:", f"{name}<0")
    listed = subprocess.run(
        [python, "-m", "pip", *impossible],
        env=_environment(LC_ALL="C"),
        capture_output=True,
        text=True,
        check=False,
    ).stderr
    found = re.search(r"\(from versions: ([^)]*)\)", listed)
    known = re.findall(r"(?:^|(?<= ))\d+(?:\.\d+)*(?=,|$)", found[1] if found else "")
    fit = [v for v in known if _numbers(v) >= _numbers(bound)]
    if not fit:
        sys.exit(f"no wheel of {requirement} for this Python: pip says\n{listed}")
    first = min(fit, key=_numbers)
    if _numbers(first)[: len(_numbers(bound))] != _numbers(bound):
        say(
            f"{name} {bound} has no wheel for this Python; {first} is the lowest with one"
        )
    return f"{name}=={first}"


def tag(name: str) -> None:
    """Compare a tag with the version."""
    if name != f"v{version()}":
        sys.exit(f"the tag {name} does not belong to version {version()} of Cargo.toml")


def version() -> str:
    """The version of the package."""
    return str(_table("Cargo.toml")["package"]["version"])


def say(text: str) -> None:
    """Print a line at once, before output of child processes."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _table(name: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))


def _wheel() -> Path:
    """The wheel of this version in out/wheels."""
    found = sorted(WHEELS.glob(f"bipot_rs-{version()}-*.whl"))
    if len(found) != 1 or not re.fullmatch(NAME, found[0].name):
        names = ", ".join(path.name for path in found) or "no wheel"
        sys.exit(f"{WHEELS}: expected one abi3 wheel of {version()}, got {names}")
    return found[0]


def _made(name: str) -> Path:
    """A new virtual environment; its interpreter."""
    folder = PLACES / name
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=True, symlinks=os.name != "nt")
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _pip(python: Path, *what: str | Path) -> None:
    """Install from wheels: a source that is compiled would test another library."""
    command = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    _run(python, *command, "--only-binary", ":all:", *what)


def _alone(python: Path) -> str:
    """Versions of NumPy and SciPy, if nothing else is there and the wheel is imported."""
    listed = _run(python, "-m", "pip", "list", "--format", "json", printed=False)
    there = {one["name"].lower(): one["version"] for one in json.loads(listed)}
    others = set(there) - {"bipot-rs", "numpy", "scipy", "pip", "setuptools", "wheel"}
    if others:
        sys.exit(f"the wheel installs more than NumPy and SciPy: {sorted(others)}")
    code = "import bipot_rs as b; print(b.__file__); print(b.__version__)"
    file, found = _run(python, "-P", "-c", code, printed=False).splitlines()
    if not Path(file).is_relative_to(PLACES) or found != version():
        sys.exit(f"imported {found} from {file}, expected {version()} of the wheel")
    return f"NumPy {there['numpy']}, SciPy {there['scipy']}, Python {_python(python)}"


def _python(python: Path) -> str:
    code = "import platform; print(platform.python_version())"
    return _run(python, "-c", code, printed=False).strip()


def _run(python: Path, *arguments: str | Path, printed: bool = True) -> str:
    """Run Python; its output is printed or returned."""
    done = subprocess.run(
        [python, *arguments],
        cwd=ROOT,
        env=_environment(),
        stdout=None if printed else subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.stdout.write(done.stdout or "")
        sys.exit(f"failed: {' '.join(map(str, arguments))}")
    return done.stdout or ""


def _environment(**more: str) -> dict[str, str]:
    kept = {k: v for k, v in os.environ.items() if k not in (*FLAGS, *PATHS)}
    return kept | more


if __name__ == "__main__":
    main(sys.argv[1:])
