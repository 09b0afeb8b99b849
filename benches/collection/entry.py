"""`Entry`: a name of the collection, and the function that makes its load path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from collection.load_path import LoadPath


class Entry(NamedTuple):
    """A load path of the collection.

    Attributes
    ----------
    family
        Group in tables and profiles.
    about
        One sentence.
    make
        Function without arguments that makes the arrays.
    """

    family: str
    about: str
    make: Callable[[], LoadPath]


def entries(
    families: Mapping[str, Sequence[Callable[[], LoadPath]]],
) -> dict[str, Entry]:
    """Entries by the names of their functions, whose docstrings say what happens."""
    return {
        make.__name__: Entry(family, make.__doc__ or "", make)
        for family, members in families.items()
        for make in members
    }
