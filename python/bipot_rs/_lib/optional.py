"""Imports at first use: of public names, and of optional libraries.

The error of a library that is not installed says which extra installs it.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType

# Name of the distribution, if it is not the name of the module.
_DISTRIBUTIONS = {"skfem": "scikit-fem"}


class MissingLibraryError(ModuleNotFoundError):
    """An optional library is not installed; the message names the extra that installs it."""


def missing(
    error: ModuleNotFoundError, what: str, library: str, extra: str
) -> ModuleNotFoundError:
    """The error of a failed import, with a message that says what to install.

    ``error``: as raised by Python. It is returned unchanged if it is about another module, for
    example one that the library itself imports: installing the extra would not help.
    ``what``: what needs the library, in the plural: ``"finite elements"``.
    ``library, extra``: name of the module, and the extra of this package with it, if any.
    """
    if error.name is None or error.name.partition(".")[0] != library:
        return error
    wanted = f"'bipot-rs[{extra}]'" if extra else library
    return MissingLibraryError(
        f"{what} need {_DISTRIBUTIONS.get(library, library)}, which is not installed: "
        f"run pip install {wanted}",
        name=error.name,
    )


def load_library(name: str, *, extra: str = "io", need: str = "files") -> ModuleType:
    """Import an optional library, or a module of it; ``need`` says what it is for.

    Raises `ModuleNotFoundError`: it is not installed; the message names the extra that installs
    it.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise missing(error, need, name.partition(".")[0], extra) from None


def lazily(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Make ``__getattr__`` and ``__dir__`` of a package.

    The names are those that its source imports for type checkers, ``if TYPE_CHECKING``. Each is
    imported when it is first used.
    """
    spec = sys.modules[package].__spec__
    source = spec.loader.get_source(package)  # type: ignore[union-attr]
    if source is None:
        raise ImportError(
            f"the source of {package} is missing, which lists its names: a program that is "
            "packed with bytecode only needs the files .py of bipot_rs too"
        )
    imports = [
        node
        for block in ast.parse(source).body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    ]
    places = {
        alias.asname or alias.name: (str(node.module), alias.name)
        for node in imports
        for alias in node.names
    }

    def getattr_(name: str) -> object:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, there = places[name]
        try:
            members = vars(import_module(module))
            # Also a module of a package.
            found = there in members
            value = members[there] if found else import_module(f"{module}.{there}")
        except MissingLibraryError:
            raise
        except ModuleNotFoundError as error:
            what = f"{package}.{name} and what uses it"
            raise missing(error, what, error.name or "", "cli") from None
        # Python does not call this function for an attribute that exists.
        setattr(sys.modules[package], name, value)
        return value

    return getattr_, lambda: sorted(places)
