"""`Entry`: a name of the collection, and the function that makes its load path."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from bipot_rs.collection.load_path import LoadPath


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
