"""Names of NumPy and SciPy that the package uses exist in the installed versions.

The check of a release runs this with the lowest versions that the package supports, also for
modules that need optional libraries, which no other test imports there.
"""

import ast
import importlib
from functools import cache
from pathlib import Path

import bipot_rs

PACKAGE = Path(bipot_rs.__file__).parent
LIBRARIES = ("numpy", "scipy")


def names(text: str) -> set[str]:
    """Full names of NumPy and SciPy in a source text, such as ``numpy.linalg.norm``."""
    nodes = list(ast.walk(ast.parse(text)))
    imported = {}
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                imported[alias.asname or alias.name] = alias.name
                top = alias.name.partition(".")[0]
                imported[top] = imported.get(top, top)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                imported[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    used = set(imported.values())
    for node in nodes:
        parts, inner = [], node
        while isinstance(inner, ast.Attribute):
            parts.append(inner.attr)
            inner = inner.value
        if parts and isinstance(inner, ast.Name) and inner.id in imported:
            used.add(".".join([imported[inner.id], *reversed(parts)]))
    return {name for name in used if name.partition(".")[0] in LIBRARIES}


@cache
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
