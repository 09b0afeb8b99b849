"""The order of the layers in Rust and Python, and names that few files may use."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from draw_architecture import PICTURE, picture
from support.places import ROOT

SOURCE, PACKAGE = ROOT / "src", ROOT / "python" / "bipot_rs"
RUST = (
    *("error", "panics", "fitted", "per_process", "threads", "tasks", "linalg"),
    *("bodies", "assembly", "law", "equilibrium", "reduced", "condensation"),
    *("solver", "proof", "path", "primal", "python"),
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
        "linalg/amg/avx2.rs",
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
    "matplotlib": ("plots/mpl.py", "plots/space_axes.py", "contact/results/result.py"),
    "petsc4py": ("petsc/library.py",),
    "mpi4py": ("petsc/library.py",),
    "jax": ("frameworks/jax_primitive.py", "frameworks/jax.py"),
    "torch": ("frameworks/torch_function.py", "frameworks/torch.py"),
    # The linter takes imports of the package for those of `_core`.
    "bipot_rs(?= as|$)": (),
}


def code(path: Path) -> str:
    """A file without strings and, in Rust, without comments."""
    return re.sub(r'//.*|"(?:\\.|[^"\\])*"', "", path.read_text(encoding="utf-8"))


def upward(layer: str, text: str) -> list[str]:
    """Paths in the code of a layer that lead to a layer above it, or that hide where they lead."""
    below = RUST[: RUST.index(layer) + 1]
    used = re.findall(r"\bcrate::(\w+|\{)|\b(super::super)\b", text)
    return [name or hidden for name, hidden in used if name not in below]


def test_a_layer_of_rust_uses_only_those_below_it() -> None:
    assert {path.stem for path in SOURCE.iterdir()} - {"lib"} <= set(RUST)
    imports_upward = {
        path.name: used
        for layer in RUST
        for path in [*(SOURCE / layer).rglob("*.rs"), *SOURCE.glob(f"{layer}.rs")]
        if (used := upward(layer, code(path)))
    }
    assert imports_upward == {}


@pytest.mark.parametrize(
    ("root", "files", "words", "pattern"),
    [
        (SOURCE, "*.rs", RUST_NAMES, r"\b{}\b"),
        (PACKAGE, "*.py", PYTHON_NAMES, r"^ *(?:import|from) {}\b"),
    ],
    ids=["Rust", "Python"],
)
def test_few_files_name_a_library(
    root: Path, files: str, words: dict[str, tuple[str, ...]], pattern: str
) -> None:
    naming = [
        f"{name}: {word}"
        for path in root.rglob(files)
        for text, name in [(code(path), path.relative_to(root).as_posix())]
        for word, allowed in words.items()
        if re.search(pattern.format(word), text, re.MULTILINE)
        and not name.startswith(allowed)
    ]
    assert naming == []


def test_python_layers() -> None:
    command = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run(
        [command, f"--config={ROOT / 'pyproject.toml'}", "--no-cache"],
        cwd=ROOT / "python",
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout


def test_picture_of_the_layers_is_up_to_date() -> None:
    assert PICTURE.read_text("utf-8") == picture(), "run docs/draw_architecture.py"
