"""What to install for a part of the package that needs more than NumPy and SciPy."""

from __future__ import annotations

# How a library is called where it is installed, if not by the name it is imported by.
_DISTRIBUTIONS = {"skfem": "scikit-fem"}


def missing(
    error: ModuleNotFoundError, what: str, library: str, extra: str
) -> ModuleNotFoundError:
    """The error of an import, in words that say what to install.

    Parameters
    ----------
    error
        As Python raised it. Where it is about another module, one that is lacking
        *inside* of the library, it comes back as it is: installing the extra would not
        help.
    what
        What needs it, in the plural: ``"finite elements"``.
    library, extra
        Name it is imported by, and the extra of this package that brings it.
    """
    if error.name is None or error.name.partition(".")[0] != library:
        return error
    return ModuleNotFoundError(
        f"{what} need {_DISTRIBUTIONS.get(library, library)}, which is not installed: it "
        f"comes with the extra {extra}, as in pip install 'bipot-rs[{extra}]'",
        name=error.name,
    )
