"""Who may use whom, in Rust and in Python, and who alone may name what."""

import ast
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from rust_source import module, naming_violations, tree_violations, uses

# From the module that knows nobody to the one that may know all.
RUST = (
    "error",
    "panics",
    "per_process",
    "threads",
    "linalg",
    "law",
    "problem",
    "solver",
    "stepping",
    "working_set",
    "python",
)
# Within a folder likewise; those named together do not know each other.
RUST_SIBLINGS = {
    "linalg": (
        "binary exact pages signs small union",
        "blocks csc jacobi",
        "gmres least_squares packed",
        "dense nonnegative ordering quotient",
        "below lu tree",
        "symbolic",
        "walk",
        "region sweep",
        "multifrontal sparse_lu",
        "solves",
        "reach",
    ),
    "law": (
        "frame cone second_order sliding",
        "alart_curnier bipotential elliptic one_node",
        "face frozen",
    ),
    "problem": (
        "forecast",
        "border memory patterns sparse stats stretch",
        "island null_space rigid_motions",
        "compliance",
        "reduced",
        "residual",
        "balance body overlap",
        "analysed surface",
        "assemble bodies",
        "condense",
        "candidates",
    ),
    "solver": (
        "anderson farkas index linearisation monitor monotony",
        "enumerate",
        "compliance_form",
        "stiffness_form",
        "gauss_seidel newton uzawa weights",
        "contraction convex interior pivoting proximal uniqueness",
        "displacement_principle stress_principle alternating_principles",
        "minimising_sequence",
        "auto error_bound refine",
        "solution",
    ),
    "python": (
        "errors arrays heap interrupt",
        "solver",
        "problem",
        "several",
        "bound estimate",
    ),
}
# Word of the code: the only files that may hold it. An upgrade of a library, or
# a review of what the compiler cannot check, then has few places to go.
RUST_NAMES = {
    "faer": ("linalg/dense/",),
    "metis_sys": ("linalg/ordering.rs",),
    "pyo3": ("python/",),
    "numpy": ("python/",),
    "unsafe": (
        *("linalg/ordering.rs", "linalg/dense/kernels.rs", "linalg/pages.rs"),
        "linalg/region.rs",
    ),
}
PYTHON = (
    "bodies facing mesh_error running",
    (
        "_core byte_order early extras figures sliding toml_text units vtu words "
        "running.exits running.folder running.interrupts running.telling running.workers"
    ),
    "shipped",
    "export error_bound installation summary",
    "structure",
    "check plane_friction result",
    "cone dof_order friction loading rigid_geometry",
    "stiffness_digits",
    "resultants remarks",
    (
        "answers diagnosis errors existence facing.box_tree facing.facet_shapes frames "
        "motion"
    ),
    "facing.clipping facing.facet_mesh facing.facet_tree facing.skewed",
    "facing.mortar",
    "facing.pairing",
    "reduced",
    "following",
    "adaptive",
    "problem",
    "global_problem one_call",
    "fclib",
    (
        "analytic bodies.elements bodies.gmsh_groups bodies.inp bodies.materials "
        "facing.closest"
    ),
    "bodies.boxes bodies.body",
    "bodies.elasticity bodies.inclined",
    "bodies.mesh_check bodies.stress bodies.surfaces",
    "bodies.mesh_file",
    "facing.facet_surface facing.rigid_motion",
    "obstacle",
    "facing.meeting",
    "theory.convex",
    "theory.materials",
    "theory.law theory.soils",
    "theory.explicit theory.functionals theory.inequalities theory.inelastic",
    "theory",
    "fem",
    "text_tables inspection contact_surface",
    "review",
    "stiffness_files",
    "schema.table",
    "schema.material schema.mesh schema.path",
    "schema.contact schema.load",
    "schema.root",
    "schema.consistency",
    "running.report schema scene_keys mesh_error.simplices",
    "case stand_ins",
    "scene_parts",
    "plots.canvas",
    "plots.source plots.skin plots.places",
    "plots.line plots.path plots.convergence plots.body",
    "plots.surface",
    "plots.space",
    "plots",
    (
        "running.resume scene plot paraview mesh_error.error_map "
        "mesh_error.johnson_mercier mesh_error.contact_facets mesh_error.equilibrium"
    ),
    "model running.forecast mesh_error.self_stress",
    "discretisation",
    "mesh_error.enough",
    "running.run_files",
    "commands.info_mesh commands.info_sweep",
    "commands.check commands.info commands.new commands.plot commands.schema",
    "commands.sweep",
    "commands",
    "running.job",
    "running.fclib_job running.stiffness_job",
    "cli",
    "__main__ __init__",
)
PYTHON_NAMES = {
    "meshio": ("bodies.mesh_file",),
    "skfem": ("bodies.elements",),
    "h5py": ("export", "fclib"),
}


FOLDERS = (
    "bipot_rs",
    "bipot_rs.bodies",
    "bipot_rs.commands",
    "bipot_rs.facing",
    "bipot_rs.mesh_error",
    "bipot_rs.plots",
    "bipot_rs.running",
    "bipot_rs.theory",
)


def python_violations(
    tree: Mapping[str, str],
    order: tuple[str, ...],
    names: Mapping[str, tuple[str, ...]],
) -> list[str]:
    """Imports against the order, and of libraries by files that may not name them."""
    found = []
    ranks = {name: rank for rank, group in enumerate(order) for name in group.split()}
    for name, text in sorted(tree.items()):
        if name not in ranks:
            found.append(f"{name}: not declared")
            continue
        for line, target in _imports(text):
            head, _, rest = target.partition(".")
            if head != "bipot_rs":
                if name not in names.get(head, (name,)):
                    found.append(f"{name}:{line}: may not name {head}")
                continue
            # Of a folder its file: theory.materials before theory.
            first, _, second = rest.partition(".")
            inner = f"{first}.{second.partition('.')[0]}"
            inner = inner if inner in ranks else first
            if inner not in ranks:
                found.append(f"{name}:{line}: {target}: import by module")
            elif ranks[inner] >= ranks[name] and inner != name:
                found.append(f"{name}:{line}: {name} may not use {inner}")
    return found


def _imports(text: str) -> list[tuple[int, str]]:
    """Absolute names of all imports, those within functions included."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "bipot_rs" if node.level else ""
            base = ".".join(part for part in (base, node.module) if part)
            if base in FOLDERS:  # from bipot_rs import result
                found += [(node.lineno, f"{base}.{a.name}") for a in node.names]
            else:
                found.append((node.lineno, base))
    return found


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


def test_python_layers(python_tree: dict[str, str]) -> None:
    assert {"__init__", "problem", "result"} <= set(python_tree)
    assert python_violations(python_tree, PYTHON, PYTHON_NAMES) == []


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("law/cone.rs", "use crate::problem::condense::f;", "law may not use problem"),
        (
            "law/cone.rs",
            "fn f() { crate::solver::g(); }",
            "law may not use solver",
        ),
        ("law/cone.rs", "use super::one_node::f;", "cone may not use one_node"),
        (
            "law/cone.rs",
            "use crate::{error::Error,\n  problem::{a as b, c}};",
            "law may not use problem",
        ),
        ("linalg/csc.rs", "use super::super::law::cone;", "linalg may not use law"),
        (
            "law/cone.rs",
            "mod tests { use super::super::one_node::f; }",
            "cone may not use one_node",
        ),
        ("law/cone.rs", "use super::frame::f;", "cone may not use frame"),
        ("error.rs", "use crate::threads::pool;", "error may not use threads"),
        ("law/cone.rs", "use crate::Status;", "name the module it lives in"),
        ("law/helpers.rs", "", "not declared among the files of law"),
        ("extra.rs", "", "layer extra is not declared"),
    ],
)
def test_rust_layers_see_a_violation(file: str, text: str, said: str) -> None:
    tree = {f"law/{name}.rs": "" for name in ("one_node", "cone", "frame", "mod")}
    found = tree_violations(tree | {file: text}, RUST, RUST_SIBLINGS)
    assert found
    assert all(f.startswith(file) and f.endswith(said) for f in found)


def test_rust_layers_let_pass_what_is_allowed() -> None:
    tree = {
        "lib.rs": "pub use crate::stepping::LoadPath;",
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
    tree = {"problem/condense.rs": f"let x = {word} ::f();", "law/a.rs": f"// {word}"}
    assert naming_violations(tree, word, RUST_NAMES[word]) == [
        f"problem/condense.rs: {word}"
    ]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("result", "from bipot_rs.problem import solve", "result may not use problem"),
        ("result", "from .problem import solve", "result may not use problem"),
        ("analytic", "from . import fem", "analytic may not use fem"),
        ("plot", "def f():\n    from . import scene", "plot may not use scene"),
        ("problem", "from bipot_rs import solve", "import by module"),
        ("check", "from bipot_rs.theory import law", "check may not use theory.law"),
        ("check", "import bipot_rs.theory.law", "check may not use theory.law"),
        ("problem", "def f():\n    import meshio", "may not name meshio"),
        ("helpers", "", "not declared"),
    ],
)
def test_python_layers_see_a_violation(name: str, text: str, said: str) -> None:
    (found,) = python_violations({name: text}, PYTHON, PYTHON_NAMES)
    assert found.startswith(name)
    assert found.endswith(said)


def third_parties(statement: str) -> set[str]:
    """Packages outside the standard library that a fresh interpreter then holds."""
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
