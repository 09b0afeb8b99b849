"""Libraries that a process must not load, because each import delays its start."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

# Together they take a third of a second or more.
HEAVY = (
    *("distributed", "h5py", "matplotlib", "meshio", "pydantic", "rich", "scipy"),
    "skfem",
)
ARRAYS = """
import numpy as np
import bipot_rs as bp
K, B = 2 * np.eye(3), np.eye(3)
result = bp.solve(K, B, [-1.0, 0.2, 0.0], gap=[0.0], mu=0.3)
assert result.success
"""
COMMAND = "from bipot_rs.cli.entry import call; assert call({!r}) in (0, None)"
RUN = ["run", "two_blocks", "--set", "mesh.n=2", "--json"]


def loaded(code: str, folder: Path) -> set[str]:
    """Modules loaded in a fresh interpreter after running the code."""
    told = "\nimport json, sys; print('\\n' + json.dumps(sorted(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", code + told],
        capture_output=True,
        text=True,
        cwd=folder,
        check=True,
    )
    return set(json.loads(run.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    ("code", "used"),
    [
        ("import bipot_rs", ()),
        ("import numpy as np, bipot_rs; bipot_rs.project(np.ones((2, 3)), 0.3)", ()),
        (ARRAYS, ("scipy",)),
        (COMMAND.format(["--help"]), ()),
        (COMMAND.format(["run", "--help"]), ()),
        (COMMAND.format(["scenes"]), ()),
        (COMMAND.format(["new"]), ()),
        (COMMAND.format(["check", *RUN[1:]]), ("pydantic", "scipy")),
        # meshio imports rich.
        (COMMAND.format(RUN), ("h5py", "meshio", "pydantic", "rich", "scipy")),
        (COMMAND.format(RUN[:-1]), ("h5py", "meshio", "pydantic", "rich", "scipy")),
        # The shapes and nodes of second order are those of scikit-fem.
        (
            COMMAND.format([*RUN, "--set", "mesh.element=Q2"]),
            ("h5py", "meshio", "pydantic", "rich", "scipy", "skfem"),
        ),
    ],
    ids=[
        "import",
        "project",
        "arrays",
        "help",
        "help of a command",
        "scenes",
        "new",
        "check",
        "json",
        "table",
        "second_order",
    ],
)
@pytest.mark.slow_variants("arrays", "check", "json", "new", "scene", "table")
def test_loads_only_what_it_uses(
    code: str, used: tuple[str, ...], tmp_path: Path
) -> None:
    modules = loaded(code, tmp_path)
    assert "bipot_rs" in modules
    assert {name for name in HEAVY if name in modules} == set(used)


@pytest.mark.slow
def test_modules_are_attributes_of_the_package(tmp_path: Path) -> None:
    code = (
        "import bipot_rs as bp\nfound = bp.{0}\nassert found.__name__ == 'bipot_rs.{1}'"
    )
    for name in ("fem", "obstacle", "scene", "theory"):
        loaded(code.format(name, name), tmp_path)
    loaded(code.format("model", "scene.builder"), tmp_path)
    loaded(code.format("paraview", "fem.paraview"), tmp_path)


# The least that a program with sparse matrices imports.
LEAST = "import numpy, scipy.sparse"


def test_help_loads_no_more_modules_than_sparse_matrices(tmp_path: Path) -> None:
    modules = loaded(COMMAND.format(["--help"]), tmp_path)
    assert not {"numpy", "bipot_rs._core"} & modules
    assert len(modules) <= len(loaded(LEAST, tmp_path))


@pytest.mark.slow
def test_few_contacts_are_paired_without_a_tree(tmp_path: Path) -> None:
    assert "scipy.spatial" not in loaded(COMMAND.format(RUN), tmp_path)
