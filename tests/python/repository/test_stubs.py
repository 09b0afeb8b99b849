"""The typed interface of the package: stubs, marker, docstrings."""

import ast
import inspect
from pathlib import Path

import pytest

import bipot_rs as bp
from bipot_rs import _core


def public(module: object) -> list[str]:
    return [name for name in dir(module) if not name.startswith("_")]


def test_the_stub_has_the_names_of_the_core(repository: Path) -> None:
    stub = ast.parse((repository / "python/bipot_rs/_core.pyi").read_text())
    declared = set()
    for node in stub.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            declared.add(node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            declared.add(node.target.id)
    declared = {name for name in declared if not name.startswith("_")}
    assert declared == set(public(_core))


def test_package_says_that_it_is_typed() -> None:
    assert (Path(bp.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("name", bp.__all__)
def test_public_docstrings(name: str) -> None:
    thing = getattr(bp, name)
    if inspect.ismodule(thing) or inspect.isclass(thing) or callable(thing):
        assert inspect.getdoc(thing)


@pytest.mark.parametrize(
    "name", [n for n in bp.__all__ if inspect.isclass(getattr(bp, n))]
)
def test_methods_have_docstrings(name: str) -> None:
    kind = getattr(bp, name)
    if issubclass(kind, int):  # # Python documents what an IntEnum inherits
        return
    for attribute, value in vars(kind).items():
        if not attribute.startswith("_") and callable(value):
            assert inspect.getdoc(value), f"{name}.{attribute}"
