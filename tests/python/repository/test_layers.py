"""The order of the layers in Rust and Python, and names that few files may use."""

import ast
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from draw_architecture import PICTURE, arrows, imports, layers, picture
from support.rust_source import module, naming_violations, tree_violations, uses

# From the lowest module, which uses no other, to the highest.
RUST = (
    "error",
    "panics",
    "per_process",
    "threads",
    "linalg",
    "assembly",
    "law",
    "reduced",
    "condensation",
    "solver",
    "proof",
    "path",
    "primal",
    "python",
)
# The same within a folder; modules named together must not use each other.
RUST_SIBLINGS = {
    "linalg": (
        "compensated packed pages power_of_two random_signs real small union",
        "dense gmres jacobi least_squares parallel",
        "conjugate_gradients flexible_gmres lu nonnegative verified_cholesky",
        "sparse",
        "amg",
    ),
    "linalg/amg": (
        "nodes settings wide",
        "block_matrix rigid_motions",
        "block_rows changes",
        "aggregates coarsest connected inverse_diagonal slots spectrum",
        "changed_rows tentative",
        "prolongation",
        "galerkin node_rows",
        "transfer",
        "level",
        "cycle hierarchy",
        "multigrid",
        "following soft_motions",
    ),
    "linalg/sparse": (
        "blocks csc ordering",
        "supervariables",
        "tree",
        "symbolic",
        "sparse_lu task_tree",
        "arena tree_solves",
        "multifrontal",
        "reach solves",
    ),
    "assembly": ("cells element inspection shapes", "pattern", "sum", "stiffness"),
    "law": (
        "cone second_order sliding",
        "alart_curnier bipotential elliptic one_node",
        "face frozen",
    ),
    "reduced": (
        "elliptic_scaling memory validate",
        "rotation",
        "island",
        "compliance",
        "reduced",
        "residual",
        "existence",
        "balance",
    ),
    "condensation": (
        "forecast pattern_cache sparse stats",
        "null_space rigid_motions",
        "body",
        "analysed surface",
        "assemble bodies",
        "condense",
        "candidates",
        "problem",
    ),
    "solver": (
        "anderson farkas outcome settings",
        "derivatives enumerate monitor",
        "newton",
        "gauss_seidel interior proximal",
        "paper auto",
        "solution",
        "fallback",
        "solve",
    ),
    "solver/newton": (
        "linearisation",
        "compliance_form",
        "stiffness_form",
        "newton",
        "refine",
    ),
    "solver/derivatives": ("tangent_system", "tangent_stiffness_form"),
    "solver/paper": ("pivoting uzawa", "principles", "multipliers"),
    "solver/paper/principles": (
        "convex",
        "alternating_principles displacement_principle stress_principle",
        "minimising_sequence",
    ),
    "proof": (
        "fixed_point_index monotonicity",
        "weights",
        "contraction uniqueness",
        "error_bound",
    ),
    "path": ("stepping", "working_set"),
    "primal": (
        "nodes",
        "own_nodes",
        "frames",
        "contacts supports transformation",
        "interface",
        "problem",
        "tangent",
        "engine linearised_laws",
        "certificate filter",
        "preconditioner",
        "local newton",
        "linearised load_step",
        "path",
    ),
    "python": (
        "errors arrays heap interrupt",
        "assembly solver",
        "problem",
        "enumeration load_path tangent",
        "contact_values",
        "contact_variables",
        "bound contact_path estimate linearised_laws primal",
        "primal_tangent",
    ),
}
# A word in the code, and the only files that may contain it. An upgrade of a library, or
# a review of code that the compiler cannot check, then concerns few files.
RUST_NAMES = {
    "faer": ("linalg/dense/",),
    "metis_sys": ("linalg/sparse/ordering.rs",),
    "pyo3": ("python/",),
    "numpy": ("python/",),
    "unsafe": (
        "linalg/amg/wide.rs",
        "linalg/dense/kernels.rs",
        "linalg/pages.rs",
        "linalg/sparse/ordering.rs",
        "linalg/sparse/arena.rs",
    ),
}
# A library, and the only modules that may name it.
PYTHON_NAMES = {
    "meshio": ("mesh.readers",),
    "skfem": ("mesh.kinds", "mesh.serendipity"),
    "h5py": ("files.export", "fclib"),
    "pandas": ("contact.results.tables",),
    "petsc4py": ("petsc.library",),
    "mpi4py": ("petsc.library",),
    "jax": ("frameworks.jax_primitive",),
    "torch": ("frameworks.torch_function",),
}
# Files allowed at the top of the package, besides folders.
TOP = {"__init__.py", "__main__.py", "_core.pyi", "analytic.py", "fclib.py", "py.typed"}


def python_name_violations(tree: Mapping[str, str]) -> list[str]:
    """Modules that name a library reserved for others."""
    return [
        f"{name}: may not name {library}"
        for name, text in sorted(tree.items())
        for library in {module.partition(".")[0] for module, _ in imports(text)}
        if name not in PYTHON_NAMES.get(library, (name,))
    ]


def borrowed(tree: Mapping[str, str]) -> list[str]:
    """Imports of a name from a module of the package that does not define it."""
    own = {name: _defined(text) for name, text in tree.items()}
    found = []
    for name, text in sorted(tree.items()):
        for module_path, names in imports(text):
            head, _, source = module_path.partition(".")
            if head != "bipot_rs" or source not in own or name == "__init__":
                continue
            if not names and not source:
                found.append(f"{name}: imports bipot_rs, not the module with the name")
            known = own[source] | {"_core"}
            found += [
                f"{name}: {what} is not defined in {source or 'bipot_rs'}"
                for what in names
                if what not in known and f"{source}.{what}".strip(".") not in tree
            ]
    return found


def _defined(text: str) -> set[str]:
    found = set()
    nodes = list(ast.parse(text).body)
    # A function may be defined for Python and imported for type checkers.
    nodes += [part for node in nodes for part in getattr(node, "orelse", ())]
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        for target in getattr(node, "targets", [getattr(node, "target", None)]):
            names = ast.walk(target) if target is not None else ()
            found |= {part.id for part in names if isinstance(part, ast.Name)}
    return found


def lint(package: Path, settings: Path) -> subprocess.CompletedProcess[str]:
    """import-linter on the package in a folder, by the contracts of pyproject.toml."""
    return subprocess.run(
        [
            Path(sys.executable).with_name("lint-imports"),
            f"--config={settings}",
            "--no-cache",
        ],
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def rust_tree(repository: Path) -> dict[str, str]:
    root = repository / "src"
    return {p.relative_to(root).as_posix(): p.read_text() for p in root.rglob("*.rs")}


@pytest.fixture(scope="module")
def python_tree(repository: Path) -> dict[str, str]:
    root = repository / "python" / "bipot_rs"
    return {_dotted(p.relative_to(root)): p.read_text() for p in root.rglob("*.py")}


def _dotted(file: Path) -> str:
    parts = file.with_suffix("").parts
    return ".".join(parts[:-1] if len(parts) > 1 and parts[-1] == "__init__" else parts)


def test_rust_layers(rust_tree: dict[str, str]) -> None:
    assert {"error.rs", "law/cone.rs", "linalg/dense/mod.rs"} <= set(rust_tree)
    assert tree_violations(rust_tree, RUST, RUST_SIBLINGS) == []


@pytest.mark.parametrize("word", RUST_NAMES)
def test_rust_names(rust_tree: dict[str, str], word: str) -> None:
    assert naming_violations(rust_tree, word, RUST_NAMES[word]) == []


def test_python_layers(repository: Path) -> None:
    run = lint(repository / "python", repository / "pyproject.toml")
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        (
            "contact/law/frames.py",
            "from bipot_rs.fem import body",
            "contact is not allowed",
        ),
        ("analytic.py", "def f():\n    import bipot_rs.scene.case", "analytic is not"),
        (
            "mesh/elements.py",
            "import bipot_rs.mesh.readers",
            "No folder has a cycle BROKEN",
        ),
        ("helpers.py", "", "not listed as layers"),
    ],
)
@pytest.mark.slow_variants("*helpers.py*", "*mesh/elements.py*")
def test_python_layers_see_a_violation(
    file: str, text: str, said: str, repository: Path, tmp_path: Path
) -> None:
    package = repository / "python" / "bipot_rs"
    shutil.copytree(package, tmp_path / "bipot_rs", ignore=_no_sources)
    with (tmp_path / "bipot_rs" / file).open("a") as planted:
        planted.write(f"\n{text}\n")
    run = lint(tmp_path, repository / "pyproject.toml")
    assert run.returncode == 1
    assert said in " ".join(run.stdout.split())


def _no_sources(folder: str, names: list[str]) -> list[str]:
    return [n for n in names if not (n.endswith(".py") or (Path(folder) / n).is_dir())]


def test_python_names(python_tree: dict[str, str]) -> None:
    assert {"__init__", "contact.problem", "mesh.readers"} <= set(python_tree)
    assert python_name_violations(python_tree) == []
    planted = {"contact.problem": "def f():\n    import meshio"}
    assert python_name_violations(planted) == ["contact.problem: may not name meshio"]


def test_names_come_from_where_they_are_defined(python_tree: dict[str, str]) -> None:
    assert borrowed(python_tree) == []
    planted = {"a": "from bipot_rs.b import f", "b": "from bipot_rs.c import f"}
    assert borrowed(planted) == ["a: f is not defined in b"]
    whole = "a: imports bipot_rs, not the module with the name"
    assert borrowed({"a": "def f():\n    import bipot_rs", "": ""}) == [whole]


def test_picture_of_the_layers_is_up_to_date() -> None:
    # More arrows than this make the picture hard to read.
    assert 30 < len(arrows(layers())) <= 62
    found = PICTURE.read_text(encoding="utf-8")
    assert found == picture(), "run docs/draw_architecture.py"


def test_the_top_of_the_package(repository: Path) -> None:
    top = (repository / "python" / "bipot_rs").iterdir()
    files = {path.name for path in top if path.is_file()}
    assert {name for name in files if not name.endswith(".so")} == TOP


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("law/cone.rs", "use crate::reduced::residual::f;", "law may not use reduced"),
        (
            "law/cone.rs",
            "fn f() { crate::solver::g(); }",
            "law may not use solver",
        ),
        ("law/cone.rs", "use super::one_node::f;", "cone may not use one_node"),
        (
            "law/cone.rs",
            "use crate::{error::Error,\n  reduced::{a as b, c}};",
            "law may not use reduced",
        ),
        ("linalg/small.rs", "use super::super::law::cone;", "linalg may not use law"),
        (
            "law/cone.rs",
            "mod tests { use super::super::one_node::f; }",
            "cone may not use one_node",
        ),
        ("law/cone.rs", "use super::sliding::f;", "cone may not use sliding"),
        ("error.rs", "use crate::threads::pool;", "error may not use threads"),
        ("law/cone.rs", "use crate::Status;", "name the module it lives in"),
        ("law/cone.rs", "use super::project;", "name the module it lives in"),
        ("law/cone.rs", "use crate::law;", "name the module it lives in"),
        (
            "solver/newton/newton.rs",
            "use crate::solver::newton::refine::f;",
            "newton may not use refine",
        ),
        (
            "solver/newton/newton.rs",
            "use crate::solver::solve::f;",
            "newton may not use solve",
        ),
        ("law/helpers.rs", "", "not declared among the files of law"),
        (
            "solver/newton/helpers.rs",
            "",
            "not declared among the files of solver/newton",
        ),
        ("extra.rs", "", "layer extra is not declared"),
    ],
)
def test_rust_layers_see_a_violation(file: str, text: str, said: str) -> None:
    tree = {f"law/{name}.rs": "" for name in ("one_node", "cone", "sliding", "mod")}
    tree |= {"solver/newton/refine.rs": "", "solver/solve.rs": ""}
    found = tree_violations(tree | {file: text}, RUST, RUST_SIBLINGS)
    assert found
    assert all(f.startswith(file) and f.endswith(said) for f in found)


def test_rust_layers_let_pass_what_is_allowed() -> None:
    tree = {
        "lib.rs": "pub use crate::path::stepping::LoadPath;",
        "law/mod.rs": "pub mod cone; pub mod one_node; use crate::law::cone::project;",
        "law/cone.rs": """
            //! See [`solve`](crate::solver::solve), and "crate::solver".
            use crate::linalg::small::{Block, dot};
            const QUOTE: char = '"'; /* crate::solver */
            const TEXT: &str = "crate::solver::f";
            const RAW: &str = r#"crate::solver::"f""#;
            fn longest<'a>(x: &'a str) -> &'a str { x }
            mod tests { use super::project; use crate::error::Error; }
        """,
        "law/one_node.rs": "use crate::law::cone::Status; use super::cone::project;",
        "linalg/small.rs": "",
    }
    assert tree_violations(tree, RUST, RUST_SIBLINGS) == []


def test_rust_paths_are_resolved() -> None:
    text = "use crate::{a::{b, c::d}, e as f};\nmod tests {\n use super::*;\n}"
    assert [u.path for u in uses("law/cone.rs", text)] == [
        ("a", "b"),
        ("a", "c", "d"),
        ("e",),
        ("law", "cone", "*"),
    ]
    assert [u.line for u in uses("law/cone.rs", text)] == [1, 1, 1, 3]
    assert [module(f) for f in ("lib.rs", "law/mod.rs", "law/cone.rs", "error.rs")] == [
        (),
        ("law",),
        ("law", "cone"),
        ("error",),
    ]


@pytest.mark.parametrize("word", RUST_NAMES)
def test_rust_names_see_a_violation(word: str) -> None:
    tree = {"reduced/island.rs": f"let x = {word} ::f();", "law/a.rs": f"// {word}"}
    assert naming_violations(tree, word, RUST_NAMES[word]) == [
        f"reduced/island.rs: {word}"
    ]


def third_parties(statement: str) -> set[str]:
    """Packages outside the standard library that a fresh interpreter has loaded."""
    script = f"""
import sys
before = set(sys.modules)
{statement}
import json
names = {{n.partition(".")[0] for n in set(sys.modules) - before}}
print(json.dumps(sorted(names - set(sys.stdlib_module_names))))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return set(json.loads(done.stdout))


def test_import_brings_only_numpy() -> None:
    found = third_parties("import bipot_rs")
    assert found <= {"bipot_rs", "numpy"} | third_parties("import numpy")
    assert "bipot_rs" in found


def test_import_check_sees_a_violation() -> None:
    assert "scipy" in third_parties("import scipy")
