"""Names of NumPy and SciPy that the package uses exist in the installed versions.

The check of a release runs this with the lowest versions that the package supports, also for
modules that need optional libraries, which no other test imports there.
"""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import bipot_rs

PACKAGE = Path(bipot_rs.__file__).parent
LIBRARIES = ("numpy", "scipy")


def imports(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Local name and full name of everything that is imported from the libraries."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                top = alias.name.partition(".")[0]
                if top in LIBRARIES:
                    yield alias.asname or alias.name, alias.name
                    yield top, top
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if module.partition(".")[0] in LIBRARIES:
                for alias in node.names:
                    yield alias.asname or alias.name, f"{module}.{alias.name}"


def names(text: str) -> set[str]:
    """Full names of NumPy and SciPy in a source text, such as ``numpy.linalg.norm``."""
    tree = ast.parse(text)
    imported = dict(imports(tree))
    names_used = set(imported.values())
    for node in ast.walk(tree):
        parts, inner = [], node
        while isinstance(inner, ast.Attribute):
            parts.append(inner.attr)
            inner = inner.value
        if parts and isinstance(inner, ast.Name) and inner.id in imported:
            names_used.add(".".join([imported[inner.id], *reversed(parts)]))
    return names_used


def exists(name: str) -> bool:
    """Whether a name can be resolved; what follows a class or a function is not examined."""
    parts = name.split(".")
    here = importlib.import_module(parts[0])
    for k, part in enumerate(parts[1:], 2):
        try:
            here = getattr(here, part)
        except AttributeError:
            try:
                here = importlib.import_module(".".join(parts[:k]))
            except ModuleNotFoundError:
                return False
        if not hasattr(here, "__path__") and not hasattr(here, "__spec__"):
            return True
    return True


def test_names_exist() -> None:
    missing = {
        f"{path.relative_to(PACKAGE).as_posix()}: {name}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for name in names(path.read_text(encoding="utf-8"))
        if not exists(name)
    }
    assert missing == set()
