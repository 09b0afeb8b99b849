"""The distributed packages: built, installed with NumPy and SciPy only, and used.

Nothing is downloaded. The dependencies of the wheel are taken from this environment by
name, and the interpreter that runs it sees no other packages.
"""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Callable
from email import message_from_bytes
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy

from support import places

pytestmark = pytest.mark.slow
SOLVE = """
import sys
sys.path.insert(0, {site!r})
import numpy as np
import bipot_rs as bp
assert bp.__file__.startswith({site!r}), bp.__file__
result = bp.solve(1000.0 * np.eye(2), np.eye(2), [-10.0, 5.0], gap=[0.0], mu=0.3)
assert result.reaction[0, 0].tolist() == [10.0, -3.0]
try:
    result.save("x.h5")
except ModuleNotFoundError as error:
    print(error)
told = bp.versions()
print(told["core"], told["h5py"], told["scikit-fem"])
"""
Build = Callable[[str], Path]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Build:
    folder = tmp_path_factory.mktemp("dist")

    @cache
    def build(kind: str) -> Path:
        release = ["--release", "--locked"] if kind == "build" else []
        command = [sys.executable, "-m", "maturin", kind, *release, "-o", folder]
        subprocess.run(command, cwd=places.ROOT, check=True, capture_output=True)
        (made,) = folder.glob("*.whl" if kind == "build" else "*.tar.gz")
        return made

    return build


def test_the_wheel_solves_with_numpy_and_scipy_alone(
    built: Build, tmp_path: Path
) -> None:
    wheel, site = built("build"), tmp_path / "site"
    assert re.fullmatch(r"bipot_rs-[\d.]+-cp311-abi3-\w+\.whl", wheel.name)
    zipfile.ZipFile(wheel).extractall(site)
    for package in (np, scipy):
        home = Path(package.__file__).parent
        for part in (home, home.with_name(f"{home.name}.libs")):
            if part.exists():
                (site / part.name).symlink_to(part)
    # Neither the packages of the environment or the user, nor their variables.
    command = [sys.executable, "-I", "-S", "-c", SOLVE.format(site=str(site))]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    message, versions = done.stdout.splitlines()
    assert "pip install 'bipot-rs[io]'" in message
    assert versions.endswith("release build not installed not installed")


def test_the_wheel_holds_the_package_and_asks_for_little(built: Build) -> None:
    wheel = built("build")
    assert wheel.stat().st_size < 10e6
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (described,) = (n for n in names if n.endswith(".dist-info/METADATA"))
        told = message_from_bytes(archive.read(described))
    assert listed(places.ROOT / "python", "") <= names
    needed = [r for r in told.get_all("Requires-Dist", []) if "extra ==" not in r]
    assert sorted(re.split(r"[<>=]", r)[0] for r in needed) == ["numpy", "scipy"]


def listed(root: Path, folder: str) -> set[str]:
    """The sources below a folder."""
    kinds = (".rs", ".py", ".pyi", ".toml", ".inp", ".typed")
    files = (path for path in (root / folder).rglob("*") if path.suffix in kinds)
    return {path.relative_to(root).as_posix() for path in files}


def test_the_source_distribution_holds_what_builds_it(
    built: Build, tmp_path: Path
) -> None:
    archive = built("sdist")
    assert archive.stat().st_size < 2e6
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, filter="data")
    (root,) = tmp_path.iterdir()
    for folder in ("src", "python"):
        assert listed(places.ROOT, folder) <= listed(root, folder)
    # Cargo reads it unchanged: every target that the manifest names must be there.
    read = ["cargo", "metadata", "--offline", "--locked", "--no-deps"]
    read += ["--format-version", "1"]
    subprocess.run(read, cwd=root, check=True, capture_output=True)
    manifest = tomllib.loads((root / "Cargo.toml").read_text("utf-8"))
    for bench in manifest["bench"]:
        assert (root / "benches" / f"{bench['name']}.rs").is_file()
    assert not (root / "tests").exists()
