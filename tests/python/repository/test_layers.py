"""The order of the layers in Rust and Python, and names that few files may use."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from draw_architecture import PICTURE, arrows, imports, layers, picture
from support.places import ROOT

SOURCE, PACKAGE = ROOT / "src", ROOT / "python" / "bipot_rs"
# From the lowest module, which uses no other, to the highest.
RUST = (
    *(
        "error",
        "panics",
        "fitted",
        "per_process",
        "threads",
        "tasks",
        "linalg",
        "bodies",
        "assembly",
    ),
    *(
        "law",
        "equilibrium",
        "reduced",
        "condensation",
        "solver",
        "proof",
        "path",
        "primal",
    ),
    "python",
)
# A word in the code, and the only files or folders that may contain it. An upgrade of a
# library, or a review of code that the compiler cannot check, then concerns few files.
RUST_NAMES = {
    "clarabel": ("equilibrium/programme.rs",),
    "faer": ("linalg/dense/",),
    "metis_sys": ("linalg/sparse/ordering.rs",),
    "pyo3": ("python/",),
    "numpy": ("python/",),
    "unsafe": (
        "linalg/amg/avx512.rs",
        "linalg/amg/wide.rs",
        "linalg/dense/kernels.rs",
        "linalg/pages.rs",
        "linalg/sparse/ordering.rs",
        "linalg/sparse/arena.rs",
    ),
}
PYTHON_NAMES = {
    "skfem": ("mesh/kinds.py", "mesh/serendipity.py"),
    "h5py": ("files/export.py", "files/vtkhdf.py", "fclib.py"),
    "pandas": ("contact/results/tables.py",),
    "petsc4py": ("petsc/library.py",),
    "mpi4py": ("petsc/library.py",),
    "jax": ("frameworks/jax_primitive.py", "frameworks/jax.py"),
    "torch": ("frameworks/torch_function.py", "frameworks/torch.py"),
}


def code(path: Path) -> str:
    """A file of Rust without comments and strings."""
    return re.sub(r'//.*|"(?:\\.|[^"\\])*"', "", path.read_text(encoding="utf-8"))


def upward(layer: str, text: str) -> list[str]:
    """Paths in the code of a layer that lead to a layer above it, or that hide where they lead."""
    below = RUST[: RUST.index(layer) + 1]
    used = re.findall(r"\bcrate::(\w+|\{)|\b(super::super)\b", text)
    return [name or hidden for name, hidden in used if name not in below]


@pytest.mark.parametrize("layer", RUST)
def test_a_layer_of_rust_uses_only_those_below_it(layer: str) -> None:
    files = [*(SOURCE / layer).rglob("*.rs"), *SOURCE.glob(f"{layer}.rs")]
    imports_upward = {path.name: upward(layer, code(path)) for path in files}
    assert {name: used for name, used in imports_upward.items() if used} == {}


def test_every_module_of_rust_has_its_place_in_the_order() -> None:
    assert {path.stem for path in SOURCE.iterdir()} - {"lib"} <= set(RUST)


@pytest.mark.parametrize("word", RUST_NAMES)
def test_few_files_of_rust_name(word: str) -> None:
    there = [
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*.rs")
        if re.search(rf"\b{word}\b", code(path))
    ]
    assert [name for name in there if not name.startswith(RUST_NAMES[word])] == []


def test_python_layers() -> None:
    command = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run(
        [command, f"--config={ROOT / 'pyproject.toml'}", "--no-cache"],
        cwd=ROOT / "python",
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout


def test_the_package_itself_is_imported_by_nobody() -> None:
    """But for `_core`: the linter takes imports of the package for those of `_core`."""
    whole = [
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for module, names in imports(path.read_text(encoding="utf-8"))
        if module == "bipot_rs" and not names
    ]
    assert whole == []


def test_few_modules_name_a_library() -> None:
    naming = [
        f"{path.relative_to(PACKAGE).as_posix()}: {module}"
        for path in PACKAGE.rglob("*.py")
        for module, _ in imports(path.read_text(encoding="utf-8"))
        if (allowed := PYTHON_NAMES.get(module.partition(".")[0]))
        and path.relative_to(PACKAGE).as_posix() not in allowed
    ]
    assert naming == []


def test_picture_of_the_layers_is_up_to_date() -> None:
    # More arrows than this make the picture hard to read.
    assert 30 < len(arrows(layers())) <= 62
    assert PICTURE.read_text("utf-8") == picture(), "run docs/draw_architecture.py"
