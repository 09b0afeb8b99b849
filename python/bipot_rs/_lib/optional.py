"""Error messages that say which extra to install for an optional library."""

from __future__ import annotations

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

    Parameters
    ----------
    error
        As raised by Python. It is returned unchanged if it is about another module, for
        example one that the library itself imports: installing the extra would not help.
    what
        What needs the library, in the plural: ``"finite elements"``.
    library, extra
        Name of the module, and the extra of this package that installs it.
    """
    if error.name is None or error.name.partition(".")[0] != library:
        return error
    return MissingLibraryError(
        f"{what} need {_DISTRIBUTIONS.get(library, library)}, which is not installed: "
        f"run pip install 'bipot-rs[{extra}]'",
        name=error.name,
    )


def load_library(name: str, *, extra: str = "io", need: str = "files") -> ModuleType:
    """Import an optional library; ``need`` says what it is for.

    Raises
    ------
    ModuleNotFoundError
        It is not installed; the message names the extra that installs it.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise missing(error, need, name, extra) from None
