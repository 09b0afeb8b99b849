"""Libraries that a process must not load, because each import delays its start."""

import json
from pathlib import Path

import pytest

from support.programs import child

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
    run = child(code + told, cwd=folder)
    assert run.returncode == 0, run.stderr
    return set(json.loads(run.stdout.splitlines()[-1]))


PROJECT = "import numpy as np, bipot_rs; bipot_rs.project(np.ones((2, 3)), 0.3)"
REDUCED = """
import bipot_rs as bp
solution = bp.ReducedProblem([[2.0, 0.0], [0.0, 1.0]], [[-1.0, 0.75]], 0.5).solve()
assert solution.converged
"""
# meshio imports rich.
FILES = ("h5py", "meshio", "pydantic", "rich", "scipy")


@pytest.mark.parametrize(
    ("code", "used"),
    [
        pytest.param("import bipot_rs", (), id="import"),
        pytest.param(PROJECT, (), id="project"),
        pytest.param(REDUCED, (), id="reduced"),
        pytest.param(ARRAYS, ("scipy",), id="arrays"),
        pytest.param(COMMAND.format(["run", "--help"]), (), id="help of a command"),
        pytest.param(COMMAND.format(["scenes"]), (), id="scenes"),
        pytest.param(COMMAND.format(["new"]), (), id="new"),
        pytest.param(
            COMMAND.format(["check", *RUN[1:]]), ("pydantic", "scipy"), id="check"
        ),
        pytest.param(COMMAND.format(RUN), FILES, id="json"),
        pytest.param(COMMAND.format(RUN[:-1]), FILES, id="table"),
        # The shapes and nodes of second order are those of scikit-fem.
        pytest.param(
            COMMAND.format([*RUN, "--set", "mesh.element=Q2"]),
            (*FILES, "skfem"),
            id="second order",
        ),
    ],
)
@pytest.mark.quick_variants("project", "reduced", "help of a command", "json")
def test_loads_only_what_it_uses(
    code: str, used: tuple[str, ...], tmp_path: Path
) -> None:
    modules = loaded(code, tmp_path)
    assert "bipot_rs" in modules
    assert {name for name in HEAVY if name in modules} == set(used)
    assert not {"petsc4py", "mpi4py"} & modules
    # Few contacts are paired without a tree.
    assert "scipy.spatial" not in modules


# The least that a program with sparse matrices imports.
LEAST = "import numpy, scipy.sparse"


def test_help_loads_no_more_modules_than_sparse_matrices(tmp_path: Path) -> None:
    modules = loaded(COMMAND.format(["--help"]), tmp_path)
    assert not {"numpy", "bipot_rs._core", *HEAVY} & modules
    assert len(modules) <= len(loaded(LEAST, tmp_path))
