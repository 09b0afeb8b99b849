"""Import the public names of a package when they are first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module

from bipot_rs._lib.optional import MissingLibraryError, missing


def lazily(
    package: str,
    names: Mapping[str, Sequence[str]],
    modules: Mapping[str, str] | None = None,
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Make ``__getattr__`` and ``__dir__`` of a package.

    Parameters
    ----------
    package
        ``__name__`` of the package.
    names
        Names that the package exports, by the absolute name of the module with them.
    modules
        Exported modules: name of the attribute, absolute name of the module.
    """
    places = {name: module for module, exported in names.items() for name in exported}
    whole = dict(modules or {})

    def getattr_(name: str) -> object:
        module = whole.get(name) or places.get(name)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            loaded = import_module(module)
        except MissingLibraryError:
            raise
        except ModuleNotFoundError as error:
            what = f"{package}.{name} and what uses it"
            raise missing(error, what, error.name or "", "cli") from None
        value = loaded if name in whole else getattr(loaded, name)
        # Python does not call this function for an attribute that exists.
        setattr(sys.modules[package], name, value)
        return value

    def dir_() -> list[str]:
        return sorted({*places, *whole})

    return getattr_, dir_
