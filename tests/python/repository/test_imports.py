"""Libraries that a process must not load, because each import delays its start."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

# Together they take a third of a second or more.
HEAVY = (
    *("distributed", "h5py", "matplotlib", "meshio", "pydantic", "rich", "scipy"),
    *("skfem", "typer"),
)
ARRAYS = """
import numpy as np
import bipot_rs as bp
K, B = 2 * np.eye(3), np.eye(3)
result = bp.solve(K, B, [-1.0, 0.2, 0.0], gap=[0.0], mu=0.3)
assert result.success
"""
COMMAND = "from bipot_rs.cli.app import app; assert app({!r}) in (0, None)"
# As the console command, which reads the arguments of a run without Typer.
PROCESS = (
    "import sys; from bipot_rs.__main__ import main; "
    "sys.argv = ['bipot', *{!r}]; assert main() == 0"
)
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
        # rich formats the help text. Typer checks arguments by pydantic, even a name.
        (COMMAND.format(["--help"]), ("rich", "typer")),
        (COMMAND.format(["scenes"]), ("pydantic", "typer")),
        (COMMAND.format(["scenes", "two_blocks"]), ("pydantic", "typer")),
        (COMMAND.format(["new"]), ("pydantic", "typer")),
        (COMMAND.format(["check", *RUN[1:]]), ("pydantic", "scipy", "typer")),
        (PROCESS.format(RUN), ("h5py", "pydantic", "scipy")),
        # rich prints tables on a terminal only.
        (PROCESS.format(RUN[:-1]), ("h5py", "pydantic", "scipy")),
        # The shapes and nodes of second order are those of scikit-fem.
        (
            PROCESS.format([*RUN, "--set", "mesh.element=Q2"]),
            ("h5py", "pydantic", "scipy", "skfem"),
        ),
    ],
    ids=[
        "import",
        "project",
        "arrays",
        "help",
        "scenes",
        "scene",
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
    found = loaded(code, tmp_path)
    assert "bipot_rs" in found
    assert {name for name in HEAVY if name in found} == set(used)


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
    found = loaded(COMMAND.format(["--help"]), tmp_path)
    assert not {"numpy", "bipot_rs._core"} & found
    assert len(found) <= len(loaded(LEAST, tmp_path))


@pytest.mark.slow
def test_a_run_loads_few_modules_beside_sparse_matrices(tmp_path: Path) -> None:
    """Each module takes about 0.5 ms: see benches/import_time.py for the time of a process."""
    run = PROCESS.format(["run", "pressed_block", "--set", "mesh.n=4"])
    more = loaded(run, tmp_path) - loaded(LEAST, tmp_path)
    ours = {name for name in more if name.startswith("bipot_rs")}
    # 148, a file for each idea; the 104 of other libraries change with their versions.
    assert len(ours) <= 148
    assert len(more - ours) <= 115
    # Parts of the package that this scene has no use for.
    unused = (
        *("cli.app", "contact.diagnosis", "contact.existence", "contact.step_control"),
        *("mesh.readers", "mortar.integrals", "mortar.pairs"),
    )
    assert not {f"bipot_rs.{name}" for name in unused} & ours
    assert "bipot_rs.contact.sensitivity.linear_path" not in ours


@pytest.mark.slow
def test_few_contacts_are_paired_without_a_tree(tmp_path: Path) -> None:
    assert "scipy.spatial" not in loaded(COMMAND.format(RUN), tmp_path)


@pytest.mark.slow
def test_check_of_imports_sees_matplotlib(tmp_path: Path) -> None:
    """The check above would notice these names."""
    assert "matplotlib" in loaded(COMMAND.format([*RUN, "--plot"]), tmp_path)
