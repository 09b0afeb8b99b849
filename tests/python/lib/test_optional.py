"""Without an optional library the rest works, and the message names the extra."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from bipot_rs._lib.optional import lazily, missing
from support.programs import child_without

OPTIONAL = (
    *("argcomplete", "gmsh", "h5py", "matplotlib", "meshio", "pydantic", "pyvista"),
    *("rich", "skfem"),
)
SOLVE = """
import pickle
import numpy as np
import bipot_rs as bp
K, B = 1000.0 * np.eye(2), np.eye(2)
problem = bp.ContactProblem(K, B, gap=[0.0], mu=0.3)
result = problem.solve([[-10.0, 2.0], [-10.0, 5.0]])
assert result.reaction[:, 0].tolist() == [[10.0, -2.0], [10.0, -3.0]]
assert result[-1].error_estimate[0] < 1e-12
assert problem.reduced([-10.0, 5.0]).solve().unique == "proved"
assert pickle.loads(pickle.dumps(result)).success
assert bp.project([[1.0, 3.0]], 0.5)[0].tolist() == [[2.0, 1.0]]
from bipot_rs import analytic, theory
bp.show_versions()
"""


def test_arrays_need_no_optional_library(tmp_path: Path) -> None:
    done = child_without(OPTIONAL, SOLVE, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "numpy" in done.stdout


PROBLEM = "bp.ContactProblem([[1, 0], [0, 1]], [[1, 0], [0, 1]], gap=[0], mu=0)"


@pytest.mark.parametrize(
    ("library", "extra", "code", "told"),
    [
        ("h5py", "io", "bp.load('x.h5')", "files need h5py"),
        ("h5py", "io", "bp.fclib.read('x')", "files need h5py"),
        (
            "skfem",
            "fem",
            "bp.fem.box([[0, 1]] * 2, 'triangle')",
            "finite elements need scikit-fem",
        ),
        (
            "pydantic",
            "cli",
            "bp.scene.read",
            "bipot_rs.scene.read and what uses it need pydantic",
        ),
        ("xarray", "", f"{PROBLEM}.solve().to_xarray()", "datasets need xarray"),
        ("jax", "jax", f"bp.jax.solve({PROBLEM}, [-1.0, 0])", "need jax"),
        ("torch", "torch", f"bp.torch.solve({PROBLEM}, [-1.0, 0])", "need torch"),
    ],
)
@pytest.mark.quick_variants("h5py-*load*")
def test_message_names_the_extra_to_install(
    library: str, extra: str, code: str, told: str, tmp_path: Path
) -> None:
    # Names of the package can be listed without them.
    names = "[getattr(bp, name) for name in dir(bp)]; " * (library in ("jax", "torch"))
    code = f"import bipot_rs as bp; {names}{code}"
    last = child_without((library,), code, cwd=tmp_path).stderr.splitlines()[-1]
    wanted = f"'bipot-rs[{extra}]'" if extra else library
    assert last.startswith("bipot_rs._lib.optional.MissingLibraryError: ")
    assert last.endswith(f"{told}, which is not installed: run pip install {wanted}")


def test_import_error_inside_a_library_is_unchanged() -> None:
    within = ModuleNotFoundError("No module named 'zlib'", name="zlib")
    assert missing(within, "files", "h5py", "io") is within
    without = ModuleNotFoundError("No module named 'h5py'", name="h5py")
    assert missing(without, "files", "h5py", "io") is not without


def test_a_package_without_its_source_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a program that is packed with bytecode only."""
    spec = SimpleNamespace(loader=SimpleNamespace(get_source=lambda _: None))
    monkeypatch.setitem(sys.modules, "packed", SimpleNamespace(__spec__=spec))
    with pytest.raises(ImportError, match="the source of packed is missing"):
        lazily("packed")
